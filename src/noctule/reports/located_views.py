"""The way of a located flight, in space and from above, and how it hovered."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import NDArray

from noctule.geometry import Array
from noctule.reports.flight_log import FlightLog
from noctule.reports.landing import draw_landing_way
from noctule.reports.located_log import LocatedLog
from noctule.reports.located_marks import CAMERA, DASHES, FUSED, PUSH, TRUE, WANTED
from noctule.reports.style import AXIS_COLOURS, INK, MUTED, WARN, WIDTH_IN, new_figure
from noctule.reports.top_view import draw_room

__all__ = ["Axes3D", "hover_figure", "path_figure"]

_PERSON = "#8e5ba6"
_MARGIN = 0.35  # [m]


def path_figure(log: FlightLog) -> Figure | None:
    """Figures 19, 20, 24 and 28 of the paper: the path and what was flown, in space and from above."""
    located = log.located
    if located is None or not np.isfinite(located.fused).any():
        return None
    figure = new_figure(WIDTH_IN, 5.3)
    # What stands beside a drawing in space is not counted by the layout.
    grid = figure.add_gridspec(1, 2, wspace=0.16)
    space = figure.add_subplot(grid[0], projection="3d")
    above = figure.add_subplot(grid[1])
    _draw_space(space, log, located)
    _draw_above(above, log, located)
    handles, labels = above.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, handletextpad=0.6)
    return figure


def _lines(located: LocatedLog) -> list[tuple[Array, dict[str, Any]]]:
    lines: list[tuple[Array, dict[str, Any]]] = [
        (
            located.measured,
            {"marker": ".", "ls": "", "ms": 2.5, "color": CAMERA, "alpha": 0.4, "label": "ceiling camera"},
        )
    ]
    if located.has_truth:
        lines.append((located.true, {"color": TRUE, "lw": 3.2, "alpha": 0.5, "label": "true"}))
    lines.append((located.fused, {"color": FUSED, "lw": 1.2, "label": "fused"}))
    wanted = located.wanted if located.path is None else located.path.position
    lines.append((wanted, {"color": WANTED, "lw": 1.1, "ls": DASHES, "label": "wanted"}))
    return lines


def _draw_space(axis: Any, log: FlightLog, located: LocatedLog) -> None:
    for rows, look in _lines(located):
        axis.plot(rows[:, 0], rows[:, 1], rows[:, 2], **look)
    if log.landing is not None:
        draw_landing_way(axis, log.landing, 3)
    for row in (_first(located.flown), *_held(located)):
        axis.plot(*row[:3], marker="o", ls="", ms=5, color=INK)
    low, high = _extent([rows[:, :3] for rows in _reached(log, located)])
    middle, half = 0.5 * (low + high), 0.5 * float((high - low).max())
    for name, centre in zip("xyz", middle, strict=True):
        getattr(axis, f"set_{name}lim")(centre - half, centre + half)
        getattr(axis, f"set_{name}label")(f"{name} [m]")
    axis.locator_params(nbins=5)
    axis.set_box_aspect((1, 1, 1))
    axis.set_title("In space")


def _draw_above(axis: Axes, log: FlightLog, located: LocatedLog) -> None:
    draw_room(axis, log)
    for walk in located.walks:
        axis.plot(walk[:, 0], walk[:, 1], color=_PERSON, lw=2.0, alpha=0.45, label="a person's way")
    for rows, look in _lines(located):
        axis.plot(rows[:, 0], rows[:, 1], **look)
    if log.landing is not None:
        draw_landing_way(axis, log.landing, 2)
    begin = _first(located.flown)
    axis.plot(*begin[:2], "o", ms=7, color="white", mec=INK, mew=1.6, zorder=6, ls="", label="start")
    stops = np.array(_held(located)).reshape(-1, 4)
    if len(stops):
        axis.plot(*stops[:, :2].T, "D", ms=13, mfc="none", mec=WARN, mew=1.8, zorder=6, ls="", label="stop")
    pushed = [p.time for p in located.pushes if 0.0 <= p.time <= located.times[-1]]
    if pushed:
        rows = located.flown[np.searchsorted(located.times, pushed)]
        axis.plot(
            *rows[:, :2].T, "*", ms=10, color=PUSH, mec="white", mew=0.6, zorder=7, ls="", label="pushed"
        )
    axis.set_aspect("equal", adjustable="box")
    low, high = _extent([*(rows[:, :2] for rows in _reached(log, located)), *located.walks])
    axis.set_xlim(low[0] - _MARGIN, high[0] + _MARGIN)
    axis.set_ylim(low[1] - _MARGIN, high[1] + _MARGIN)
    axis.set(xlabel="x [m]", ylabel="y [m]", title="From above")


def _reached(log: FlightLog, located: LocatedLog) -> list[Array]:
    """Return all poses (n, 4) that are to be seen."""
    landing = [] if log.landing is None else [log.landing.pose]
    return [*(rows for rows, _ in _lines(located)), *landing]


def _first(rows: Array) -> Array:
    known = rows[np.isfinite(rows).all(axis=1)]
    return np.asarray(known[0] if len(known) else np.full(4, np.nan))


def _held(located: LocatedLog) -> list[Array]:
    """Return the points that were held at the stops, (4,) each."""
    return [located.wanted[int(np.searchsorted(located.times, 0.5 * (a + b)))] for a, b in located.stops]


def _extent(rows: list[Array]) -> tuple[Array, Array]:
    """Return the lowest and the highest corner [m] of all rows (n, k) that are known."""
    everything = np.vstack(rows)
    everything = everything[np.isfinite(everything).all(axis=1)]
    return everything.min(axis=0), everything.max(axis=0)


def hover_figure(log: FlightLog) -> Figure | None:
    """Return how it scattered about the points that it held, from two sides; None without stops."""
    located = log.located
    if located is None or not located.stops:
        return None
    off = 1e3 * located.off[:, :3]
    counted = located.hovering & np.isfinite(off).all(axis=1)
    stopped = located.stopped & np.isfinite(off).all(axis=1)
    if not stopped.any():
        return None
    figure = new_figure(WIDTH_IN, 4.3)
    rms = float(np.sqrt(np.mean(np.sum(off[counted] ** 2, axis=1)))) if counted.any() else None
    reach = 1.15 * float(np.max(np.abs(off[counted]))) if counted.any() else 50.0
    reach = max(reach, 1.25 * (rms or 0.0), 5.0)
    views = (("From above", 0, 1, "x", "y"), ("From the side", 0, 2, "x", "z"))
    axes = figure.subplots(1, 2)
    for axis, (title, i, j, right, up) in zip(axes, views, strict=True):
        rest = stopped & ~counted
        axis.plot(off[rest, i], off[rest, j], ".", ms=3, color=MUTED, alpha=0.3, label="settling, pushed")
        _draw_stops(axis, located, off, counted, (i, j))
        if rms is not None:
            axis.add_patch(Circle((0.0, 0.0), rms, fill=False, ec=INK, ls="--", lw=1.2))
            axis.plot([], [], "--", color=INK, lw=1.2, label=f"{rms:.1f} mm rms, in space")
        axis.plot(0.0, 0.0, "+", ms=12, color=INK, mew=1.5)
        axis.set_aspect("equal")
        axis.set(
            xlim=(-reach, reach),
            ylim=(-reach, reach),
            xlabel=f"{right} [mm]",
            ylabel=f"{up} [mm]",
            title=title,
        )
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, markerscale=3.0, handletextpad=0.6)
    return figure


def _draw_stops(
    axis: Axes, located: LocatedLog, off: Array, counted: NDArray[np.bool_], columns: tuple[int, int]
) -> None:
    for k, (a, b) in enumerate(located.stops):
        inside = counted & (located.times >= a) & (located.times <= b)
        if inside.any():
            axis.plot(
                off[inside, columns[0]], off[inside, columns[1]], ".", ms=3, alpha=0.6,
                color=AXIS_COLOURS[k % len(AXIS_COLOURS)], label=f"{a:.0f} to {b:.0f} s",
            )  # fmt: skip
