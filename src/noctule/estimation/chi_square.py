"""Quantiles of the chi-square distribution, and whether a filter knows how wrong it is."""

from __future__ import annotations

import math
from functools import lru_cache
from statistics import NormalDist

import numpy as np

from noctule.estimation.filter_state import YAW, StateEstimate
from noctule.geometry import Array, wrap_angle

_EXACT_UP_TO = 200


def chi_square_cdf(value: float, freedom: int) -> float:
    """Return the probability of a chi-square number of `freedom` degrees at or below `value`."""
    if value <= 0.0:
        return 0.0
    half = 0.5 * value
    if freedom % 2:
        total, k = math.erf(math.sqrt(half)), 1
    else:
        total, k = -math.expm1(-half), 2
    while k < freedom:
        # F(k + 2) = F(k) - half^(k/2) exp(-half) / Gamma(k/2 + 1)
        total -= math.exp(0.5 * k * math.log(half) - half - math.lgamma(0.5 * k + 1.0))
        k += 2
    return max(0.0, total)


@lru_cache(maxsize=256)
def chi_square_quantile(probability: float, freedom: int) -> float:
    """Return the value that a chi-square number of `freedom` degrees stays below with `probability`.

    Exact up to 200 degrees; beyond, the approximation of Wilson and Hilferty, good to 1e-4.
    """
    z, spread = NormalDist().inv_cdf(probability), 2.0 / (9.0 * freedom)
    guess = freedom * max(0.0, 1.0 - spread + z * math.sqrt(spread)) ** 3
    if freedom > _EXACT_UP_TO:
        return guess
    low, high = 0.0, 2.0 * guess + 1.0
    while chi_square_cdf(high, freedom) < probability:
        high *= 2.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        if chi_square_cdf(middle, freedom) < probability:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def nees(estimate: StateEstimate, truth: Array) -> float:
    """Return the normalised estimation error squared, e' P^-1 e, of a true state (n,); the yaw wraps."""
    error = estimate.x - truth
    error[YAW] = wrap_angle(float(error[YAW]))
    return float(error @ np.linalg.solve(estimate.P, error))


def nees_band(samples: int, size: int, probability: float = 0.95) -> tuple[float, float]:
    """Return the interval that the mean NEES per state of independent `samples` has to lie in."""
    tail, freedom = 0.5 * (1.0 - probability), samples * size
    low = chi_square_quantile(tail, freedom) / freedom
    return low, chi_square_quantile(1.0 - tail, freedom) / freedom
