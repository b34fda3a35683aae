"""Figures 11 and 12 of the paper on localization: what the detectors learned, and how long they take."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from noctule.geometry import Array
from noctule.localization.detection.band import SurfaceBand
from noctule.localization.detection.cubics import AreaCubics
from noctule.localization.detection.samples import FlightSamples
from noctule.reports.flight_report import write_files
from noctule.reports.style import (
    FORWARD,
    INK,
    LEFT,
    MUTED,
    UP,
    WIDTH_IN,
    YAW,
    encode_png,
    house_style,
    key,
    new_figure,
)

_COLOURS = (FORWARD, LEFT, UP, YAW, INK)
_WINDOW = 9  # frames of the running median that is drawn through the times


def write_detector_figure(samples: FlightSamples, cubics: AreaCubics, band: SurfaceBand, path: Path) -> Path:
    """Draw `detector_figure` into a PNG and return its path; raises ReportWriteError."""
    with house_style():
        png = encode_png(detector_figure(samples, cubics, band))
    return write_files({path.name: png}, path.parent, path.name)


def write_timing_figure(times_ms: Mapping[str, Array], path: Path) -> Path:
    """Draw `timing_figure` into a PNG and return its path; raises ReportWriteError."""
    with house_style():
        png = encode_png(timing_figure(times_ms))
    return write_files({path.name: png}, path.parent, path.name)


def detector_figure(samples: FlightSamples, cubics: AreaCubics, band: SurfaceBand) -> Figure:
    """Figure 11: area against altitude in the manual flight, the cubics, and the region they accept.

    Beside it the same flight as surface against altitude, with the band.
    """
    figure = new_figure(WIDTH_IN, 3.6)
    left, right = figure.subplots(1, 2)
    dots = {"marker": ".", "ls": "", "ms": 3.0, "color": INK, "alpha": 0.4}
    left.plot(samples.altitude, samples.area, label=f"{len(samples)} frames", **dots)
    _draw_cubics(left, cubics)
    left.set(xlabel="altitude of the surface seen [m]", ylabel="area [px]", title="Area cubics")
    left.set_ylim(0.0, 1.15 * max(samples.area.max(), float(np.max(_curves(cubics)[2]))))
    left.legend(loc="upper left", fontsize=8)
    right.plot(samples.altitude, samples.surface, **dots)
    corner = (band.lowest, band.smallest)
    size = (band.highest - band.lowest, band.largest - band.smallest)
    right.add_patch(Rectangle(corner, *size, fc=UP, alpha=0.18, lw=0, zorder=0))
    right.add_patch(Rectangle(corner, *size, fill=False, ec=UP, lw=1.3, label="accepted"))
    right.set(
        xlabel="altitude of the surface seen [m]",
        ylabel="area x depth$^2$ [m$^2$]",
        title="Band of the surface seen",
    )
    right.set_ylim(0.0, 1.35 * max(float(samples.surface.max()), band.largest))
    right.legend(loc="upper left", fontsize=8)
    width = max(float(np.ptp(samples.altitude)), 0.1)
    for axis in (left, right):
        axis.set_xlim(samples.altitude.min() - 0.08 * width, samples.altitude.max() + 0.08 * width)
    return figure


def _curves(cubics: AreaCubics) -> tuple[Array, Array, Array]:
    z = np.linspace(cubics.lowest, cubics.highest, 200)
    low, high = cubics.limits(z)
    return z, low, high


def _draw_cubics(axis: Axes, cubics: AreaCubics) -> None:
    z, low, high = _curves(cubics)
    axis.fill_between(z, low, high, color=UP, alpha=0.18, lw=0, label="accepted", zorder=0)
    axis.plot(z, high, color=LEFT, label="$g_1$, largest")
    axis.plot(z, low, color=FORWARD, label="$g_2$, smallest")
    # Nothing is extrapolated: the region ends where the flight did.
    for row, limits in ((0, (low[0], high[0])), (-1, (low[-1], high[-1]))):
        axis.plot([z[row]] * 2, limits, color=MUTED, lw=1.0)


def timing_figure(times_ms: Mapping[str, Array]) -> Figure:
    """Figure 12: the time that each method takes for a frame.

    `times_ms` has for each method its times (n,) [ms] in the order of the frames. Dots are frames, lines
    running medians; the axis is logarithmic, as the methods may differ by more than ten times.
    """
    figure = new_figure(WIDTH_IN, 2.8)
    axis = figure.subplots()
    for colour, (name, times) in zip(_COLOURS, times_ms.items(), strict=False):
        frame = np.arange(len(times))
        label = (
            f"{name}\n{np.median(times):.3f} ms median\n{np.mean(times):.3f} $\\pm$ {np.std(times):.3f} ms"
        )
        axis.plot(frame, times, ".", ms=2.0, color=colour, alpha=0.25)
        axis.plot(frame, _running_median(np.asarray(times)), color=colour, lw=1.4, label=label)
    axis.set(xlabel="frame", ylabel="time of a frame [ms]", yscale="log")
    axis.set_xlim(left=0.0)
    key(axis)
    return figure


def _running_median(values: Array) -> Array:
    half = _WINDOW // 2
    return np.array([np.median(values[max(i - half, 0) : i + half + 1]) for i in range(len(values))])
