"""A calibration board to print, at its true size."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from numpy.typing import NDArray

from noctule.errors import NoctuleError
from noctule.localization.calibration.board import Board
from noctule.reports.flight_report import write_files
from noctule.reports.style import INK, house_style

_MARGIN, _OF_SQUARE = 0.04, 0.4  # of the page around the board: [m], and at most of a square
_INCH = 0.0254  # [m]
_PNG_DPI = 150
_RULER = 0.1  # [m]


class BoardSheetError(NoctuleError):
    """A file that no board can be drawn into."""


def write_board_sheet(board: Board, file: Path) -> Path:
    """Draw a board into a .pdf or .png file, to be printed at 100 %, and return it.

    Raises
    ------
    BoardSheetError
        When the name ends otherwise.
    ReportWriteError
        When the file cannot be written.
    """
    kind = file.suffix.lower()
    ending = repr(kind) if kind else "nothing"
    if kind not in (".pdf", ".png"):
        raise BoardSheetError(f"board {file}: its name ends in {ending}; expected .pdf or .png")
    buffer = io.BytesIO()
    with house_style():
        figure = board_sheet(board)
        metadata = {"CreationDate": None} if kind == ".pdf" else {"Software": None}
        figure.savefig(buffer, format=kind[1:], dpi=_PNG_DPI, metadata=metadata)
    return write_files({file.name: buffer.getvalue()}, file.parent, file.name)


def board_sheet(board: Board) -> Figure:
    """Return the page: the board at its true size, its axes, and a line to measure."""
    size = board.size + 2.0 * _margin(board)
    figure = Figure(figsize=tuple(size / _INCH))
    FigureCanvasPdf(figure)
    figure.set_layout_engine("none")
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.set_axis_off()
    axis.set_xlim(-_margin(board), board.size[0] + _margin(board))
    axis.set_ylim(-_margin(board), board.size[1] + _margin(board))
    # Cell for cell, so that a printer's driver has nothing to smooth.
    charuco = board.opencv()
    dark = np.add.outer(np.arange(board.rows), np.arange(board.columns)) % 2 == 0
    _cells(axis, np.where(dark, 0, 255).astype(np.uint8), (0.0, board.size[0], 0.0, board.size[1]))
    family = charuco.getDictionary()
    across = int(family.markerSize) + 2
    for number, corners in zip(charuco.getIds().ravel(), charuco.getObjPoints(), strict=True):
        x, y = np.asarray(corners)[:, 0], board.size[1] - np.asarray(corners)[:, 1]
        marker = cv2.aruco.generateImageMarker(family, int(number), across)
        _cells(axis, np.asarray(marker), (x.min(), x.max(), y.min(), y.max()))
    _words(axis, board)
    return figure


def _margin(board: Board) -> float:
    return min(_MARGIN, _OF_SQUARE * board.square)


def _cells(axis: Axes, cells: NDArray[np.uint8], extent: tuple[float, float, float, float]) -> None:
    axis.imshow(
        cells, cmap="gray", vmin=0, vmax=255, extent=extent, interpolation="none", aspect="auto", zorder=1
    )


def _words(axis: Axes, board: Board) -> None:
    """Write outside the board, on white: where its frame is, what it is, and how long a line must be."""
    wide, tall = board.size
    margin = _margin(board)
    size = 350.0 * margin  # [pt]
    arrow = {"arrowstyle": "->", "color": INK, "lw": 1.5}
    middle, long = margin / 2.0, 0.6 * board.square
    axis.plot(-middle / 2, -middle / 2, "o", ms=6, color=INK)
    for tip, name in (((long, -middle / 2), "x"), ((-middle / 2, long), "y")):
        axis.annotate("", tip, (-middle / 2, -middle / 2), arrowprops=arrow)
        axis.text(tip[0] + 0.1 * margin, tip[1] + 0.1 * margin, name, ha="left", va="bottom", fontsize=size)
    length = min(_RULER, wide / 2.0)
    axis.plot([wide - length, wide], [-middle, -middle], color=INK, lw=1.2)
    for x in (wide - length, wide):
        axis.plot([x, x], [-1.2 * middle, -0.8 * middle], color=INK, lw=1.2)
    axis.text(
        wide - length - 0.005, -middle, f"{1000 * length:.0f} mm", ha="right", va="center", fontsize=size
    )  # fmt: skip
    axis.text(
        0.0, tall + middle,
        f"{board.columns}x{board.rows} squares of {1000 * board.square:g} mm, markers "
        f"{1000 * board.marker:g} mm, {board.dictionary}; print at 100 %, glue onto something flat and stiff",
        va="center", fontsize=size,
    )  # fmt: skip
