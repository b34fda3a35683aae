"""Where the drone must be in the next frame: a track of constant velocity."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from noctule.geometry import Array, Pose, wrap_angle
from noctule.localization.half_turn import HalfTurn
from noctule.localization.registration import Registration

_GAIN = 0.5  # share of what the velocity was wrong by that one frame mends
_FASTEST, _FASTEST_TURN = 4.0, 6.0  # [m/s], [rad/s]
# [s], an unseen drone is supposed to go on for a while, and to stop within another
_STEADY, _COAST = 0.1, 0.2
_ACCELERATION, _YAW_ACCELERATION = 3.0, 6.0  # [m/s^2], [rad/s^2], what may go on unseen
_LEVELLING = 0.8  # a frame's tilt that carries over to the next


@dataclass(frozen=True, slots=True)
class Prediction:
    """Where something else (a filter) expects the drone at the exposure of a frame."""

    pose: Pose
    covariance: Array  # (4, 4), of x, y, z [m] and yaw [rad]


@dataclass(frozen=True, slots=True)
class Track:
    """The drone as last seen."""

    stamp: float  # [s], when it was seen
    pose: Pose
    velocity: Array  # (3,) [m/s], world
    yaw_rate: float  # [rad/s]
    half_turn: HalfTurn

    @classmethod
    def start(cls, stamp: float, pose: Pose) -> Track:
        """Return the track of a drone that was seen once."""
        return cls(stamp, pose, np.zeros(3), 0.0, HalfTurn())

    def predict(self, stamp: float) -> Prediction:
        """Return where it must be at `stamp` [s]; unseen it slows down, and may be ever farther off."""
        dt = max(stamp - self.stamp, 0.0)
        moving = min(dt, _STEADY) + _COAST * (1.0 - math.exp(-max(dt - _STEADY, 0.0) / _COAST))
        pose = Pose(
            self.pose.position + moving * self.velocity,
            wrap_angle(self.pose.yaw + moving * self.yaw_rate),
            _LEVELLING * self.pose.roll,
            _LEVELLING * self.pose.pitch,
        )
        reach = 0.01 + 0.5 * _ACCELERATION * dt**2
        turn = min(0.02 + 0.5 * _YAW_ACCELERATION * dt**2, math.pi)
        covariance = np.zeros((4, 4))
        covariance[0, 0] = covariance[1, 1] = covariance[2, 2] = reach**2
        covariance[3, 3] = turn**2
        return Prediction(pose, covariance)

    def follow(self, stamp: float, found: Registration) -> Track:
        """Return the track after the drone was found at `stamp` [s], the half turn decided anew."""
        dt = max(stamp - self.stamp, 1e-3)
        expected = self.predict(stamp).pose
        gain = _GAIN / dt
        velocity = self.velocity + gain * (found.pose.position - expected.position)
        speed = math.hypot(*velocity.tolist())
        velocity = velocity * min(1.0, _FASTEST / max(speed, 1e-9))
        yaw_rate = self.yaw_rate + gain * wrap_angle(found.pose.yaw - expected.yaw)
        half_turn, around = self.half_turn.add(found.half_turn)
        return Track(
            stamp,
            turned(found.pose) if around else found.pose,
            velocity,
            min(max(yaw_rate, -_FASTEST_TURN), _FASTEST_TURN),
            half_turn,
        )


def turned(pose: Pose) -> Pose:
    """Return the pose turned by half a turn: the same tilt in the world, seen from the other heading."""
    return Pose(pose.position, wrap_angle(pose.yaw + math.pi), -pose.roll, -pose.pitch)


def facing_as(pose: Pose, yaw: float) -> Pose:
    """Return the pose or its half turn, whichever is nearer to `yaw` [rad]: Alg. 1, corrected."""
    return turned(pose) if abs(wrap_angle(pose.yaw - yaw)) > math.pi / 2.0 else pose


def merged(track: Track, stamp: float, given: Prediction | None) -> Prediction:
    """Return what to expect: a filter's prediction with the track's half turn and tilt, or the track's."""
    own = track.predict(stamp)
    if given is None:
        return own
    pose = facing_as(given.pose, own.pose.yaw)
    if pose.roll == 0.0 and pose.pitch == 0.0:
        pose = replace(pose, roll=own.pose.roll, pitch=own.pose.pitch)
    return Prediction(pose, given.covariance)
