"""Figures 17 and 18 of the paper on localization: what sensors say of the heading, and their errors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from noctule.estimation.sensor_calibration import HeadingErrors, heading_table
from noctule.reports.flight_report import write_files
from noctule.reports.headings import turning
from noctule.reports.style import (
    FORWARD,
    INK,
    LEFT,
    MUTED,
    UP,
    WIDTH_IN,
    encode_png,
    house_style,
    key,
    new_figure,
    time_panels,
)

_COLOURS = {"onboard": LEFT, "depth": FORWARD, "markers": UP}
_MOST_POINTS = 3000  # of a sensor that are drawn


def write_heading_figures(headings: Mapping[str, HeadingErrors], folder: Path) -> list[Path]:
    """Draw both figures into a folder and return their files; raises ReportWriteError."""
    with house_style():
        files = {
            "sensors-flight.png": encode_png(flight_figure(headings)),
            "sensors-heading.png": encode_png(heading_figure(headings)),
        }
    write_files(files, folder, "sensors-flight.png")
    return [folder / name for name in files]


def flight_figure(headings: Mapping[str, HeadingErrors]) -> Figure:
    """Return Fig. 17: headings over the flight, and below each sensor's error before and after."""
    begin = min(float(errors.stamps[0]) for errors in headings.values())
    end = max(float(errors.stamps[-1]) for errors in headings.values())
    figure, axes = time_panels([2.2] + [1.6] * len(headings), (begin, end))
    shown = next(iter(headings.values()))
    for name, errors in headings.items():
        said = errors.reference + errors.before
        axes[0].plot(*turning(errors.stamps, said), color=_COLOURS[name], lw=0.8, alpha=0.8, label=name)
    dashes: Any = (0, (4, 3))
    axes[0].plot(*turning(shown.stamps, shown.reference), color=INK, lw=1.1, ls=dashes, label="reference")
    axes[0].set_ylabel("heading\n[deg]")
    axes[0].set_ylim(0.0, 360.0)
    axes[0].set_yticks(range(0, 361, 90))
    axes[0].set_title("What the sensors say of the heading")
    key(axes[0])
    for axis, (name, errors) in zip(axes[1:], headings.items(), strict=True):
        before, after = np.degrees(errors.before), np.degrees(errors.after)
        axis.plot(errors.stamps, before, color=_COLOURS[name], lw=0.7, alpha=0.45, label="as it is said")
        axis.plot(errors.stamps, after, color=_COLOURS[name], lw=0.7, label="corrected")
        axis.axhline(0.0, color=MUTED, lw=0.8)
        axis.set_ylabel("error\n[deg]")
        axis.set_title(
            f"{name}: {before.mean():+.2f} ± {before.std():.2f} deg, corrected "
            f"{after.mean():+.2f} ± {after.std():.2f} deg"
        )
        key(axis)
    return figure


def heading_figure(headings: Mapping[str, HeadingErrors]) -> Figure:
    """Return the errors over the heading: measurements, Table 3's means and spreads, and what was fitted."""
    figure = new_figure(WIDTH_IN, 3.0 * len(headings) + 0.4)
    axes = figure.subplots(len(headings), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (name, errors) in zip(axes, headings.items(), strict=True):
        _draw_errors(axis, name, errors)
    axes[-1].set_xlabel("heading of the reference [deg]")
    axes[-1].set_xlim(0.0, 360.0)
    axes[-1].set_xticks(range(0, 361, 45))
    return figure


def _draw_errors(axis: Axes, name: str, errors: HeadingErrors) -> None:
    at = np.degrees(np.mod(errors.reference, 2.0 * math.pi))
    some = slice(None, None, max(1, at.size // _MOST_POINTS))
    axis.plot(at[some], np.degrees(errors.before)[some], ".", ms=2, color=_COLOURS[name], alpha=0.35)
    said = np.linspace(0.0, 2.0 * math.pi, 721)
    bias = errors.correction.bias(said)
    # The correction is by the heading that is said; the true one is that much less.
    true = np.degrees(np.mod(said - bias, 2.0 * math.pi))
    order = np.argsort(true)
    axis.plot(
        true[order], np.degrees(bias)[order], color=INK, lw=1.4, label=f"harmonics, order {_order(errors)}"
    )
    rows = heading_table(errors)
    axis.errorbar(
        [math.degrees(row.heading) for row in rows],
        [math.degrees(row.mean) for row in rows],
        [math.degrees(row.sd) for row in rows],
        fmt="o",
        ms=5,
        color=MUTED,
        mec="white",
        capsize=3,
        label="mean ± sd of\na tenth of a turn",
    )
    low, high = np.percentile(np.degrees(errors.before), [0.2, 99.8])
    room = 0.15 * max(float(high - low), 0.5)
    axis.set_ylim(float(low) - room, float(high) + room)
    axis.set_ylabel("error [deg]")
    axis.set_title(f"{name}: what it says too much, by the heading")
    key(axis)


def _order(errors: HeadingErrors) -> int:
    return len(errors.correction.cosines)
