"""`noctule experiment loc-1`, `loc-2`, `loc-3`: flown as any mission, told by their own figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from noctule.cli.flights import Asked, Judging, fly_asked

if TYPE_CHECKING:
    from noctule.experiments.loc_flight import LocFlightOptions
    from noctule.flight.mission import Mission

NAMES = ("loc-1", "loc-2", "loc-3")


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure as a person reads it."""

    path: tuple[str, ...]
    label: str
    short: str
    unit: str
    scale: float = 1.0

    def told(self, of: Mapping[str, Any]) -> str:
        """Return its value with the unit; - where it was not measured."""
        value: Any = of
        for step in self.path:
            value = value.get(step) if isinstance(value, Mapping) else None
        if value is None:
            return "-"
        return f"{self.scale * value:.0f}" if not self.unit else f"{self.scale * value:.2f} {self.unit}"


_FIGURES = (
    Figure(("cross_track_mean_m",), "From the path, mean", "path", "mm", 1e3),
    Figure(("cross_track_p95_m",), "From the path, 95 of 100 ticks within", "95 %", "mm", 1e3),
    Figure(("hover_rms_m",), "From the held point, root mean square", "hover", "mm", 1e3),
    Figure(("heading_p95_deg",), "Heading from the wanted one, 95 of 100 ticks within", "heading", "deg"),
    Figure(("recovery_s", "mean"), "Back within 8 cm of a push after, mean", "push", "s"),
    Figure(("recovery_s", "max"), "Back within 8 cm of a push after, at most", "at most", "s"),
    Figure(("position_rms_m",), "Estimate from the truth, root mean square", "estimate", "mm", 1e3),
    Figure(("position_p95_m",), "Estimate from the truth, 95 of 100 ticks within", "95 %", "mm", 1e3),
    Figure(("yaw_mean_deg",), "Estimated yaw less the true one, mean", "yaw", "deg"),
    Figure(("yaw_sd_deg",), "Estimated yaw less the true one, deviation", "yaw sd", "deg"),
    Figure(("slips",), "Times that the estimate was half a turn off", "slips", ""),
    Figure(("lost_s",), "Unseen or in doubt", "lost", "s"),
    Figure(("min_clearance_m",), "Least clearance, surface to surface", "clear", "m"),
)
_IN_A_ROW = ("path", "95 %", "hover", "heading", "at most", "estimate", "yaw sd", "lost")


def fly_loc(
    name: str,
    options: LocFlightOptions,
    seed: int,
    seeds: str | None,
    out: Path | None,
    report: bool,
    json: bool,
) -> int:
    """Fly, judge and tell; 0 if and only if every flight was completed."""
    from noctule.experiments.loc_flight_run import judged, pooled

    judging = Judging(judged, "completed", pooled, loc_text, loc_campaign_text, by_law=False)
    make = partial(mission_of, name, options)
    return fly_asked(Asked(name, make, seed, seeds, out, report, json, judging))


def mission_of(name: str, options: LocFlightOptions, seed: int) -> Mission:
    """Return the mission of a seed: what the workers make."""
    from noctule.experiments.loc_flight import LOC_FLIGHTS

    return LOC_FLIGHTS[name].mission(seed, options)


def loc_text(run: Mapping[str, Any]) -> str:
    """Return the outcome of a flight, why it ended, its figures, and where its recording and report are."""
    lines = [f"outcome: {run['outcome']}", f"reason: {run.get('reason') or 'none given'}", ""]
    width = max(len(figure.label) for figure in _FIGURES)
    lines += [f"  {figure.label:<{width}}  {figure.told(run)}" for figure in _FIGURES]
    doubts = {name: seconds for name, seconds in run.get("doubt_s", {}).items() if seconds}
    said = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in doubts.items())
    lines += [f"  {'In doubt':<{width}}  {said or 'never'}", ""]
    lines += [f"{key}: {run[key]}" for key in ("recording", "report") if run.get(key)]
    return "\n".join(lines)


def loc_campaign_text(results: Mapping[str, Any]) -> str:
    """Return a line per seed, the means and the largest, and why flights were not completed."""
    figures, names = [], list(_IN_A_ROW)
    for figure in _FIGURES:
        if names and figure.short == names[0]:
            figures.append(figure)
            names.pop(0)
    rows = [(str(run["seed"]), run["outcome"], run) for run in results["runs"]]
    rows += [("mean", "", results["summary"]), ("most", "", results["most"])]
    lines = [f"{'seed':>6}  {'outcome':<11}" + "".join(f"  {figure.short:>9}" for figure in figures)]
    for seed, outcome, run in rows:
        lines.append(f"{seed:>6}  {outcome:<11}" + "".join(f"  {figure.told(run):>9}" for figure in figures))
    completed = sum(run["outcome"] == "completed" for run in results["runs"])
    lines += ["", f"outcome: {completed} of {len(results['runs'])} completed"]
    lines += [
        f"seed {run['seed']}: {run['outcome']}: {run.get('reason') or 'no reason given'}"
        for run in results["runs"]
        if run["outcome"] != "completed"
    ]
    return "\n".join(lines)
