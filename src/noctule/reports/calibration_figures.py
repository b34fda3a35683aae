"""Figures of a calibration: where boards were seen and how well they fit, and where the camera hangs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from noctule.camera import PinholeCamera
from noctule.geometry import Array
from noctule.localization.calibration.board import Board
from noctule.localization.calibration.extrinsics import Extrinsics
from noctule.localization.calibration.intrinsics import Intrinsics, coverage
from noctule.reports.flight_report import write_files
from noctule.reports.style import (
    GRID,
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

_ARROW = 22.0  # [px], how long the largest of the usual residuals is drawn
_NICE = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_MOST_BARS = 40


def write_intrinsics_figure(found: Intrinsics, board: Board, limit: float, file: Path) -> Path:
    """Draw intrinsics into the PNG `file` and return it; raises ReportWriteError.

    `limit` [px] is the largest residual that is accepted.
    """
    with house_style():
        png = encode_png(intrinsics_figure(found, board, limit))
    return write_files({file.name: png}, file.parent, file.name)


def write_extrinsics_figure(found: Extrinsics, board: Board, file: Path) -> Path:
    """Draw where the camera hangs into the PNG `file` and return it; raises ReportWriteError."""
    with house_style():
        png = encode_png(extrinsics_figure(found, board))
    return write_files({file.name: png}, file.parent, file.name)


def intrinsics_figure(found: Intrinsics, board: Board, limit: float) -> Figure:
    """Return the figure: residuals over the picture, residuals per picture, and how the board was held."""
    camera = found.camera
    tall = 5.6 * camera.height / camera.width
    figure = new_figure(WIDTH_IN, tall + 3.7)
    parts = figure.subfigures(2, 1, height_ratios=(tall + 0.7, 3.0), squeeze=False)
    above, below = parts[:, 0]
    picture, bars = above.subplots(1, 2, width_ratios=(5.6, 2.6))
    colours = _colours(len(found.used))
    _coverage(picture, found)
    points = [one.view.p for one in found.used]
    _residuals(picture, camera, points, [one.residuals for one in found.used], colours)
    picture.set_title(f"{len(points)} pictures, residual {found.residual:.2f} px rms; red: no corner there")
    _bars(bars, found, limit, colours)
    from_above, from_side = below.subplots(1, 2)
    _boards(from_above, found, board, colours, 0)
    from_above.set(
        xlabel="x [m], to the right", ylabel="depth [m]", title="The boards before the camera, from above"
    )
    _boards(from_side, found, board, colours, 1)
    from_side.set(xlabel="y [m], down", ylabel="depth [m]", title="The same from the side")
    return figure


def extrinsics_figure(found: Extrinsics, board: Board) -> Figure:
    """Return the figure: residuals over the picture, and camera, floor and board from above and beside."""
    camera = found.camera.intrinsics
    figure = new_figure(WIDTH_IN, 4.4)
    picture, above = figure.subplots(1, 2, width_ratios=(5.2, 3.8))
    colours = _colours(len(found.views))
    for k, place in enumerate(found.places):
        outline = found.camera.project(place.to_world(board.outline))
        picture.add_patch(Polygon(outline, fill=False, ec=colours[k], lw=1.0))
    _residuals(picture, camera, [view.p for view in found.views], found.residuals, colours)
    sd = 1000.0 * float(np.linalg.norm(found.sd_position))
    picture.set_title(f"Residual {found.residual:.2f} px rms; camera placed to {sd:.0f} mm")
    _from_above(above, found, board, colours)
    return figure


def _colours(count: int) -> list[str]:
    shades = mpl.colormaps["viridis"](np.linspace(0.0, 0.9, max(count, 2)))
    return [mpl.colors.to_hex(shade) for shade in shades[:count]]


def _coverage(axis: Axes, found: Intrinsics) -> None:
    """Shade the parts of the picture that no corner was in."""
    counts = coverage(found)
    rows, columns = counts.shape
    wide, tall = found.camera.width / columns, found.camera.height / rows
    for row, column in np.argwhere(counts == 0):
        corner = (column * wide - 0.5, row * tall - 0.5)
        axis.add_patch(Rectangle(corner, wide, tall, fc=WARN, ec="white", alpha=0.12, lw=0.8, zorder=0))


def _residuals(
    axis: Axes, camera: PinholeCamera, points: Sequence[Array], off: Sequence[Array], colours: Sequence[str]
) -> None:
    """Draw each corner and, enlarged, how far it was found from where it should be."""
    usual = float(np.percentile(np.hypot(*np.concatenate(off).T), 95.0))
    times = max((n for n in _NICE if n * usual <= _ARROW), default=1)
    for p, residual, colour in zip(points, off, colours, strict=True):
        axis.plot(*p.T, ".", ms=2.5, color=colour)
        axis.quiver(
            *p.T, *(times * residual).T, color=colour, angles="xy", scale_units="xy", scale=1.0, width=0.0022
        )
    axis.set_aspect("equal")
    axis.set_xlim(-0.5, camera.width - 0.5)
    axis.set_ylim(camera.height - 0.5, -0.5)
    axis.grid(visible=False)
    axis.set(xlabel=f"u [px]; arrows: residuals, {times} times enlarged", ylabel="v [px]")


def _bars(axis: Axes, found: Intrinsics, limit: float, colours: Sequence[str]) -> None:
    """Draw the residual of each picture, the worst on top, and how many were left out."""
    order = np.argsort([one.residual for one in found.used])[-_MOST_BARS:]
    names = [found.used[k].view.name for k in order]
    values = [found.used[k].residual for k in order]
    axis.barh(np.arange(len(order)), values, color=[colours[k] for k in order], height=0.7)
    axis.set_yticks(np.arange(len(order)), names, fontsize=7.0)
    axis.set_xlim(0.0, max(1.25 * max(values), 0.1))
    if limit <= axis.get_xlim()[1]:
        axis.axvline(limit, color=WARN, lw=1.0)
    axis.grid(visible=False, axis="y")
    left = f", {len(found.left_out)} left out" if found.left_out else ""
    axis.set(xlabel="residual [px rms]", title=f"Each picture{left}")


def _boards(axis: Axes, found: Intrinsics, board: Board, colours: Sequence[str], across: int) -> None:
    """Draw the boards over depth and one axis of the camera's, 0 (right) or 1 (down), and what it sees."""
    for one, colour in zip(found.used, colours, strict=True):
        corners = one.t_camera_board + board.outline @ one.R_camera_board.T
        axis.add_patch(Polygon(corners[:, [across, 2]], fc=colour, ec=colour, alpha=0.35, lw=1.2))
    axis.autoscale_view()
    far = axis.get_ylim()[1]
    size = (found.camera.width, found.camera.height)[across]
    for border in (-0.5, size - 0.5):
        m = (border - found.camera.centre[across]) / found.camera.focal[across]
        axis.plot([0.0, m * far], [0.0, far], color=INK, lw=0.9)
    axis.set_ylim(0.0, far)
    axis.set_aspect("equal")


