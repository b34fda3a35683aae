"""Flight by progress: a velocity along the path, a correction across it, and a stop at the end.

Everything is in the levelled heading frame (FLU, metres) of the current tick. The metres come from scale
from motion (`estimation.target`); an error of the scale changes the time a flight takes, not where it ends,
because at the end both the direction and its length go to zero together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noctule.geometry import Array
from noctule.messages import Limits
from noctule.pilots.settings import ProgressGains


@dataclass(frozen=True, slots=True)
class Segment:
    """The piece of path that ends at the current target image."""

    to_target: Array  # (3,) [m] from the body to where the body has to be
    turn: float  # [rad] left to make, positive counterclockwise
    direction: Array  # (3,) unit vector of the segment
    next_direction: Array | None  # (3,) unit vector of the following segment, None at the last image
    v: Array  # (3,) [m/s] velocity now

    @property
    def along(self) -> float:
        """How far the target still is along the segment [m]; negative once passed."""
        return float(self.direction @ self.to_target)

    @property
    def across(self) -> Array:
        """The part of the way to the target across the segment, (3,) [m]."""
        return self.to_target - self.along * self.direction


def unit(v: Array) -> Array:
    """Return v / |v|, or zeros for a vector too short to have a direction."""
    length = float(np.linalg.norm(v))
    return v / length if length > 1e-9 else np.zeros_like(v)


def yaw_rate(turn: float, gains: ProgressGains, limits: Limits) -> float:
    """Return the yaw rate [rad/s] that makes `turn` [rad]."""
    return float(np.clip(gains.yaw * turn, -limits.yaw_rate, limits.yaw_rate))


def cruise_velocity(segment: Segment, gains: ProgressGains, blend: float = 0.25) -> Array:
    """Return the velocity (3,) [m/s] on the way to an image that is not the last.

    Cruise speed along a blend of this segment's direction and the next one's, a proportional correction
    across it, slower while the heading is far off.
    """
    direction = segment.direction
    if segment.next_direction is not None:
        w = float(np.clip(1.0 - segment.along / blend, 0.0, 1.0)) * 0.5
        direction = unit((1.0 - w) * segment.direction + w * segment.next_direction)
    across = segment.to_target - (direction @ segment.to_target) * direction
    speed = gains.cruise / (1.0 + (segment.turn / 0.5) ** 2)
    correction = gains.cross * across
    size = float(np.linalg.norm(correction))
    if size > 0.8 * speed:  # far from the path: approach it at a slant, never straight across
        correction *= 0.8 * speed / size
        size = 0.8 * speed
    return np.asarray(np.sqrt(speed**2 - size**2) * direction + correction)


def stop_velocity(segment: Segment, gains: ProgressGains, limits: Limits, lag: float) -> Array:
    """Return the velocity (3,) [m/s] towards the last image.

    Proportional to where the vehicle will be once it has answered to its last command (v * lag ahead),
    bounded by cruise speed and by what can still be braked at half the acceleration limit.
    """
    ahead = segment.to_target - lag * segment.v
    distance = float(np.linalg.norm(segment.to_target))
    speed = min(gains.cruise / (1.0 + (segment.turn / 0.5) ** 2), np.sqrt(limits.acceleration * distance))
    wanted = gains.position * ahead
    size = float(np.linalg.norm(wanted))
    if size > speed:
        # Far away keep to the line through the images; near the end both directions are the same.
        along = max(segment.along, 0.0)
        across = gains.cross * segment.across
        wanted = wanted / size * speed
        if along > 0.4:
            size = float(np.linalg.norm(across))
            if size > 0.8 * speed:
                across, size = across * 0.8 * speed / size, 0.8 * speed
            w = min((along - 0.4) / 0.3, 1.0)
            wanted = (1 - w) * wanted + w * (np.sqrt(speed**2 - size**2) * segment.direction + across)
    return np.asarray(wanted)
