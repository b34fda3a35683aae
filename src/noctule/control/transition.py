"""Smooth commands where the reference image changes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from noctule.control.activation import ActivationError, check_duration, check_time_step
from noctule.geometry import Array


@dataclass(frozen=True, slots=True)
class Transition:
    """Blends from the last command before a switch to the new law: eqs. (28) and (29).

    h = h_0 + (1 - h_0) (1 - cos(pi t / T)) / 2 and nu = h nu_new + (1 - h) nu_last. Corrected: h nu_new alone
    is not continuous at a switch. With `h_0` above 0 there is a step of h_0 |nu_new - nu_last|; the paper
    needs it to keep moving, this form does not.
    """

    nu_last: Array  # (4,), the last command before the switch
    duration: float  # [s], T
    h_0: float = 0.0
    elapsed: float = 0.0  # [s]

    def __post_init__(self) -> None:
        """Check duration and h_0."""
        check_duration(self.duration)
        if not 0.0 <= self.h_0 <= 1.0:
            raise ActivationError(f"h_0 is {self.h_0:g}, expected 0 to 1; 0 makes the switch continuous")

    @property
    def h(self) -> float:
        """The weight of the new law, h_0 to 1."""
        part = min(1.0, self.elapsed / self.duration)
        return self.h_0 + 0.5 * (1.0 - self.h_0) * (1.0 - math.cos(math.pi * part))

    @property
    def done(self) -> bool:
        """Whether only the new law is left."""
        return self.elapsed >= self.duration

    def step(self, dt: float) -> Transition:
        """Return the transition `dt` [s] later."""
        check_time_step(dt)
        return replace(self, elapsed=self.elapsed + dt)

    def blend(self, nu_new: Array) -> Array:
        """Return the command (4,) for the new law's `nu_new` (4,)."""
        if self.done:
            return nu_new
        h = self.h
        return h * nu_new + (1.0 - h) * self.nu_last
