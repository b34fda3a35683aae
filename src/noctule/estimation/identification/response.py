"""What eq. (2) answers to inputs that are held between commands, solved exactly, with sensitivities.

Each axis is dv/dt = k_u u(t - delay) - k_v v. The left side of (2) is the world's acceleration resolved on
body axes (corrected), so of a vehicle that turns the two horizontal axes go together: the velocity seen on
them turns the other way.
"""

from __future__ import annotations

import math

import numpy as np

from noctule.compiled import compiled
from noctule.geometry import Array


@compiled
def held(k: float, dt: float) -> tuple[float, float, float, float, float]:
    """Return e, g, dg/dk, h, dh/dk of dv/dt = a - k v over `dt` [s].

    The velocity becomes e v + g a and the way g v + h a. Series where k dt is small: the closed forms cancel.
    """
    z = k * dt
    e = math.exp(-z)
    if abs(z) < 0.5:
        g, g_k, h, h_k = 0.0, 0.0, 0.0, 0.0
        term = 1.0  # (-z)^m / m!
        for m in range(16):
            g += term / (m + 1)
            g_k -= term / (m + 2)
            h += term / ((m + 1) * (m + 2))
            h_k -= term / ((m + 2) * (m + 3))
            term *= -z / (m + 1)
        return e, dt * g, dt * dt * g_k, dt * dt * h, dt**3 * h_k
    g = -math.expm1(-z) / k
    g_k = (dt * e - g) / k
    h = (dt - g) / k
    return e, g, g_k, h, (-g_k - h) / k


@compiled
def response(
    k_u: float, k_v: float, delay: float, v0: float, command_stamps: Array, inputs: Array, stamps: Array
) -> tuple[Array, Array, Array, Array]:
    """Return velocities (n,), their derivatives by k_u, k_v, delay and v0 (n, 4), and both of the way.

    `v0` is the velocity at the first stamp, where the way is 0. Before the first command the input is 0. A
    later start of a step of the input takes away from the velocity what the step had done so far.
    """
    n, m = stamps.size, inputs.size
    v, J, x, X = np.empty(n), np.empty((n, 4)), np.empty(n), np.empty((n, 4))
    now, u, j = stamps[0], 0.0, 0
    while j < m and command_stamps[j] + delay <= now:
        u = inputs[j]
        j += 1
    value, way = v0, 0.0
    by, way_by = np.zeros(4), np.zeros(4)
    by[3] = 1.0
    for i in range(n):
        while True:
            change = command_stamps[j] + delay if j < m else np.inf
            until = min(change, stamps[i])
            dt = until - now
            e, g, g_k, h, h_k = held(k_v, dt)
            a = k_u * u
            way_by += g * by
            way_by[0] += h * u
            way_by[1] += g_k * value + h_k * a
            way += g * value + h * a
            by *= e
            by[0] += g * u
            by[1] += g_k * a - dt * e * value
            value = e * value + g * a
            now = until
            if change > stamps[i]:
                break
            by[2] -= k_u * (inputs[j] - u)
            u = inputs[j]
            j += 1
        v[i], x[i] = value, way
        J[i], X[i] = by, way_by
    return v, J, x, X


@compiled
def plane_response(
    k: Array, delay: float, v0: Array, command_stamps: Array, inputs: Array, stamps: Array, yaw: Array
) -> tuple[Array, Array]:
    """Return forward and left velocities (2, n) of a vehicle that turns, and their derivatives (2, n, 7).

    `k` is k1 to k4, `inputs` (m, 2), `yaw` (n,) [rad] the unwrapped heading at the stamps; derivatives are by
    k1 to k4, the delay and v0 (2,). Between two events the heading turns evenly; half of the turn is taken
    before and half after the axes' own answer, which is exact but for terms of third order in the turn. The
    derivative by the delay is that of the exact answer.
    """
    n, m = stamps.size, command_stamps.size
    v, J = np.empty((2, n)), np.empty((2, n, 7))
    now, u, j = stamps[0], np.zeros(2), 0
    while j < m and command_stamps[j] + delay <= now:
        u[:] = inputs[j]
        j += 1
    value, by = v0.copy(), np.zeros((2, 7))
    by[0, 5], by[1, 6] = 1.0, 1.0
    rate = 0.0
    for i in range(n):
        if i > 0:
            rate = (yaw[i] - yaw[i - 1]) / (stamps[i] - stamps[i - 1])
        while True:
            change = command_stamps[j] + delay if j < m else np.inf
            until = min(change, stamps[i])
            dt = until - now
            c, s = math.cos(0.5 * rate * dt), math.sin(0.5 * rate * dt)
            _turn(value, by, c, s)
            for axis in range(2):
                k_u, k_v = k[2 * axis], k[2 * axis + 1]
                e, g, g_k, _, _ = held(k_v, dt)
                by[axis] *= e
                by[axis, 2 * axis] += g * u[axis]
                by[axis, 2 * axis + 1] += g_k * k_u * u[axis] - dt * e * value[axis]
                value[axis] = e * value[axis] + g * k_u * u[axis]
            _turn(value, by, c, s)
            now = until
            if change > stamps[i]:
                break
            for axis in range(2):
                by[axis, 4] -= k[2 * axis] * (inputs[j, axis] - u[axis])
            u[:] = inputs[j]
            j += 1
        v[:, i] = value
        J[:, i] = by
    return v, J


@compiled
def _turn(value: Array, by: Array, c: float, s: float) -> None:
    """Turn the axes by the angle of cosine c and sine s; what is seen on them turns the other way."""
    forward, left = value[0], value[1]
    value[0], value[1] = c * forward + s * left, c * left - s * forward
    for i in range(by.shape[1]):
        forward, left = by[0, i], by[1, i]
        by[0, i], by[1, i] = c * forward + s * left, c * left - s * forward
