"""The look that all figures share: colours that colour-blind readers can tell apart, and one way to a PNG."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

# Okabe and Ito's palette. One colour per direction of motion, the same in every figure.
FORWARD, LEFT, UP, YAW = "#0072B2", "#D55E00", "#009E73", "#AA4499"
AXIS_COLOURS = (FORWARD, LEFT, UP, YAW)
INK, MUTED, GRID = "#1f2328", "#6b7280", "#e5e7eb"
AVOIDING = "#00bcd4"  # the cyan of the paper's figures 10 and 15
WARN = "#C1121F"

WIDTH_IN, DPI = 9.0, 150  # 1350 px, readable when a page shows it at 900

_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.labelsize": 10.0,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": "#9ca3af",
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.unicode_minus": False,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "lines.linewidth": 1.5,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "legend.handlelength": 1.6,
    "legend.borderaxespad": 0.0,
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
}


@contextmanager
def house_style() -> Iterator[None]:
    """Draw inside this: a matplotlibrc of the reader's changes nothing, and nothing of ours stays behind."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of `width` x `height` [in] on the Agg canvas, without pyplot."""
    figure = Figure(figsize=(width, height), dpi=DPI)
    FigureCanvasAgg(figure)
    return figure


def time_panels(heights: Sequence[float], spans: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    """Return a figure of stacked panels, `heights` [in], over a time axis from spans[0] to spans[1] [s]."""
    figure = new_figure(WIDTH_IN, sum(heights) + 0.35)
    grid = figure.subplots(
        len(heights), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
    )
    axes = [grid[i, 0] for i in range(len(heights))]
    end = spans[1] if spans[1] > spans[0] else spans[0] + 1.0
    axes[-1].set_xlim(spans[0], end)
    axes[-1].set_xlabel("time [s]")
    figure.align_ylabels(axes)
    return figure, axes


def key(axis: Axes, columns: int = 1) -> None:
    """Put the legend outside on the right, where it hides no line."""
    if axis.get_legend_handles_labels()[0]:  # a flight that saw nothing has nothing to name
        axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), ncols=columns)


def encode_png(figure: Figure) -> bytes:
    """Return the figure as PNG bytes; the same figure always gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()
