"""The cascade: from the error on a path to a velocity, and from that to a command; eqs. (46) to (56).

Written in the world frame (ENU) with a state of x, y, z, yaw. The paper's signs hold: u_psi turns
counterclockwise here too.
"""

from __future__ import annotations

import numpy as np

from noctule.compiled import compiled, wrap
from noctule.geometry import Array


@compiled
def kinematic_law(
    x: Array, pose: Array, velocity: Array, motion: Array, acceleration: Array, k1: Array, k2: Array
) -> tuple[Array, Array, Array]:
    """Return v_r, its derivative, and the error, (4,) each: eq. (48), resolved in the world.

    v_r = v_d + k1 tanh(k2 e) with e = x_d - x, the yaw wrapped. Corrected: (49)'s gamma is v_r - x_dot, and
    (53) needs the derivative of v_r in world axes; with a wanted point that moves with `motion`

        dv_r/dt = a_d + k1 k2 sech^2(k2 e) (motion - x_dot)

    `x` (8,) is the state; `pose`, `velocity` (v_d), `motion` and `acceleration` (a_d) (4,) are the wanted
    point's. On a path `motion` is that of the nearest point, and a_d holds the curvature. v_d = 0 hovers.
    """
    v_r, rate, error = np.empty(4), np.empty(4), np.empty(4)
    for i in range(4):
        e = pose[i] - x[i]
        if i == 3:
            e = wrap(e)
        th = np.tanh(k2[i] * e)
        v_r[i] = velocity[i] + k1[i] * th
        rate[i] = acceleration[i] + k1[i] * k2[i] * (1.0 - th * th) * (motion[i] - x[4 + i])
        error[i] = e
    return v_r, rate, error


@compiled
def compensator(x: Array, v_r: Array, rate: Array, K: Array, gains: Array, drags: Array) -> Array:
    """Return the command (4,), before any limit, with which gamma = v_r - x_dot falls as (56): eq. (53).

    F1 u = dv_r/dt + K gamma + F2 x_dot, where `gains` and `drags` (4,) are the diagonals k1, k3, k5, k7 and
    k2, k4, k6, k8 on body axes. gamma converges exponentially, not in finite time.
    """
    a = np.empty(4)
    for i in range(4):
        a[i] = rate[i] + K[i] * (v_r[i] - x[4 + i])
    c, s = np.cos(x[3]), np.sin(x[3])
    u = np.empty(4)
    u[0] = (c * a[0] + s * a[1] + drags[0] * (c * x[4] + s * x[5])) / gains[0]
    u[1] = (c * a[1] - s * a[0] + drags[1] * (c * x[5] - s * x[4])) / gains[1]
    u[2] = (a[2] + drags[2] * x[6]) / gains[2]
    u[3] = (a[3] + drags[3] * x[7]) / gains[3]
    return u


@compiled
def saturated(u: Array, limits: Array) -> Array:
    """Return the command (4,) within +-`limits` (4,): the level part keeps its direction, the others are cut.

    The law has no memory, so nothing winds up; what predicts the vehicle is told of the cut command.
    """
    scale = 1.0
    for i in range(2):
        if abs(u[i]) > limits[i]:
            scale = min(scale, limits[i] / abs(u[i]))
    cut = np.empty(4)
    cut[0], cut[1] = scale * u[0], scale * u[1]
    for i in range(2, 4):
        cut[i] = min(max(u[i], -limits[i]), limits[i])
    return cut


@compiled
def cascade(
    x: Array,
    pose: Array,
    velocity: Array,
    motion: Array,
    acceleration: Array,
    k1: Array,
    k2: Array,
    K: Array,
    gains: Array,
    drags: Array,
    push: Array,
    limits: Array,
) -> tuple[Array, Array, Array, Array]:
    """Return (the command, the command before its limits, v_r, the error), (4,) each: both laws in a row.

    `push` (4,) is a disturbance, as the command that would have the same effect; it is taken out.
    """
    v_r, rate, error = kinematic_law(x, pose, velocity, motion, acceleration, k1, k2)
    u = compensator(x, v_r, rate, K, gains, drags) - push
    return saturated(u, limits), u, v_r, error
