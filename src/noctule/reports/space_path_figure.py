"""A path in space as it is to be flown: from above, its height, its speed, and where the nose points."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from noctule.control.paths import PathPlan
from noctule.control.paths.heading import heading_at
from noctule.reports.flight_report import write_files
from noctule.reports.style import (
    FORWARD,
    INK,
    LEFT,
    MUTED,
    UP,
    WARN,
    WIDTH_IN,
    encode_png,
    house_style,
    new_figure,
)

_ARROWS = 24
_TOLD = 4  # stops in words
_MARGIN = 0.25  # [m]


def write_space_path_figure(plan: PathPlan, title: str, file: Path) -> Path:
    """Draw `space_path_figure` into the PNG `file` and return it; raises ReportWriteError."""
    with house_style():
        png = encode_png(space_path_figure(plan, title))
    return write_files({file.name: png}, file.parent, file.name)


def space_path_figure(plan: PathPlan, title: str) -> Figure:
    """Return the figure: the top view to scale, height and speed over the way along the path."""
    figure = new_figure(WIDTH_IN, 4.6)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1.0))
    top = figure.add_subplot(grid[:, 0])
    height = figure.add_subplot(grid[0, 1])
    speed = figure.add_subplot(grid[1, 1], sharex=height)
    _draw_top(top, plan)
    top.set_title(title)
    path = plan.path
    height.plot(path.s, path.position[:, 2], color=UP)
    low, high = float(path.position[:, 2].min()), float(path.position[:, 2].max())
    middle, half = 0.5 * (low + high), max(0.6 * (high - low), 0.25)
    height.set(ylabel="height [m]", ylim=(middle - half, middle + half), title="Height")
    height.tick_params(labelbottom=False)
    _draw_speed(speed, plan)
    return figure


def _draw_top(axis: Axes, plan: PathPlan) -> None:
    path = plan.path
    x, y = path.position[:, 0], path.position[:, 1]
    axis.plot(x, y, color=FORWARD)
    size = 0.06 * max(float(np.ptp(x)), float(np.ptp(y)), 0.5)
    for s in np.linspace(0.0, path.length, _ARROWS, endpoint=not path.closed):
        point = path.at(float(s))
        found = heading_at(plan.heading, point, float(s))
        if found is not None:
            px, py = point.position[:2].tolist()
            tip = (px + 1.6 * size * math.cos(found[0]), py + 1.6 * size * math.sin(found[0]))
            arrow = {"arrowstyle": "-|>", "color": LEFT, "lw": 1.0, "shrinkA": 0.0, "shrinkB": 0.0}
            axis.annotate("", tip, (px, py), arrowprops=arrow)
    px, py = path.start.position[:2].tolist()
    axis.plot(px, py, "o", color=INK, ms=6.0, zorder=4)
    axis.annotate("start", (px, py), (6, 6), textcoords="offset points", zorder=5)
    if not path.closed:
        axis.plot(*path.end.position[:2], "s", color=INK, ms=6.0, zorder=4)
    for stop in plan.placed:
        axis.plot(*path.at(stop.s or 0.0).position[:2], "D", color=WARN, ms=6.0, zorder=4)
    for (px, py), seconds in _stop_labels(plan, size):
        axis.annotate(_joined(seconds), (px, py), (6, -12), textcoords="offset points", color=WARN, zorder=5)
    words = [
        f"{stop.time:g} to {(stop.time or 0.0) + stop.seconds:g} s: stop, wherever it is then"
        for stop in plan.timed[:_TOLD]
    ]
    if len(plan.timed) > _TOLD:
        words.append(f"and {len(plan.timed) - _TOLD} more")
    if words:
        axis.text(0.0, -0.16, "\n".join(words), transform=axis.transAxes, color=WARN, va="top", fontsize=9.0)
    axis.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axis.set_xlim(float(x.min()) - _MARGIN, float(x.max()) + _MARGIN)
    axis.set_ylim(float(y.min()) - _MARGIN, float(y.max()) + _MARGIN)


def _stop_labels(plan: PathPlan, apart: float) -> list[tuple[tuple[float, float], list[float]]]:
    """Return the x, y [m] of the labels of stops at places, and how long [s] each stop there is.

    Those nearer than `apart` [m] to one before share its label: theirs would lie on each other.
    """
    found: list[tuple[tuple[float, float], list[float]]] = []
    for stop in plan.placed:
        px, py = plan.path.at(stop.s or 0.0).position[:2].tolist()
        for (qx, qy), seconds in found:
            if math.hypot(px - qx, py - qy) < apart:
                seconds.append(stop.seconds)
                break
        else:
            found.append(((px, py), [stop.seconds]))
    return found


def _joined(seconds: list[float]) -> str:
    """Return the durations [s] of the stops at a place in words: 2 s + 3 s, or 3 x 2 s."""
    if len(seconds) > 1 and len(set(seconds)) == 1:
        return f"{len(seconds)} \N{MULTIPLICATION SIGN} {seconds[0]:g} s"
    words = " + ".join(f"{v:g} s" for v in seconds[:_TOLD])
    return words if len(seconds) <= _TOLD else f"{words} + {len(seconds) - _TOLD} more"


def _draw_speed(axis: Axes, plan: PathPlan) -> None:
    profile = plan.profile
    axis.plot(profile.s, profile.v, color=FORWARD, label="allowed")
    if plan.speed.cruise > 1.001 * float(profile.v.min()):
        axis.axhline(plan.speed.cruise, color=MUTED, lw=1.0, ls=(0, (4, 3)))
        axis.annotate(
            "cruise", (0.0, plan.speed.cruise), (2, 3), textcoords="offset points", color=MUTED, fontsize=9.0
        )
    for stop in plan.placed:
        axis.axvline(plan.path.within(stop.s or 0.0), color=WARN, lw=1.0)
    axis.set(
        xlabel="along the path [m]",
        ylabel="speed [m/s]",
        xlim=(0.0, plan.path.length),
        ylim=(0.0, 1.25 * max(float(profile.v.max()), plan.speed.cruise)),
        title="Speed, without the stops",
    )
