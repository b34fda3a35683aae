"""Gains that grow as the error goes to zero."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from noctule.errors import NoctuleError
from noctule.geometry import Array


class GainError(NoctuleError):
    """Gains with which no law is stable."""


@dataclass(frozen=True, slots=True)
class AdaptiveGain:
    """Eq. (4) of Toro-Arcila et al.: a gain that falls from `at_zero` to `at_infinity` as |e| grows.

    Corrected: with `slope` positive the derivative at |e| = 0 is -slope, not +slope as the text has it. With
    `at_zero` below `at_infinity` the printed exponential grows without bound, so that is refused. Equal ends
    make a constant gain.
    """

    at_zero: float  # [1/s], lambda_0
    at_infinity: float  # [1/s], lambda_inf
    slope: float  # [1/s per unit of error], lambda'_0

    def __post_init__(self) -> None:
        """Refuse what would diverge."""
        if not (math.isfinite(self.at_zero) and 0.0 < self.at_infinity <= self.at_zero):
            raise GainError(
                f"adaptive gain: at_zero is {self.at_zero:g} and at_infinity {self.at_infinity:g}, "
                "expected 0 < at_infinity <= at_zero; raise at_zero or lower at_infinity"
            )
        if not (math.isfinite(self.slope) and self.slope >= 0.0):
            raise GainError(f"adaptive gain: slope is {self.slope:g}, expected 0 or more; drop its sign")

    def __call__(self, error: Array) -> float:
        """Return lambda(|e|) [1/s] for an error vector of any length."""
        fall = self.at_zero - self.at_infinity
        if fall == 0.0:
            return self.at_infinity
        return float(fall * np.exp(-self.slope / fall * np.linalg.norm(error)) + self.at_infinity)


def gain_vector(gain: float, lateral_extra: float = 0.0, angular_scale: float = 1.0) -> Array:
    """Return the diagonal of Lambda in camera axes, (6,) [1/s]: (v_x, v_y, v_z, w_x, w_y, w_z).

    Section 5 of the paper adds a constant to "lambda_vy" and halves the angular gains. Corrected reading: its
    y is the body's lateral axis, which is x of the camera; with the vertical reading avoidance works no
    better than none.
    """
    return np.array([gain + lateral_extra, gain, gain, *(3 * [angular_scale * gain])])
