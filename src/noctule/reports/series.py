"""Figures over time: errors, velocities, task errors, clearance, and how long the ticks took."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from noctule.geometry import Array
from noctule.reports.flight_log import FlightLog
from noctule.reports.located_marks import mark_stops_and_pushes
from noctule.reports.style import (
    AVOIDING,
    AXIS_COLOURS,
    FORWARD,
    INK,
    LEFT,
    MUTED,
    UP,
    WARN,
    WIDTH_IN,
    YAW,
    key,
    new_figure,
    time_panels,
)

SAFE_CLEARANCE = 0.10  # [m], what the experiments ask for, surface to surface
_TASK_COLOURS = ("#00838F", "#E69F00", FORWARD, YAW, UP, LEFT)


def avoidance_task(log: FlightLog) -> str | None:
    """Return the name of the task that keeps the drone off obstacles, None if the flight had none."""
    return next((name for name in log.activations if "avoid" in name or "collision" in name), None)


def mark_events(axes: list[Axes], log: FlightLog) -> None:
    """Shade where avoidance is active, dot the switches of the target; the first panel names them."""
    task = avoidance_task(log)
    for axis in axes:
        for start, end in log.active(task) if task else []:
            axis.axvspan(start, end, color=AVOIDING, alpha=0.16, lw=0, zorder=0)
        for t in log.switches:
            axis.axvline(t, color=MUTED, ls=":", lw=1.1, zorder=1)
    if task and log.active(task):
        axes[0].fill_between([], [], color=AVOIDING, alpha=0.16, lw=0, label="avoiding")
    if len(log.switches):
        axes[0].plot([], [], color=MUTED, ls=":", lw=1.1, label="new target image")


def _lines(
    axis: Axes, times: Array, values: Array, labels: tuple[str, ...], colours: tuple[str, ...]
) -> None:
    for column, label, colour in zip(values.T, labels, colours, strict=True):
        axis.plot(times, column, color=colour, label=label)


def _level(axis: Axes, y: float, label: str) -> None:
    """Draw a dashed level across the panel and name it in the legend."""
    axis.axhline(y, color=WARN, ls="--", lw=1.1, zorder=1, label=label)


def errors_figure(log: FlightLog) -> Figure:
    """Figures 9 and 14 of the paper: epsilon [px], the servoing error, the switches of the target image."""
    figure, (top, middle, bottom) = time_panels((1.7, 1.7, 1.7), log.span)
    top.plot(log.times, log.epsilon, color=INK, label=r"$\epsilon$")
    if log.epsilon_limit is not None:
        _level(top, log.epsilon_limit, f"reached: {log.epsilon_limit:g} px")
    top.set(ylabel=r"$\epsilon$ [px]", title="Mean distance of the points to their references")
    top.set_ylim(bottom=0.0)
    colours = (LEFT, UP, FORWARD)
    _lines(middle, log.times, log.errors[:, :3], ("x right", "y down", "z forward"), colours)
    middle.set(ylabel=r"$e_v$ [1]", title="Servoing error, translation (camera axes)")
    _lines(bottom, log.times, log.errors[:, 3:], ("x right", "y down", "z forward"), colours)
    bottom.set(ylabel=r"$e_\omega$ [1]", title="Servoing error, rotation (camera axes)")
    mark_events([top, middle, bottom], log)
    for axis in (top, middle, bottom):
        key(axis)
    return figure


def velocities_figure(log: FlightLog) -> Figure:
    """Figures 10 and 15 of the paper: commands, activations, the step of the command and its limit."""
    # A pilot that is located has no tasks to switch on.
    tasks = bool(log.activations) or log.located is None
    figure, axes = time_panels((2.2, 1.4, 1.4, 1.4) if tasks else (2.2, 1.4, 1.4), log.span)
    linear, yaw, step = axes[0], axes[1], axes[-1]
    names = ("forward", "left", "up", "yaw rate")
    for i, axis in ((0, linear), (1, linear), (2, linear), (3, yaw)):
        axis.plot(log.times, log.sent[:, i], color=AXIS_COLOURS[i], label=names[i])
        axis.plot(log.times, log.asked[:, i], color=AXIS_COLOURS[i], lw=0.9, ls=(0, (4, 2)), alpha=0.75)
    for axis in (linear, yaw):
        axis.plot([], [], color=MUTED, lw=0.9, ls=(0, (4, 2)), label="asked by pilot")
    speeds = log.limits.speeds
    for axis, limits in ((linear, sorted({float(s) for s in speeds[:3]})), (yaw, [float(speeds[3])])):
        for limit in limits:
            for sign in (-1.0, 1.0):
                axis.axhline(sign * limit, color=WARN, ls=":", lw=0.9, zorder=1)
        axis.plot([], [], color=WARN, lw=0.9, ls=":", label="speed limit")
    linear.set(ylabel="velocity [m/s]", title="Command sent (heading frame)")
    yaw.set(ylabel="yaw rate [rad/s]")
    if tasks:
        draw_activations(axes[2], log)
    draw_steps(step, log)
    mark_events(axes, log)
    if log.located is not None:
        mark_stops_and_pushes(axes, log.located)
    for axis in axes:
        key(axis)
    return figure


def draw_activations(axis: Axes, log: FlightLog) -> None:
    """Draw how far each task of the hierarchy is switched on."""
    for i, (name, h) in enumerate(log.activations.items()):
        axis.plot(log.times, h, color=_TASK_COLOURS[i % len(_TASK_COLOURS)], label=name.replace("_", " "))
    axis.set(ylabel="activation h [1]", ylim=(-0.05, 1.08), title="Activation of each task")
    if not log.activations:
        _say(axis, "the recording holds no activations")


def draw_steps(axis: Axes, log: FlightLog) -> None:
    """Draw the change of the command from tick to tick as a share of what the acceleration limits allow."""
    duration = np.concatenate([[np.nan], np.diff(log.times)])
    steps = log.command_steps
    allowed = (log.limits.acceleration, log.limits.yaw_acceleration)
    for i, (label, colour) in enumerate((("linear", FORWARD), ("yaw", YAW))):
        axis.plot(log.times, 100.0 * steps[:, i] / (allowed[i] * duration), color=colour, lw=1.0, label=label)
    _level(axis, 100.0, "acceleration limit")
    axis.set(ylabel="step [% of limit]", title="Step of the command from tick to tick")
    axis.set_ylim(0.0, max(125.0, axis.get_ylim()[1]))


def tasks_figure(log: FlightLog) -> Figure | None:
    """Figures 11 and 16 of the paper: the error of each task; None when the recording holds none."""
    if not log.task_errors:
        return None
    figure, axes = time_panels((1.6,) * len(log.task_errors), log.span)
    for i, (axis, (name, error)) in enumerate(zip(axes, log.task_errors.items(), strict=True)):
        colour = _TASK_COLOURS[i % len(_TASK_COLOURS)]
        # Between its activations a task holds its last error, or measures one that nothing acts on.
        active = np.nan_to_num(log.activations.get(name, np.ones_like(error))) > 0.0
        axis.plot(log.times, error, color=colour, alpha=0.35, lw=1.2, label="while inactive")
        axis.plot(log.times, np.where(active, error, np.nan), color=colour, label="while active")
        axis.set(ylabel="norm of error [1]", title=f"Task: {name.replace('_', ' ')}")
    mark_events(axes, log)
    for axis in axes:
        key(axis)
    return figure


def clearance_figure(log: FlightLog) -> Figure | None:
    """Clearance over time, from the hull's surface to the nearest surface; None without the truth."""
    if log.truth is None:
        return None
    figure, (axis,) = time_panels((2.3,), log.span)
    clearance = np.where(np.isfinite(log.truth.clearance), log.truth.clearance, np.nan)
    axis.plot(log.truth.times, clearance, color=FORWARD, label="clearance")
    axis.axhspan(-10.0, 0.0, color=WARN, alpha=0.12, lw=0, zorder=0)
    top = 1.0
    if np.isfinite(clearance).any():
        nearest = int(np.nanargmin(clearance))
        t, c = float(log.truth.times[nearest]), float(clearance[nearest])
        axis.plot(
            t, c, "o", color=WARN if c < SAFE_CLEARANCE else INK, ms=5, zorder=4, label=f"least: {c:.2f} m"
        )
        top = float(np.nanmax(clearance))
    _level(axis, SAFE_CLEARANCE, f"asked for: {SAFE_CLEARANCE:.2f} m")
    axis.set_ylim(min(-0.05, float(np.nanmin(clearance, initial=0.0)) - 0.05), max(0.3, 1.08 * top))
    axis.set(ylabel="clearance [m]")
    mark_events([axis], log)
    key(axis)
    return figure


