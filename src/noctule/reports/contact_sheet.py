"""The contact sheet of a path: its key images in order, and how well each hangs together with the next."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from noctule.flight.feature_cache import FEWEST_SHARED
from noctule.pilots.visual_path import VisualPath
from noctule.reports.flight_report import write_files
from noctule.reports.style import (
    DPI,
    FORWARD,
    GRID,
    INK,
    MUTED,
    WARN,
    WIDTH_IN,
    encode_png,
    house_style,
    new_figure,
)
from noctule.vision.links import LinkQuality

_GAP, _FOOT, _HEAD = 0.10, 0.46, 0.42  # [in]
_FULL = 100  # shared points that fill a bar, where no link has more
_OUTLINE = [patheffects.withStroke(linewidth=2.2, foreground="black")]


def weakest_link(links: Sequence[LinkQuality]) -> int | None:
    """Return the index of the link that shares the fewest points, the first of equals; None without links."""
    return min(range(len(links)), key=lambda k: links[k].shared, default=None)


def write_contact_sheet(
    path: VisualPath, links: Sequence[LinkQuality], title: str, file: Path, faulty: Sequence[int] = ()
) -> Path:
    """Draw the contact sheet of a path into the PNG `file` and return it.

    Raises
    ------
    ReportWriteError
        When the file cannot be written.
    """
    with house_style():
        png = encode_png(contact_sheet(path, links, title, faulty))
    return write_files({file.name: png}, file.parent, file.name)


def contact_sheet(
    path: VisualPath, links: Sequence[LinkQuality], title: str, faulty: Sequence[int] = ()
) -> Figure:
    """Return the figure: every key image with its number, and below it what it shares with the next.

    The weakest link is marked, and each of the links `faulty` (their indices) that cannot be flown.
    """
    count = len(path.images)
    columns = 2 if count == 4 else min(count, 3 if count <= 9 else 4 if count <= 20 else 6)
    rows = -(-count // columns)
    each = (WIDTH_IN - _GAP * (columns + 1)) / columns
    tall = each * path.camera.height / path.camera.width
    total = _HEAD + rows * (tall + _FOOT)
    figure = new_figure(WIDTH_IN, total)
    figure.set_layout_engine("none")
    figure.text(_GAP / WIDTH_IN, 1 - 0.5 * _HEAD / total, title, va="center", fontweight="bold", fontsize=11)
    weakest, full = weakest_link(links), max([_FULL, *(link.shared for link in links)])
    for k, image in enumerate(path.images):
        row, column = divmod(k, columns)
        x, top = _GAP + column * (each + _GAP), total - _HEAD - row * (tall + _FOOT)
        axis = figure.add_axes((x / WIDTH_IN, (top - tall) / total, each / WIDTH_IN, tall / total))
        _picture(axis, image.pixels, k, int(each * DPI))
        if k < len(links):
            below = figure.add_axes(
                (x / WIDTH_IN, (top - tall - 0.34) / total, each / WIDTH_IN, 0.28 / total)
            )
            _bar(below, links[k], k, full, k == weakest, k in faulty)
    return figure


def _picture(axis: Axes, pixels: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], k: int, wide: int) -> None:
    size = (wide, round(wide * pixels.shape[0] / pixels.shape[1]))
    axis.imshow(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA))
    axis.set_axis_off()
    axis.text(
        0.03, 0.94, str(k), transform=axis.transAxes, va="top", color="white", fontsize=12, fontweight="bold",
        path_effects=_OUTLINE,
    )  # fmt: skip


def _bar(axis: Axes, link: LinkQuality, k: int, full: int, weakest: bool, faulty: bool) -> None:
    """Draw the number of shared points as a bar; the tick in it is the fewest that can be flown."""
    axis.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    axis.set_axis_off()
    colour = WARN if weakest or faulty else FORWARD
    axis.add_patch(Rectangle((0.0, 0.68), 1.0, 0.3, color=GRID, lw=0))
    axis.add_patch(Rectangle((0.0, 0.68), link.shared / full, 0.3, color=colour, lw=0))
    axis.plot([FEWEST_SHARED / full] * 2, [0.6, 1.0], color=INK, lw=1.0)
    mark = "refused" if faulty else "weakest" if weakest else ""
    # Short where it is bold: six fit beside each other.
    words = f"to {k + 1}: {link.shared}, {mark}" if mark else f"to {k + 1}: {link.shared} points"
    axis.text(
        0.0, 0.5, words, va="top", fontsize=8, color=colour if mark else MUTED,
        fontweight="bold" if mark else "normal",
    )  # fmt: skip
