"""One picture that shows a flight: what the camera saw, where it flew, and what was commanded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from noctule.reports.flight_log import FlightLog, Snapshot
from noctule.reports.flight_report import write_files
from noctule.reports.loading import load_flight_log
from noctule.reports.series import mark_events
from noctule.reports.strip import draw_snapshot, legend_handles
from noctule.reports.style import AXIS_COLOURS, DPI, MUTED, encode_png, house_style, new_figure
from noctule.reports.top_view import draw_top, path_extent

WIDTH, HEIGHT = 1600, 660  # [px]
_MAP_SHAPE = 2.1  # width over height
_CHOICE = 60  # pictures to choose from


def poster(recording: Path, out: Path) -> Path:
    """Write one PNG of 1600 x 660 px to the file `out`: camera, map, velocities; return its path.

    Raises
    ------
    NoctuleError
        As `write_report`.
    """
    out = Path(out)
    with house_style():
        png = encode_png(poster_figure(load_flight_log(recording, pictures=_CHOICE)))
    return write_files({out.name: png}, out.parent, out.name)


def poster_figure(log: FlightLog) -> Figure:
    """Return the picture; what the recording does not hold leaves its place empty."""
    figure = new_figure(WIDTH / DPI, HEIGHT / DPI)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.62, 1.0), height_ratios=(1.12, 1.0))
    view = figure.add_subplot(grid[:, 0])
    snapshot = telling_snapshot(log)
    if snapshot is None:
        view.set_axis_off()
    else:
        draw_snapshot(view, log, snapshot, scale=1.15)
        view.set_title(f"What the camera sees, {snapshot.time:.1f} s after the start")
        marks = view.legend(
            handles=legend_handles(log), loc="upper center", bbox_to_anchor=(0.5, -0.02), ncols=4,
            columnspacing=1.4, handletextpad=0.4,
        )  # fmt: skip
        marks.set_in_layout(False)  # it would make the picture narrower
    _map(figure.add_subplot(grid[0, 1]), log)
    _velocities(figure.add_subplot(grid[1, 1]), log)
    return figure


def telling_snapshot(log: FlightLog) -> Snapshot | None:
    """Return the picture that tells most: points, and columns that are large and near its middle."""

    def worth(snapshot: Snapshot) -> tuple[bool, float]:
        width = snapshot.pixels.shape[1]
        columns = 0.0
        for box in snapshot.columns:
            off = abs((box.left + box.right) / width - 1.0)
            columns += (box.right - box.left) * max(1.0 - 2.0 * off, 0.0)
        return (len(snapshot.points_current) > 0, columns)

    return max(log.snapshots, key=worth, default=None)


def _map(axis: Axes, log: FlightLog) -> None:
    if log.truth is None or len(log.truth.times) < 2:
        axis.set_axis_off()
        return
    low, high = path_extent(log, log.truth, margin=0.35)
    # As wide as the place on the poster, so that the room fills it.
    short = np.maximum((high - low)[::-1] * (_MAP_SHAPE, 1.0 / _MAP_SHAPE) - (high - low), 0.0) / 2.0
    draw_top(axis, log, log.truth, (low - short, high + short))
    axis.set(title="Where it flies, from above", xlabel="", ylabel="", xticks=[], yticks=[])
    for side in axis.spines.values():
        side.set_visible(True)


def _velocities(axis: Axes, log: FlightLog) -> None:
    for i, name in enumerate(("forward", "left", "up")):
        axis.plot(log.times, log.sent[:, i], color=AXIS_COLOURS[i], label=name)
    axis.axhline(0.0, color=MUTED, lw=0.8, zorder=1)
    mark_events([axis], log)
    axis.set(title="What is commanded", xlabel="time [s]", ylabel="[m/s]")
    axis.set_xlim(log.span[0], max(log.span[1], log.span[0] + 1.0))
    low, high = np.nanmin(log.sent[:, :3], initial=0.0), np.nanmax(log.sent[:, :3], initial=0.1)
    axis.set_ylim(low - 0.05, high + 0.35 * (high - low))
    axis.legend(loc="upper left", ncols=3, fontsize=8, columnspacing=0.8, handlelength=1.2)