def ticks_figure(log: FlightLog) -> Figure | None:
    """Histogram of the time a tick took, picture to command; None when the recording holds none."""
    ticks = log.tick_ms[np.isfinite(log.tick_ms)] if len(log.tick_ms) else log.tick_ms
    if not len(ticks):
        return None
    figure = new_figure(WIDTH_IN, 2.6)
    axis = figure.subplots()
    median, p95 = (float(q) for q in np.percentile(ticks, [50, 95]))
    # Matching and garbage collection make a long thin tail: it is counted in words, not drawn.
    edge = max(1.25 * float(np.percentile(ticks, 99)), 1.1 * p95, 1e-3)
    axis.hist(ticks[ticks <= edge], bins=60, range=(0.0, edge), color=FORWARD, alpha=0.85)
    for value, name, colour in ((median, "median", INK), (p95, "95th percentile", LEFT)):
        axis.axvline(value, color=colour, ls="--", lw=1.3, label=f"{name}: {value:.2f} ms")
    beyond = int(np.count_nonzero(ticks > edge))
    if beyond:
        axis.plot([], [], " ", label=f"{beyond} of {len(ticks)} are longer,\nthe worst {ticks.max():.1f} ms")
    axis.set(xlabel="time of a tick, without rendering [ms]", ylabel="ticks", xlim=(0.0, edge))
    key(axis)
    return figure


def _say(axis: Axes, text: str) -> None:
    axis.text(0.5, 0.5, text, transform=axis.transAxes, ha="center", va="center", color=MUTED)
