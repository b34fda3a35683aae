"""The state of the fusion: what its numbers are, and an estimate of it.

x, y, z [m], yaw [rad], their rates in the world [m/s, rad/s], and then, as the size says, the bias of the
onboard heading [rad] and the biases of the onboard forward and left velocity [m/s]:

    8: none    9: heading    10: velocities    11: heading, velocities

The yaw of a state is unwrapped: it counts turns. Innovations are wrapped, so no measurement has to know
the count; only an information vector y = Y x does, see `information_filter`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noctule.compiled import compiled
from noctule.errors import NoctuleError
from noctule.geometry import Array, Pose, rot_z, wrap_angle

SIZES = (8, 9, 10, 11)
YAW = 3
YAW_RATE = 7


class FilterError(NoctuleError):
    """A state, a covariance or a measurement that no filter can use."""


@compiled
def heading_bias_index(n: int) -> int:
    """Return where a state of `n` numbers keeps the bias of the onboard heading, -1 when it has none."""
    return 8 if n == 9 or n == 11 else -1


@compiled
def velocity_bias_index(n: int) -> int:
    """Return where a state of `n` numbers keeps the first of both velocity biases, -1 when it has none."""
    return n - 2 if n >= 10 else -1


def state_size(heading_bias: bool, velocity_biases: bool) -> int:
    """Return the size of the state, 8 to 11."""
    return 8 + int(heading_bias) + 2 * int(velocity_biases)


def state_names(n: int) -> tuple[str, ...]:
    """Return the names of the `n` numbers."""
    names = ["x", "y", "z", "yaw", "vx", "vy", "vz", "yaw_rate"]
    if heading_bias_index(n) >= 0:
        names.append("heading_bias")
    if velocity_bias_index(n) >= 0:
        names += ["forward_bias", "left_bias"]
    return tuple(names)


@dataclass(frozen=True, slots=True)
class StateEstimate:
    """A mean and a covariance at a time."""

    stamp: float  # [s]
    x: Array  # (n,) the state, yaw unwrapped
    P: Array  # (n, n) its covariance

    @property
    def position(self) -> Array:
        """Where the vehicle is, (3,) [m], world."""
        return self.x[:3]

    @property
    def yaw(self) -> float:
        """How it is turned [rad], wrapped."""
        return wrap_angle(float(self.x[YAW]))

    @property
    def v_world(self) -> Array:
        """Its velocity, (3,) [m/s], world."""
        return self.x[4:7]

    @property
    def v_heading(self) -> Array:
        """Its velocity in the levelled heading frame FLU, (3,) [m/s]."""
        v: Array = rot_z(float(self.x[YAW])).T @ self.x[4:7]
        return v

    @property
    def pose(self) -> Pose:
        """Where it is and how it is turned, levelled."""
        return Pose(self.x[:3].copy(), self.yaw)

    @property
    def yaw_rate(self) -> float:
        """How fast it turns [rad/s]."""
        return float(self.x[YAW_RATE])

    @property
    def sd(self) -> Array:
        """The standard deviation of every number, (n,)."""
        sd: Array = np.sqrt(np.diag(self.P))
        return sd


@dataclass(frozen=True, slots=True)
class Prior:
    """Standard deviations of a start; wide where the first measurements know better."""

    position: float = 1.0  # [m]
    yaw: float = 0.5  # [rad]
    velocity: float = 0.3  # [m/s]
    yaw_rate: float = 0.3  # [rad/s]
    heading_bias: float = 0.3  # [rad]
    velocity_bias: float = 0.05  # [m/s]


def start_at(
    stamp: float, position: Array, yaw: float, prior: Prior = Prior(), size: int = 11
) -> StateEstimate:
    """Return an estimate at rest at `position` (3,) [m] and `yaw` [rad]. Raises FilterError."""
    if size not in SIZES:
        raise FilterError(f"state of {size} numbers; expected 8, 9, 10 or 11: choose which biases it keeps")
    x = np.zeros(size)
    x[:3], x[YAW] = position, yaw
    sd = np.empty(size)
    sd[:3], sd[YAW] = prior.position, prior.yaw
    sd[4:7], sd[YAW_RATE] = prior.velocity, prior.yaw_rate
    if heading_bias_index(size) >= 0:
        sd[heading_bias_index(size)] = prior.heading_bias
    if velocity_bias_index(size) >= 0:
        sd[velocity_bias_index(size) :] = prior.velocity_bias
    if not (np.isfinite(x).all() and np.isfinite(sd).all() and (sd > 0.0).all()):
        raise FilterError(
            f"start at position {np.round(x[:3], 3).tolist()} m, yaw {x[YAW]:g} rad with deviations from "
            f"{sd.min():g} to {sd.max():g}; expected finite numbers and deviations above 0"
        )
    return StateEstimate(float(stamp), x, np.diag(sd**2))