def _from_above(axis: Axes, found: Extrinsics, board: Board, colours: Sequence[str]) -> None:
    """Draw what the camera sees of the floor, the camera, the boards and the world's axes."""
    seen = _footprint(found)
    if seen is not None:
        axis.add_patch(Polygon(seen, fc=GRID, ec=MUTED, lw=1.0, zorder=1))
    for place, colour in zip(found.places, colours, strict=True):
        outline = place.to_world(board.outline)[:, :2]
        axis.add_patch(Polygon(outline, fc=colour, ec=INK, alpha=0.5, lw=0.8, zorder=2))
        axis.plot(*outline[0], "o", ms=4, color=INK, zorder=3)
    at = found.camera.t_world_camera
    axis.plot(*at[:2], "s", ms=8, color="white", mec=INK, mew=1.6, zorder=4)
    axis.annotate(
        f"camera, {at[2]:.3f} m up",
        (float(at[0]), float(at[1])),
        (0, 10),
        textcoords="offset points",
        ha="center",
        fontsize=9.0,
        zorder=5,
    )
    for direction, colour, name in (((0.5, 0.0), LEFT, "x"), ((0.0, 0.5), UP, "y")):
        axis.annotate(
            "", direction, (0.0, 0.0), arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.6}, zorder=4
        )
        axis.text(
            1.2 * direction[0], 1.2 * direction[1], name, color=colour, ha="center", va="center", zorder=5
        )
    axis.autoscale_view()
    axis.margins(0.06)
    axis.set_aspect("equal")
    axis.set(xlabel="x [m], world", ylabel="y [m], world")
    axis.set_title("The floor it sees, from above")


def _footprint(found: Extrinsics) -> Array | None:
    """Return where the picture's corners meet the floor, (4, 2) [m]; None where one is above the horizon."""
    camera = found.camera.intrinsics
    right, bottom = camera.width - 0.5, camera.height - 0.5
    p = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    rays = found.camera.to_world(p, np.ones(4)) - found.camera.t_world_camera
    if (rays[:, 2] > -0.05).any():
        return None
    scale = -found.camera.t_world_camera[2] / rays[:, 2]
    return np.asarray((found.camera.t_world_camera + scale[:, None] * rays)[:, :2])
