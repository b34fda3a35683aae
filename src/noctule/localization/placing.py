"""Compiled last steps of `registration`: the pose in the world and its covariance."""

from __future__ import annotations

import math

import numpy as np

from noctule.compiled import compiled
from noctule.geometry import Array

SURFACE_SD = 0.02  # [m], of one cell's height; cells err together, so this is more than their spread
_CLOSEST = 0.3  # [m], below the camera
_INFLATION = 3.0  # neighbouring cells err together: the curvature promises too much
_FLOOR_SD = (0.0015, 0.0015, 0.0012, 0.003)  # [m, m, m, rad], what differs with the view


def slanted(slant: float, eye: Array, position: Array) -> Array:
    """Return what a position (3,) is off by because it is seen from aside, (3,) [m], world.

    The more slanting a ray, the more of a flank it sees, on the near side alone: flank and the spread of its
    readings draw the top view along the ray, by `slant` [m] times the cube of the ray's slope, of 1 at the
    most. Below one half near and far side are off alike. `eye` (3,) is the camera's place; the slope is from
    straight down.
    """
    x, y, z = (position - eye).tolist()
    slope_x, slope_y = x / max(-z, _CLOSEST), y / max(-z, _CLOSEST)
    slope = math.hypot(slope_x, slope_y)
    along = slant * min(slope, 1.0) ** 3 / max(slope, 1e-9)
    return np.array([along * slope_x, along * slope_y, 0.0])


@compiled
def moved(
    R: Array, position: Array, at: Array, surface: Array
) -> tuple[float, float, float, float, float, float]:
    """Return x, y, z [m], yaw, roll, pitch [rad] of a pose R, position after a fit in its axes.

    `at` (3,) is x, y [m] and heading [rad], `surface` (3,) height [m] and slopes along the turned x and y.
    """
    x = position[0] + R[0, 0] * at[0] + R[0, 1] * at[1] + R[0, 2] * surface[0]
    y = position[1] + R[1, 0] * at[0] + R[1, 1] * at[1] + R[1, 2] * surface[0]
    z = position[2] + R[2, 0] * at[0] + R[2, 1] * at[1] + R[2, 2] * surface[0]
    c, s = math.cos(at[2]), math.sin(at[2])
    # The surface rises by the slopes: forward and left turn up with it.
    a, b = math.atan(surface[1]), math.atan(surface[2])
    ca, sa = math.cos(a), math.sin(a)
    nose_x = ca * (c * R[0, 0] + s * R[0, 1]) + sa * R[0, 2]
    nose_y = ca * (c * R[1, 0] + s * R[1, 1]) + sa * R[1, 2]
    forward_z, left_z = c * R[2, 0] + s * R[2, 1], c * R[2, 1] - s * R[2, 0]
    nose_z = ca * forward_z + sa * R[2, 2]
    up_z = ca * R[2, 2] - sa * forward_z
    side_z = math.cos(b) * left_z + math.sin(b) * up_z
    up_z = math.cos(b) * up_z - math.sin(b) * left_z
    pitch = -math.asin(min(1.0, max(-1.0, nose_z)))
    return x, y, z, math.atan2(nose_y, nose_x), math.atan2(side_z, up_z), pitch


@compiled
def covariance(information: Array, cells: float, yaw: float) -> Array:
    """Return the covariance (4, 4) of x, y, z [m] and yaw [rad] in the world.

    From the curvature (3, 3) in body axes of the fit of the edges, and the cells that gave the height.
    """
    a, b, d = information[0, 0] + 1.0, information[0, 1], information[0, 2]
    e, f, i = information[1, 1] + 1.0, information[1, 2], information[2, 2] + 1e-2
    # The inverse by cofactors; the sum with a little on the diagonal is positive definite.
    c00, c01, c02 = e * i - f * f, d * f - b * i, b * f - d * e
    scale = _INFLATION / (a * c00 + b * c01 + d * c02)
    p00, p01, p02 = scale * c00, scale * c01, scale * c02
    p11, p12, p22 = scale * (a * i - d * d), scale * (b * d - a * f), scale * (a * e - b * b)
    c, s = math.cos(yaw), math.sin(yaw)
    out = np.zeros((4, 4))
    out[0, 0] = c * c * p00 - 2.0 * c * s * p01 + s * s * p11 + _FLOOR_SD[0] ** 2
    out[1, 1] = s * s * p00 + 2.0 * c * s * p01 + c * c * p11 + _FLOOR_SD[1] ** 2
    out[0, 1] = out[1, 0] = c * s * (p00 - p11) + (c * c - s * s) * p01
    out[0, 3] = out[3, 0] = c * p02 - s * p12
    out[1, 3] = out[3, 1] = s * p02 + c * p12
    out[2, 2] = SURFACE_SD**2 / (1.0 + 0.1 * cells) + _FLOOR_SD[2] ** 2
    out[3, 3] = p22 + _FLOOR_SD[3] ** 2
    return out
