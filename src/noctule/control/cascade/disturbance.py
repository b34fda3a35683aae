"""What accelerates the vehicle beside the model: trim, draught, and a model that is off.

With a wrong model errors persist (the paper's Note 1). This estimates, on body axes, the acceleration that
explains why the velocity was not the predicted one; the cascade takes it out. Per axis it is a constant
(trim, draught) and a part that goes with the wanted speed: with k1 and k2 off, flying steadily asks for
(k2 - k1 of the vehicle less that of the model) times the speed, and a constant alone would trail behind that
wherever the path turns. It is told of commands as they were cut and sent, and is bounded: nothing winds up.
"""

from __future__ import annotations

import numpy as np

from noctule.compiled import compiled
from noctule.geometry import Array

# A velocity differs by this from the predicted one although nothing pushes [m/s, rad/s], as estimates at
# 30 Hz do: how much flying it takes to believe in a part that goes with the speed.
_NOISE = 0.02
_ODD = 3.0  # standard deviations; what is beyond, as a push is, does not go with the speed
_CONSTANT_SD = 0.2  # [m/s^2, rad/s^2], before anything is learnt
_FORGET = 1e-4  # [1/s], of the first variance: a battery that runs low is another vehicle


def nothing_learnt(slope_sd: Array) -> tuple[Array, Array]:
    """Return what to begin with: the estimate (4, 2), and its covariances (4, 2, 2).

    `slope_sd` (4,) [1/s] is how far off the part that goes with the wanted speed may well be.
    """
    covariance = np.zeros((4, 2, 2))
    covariance[:, 0, 0] = _CONSTANT_SD**2
    covariance[:, 1, 1] = slope_sd**2
    return np.zeros((4, 2)), covariance


@compiled
def on_body_axes(rates: Array, yaw: float) -> Array:
    """Return world rates (4,) [m/s, rad/s] as forward, left, up, yaw."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * rates[0] + s * rates[1], c * rates[1] - s * rates[0], rates[2], rates[3]])


@compiled
def disturbance_after(
    learnt: Array,
    covariance: Array,
    expected: Array,
    found: Array,
    wanted: Array,
    dt: float,
    rate: float,
    slope_sd: Array,
    bounds: Array,
) -> tuple[Array, Array]:
    """Return the estimate (4, 2) and its covariances (4, 2, 2) after one more state; a filter for each axis.

    Rows are forward, left, up, yaw; columns a constant [m/s^2, rad/s^2], and what times `wanted` (4,), the
    body velocity asked for, is an acceleration [1/s]. `expected` (8,) is what was predicted `dt` [s] on with
    `learnt` at work, `found` (8,) what the state then was. The constant walks so that alone it is learnt with
    `rate` [1/s]. The wanted speed, not the measured one: noise in that goes around the loop and would be
    learnt. `slope_sd` (4,) as in `nothing_learnt`; `bounds` (4, 2) cut the estimate.
    """
    off = on_body_axes(found[4:] - expected[4:], expected[3])
    after, P = learnt.copy(), covariance.copy()
    gain = min(rate * dt, 0.9)
    for i in range(4):
        first = slope_sd[i] * slope_sd[i]
        P[i, 0, 0] += gain * gain / (1.0 - gain) * (_NOISE / dt) ** 2
        P[i, 1, 1] = min(P[i, 1, 1] + _FORGET * dt * first, first)
        a, b = dt, dt * wanted[i]
        g, h = P[i, 0, 0] * a + P[i, 0, 1] * b, P[i, 1, 0] * a + P[i, 1, 1] * b
        variance = _NOISE**2 + a * g + b * h
        odd = _ODD * np.sqrt(variance)
        sane = min(max(off[i], -odd), odd)
        after[i, 0] = min(max(learnt[i, 0] + g / variance * off[i], -bounds[i, 0]), bounds[i, 0])
        after[i, 1] = min(max(learnt[i, 1] + h / variance * sane, -bounds[i, 1]), bounds[i, 1])
        P[i, 0, 0] -= g * g / variance
        P[i, 0, 1] -= g * h / variance
        P[i, 1, 0] = P[i, 0, 1]
        P[i, 1, 1] -= h * h / variance
    return after, P


@compiled
def disturbance_at(learnt: Array, wanted: Array, gains: Array) -> tuple[Array, Array]:
    """Return what acts at the body velocity `wanted` (4,), (4,) [m/s^2, rad/s^2], and as a command (4,)."""
    acts = learnt[:, 0] + learnt[:, 1] * wanted
    return acts, acts / gains
