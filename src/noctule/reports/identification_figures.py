"""Figures 14 and 15 of the paper on localization: what was sent, what was measured, what the model has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from noctule.estimation.identification import AXES, Validation
from noctule.reports.flight_report import write_files
from noctule.reports.style import (
    AXIS_COLOURS,
    INK,
    MUTED,
    encode_png,
    house_style,
    key,
    time_panels,
)

_UNITS = ("m/s", "m/s", "m/s", "rad/s")
_MODEL: Any = {"color": INK, "lw": 1.1, "ls": (0, (5, 2))}


def write_velocities_figure(flight: Validation, title: str, file: Path) -> Path:
    """Draw `velocities_figure` into the PNG `file` and return it; raises ReportWriteError."""
    with house_style():
        png = encode_png(velocities_figure(flight, title))
    return write_files({file.name: png}, file.parent, file.name)


def velocities_figure(flight: Validation, title: str) -> Figure:
    """Return the figure: each axis over time, its input as a thin line on its own scale.

    An axis that is moved in only a part of the flight is drawn over all of it, so that one sees that it was
    the only one (Fig. 14: one axis after the other; Fig. 15: all at once).
    """
    figure, axes = time_panels([1.55] * 4, (float(flight.stamps[0]), float(flight.stamps[-1])))
    fits = flight.fit
    for a, axis in enumerate(axes):
        colour = AXIS_COLOURS[a]
        axis.plot(flight.stamps, flight.measured[:, a], color=colour, lw=0.9, alpha=0.75, label="measured")
        axis.plot(flight.stamps, flight.simulated[:, a], label="model", **_MODEL)
        name = "yaw rate" if a == 3 else AXES[a]
        axis.set_ylabel(f"{name}\n[{_UNITS[a]}]")
        fit = "not moved" if np.isnan(fits[a]) else f"fit {100.0 * fits[a]:.1f} %"
        axis.set_title(f"{title}: {fit}" if a == 0 else fit)
        _draw_input(axis, flight, a)
        key(axis)
    return figure


def _draw_input(axis: Axes, flight: Validation, a: int) -> None:
    """Draw the input in the same panel, scaled to its height and moved below what was measured."""
    u = flight.inputs[:, a]
    largest = float(np.abs(u).max())
    shown = np.concatenate([flight.measured[:, a], flight.simulated[:, a]])
    low, high = np.nanpercentile(shown, [0.1, 99.9]) if np.isfinite(shown).any() else (-1.0, 1.0)
    tall = max(float(high - low), 1e-3)
    if largest > 0.0:
        scaled = low - 0.45 * tall + 0.3 * tall * u / largest
        label = f"input, at most\n{largest:.2g}"
        axis.step(flight.command_stamps, scaled, where="post", color=MUTED, lw=0.8, label=label)
    axis.set_ylim(low - 0.85 * tall, high + 0.15 * tall)
    ticks = MaxNLocator(4).tick_values(low, high)
    axis.set_yticks([tick for tick in ticks if low - 0.1 * tall <= tick <= high + 0.1 * tall])
