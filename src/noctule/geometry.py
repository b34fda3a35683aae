"""Rotations, angles and poses.

World is ENU (x forward along the room, y left, z up), body is FLU (x forward, y left, z up), cameras are RDF
(x right, y down, z forward). Only this module wraps angles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

R_BODY_CAMERA: Array = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Takes RDF camera coordinates to FLU body coordinates, for a camera that looks straight ahead."""
R_BODY_CAMERA.setflags(write=False)


def wrap_angle(angle: float) -> float:
    """Return `angle` [rad] wrapped to (-pi, pi]."""
    wrapped = float(-((-angle + np.pi) % (2.0 * np.pi) - np.pi))
    # Floating point: a tiny negative excess rounds to -pi, which is outside the half-open interval.
    return np.pi if wrapped <= -np.pi else wrapped


def wrap_angles(angles: Array) -> Array:
    """Return `angles` (any shape) [rad] wrapped to [-pi, pi)."""
    return np.asarray((angles + np.pi) % (2.0 * np.pi) - np.pi)


def skew(v: Array) -> Array:
    """Return the (3, 3) matrix [v]x with skew(v) @ w = v x w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rot_x(angle: float) -> Array:
    """Return the rotation by `angle` [rad] about x, (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rot_y(angle: float) -> Array:
    """Return the rotation by `angle` [rad] about y, (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rot_z(angle: float) -> Array:
    """Return the rotation by `angle` [rad] about z, (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def tilt(roll: float, pitch: float) -> Array:
    """Return the rotation from body to levelled heading frame, R_y(pitch) R_x(roll), (3, 3), angles in [rad].

    In FLU axes a positive roll lowers the right side and a positive pitch lowers the nose.
    """
    return rot_y(pitch) @ rot_x(roll)


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a body is and how it is turned, in the world frame."""

    position: Array  # (3,) [m], world ENU
    yaw: float  # [rad], counterclockwise seen from above, 0 along world x
    roll: float = 0.0  # [rad], positive lowers the right side
    pitch: float = 0.0  # [rad], positive lowers the nose

    @property
    def R_world_body(self) -> Array:
        """The (3, 3) rotation that takes FLU body coordinates to world coordinates."""
        return rot_z(self.yaw) @ tilt(self.roll, self.pitch)

    @property
    def levelled(self) -> Pose:
        """The same pose without roll and pitch."""
        return Pose(self.position, self.yaw)
