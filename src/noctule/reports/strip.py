"""The camera's side of the flight: pictures with what the pilot saw in them."""

from __future__ import annotations

from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from noctule.reports.flight_log import FlightLog, Snapshot
from noctule.reports.style import INK, WIDTH_IN, new_figure

# The paper's colours; the shapes differ too, for readers who cannot tell red from green.
CURRENT, REFERENCE, COLUMN, SAFETY = "#ff3b30", "#34e07a", "#ffe14d", "#ffffff"
_PAPER = "#111417"
_OUTLINE = [patheffects.withStroke(linewidth=2.6, foreground="black", alpha=0.75)]
_TEXT_OUTLINE = [patheffects.withStroke(linewidth=2.0, foreground="black")]


def draw_snapshot(axis: Axes, log: FlightLog, snapshot: Snapshot, scale: float = 1.0) -> None:
    """Draw a picture with points, references, columns and safety area; `scale` sizes the marks."""
    height, width = snapshot.pixels.shape[:2]
    axis.imshow(snapshot.pixels, interpolation="antialiased")
    if log.safety_area is not None:
        left, top, right, bottom = log.safety_area
        frame = Rectangle((left, top), right - left, bottom - top, fill=False, ec=SAFETY, ls="--", alpha=0.8)
        frame.set_linewidth(1.0 * scale)
        axis.add_patch(frame)
    for box in snapshot.columns:
        axis.add_patch(
            Rectangle(
                (box.left, box.top), box.right - box.left, box.bottom - box.top, fill=False, ec=COLUMN,
                lw=1.8 * scale, path_effects=_OUTLINE,
            )
        )  # fmt: skip
    now, ref = snapshot.points_current, snapshot.points_ref
    if len(now) == len(ref):
        for a, b in zip(now, ref, strict=True):
            axis.plot((a[0], b[0]), (a[1], b[1]), color="white", lw=0.6 * scale, alpha=0.55)
    if len(ref):
        size, edge = 5.0 * scale, 1.3 * scale
        axis.plot(*ref.T, "o", mfc="none", mec=REFERENCE, ms=size, mew=edge, path_effects=_OUTLINE)
    if len(now):
        size, edge = 4.6 * scale, 1.5 * scale
        axis.plot(*now.T, "x", color=CURRENT, ms=size, mew=edge, path_effects=_OUTLINE)
    axis.set_xlim(-0.5, width - 0.5)
    axis.set_ylim(height - 0.5, -0.5)
    axis.set_axis_off()


def _caption(axis: Axes, log: FlightLog, snapshot: Snapshot) -> None:
    images = max(len(log.key_poses), int(log.target_index.max(initial=0)) + 1)
    left = f"{snapshot.time:.1f} s   {snapshot.phase.replace('_', ' ')}"
    right = f"image {snapshot.target_index + 1} of {images}"
    for x, text, side in ((0.02, left, "left"), (0.98, right, "right")):
        axis.text(
            x, 0.965, text, transform=axis.transAxes, ha=side, va="top", color="white", fontsize=9,
            fontweight="bold", path_effects=_TEXT_OUTLINE,
        )  # fmt: skip


def strip_figure(log: FlightLog) -> Figure | None:
    """Figures 7 and 13 of the paper, the camera's column: pictures over the flight; None without any."""
    if not log.snapshots:
        return None
    columns = 2 if len(log.snapshots) > 1 else 1
    rows = -(-len(log.snapshots) // columns)
    height, width = log.snapshots[0].pixels.shape[:2]
    gap, foot = 0.06, 0.30
    each = (WIDTH_IN - gap * (columns + 1)) / columns
    tall = each * height / width
    total = rows * (tall + gap) + gap + foot
    figure = new_figure(WIDTH_IN, total)
    figure.set_layout_engine("none")
    figure.set_facecolor(_PAPER)
    for i, snapshot in enumerate(log.snapshots):
        row, column = divmod(i, columns)
        x, y = gap + column * (each + gap), total - (row + 1) * (tall + gap)
        axis = figure.add_axes((x / WIDTH_IN, y / total, each / WIDTH_IN, tall / total))
        draw_snapshot(axis, log, snapshot)
        _caption(axis, log, snapshot)
    _legend(figure, log, total, foot)
    return figure


def legend_handles(log: FlightLog, line: str = INK) -> list[Line2D]:
    """Return what the marks mean; `line` shows the safety area, white on pictures, on the legend's ground."""
    marks = [
        Line2D([], [], ls="", marker="x", color=CURRENT, mew=1.6, label="points tracked"),
        Line2D(
            [],
            [],
            ls="",
            marker="o",
            mfc="none",
            mec=REFERENCE,
            mew=1.6,
            label="where the key image has them",
        ),
        Line2D([], [], ls="", marker="s", mfc="none", mec=COLUMN, mew=1.8, label="column seen"),
    ]
    if log.safety_area is not None:
        marks.append(Line2D([], [], ls="--", color=line, label="safety area"))
    return marks


def _legend(figure: Figure, log: FlightLog, total: float, foot: float) -> None:
    axis = figure.add_axes((0.0, 0.0, 1.0, foot / total))
    axis.set_axis_off()
    axis.legend(
        handles=legend_handles(log, SAFETY), loc="center", ncols=4, labelcolor="white", columnspacing=2.2
    )
