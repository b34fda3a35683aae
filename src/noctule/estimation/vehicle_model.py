"""How the state moves on: the identified model, discretised exactly.

Eq. (1) to (5) of "Indoor low-cost localization system", corrected: the left side of (2) is the world's
acceleration resolved on body axes, not the derivative of body velocities. With u in force and noise w,

    R(yaw)' dv/dt = K_u u - K_v R(yaw)' v + w       (and alike for up and yaw)

which within a step is solved in closed form on body axes held at the yaw of mid-step. A vehicle with a
velocity loop of its own is the same equation with K_u = K_v = 1 / lag and u the velocity asked for; where no
command is known, K_u = K_v = 0 leaves constant velocity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from noctule.compiled import compiled
from noctule.estimation.filter_state import FilterError, heading_bias_index, velocity_bias_index
from noctule.geometry import Array
from noctule.settings import Settings

TABLE_1 = (4.7202, 0.2660, 6.2330, 0.5328, 2.6504, 2.5761, 2.3788, 1.5216)
"""k1 to k8 as the paper identified them (Parrot AR.Drone 2.0)."""


@dataclass(frozen=True, slots=True)
class VehicleModel:
    """What a command does, axis by axis: forward, left, up, yaw."""

    input_gains: Array  # (4,) k1, k3, k5, k7: acceleration per unit of input
    drags: Array  # (4,) k2, k4, k6, k8 [1/s]
    delay: float = 0.0  # [s], from sending a command to its effect

    def __post_init__(self) -> None:
        """Refuse what cannot be a vehicle."""
        gains, drags = (np.ascontiguousarray(a, dtype=np.float64) for a in (self.input_gains, self.drags))
        if gains.shape != (4,) or drags.shape != (4,):
            raise FilterError(
                f"vehicle model: input gains {gains.shape} and drags {drags.shape}; expected (4,) and (4,)"
            )
        values = np.concatenate([gains, drags, [self.delay]])
        if not (np.isfinite(values).all() and (drags >= 0.0).all() and self.delay >= 0.0):
            raise FilterError(
                f"vehicle model: drags {drags.tolist()} 1/s, delay {self.delay:g} s; "
                "expected finite numbers, none below 0: identify the vehicle again"
            )
        object.__setattr__(self, "input_gains", gains)
        object.__setattr__(self, "drags", drags)

    @classmethod
    def identified(cls, k: tuple[float, ...] | Array = TABLE_1, delay: float = 0.0) -> VehicleModel:
        """Return the model of eq. (2) from k1 to k8; its inputs are normalised, -1 to 1."""
        values = np.asarray(k, dtype=np.float64)
        return cls(values[0::2], values[1::2], delay)

    @classmethod
    def velocity_loop(cls, lag: float, delay: float = 0.0) -> VehicleModel:
        """Return the model of a vehicle that follows velocities [m/s, rad/s] with a `lag` [s]."""
        return cls(np.full(4, 1.0 / lag), np.full(4, 1.0 / lag), delay)


class ProcessNoise(Settings):
    """Square roots of the spectral densities of what the model does not know."""

    horizontal: float = Field(0.3, gt=0.0, le=20.0, description="acceleration [m/s^2/sqrt(Hz)]")
    vertical: float = Field(0.2, gt=0.0, le=20.0, description="acceleration [m/s^2/sqrt(Hz)]")
    turn: float = Field(0.3, gt=0.0, le=50.0, description="of the yaw [rad/s^2/sqrt(Hz)]")
    # The onboard heading is off by tens of degrees that depend on the heading (Table 3): as the vehicle turns
    # its bias moves, and unless that was calibrated away the filter has to let it.
    heading_bias: float = Field(0.05, ge=0.0, le=1.0, description="random walk [rad/sqrt(s)]")
    velocity_bias: float = Field(0.003, ge=0.0, le=1.0, description="random walk [m/s/sqrt(s)]")

    @property
    def densities(self) -> Array:
        """The densities themselves, (5,)."""
        roots = (self.horizontal, self.vertical, self.turn, self.heading_bias, self.velocity_bias)
        return np.square(np.array(roots, dtype=np.float64))


@compiled
def axis_step(k: float, dt: float) -> tuple[float, float, float, float, float, float]:
    """Return (e, g, h, q_pp, q_pv, q_vv) of dv/dt = a - k v + w over `dt` [s], w of unit density.

    The velocity keeps the share e and gains g a; the position gains g v + h a. Closed forms, as series where
    k dt is small and the closed forms cancel.
    """
    u = k * dt
    e = np.exp(-u)
    if u < 0.5:
        g_sum, h_sum, q_sum = 0.0, 0.0, 0.0
        term, power = 1.0, 1.0  # (-u)^m / m!, 2^m
        for m in range(18):
            g_sum += term / (m + 1)
            h_sum += term / ((m + 1) * (m + 2))
            q_sum += term * (4.0 * power - 2.0) / ((m + 1) * (m + 2) * (m + 3))
            term *= -u / (m + 1)
            if abs(term) * power < 1e-18:
                break
            power *= 2.0
        g, h, q_pp = dt * g_sum, dt * dt * h_sum, dt**3 * q_sum
        q_vv = dt
        if u > 0.0:
            q_vv = -np.expm1(-2.0 * u) / (2.0 * k)
    else:
        g = -np.expm1(-u) / k
        h = (dt - g) / k
        q_vv = -np.expm1(-2.0 * u) / (2.0 * k)
        q_pp = (dt - 2.0 * g + q_vv) / (k * k)
    return e, g, h, q_pp, 0.5 * g * g, q_vv


@compiled
def transition(x: Array, dt: float, u: Array, gains: Array, drags: Array) -> tuple[Array, Array]:
    """Return the state after `dt` [s] under the input `u` (4,), (n,), and its Jacobian F, (n, n)."""
    n = x.size
    ex, gx, hx, _, _, _ = axis_step(drags[0], dt)
    ey, gy, hy, _, _, _ = axis_step(drags[1], dt)
    ez, gz, hz, _, _, _ = axis_step(drags[2], dt)
    ew, gw, hw, _, _, _ = axis_step(drags[3], dt)
    ax, ay, az, aw = gains[0] * u[0], gains[1] * u[1], gains[2] * u[2], gains[3] * u[3]
    turn = gw * x[7] + hw * aw
    mid = x[3] + 0.5 * turn
    c, s = np.cos(mid), np.sin(mid)
    vf, vl = c * x[4] + s * x[5], c * x[5] - s * x[4]
    pf, pl = gx * vf + hx * ax, gy * vl + hy * ay
    wf, wl = ex * vf + gx * ax, ey * vl + gy * ay
    x1 = x.copy()
    x1[0] += c * pf - s * pl
    x1[1] += s * pf + c * pl
    x1[2] += gz * x[6] + hz * az
    x1[3] += turn
    x1[4] = c * wf - s * wl
    x1[5] = s * wf + c * wl
    x1[6] = ez * x[6] + gz * az
    x1[7] = ew * x[7] + gw * aw
    F = np.eye(n)
    F[0, 4], F[0, 5] = c * c * gx + s * s * gy, c * s * (gx - gy)
    F[1, 4], F[1, 5] = F[0, 5], s * s * gx + c * c * gy
    F[4, 4], F[4, 5] = c * c * ex + s * s * ey, c * s * (ex - ey)
    F[5, 4], F[5, 5] = F[4, 5], s * s * ex + c * c * ey
    F[2, 6], F[6, 6], F[3, 7], F[7, 7] = gz, ez, gw, ew
    # By mid-step yaw: the axes turn with it, and the velocity seen on them turns the other way.
    df, dl = -pl + gx * vl, pf - gy * vf
    F[0, 3], F[1, 3] = c * df - s * dl, s * df + c * dl
    df, dl = -wl + ex * vl, wf - ey * vf
    F[4, 3], F[5, 3] = c * df - s * dl, s * df + c * dl
    for i in (0, 1, 4, 5):
        F[i, 7] = 0.5 * gw * F[i, 3]
    return x1, F


@compiled
def process_covariance(yaw: float, dt: float, drags: Array, densities: Array, n: int) -> Array:
    """Return Q (n, n): what the white noises of `densities` (5,) add in `dt` [s].

    `yaw` [rad] is that of mid-step. What the noise of the turn does to the direction of flight within the
    same step is of third order in dt and left out.
    """
    Q = np.zeros((n, n))
    c, s = np.cos(yaw), np.sin(yaw)
    _, _, _, ppx, pvx, vvx = axis_step(drags[0], dt)
    _, _, _, ppy, pvy, vvy = axis_step(drags[1], dt)
    forward, left, cross = c * c, s * s, c * s
    for i, j, along, across in ((0, 0, ppx, ppy), (0, 4, pvx, pvy), (4, 4, vvx, vvy)):
        Q[i, j] = densities[0] * (forward * along + left * across)
        Q[i + 1, j + 1] = densities[0] * (left * along + forward * across)
        Q[i, j + 1] = densities[0] * cross * (along - across)
        Q[i + 1, j] = Q[i, j + 1]
    for i, k in ((2, 1), (3, 2)):
        _, _, _, pp, pv, vv = axis_step(drags[i], dt)
        Q[i, i], Q[i, i + 4], Q[i + 4, i + 4] = densities[k] * pp, densities[k] * pv, densities[k] * vv
    for i in range(4):
        for j in range(4, 8):
            Q[j, i] = Q[i, j]
    b = heading_bias_index(n)
    if b >= 0:
        Q[b, b] = densities[3] * dt
    b = velocity_bias_index(n)
    if b >= 0:
        Q[b, b] = densities[4] * dt
        Q[b + 1, b + 1] = densities[4] * dt
    return Q
