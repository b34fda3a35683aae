"""What a person's keys do to the vehicle: a velocity that decays, and a bumper before everything solid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from noctule.control.limiter import limit_command
from noctule.flight.key_script import STICKS
from noctule.geometry import Array, Pose, rot_z
from noctule.messages import Command, Limits, Truth

SPEEDS = np.array([0.4, 0.4, 0.3, 0.6])  # [m/s, rad/s] of a key that is held, where the limits allow it
DEAD_MAN = 0.4  # [s] without a key, and the vehicle hovers
_BUMPER = 0.05  # [m] kept in front of the hull where it would come to rest


class Sticks:
    """Keys as a velocity that decays: full when pressed, gone after DEAD_MAN; terminals repeat held keys."""

    def __init__(self, limits: Limits) -> None:
        self._speeds = np.minimum(SPEEDS, limits.speeds)
        self._signs = np.zeros(4)
        self._pressed = np.full(4, -np.inf)

    def press(self, key: str, now: float) -> None:
        """Press a key of STICKS at `now` [s]."""
        axis, sign = STICKS[key]
        self._signs[axis], self._pressed[axis] = sign, now

    def release(self) -> None:
        """Let go of all: hover."""
        self._pressed[:] = -np.inf

    def wanted(self, now: float) -> Array:
        """Return the velocity (4,): forward, left, up [m/s], yaw rate [rad/s]."""
        left = np.clip(1.0 - (now - self._pressed) / DEAD_MAN, 0.0, 1.0)
        return np.asarray(self._signs * self._speeds * left)


@dataclass(frozen=True, slots=True)
class Bumper:
    """Stops the vehicle before it touches something: it must be able to come to rest where nothing is."""

    touches: Callable[[Pose], tuple[str, ...]]
    lag: float  # [s], of the velocity
    limits: Limits
    dt: float  # [s]

    def command(self, wanted: Array, previous: Command, truth: Truth) -> tuple[Array, tuple[str, ...]]:
        """Return the command (4,) within the limits, and the names of what stopped it."""
        before = previous.as_array()
        asked = limit_command(wanted, before, self.limits, self.dt)
        names = self._in_the_way(asked, truth)
        if not names:
            return asked, ()
        still = np.array([0.0, 0.0, 0.0, wanted[3]])
        return limit_command(still, before, self.limits, self.dt), names

    def _in_the_way(self, nu: Array, truth: Truth) -> tuple[str, ...]:
        speed = float(np.linalg.norm(nu[:3]))
        braking = self.dt + speed / (2.0 * self.limits.acceleration)
        way = rot_z(truth.pose.yaw) @ nu[:3] * braking + truth.v_world * self.lag
        length = float(np.linalg.norm(way))
        if speed == 0.0 or length == 0.0:
            return ()
        rest = truth.pose.position + way * (1.0 + _BUMPER / length)
        return self.touches(Pose(rest, truth.pose.yaw))
