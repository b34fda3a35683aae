"""The fence: a box that the vehicle must not leave, by what it reports of itself, never by the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from noctule.geometry import Array, rot_z
from noctule.messages import Limits, VehicleState, Whereabouts

_SIGMAS = 3.0  # of a pilot's own estimate


@dataclass(frozen=True, slots=True)
class Fence:
    """A box in the world frame, and how fast dead reckoning loses trust in it."""

    low: tuple[float, float, float] = (-10.0, -10.0, 0.2)  # [m]
    high: tuple[float, float, float] = (10.0, 10.0, 2.5)  # [m]
    margin_per_second: float = 0.005  # [m/s]
    margin_per_metre: float = 0.02  # [m/m]


@dataclass(frozen=True, slots=True)
class DeadReckoning:
    """Where the vehicle is held to be: its own velocity and heading, added up, and its reported height.

    It begins where the mission does, and anew at every tick of a pilot that knows better.
    """

    position: Array  # (3,) [m], world
    yaw: float  # [rad], world
    yaw_offset: float | None = None  # [rad], world heading minus reported heading at the first report
    elapsed: float = 0.0  # [s]
    travelled: float = 0.0  # [m]
    unsure: float = 0.0  # [m], where it began may have been off by this

    @classmethod
    def at(cls, known: Whereabouts) -> DeadReckoning:
        """Return the estimate anew, where a located pilot holds the vehicle to be."""
        position = np.array(known.position, dtype=np.float64)
        return cls(position, known.yaw, unsure=_SIGMAS * known.position_sd)

    def margin(self, fence: Fence) -> float:
        """Return what the position may be off by [m]."""
        return self.unsure + fence.margin_per_second * self.elapsed + fence.margin_per_metre * self.travelled

    def advance(self, state: VehicleState, sent: Array, dt: float) -> DeadReckoning:
        """Return the estimate `dt` [s] later; `sent` (4,) stands in for what the vehicle does not report."""
        offset = self.yaw_offset
        if state.yaw is None:
            yaw = self.yaw + float(sent[3]) * dt
        else:
            if offset is None:
                offset = self.yaw - state.yaw
            yaw = state.yaw + offset
        v = rot_z(yaw) @ (np.asarray(sent[:3]) if state.v_body is None else state.v_body)
        position = self.position + v * dt
        if state.height is not None:
            position[2] = state.height
        travelled = self.travelled + float(np.linalg.norm(v)) * dt
        return replace(
            self,
            position=position,
            yaw=yaw,
            yaw_offset=offset,
            elapsed=self.elapsed + dt,
            travelled=travelled,
        )


def bound_by_fence(
    wanted: Array, position: Array, yaw: float, margin: float, fence: Fence, limits: Limits
) -> Array:
    """Return `wanted` (4,) with the speed toward each side no higher than what can be braked.

    The distance to a side is reduced by `margin` in the plane (height is measured, not added up). On or
    beyond a side there is no speed toward it; the way back is free.
    """
    R = rot_z(yaw)
    v_world = R @ wanted[:3]
    slack = np.array([margin, margin, 0.0])
    ahead = np.asarray(fence.high) - slack - position
    behind = position - (np.asarray(fence.low) + slack)
    # Half of the acceleration: the vehicle answers late, and two sides may be met at once.
    bounded = np.clip(v_world, -_brakable(behind, limits), _brakable(ahead, limits))
    if np.array_equal(bounded, v_world):
        return wanted
    return np.concatenate([R.T @ bounded, wanted[3:]])


def _brakable(distance: Array, limits: Limits) -> Array:
    return np.array([math.sqrt(limits.acceleration * max(d, 0.0)) for d in distance])
