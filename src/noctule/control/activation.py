"""Tasks that come and go smoothly, each with its own clock."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from noctule.control.hierarchy import TaskRows
from noctule.errors import NoctuleError
from noctule.geometry import Array


class ActivationError(NoctuleError):
    """Durations or time steps that would make an activation jump."""


def check_time_step(dt: float) -> None:
    """Raise ActivationError unless `dt` [s] is finite and not negative."""
    if not (math.isfinite(dt) and dt >= 0.0):
        raise ActivationError(f"time step is {dt:g} s, expected 0 or more; are the stamps in order?")


def check_duration(duration: float) -> None:
    """Raise ActivationError unless `duration` [s] is finite and positive."""
    if not (math.isfinite(duration) and duration > 0.0):
        raise ActivationError(
            f"duration is {duration:g} s, expected more than 0; use a small one for a quick switch"
        )


@dataclass(frozen=True, slots=True)
class Activation:
    """How far a task is active: eq. (20) as a phase u with du/dt = +-1/T and h = (1 - cos(pi u)) / 2.

    Corrected: with "1 - h(t)" the activation jumps when a deactivation interrupts an activation, and
    Algorithm 1 lets all tasks share one t. A phase of one's own does neither.
    """

    duration: float  # [s], T, from off to on
    phase: float = 0.0  # u in [0, 1]

    def __post_init__(self) -> None:
        """Check duration and phase."""
        check_duration(self.duration)
        if not 0.0 <= self.phase <= 1.0:
            raise ActivationError(f"phase is {self.phase:g}, expected 0 to 1; start at 0 (off) or 1 (on)")

    @property
    def h(self) -> float:
        """The activation, 0 to 1; exactly 0 or 1 at the ends."""
        return 0.5 * (1.0 - math.cos(math.pi * self.phase))

    def step(self, on: bool, dt: float) -> Activation:
        """Return the activation `dt` [s] later, moving towards on or off."""
        check_time_step(dt)
        change = dt / self.duration
        return replace(self, phase=min(1.0, self.phase + change) if on else max(0.0, self.phase - change))


@dataclass(frozen=True, slots=True)
class FadingTask:
    """A task that may vanish from sight: it keeps its last rows until its activation has faded to 0."""

    activation: Activation
    J: Array | None = None  # (m, 4), of the last time it was wanted
    demand: Array | None = None  # (m,)

    def step(self, rows: TaskRows | tuple[Array, Array] | None, dt: float) -> FadingTask:
        """Return the task `dt` [s] later: `rows` while it is wanted, None while it is not.

        `rows` is (J, demand) or a `TaskRows`, whose own activation does not count.
        """
        activation = self.activation.step(rows is not None, dt)
        if rows is not None:
            return FadingTask(activation, rows[0], rows[1])
        if activation.phase == 0.0:
            return FadingTask(activation)
        return replace(self, activation=activation)

    @property
    def rows(self) -> tuple[TaskRows, ...]:
        """What to hand to the hierarchy: one entry, or none when the task is off."""
        if self.J is None or self.demand is None:
            return ()
        return (TaskRows(self.J, self.demand, self.activation.h),)
