"""The noise of what was measured, and measurements made white by it.

Velocities have white noise. Of a vehicle that says its heading only, rates are differences between two
reports: noise of the heading is in both neighbours, with opposite signs, and noise of the rate (gusts, a
heading that a gyro adds up) adds up in the heading. Which of them it is the residuals tell. With the noise
of the heading alone, whitened differences are the output error on the heading itself, its beginning unknown.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from noctule.compiled import compiled
from noctule.estimation.identification.flights import AxisFlight, Flight, axes_of, channels
from noctule.geometry import Array

FINEST = 1e-6  # of the largest velocity: no sensor is taken for better
_LEAST = 1e-12
_RATIOS = np.concatenate([[0.0], 10.0 ** np.arange(-2.0, 8.5, 0.5), [math.inf]])
"""Variance of the heading's noise against that of the rate's within a report, where searches look first."""
_NARROWINGS = 25
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@dataclass(frozen=True, slots=True)
class Noise:
    """The noise of one measured axis of a flight."""

    sd: float  # [m/s, rad/s] of each velocity; of means by `heading` see `whitened`
    heading: float = 0.0  # 0 to 1, of means: the share that is the heading's own noise

    @classmethod
    def of_heading(cls, sd: float, flight: AxisFlight) -> Noise:
        """Return that of means between headings with white noise of `sd` [rad]."""
        return cls(sd / float(np.mean(np.diff(flight.stamps))), 1.0)


def whitened(flights: Sequence[Flight], noises: Sequence[Noise], rows: Array) -> Array:
    """Return `rows` (all, p), what belongs to each measurement of `flights`, in units of white noise.

    `noises` are those of each flight's axes. The covariance of means, times their time against its mean, is
    sd^2 ((1 - heading) diag(time) + heading (2 on the diagonal, -1 beside it)).
    """
    found = np.empty(rows.shape)
    at, noise = 0, iter(noises)
    for flight in flights:
        for row in channels(flight):
            part, own = slice(at, at + row.size), next(noise)
            at += row.size
            if isinstance(flight, AxisFlight) and flight.means:
                steps = _steps(flight)
                found[part] = _decorrelated(steps, own.heading, rows[part] * steps[:, None])[0] / own.sd
            else:
                found[part] = rows[part] / own.sd
    return found


def noises_of(flight: Flight, residuals: Array, fitted: float) -> list[Noise]:
    """Return the noise of each axis of a flight from `residuals` (axes, n), `fitted` parameters taken off."""
    found = []
    for row, velocity in zip(residuals, channels(flight), strict=True):
        # Noise-free data leave nothing but rounding: all axes then weigh the same, and one that alone is free
        # of noise does not drown the others.
        least = max(FINEST * float(np.abs(velocity).max()), _LEAST)
        freedom = max(1.0, row.size - fitted)
        sd, heading = math.sqrt(float(row @ row) / freedom), 0.0
        if sd > least and isinstance(flight, AxisFlight) and flight.means:
            steps = _steps(flight)
            heading = _heading_share(steps, row * steps)
            white = _decorrelated(steps, heading, (row * steps)[:, None])[0]
            sd = math.sqrt(float(np.sum(white**2)) / freedom)
        found.append(Noise(max(sd, least), heading))
    return found


def unit_noises(flight: Flight) -> list[Noise]:
    """Return noises of 1: what is taken before anything is known."""
    return [Noise(1.0) for _ in axes_of(flight)]


def _steps(flight: AxisFlight) -> Array:
    """Return the time of each mean against that of all (n,)."""
    dt = np.diff(flight.stamps)
    return np.asarray(dt / dt.mean())


def _heading_share(steps: Array, changes: Array) -> float:
    """Return the share of largest likelihood: how much of the noise is the heading's own."""
    column = changes[:, None]

    def unlikely(ratio: float) -> float:
        white, log_det = _decorrelated(steps, _share(ratio), column)
        return float(changes.size * math.log(np.sum(white**2)) + log_det)

    costs = [unlikely(ratio) for ratio in _RATIOS]
    best = int(np.argmin(costs))
    if not 1 < best < len(costs) - 2:
        return _share(float(_RATIOS[best]))
    low, high = math.log(_RATIOS[best - 1]), math.log(_RATIOS[best + 1])
    for _ in range(_NARROWINGS):
        a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        low, high = (low, b) if unlikely(math.exp(a)) < unlikely(math.exp(b)) else (a, high)
    return _share(math.exp(0.5 * (low + high)))


def _share(ratio: float) -> float:
    return 1.0 if math.isinf(ratio) else ratio / (1.0 + ratio)


@compiled
def _decorrelated(steps: Array, heading: float, rows: Array) -> tuple[Array, float]:
    """Return L^-1 rows (n, p) of the covariance L L' in `whitened` with sd 1, and its log determinant."""
    n, p = rows.shape
    found = np.empty((n, p))
    beside, log_det = 0.0, 0.0
    for i in range(n):
        on = math.sqrt((1.0 - heading) * steps[i] + 2.0 * heading - beside * beside)
        log_det += 2.0 * math.log(on)
        for j in range(p):
            before = found[i - 1, j] if i > 0 else 0.0
            found[i, j] = (rows[i, j] - beside * before) / on
        beside = -heading / on
    return found, log_det
