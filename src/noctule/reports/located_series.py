"""Figures over time of a located flight: where it was, how fast, how far off, and how well it knew it."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from noctule.geometry import Array
from noctule.reports.flight_log import FlightLog
from noctule.reports.headings import LOW, compass, turning
from noctule.reports.landing import draw_landing_over_time, landing_end
from noctule.reports.located_log import LocatedLog
from noctule.reports.located_marks import (
    CAMERA,
    DASHES,
    FUSED,
    TRUE,
    VEHICLE,
    WANTED,
    mark_stops_and_pushes,
    zero,
)
from noctule.reports.style import AXIS_COLOURS, INK, MUTED, key, time_panels

_WORLD = ("x", "y", "z")
_BAND = 3.0  # standard deviations
_BAND_COLOUR = "#56B4E9"
_DOTS: dict[str, Any] = {
    "marker": ".", "ls": "", "ms": 2.5, "color": CAMERA, "alpha": 0.5, "label": "ceiling camera",
}  # fmt: skip
_TRUE_LOOK: dict[str, Any] = {"color": TRUE, "lw": 3.2, "alpha": 0.5, "label": "true"}
_FUSED_LOOK: dict[str, Any] = {"color": FUSED, "lw": 1.3, "label": "fused"}
_WANTED_LOOK: dict[str, Any] = {"color": WANTED, "lw": 1.0, "ls": DASHES, "label": "wanted"}


def pose_figure(log: FlightLog) -> Figure | None:
    """Figures 21, 25 and 29 of the paper: x, y, z and heading as wanted, true, fused and measured."""
    located = log.located
    if located is None:
        return None
    figure, axes = time_panels((1.7, 1.5, 1.5, 1.7), (log.span[0], landing_end(log)))
    for i, axis in enumerate(axes):
        _draw_said(axis, i, located.measured_times, located.measured, _DOTS)
        if located.has_truth:
            _draw_said(axis, i, located.at, located.true, _TRUE_LOOK)
        _draw_said(axis, i, located.at, located.fused, _FUSED_LOOK)
        _draw_said(axis, i, located.at, located.wanted, _WANTED_LOOK)
        if log.landing is not None:
            draw_landing_over_time(axis, log.landing, i)
        axis.set_ylabel("heading\n[deg]" if i == 3 else f"{_WORLD[i]} [m]")
    compass(axes[3])
    axes[0].set_title("Position and heading in the room")
    mark_stops_and_pushes(axes, located)
    key(axes[0])
    return figure


def _draw_said(axis: Axes, column: int, times: Array, rows: Array, look: dict[str, Any]) -> None:
    """Draw x, y or z, or, in the last column, the heading."""
    if column == 3:
        axis.plot(*turning(times, rows[:, 3], LOW), **look)
    else:
        axis.plot(times, rows[:, column], **look)


def speed_figure(log: FlightLog) -> Figure | None:
    """Figures 22, 26 and 30 of the paper: the velocity in the room, fused and true."""
    located, truth = log.located, log.truth
    if located is None:
        return None
    figure, axes = time_panels((1.5, 1.3, 1.3, 1.3), log.span)
    for i, (axis, name) in enumerate(zip(axes, (*_WORLD, "heading"), strict=True)):
        if truth is not None and i < 3 and len(truth.velocity):
            axis.plot(truth.times, truth.velocity[:, i], color=TRUE, lw=3.2, alpha=0.5, label="true")
        axis.plot(located.at, located.velocity[:, i], color=FUSED, lw=1.1, label="fused")
        zero(axis)
        axis.set_ylabel("turn rate\n[rad/s]" if i == 3 else f"{name} [m/s]")
    axes[0].set_title("Velocity in the room")
    mark_stops_and_pushes(axes, located)
    key(axes[0])
    return figure


def control_figure(log: FlightLog) -> Figure | None:
    """Figures 23, 27 and 31 of the paper: cross-track, and position and heading less what was wanted."""
    located = log.located
    if located is None:
        return None
    cross = 1e3 * located.cross_track()
    heights = (1.8, 1.8, 1.5) if np.isfinite(cross).any() else (1.8, 1.5)
    figure, axes = time_panels(heights, log.span)
    off, on = located.off, located.begun
    if len(axes) == 3:
        _draw_cross_track(axes[0], located, cross)
    for i, name in enumerate(_WORLD):
        axes[-2].plot(
            located.at, np.where(on, 1e3 * off[:, i], np.nan), color=AXIS_COLOURS[i], lw=1.1, label=name
        )
    axes[-2].set(ylabel="position [mm]", title=f"Position, {_kind(located)} less wanted")
    axes[-1].plot(located.at, np.where(on, np.degrees(off[:, 3]), np.nan), color=AXIS_COLOURS[3], lw=1.1)
    axes[-1].set(ylabel="heading [deg]", title=f"Heading, {_kind(located)} less wanted")
    for axis in axes[-2:]:
        zero(axis)
    mark_stops_and_pushes(axes, located)
    for axis in axes[:-1]:
        key(axis)
    return figure


def _kind(located: LocatedLog) -> str:
    return "true" if located.has_truth else "fused"


def _draw_cross_track(axis: Axes, located: LocatedLog, cross: Array) -> None:
    counted = cross[located.following]
    counted = counted[np.isfinite(counted)]
    axis.plot(located.at, cross, color=MUTED, lw=1.0, alpha=0.6, label="stops, pushes")
    axis.plot(
        located.at, np.where(located.following, cross, np.nan), color=INK, lw=1.2, label="along the path"
    )
    if counted.size:
        mean, p95 = float(counted.mean()), float(np.percentile(counted, 95.0))
        axis.axhline(mean, color=INK, ls=DASHES, lw=1.0, label=f"mean {mean:.1f} mm")
        axis.axhline(p95, color=INK, ls=":", lw=1.2, label=f"95 %: {p95:.1f} mm")
    axis.set(ylabel="distance [mm]", title=f"Distance from the path, {_kind(located)}")
    axis.set_ylim(bottom=0.0)


def estimate_figure(log: FlightLog) -> Figure | None:
    """Return what the pilot held less what was true, within 3 of its own standard deviations.

    Without a referee: what the camera measured less what the pilot held.
    """
    located = log.located
    if located is None:
        return None
    figure, (position, heading) = time_panels((2.4, 1.8), log.span)
    scaled = (
        (position, 1e3, slice(0, 3), located.position_sd),
        (heading, 180.0 / np.pi, slice(3, 4), located.yaw_sd),
    )
    for axis, scale, columns, sd in scaled:
        band = _BAND * scale * sd
        axis.fill_between(
            located.at, -band, band, color=_BAND_COLOUR, alpha=0.25, lw=0, label="3 sd, as it believed"
        )
        zero(axis)
        for i in range(4)[columns]:
            name = "heading" if i == 3 else _WORLD[i]
            if located.has_truth:
                axis.plot(
                    located.at, scale * located.estimate_off[:, i], color=AXIS_COLOURS[i], lw=1.1, label=name
                )
            else:
                axis.plot(
                    located.measured_times, scale * located.camera_off[:, i], ".", ms=2.5,
                    color=AXIS_COLOURS[i], alpha=0.6, label=name,
                )  # fmt: skip
        _limit(axis, located, band)
    words = "fused less true" if located.has_truth else "camera less fused"
    position.set(ylabel="[mm]", title=f"Position, {words}")
    heading.set(ylabel="[deg]", title=f"Heading, {words}")
    mark_stops_and_pushes([position, heading], located)
    for axis in (position, heading):
        key(axis)
    return figure


def _limit(axis: Axes, located: LocatedLog, band: Array) -> None:
    """Keep the first guess and the time in the dark from hiding all the rest: they leave the picture."""
    known = band[np.isfinite(band)]
    lines = [np.abs(line.get_ydata()) for line in axis.get_lines()[1:]]
    drawn = np.concatenate([np.asarray(line, dtype=np.float64) for line in lines]) if lines else np.empty(0)
    drawn = drawn[np.isfinite(drawn)]
    sizes = [float(np.percentile(v, q)) for v, q in ((known, 95.0), (drawn, 99.5)) if v.size]
    most = 1.3 * max(sizes, default=1.0)
    axis.set_ylim(-most, most)


def heading_figure(log: FlightLog) -> Figure | None:
    """Return the heading as wanted, fused, true and as the vehicle says it, and how far it was off."""
    located = log.located
    if located is None:
        return None
    figure, (top, bottom) = time_panels((2.2, 1.6), log.span)
    if np.isfinite(located.reported_yaw).any():
        said = turning(located.times, located.reported_yaw, LOW)
        top.plot(*said, color=VEHICLE, lw=0.9, alpha=0.8, label="the vehicle's own")
    if located.has_truth:
        _draw_said(top, 3, located.at, located.true, _TRUE_LOOK)
    _draw_said(top, 3, located.at, located.fused, _FUSED_LOOK)
    _draw_said(top, 3, located.at, located.wanted, _WANTED_LOOK)
    compass(top)
    top.set(ylabel="heading [deg]", title="Heading")
    off = np.degrees(np.abs(located.off[:, 3]))
    bottom.plot(located.at, off, color=MUTED, lw=1.0, alpha=0.6)
    counted = off[located.on_path & ~located.disturbed]
    counted = counted[np.isfinite(counted)]
    if counted.size:
        p95 = float(np.percentile(counted, 95.0))
        shown = np.where(located.on_path & ~located.disturbed, off, np.nan)
        bottom.plot(located.at, shown, color=INK, lw=1.2, label="on the path")
        bottom.axhline(p95, color=INK, ls=":", lw=1.2, label=f"95 %: {p95:.2f} deg")
        bottom.set_ylim(0.0, max(1.4 * p95, 1.05 * float(counted.max()), 0.1))
    bottom.set(ylabel="off by [deg]", title=f"How far the heading was off, {_kind(located)} from wanted")
    mark_stops_and_pushes([top, bottom], located)
    for axis in (top, bottom):
        key(axis)
    return figure
