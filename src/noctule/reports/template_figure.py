"""The learned top view of the drone, with the axes of its body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from noctule.geometry import Array
from noctule.localization.template import Template
from noctule.reports.flight_report import write_files
from noctule.reports.style import INK, MUTED, UP, WARN, encode_png, house_style, new_figure

_MARGIN = 0.06  # [m], around the drone


def write_template_figure(template: Template, path: Path) -> Path:
    """Draw `template_figure` into a PNG and return its path; raises ReportWriteError."""
    with house_style():
        png = encode_png(template_figure(template))
    return write_files({path.name: png}, path.parent, path.name)


def template_figure(template: Template) -> Figure:
    """Draw how probable it is that a cell is drone, and how high its surface lies; the nose points up."""
    figure = new_figure(8.2, 4.1)
    left, right = figure.subplots(1, 2, sharey=True)
    known = np.where(template.weight > 0.0, template.probability, np.nan)
    _map(figure, left, template, known, "Greys", (0.0, 1.0), "drone [probability]")
    left.set_title(f"Top view, learned from {template.frames} frames")
    left.set_ylabel("x, ahead [cm]")
    solid = np.where(template.probability > 0.3, 1000.0 * template.height, np.nan)
    shown = solid[np.isfinite(solid)]
    span = tuple(float(q) for q in np.quantile(shown, [0.02, 0.98])) if len(shown) else (0.0, 1.0)
    _map(figure, right, template, solid, "viridis", (span[0], span[1]), "over the origin [mm]")
    right.set_title("Height of the surface seen")
    return figure


def _map(
    figure: Figure,
    axis: Axes,
    template: Template,
    values: Array,
    colours: str,
    limits: tuple[float, float],
    label: str,
) -> None:
    # Columns of the picture run to the right, and y of the body to the left.
    half = 50.0 * template.grid.cell * template.grid.n
    picture = axis.imshow(
        values[:, ::-1], origin="lower", extent=(half, -half, -half, half), cmap=colours,
        vmin=limits[0], vmax=limits[1], interpolation="nearest",
    )  # fmt: skip
    reach = 100.0 * (template.extent + _MARGIN)
    axis.set(xlim=(reach, -reach), ylim=(-reach, reach), xlabel="y, to the left [cm]")
    axis.grid(visible=False)
    for name, tip, colour in (("x", (0.0, 10.0), WARN), ("y", (10.0, 0.0), UP)):
        axis.annotate("", tip, (0.0, 0.0), arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2.0})
        axis.text(
            1.25 * tip[0], 1.25 * tip[1], name, color=colour, ha="center", va="center", weight="bold",
            path_effects=[patheffects.withStroke(linewidth=2.5, foreground="white")],
        )  # fmt: skip
    axis.plot(0.0, 0.0, "o", color=INK, ms=4.0)
    axis.text(0.5, 0.97, "nose", transform=axis.transAxes, ha="center", va="top", color=MUTED)
    figure.colorbar(picture, ax=axis, label=label, shrink=0.85)
