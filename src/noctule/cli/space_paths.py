"""`noctule path show` on a path file: what is flown, in words and as a figure."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from noctule.cli.show import as_json
from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.control.paths import PathPlan, Stop


class NoPathError(NoctuleError):
    """A file that holds no path."""


def show_space_path(file: Path, out: Path | None, json: bool) -> int:
    """Draw the path of a path file or a mission and print its figures; 0 when it can be flown."""
    from noctule.reports.space_path_figure import write_space_path_figure

    plan = _plan_of(file)
    picture = write_space_path_figure(plan, file.name, out or file.with_suffix(".png"))
    figures = figures_of(plan)
    if json:
        print(as_json({"path": file, **figures, "figure": picture}))
    else:
        print("\n".join([f"path {file}: {in_words(figures)}", *stop_lines(plan), f"figure: {picture}"]))
    return 0


def _plan_of(file: Path) -> PathPlan:
    """Return what a file says is to be flown in space. Raises NoPathError, and what reading it raises."""
    from noctule.flight import load_mission
    from noctule.flight.space_path_file import read_space_path

    if file.suffix.lower() not in (".csv", ".toml"):
        raise NoPathError(
            f"path {file}: a file of another kind; expected a folder of key images, waypoints (.csv), a path "
            "file or a mission (.toml)"
        )
    if not _is_mission(file):
        return read_space_path(file)
    mission = load_mission(file)
    if mission.space_path is None:
        raise NoPathError(f"path {file}: a mission without a path in space; show its path's folder instead")
    return mission.space_plan(str(file))


def _is_mission(file: Path) -> bool:
    try:
        keys = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):  # whoever reads it says what is wrong
        return False
    return "space_path" in keys or "path" in keys


def figures_of(plan: PathPlan) -> dict[str, Any]:
    """Return length, speeds, curvature, heights and stops of a plan."""
    import numpy as np

    path, speeds = plan.path, plan.profile.v
    bend = np.linalg.norm(path.curvature, axis=1)
    at = int(bend.argmax())
    heights = path.position[:, 2]
    steps, means = np.diff(path.s), 0.5 * (speeds[:-1] + speeds[1:])
    return {
        "length_m": path.length,
        "closed": path.closed,
        "laps": plan.laps,
        "lap_s": float((steps / means).sum()),
        "speed_mps": [float(speeds.min()), float(speeds.max())],
        "height_m": [float(heights.min()), float(heights.max())],
        "smallest_radius_m": 1.0 / float(bend[at]) if bend[at] > 1e-9 else math.inf,
        "smallest_radius_at_m": float(path.s[at]),
        "stops": len(plan.placed) + len(plan.timed),
        "stop_list": [_stop_figures(stop) for stop in (*plan.placed, *plan.timed)],
    }


def _stop_figures(stop: Stop) -> dict[str, Any]:
    return {
        "s_m": stop.s,
        "time_s": stop.time,
        "seconds": stop.seconds,
        "turn_deg": None if stop.yaw is None else math.degrees(stop.yaw),
        "turn_after_s": None if stop.yaw is None else stop.turn_after,
        "keep_yaw": stop.keep_yaw,
    }


def stop_lines(plan: PathPlan) -> list[str]:
    """Return a line per stop: those at a place in their order, then those at a time."""
    lines = []
    for stop in (*plan.placed, *plan.timed):
        where = f"at {stop.time:g} s" if stop.s is None else f"at {plan.path.place(stop.s)}"
        words = [f"stop {where}: {stop.seconds:g} s"]
        if stop.yaw is not None:
            after = f" after {stop.turn_after:g} s" if stop.turn_after > 0.0 else ""
            words.append(f"turns to {math.degrees(stop.yaw):.0f}\N{DEGREE SIGN}{after}")
        if not stop.keep_yaw:
            words.append("then by the rule again")
        lines.append(", ".join(words))
    return lines


def in_words(figures: dict[str, Any]) -> str:
    """Return the figures as one line."""
    slow, fast = figures["speed_mps"]
    low, high = figures["height_m"]
    laps = figures["laps"]
    kind = "one way"
    if figures["closed"]:
        kind = "closed, without end" if laps is None else f"closed, {laps} lap{'s' if laps > 1 else ''}"
    words = [
        f"{figures['length_m']:.2f} m ({kind})",
        f"{slow:.2f} to {fast:.2f} m/s" if fast - slow > 0.005 else f"{fast:.2f} m/s",
        f"height {low:.2f} to {high:.2f} m",
    ]
    if math.isfinite(figures["smallest_radius_m"]):
        radius, at = figures["smallest_radius_m"], figures["smallest_radius_at_m"]
        words.append(f"smallest radius {radius:.2f} m at s = {at:.2f} m")
    words.append(f"{figures['stops']} stop{'' if figures['stops'] == 1 else 's'}")
    return ", ".join(words)
