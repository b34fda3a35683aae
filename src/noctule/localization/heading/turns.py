"""Headings that are known up to a part of a turn."""

from __future__ import annotations

import numpy as np

from noctule.geometry import Array

HALF_TURN = float(np.pi)
QUARTER_TURN = float(np.pi / 2.0)
FULL_TURN = float(2.0 * np.pi)


def nearest_turn(measured: float, predicted: float, period: float) -> float:
    """Return the angle nearest to `predicted` that equals `measured` up to multiples of `period` [rad].

    Algorithm 1 of Santos et al., corrected: with a period of half a turn,
    psi = m + pi round((psi_pred - m) / pi). As printed it jumps by 358 deg. The answer is not wrapped: along
    a sequence of predictions it stays continuous through any number of turns.
    """
    return measured + period * round((predicted - measured) / period)


def mean_and_variance(angles: Array, period: float) -> tuple[float, float]:
    """Return the mean of angles (n,) known up to `period` [rad], in half a period around 0, and the variance.

    The mean is the circular one; the variance [rad^2] is that of the deviations from it, each taken the
    short way round.
    """
    order = FULL_TURN / period
    mean = float(np.angle(np.mean(np.exp(1j * order * np.asarray(angles)))) / order)
    deviations = np.array([nearest_turn(float(a) - mean, 0.0, period) for a in angles])
    return mean, float(np.mean(deviations**2))
