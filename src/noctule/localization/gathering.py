"""Compiled inner loops of `evidence`: readings of a window of the picture, counted in the cells of a body."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from noctule.compiled import compiled
from noctule.geometry import Array

Map = NDArray[np.float32]

BAND = 0.13  # [m], a reading this near to the body's height may be drone; from localization.md
BELOW = 0.5  # [m], foreground between the band and this far below is neither drone nor free
_THICK = 0.08  # [m], from the plane up to the highest that is drone
# readings along a cell's sides at least; nearer drones are read in strides
_PER_CELL_U, _PER_CELL_V = 2.0, 1.0
FULL = 0.3
"""A cell covered this far by drone counts as drone. Sides turned to the camera fill the cells at their foot;
well below one half, cells on the far side fill as early, and the two biases cancel.
"""


@compiled
def rotation(yaw: float, roll: float, pitch: float) -> Array:
    """Return the rotation (3, 3) from body to world, R_z(yaw) R_y(pitch) R_x(roll), angles in [rad]."""
    cy, sy = math.cos(yaw), math.sin(yaw)
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    R[1, 0], R[1, 1], R[1, 2] = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    R[2, 0], R[2, 1], R[2, 2] = -sp, cp * sr, cp * cr
    return R


@compiled
def count_readings(
    depth: NDArray[np.uint16],
    nearest: NDArray[np.uint16],
    intrinsics: tuple[float, float, float, float],
    R_world_camera: Array,
    t_world_camera: Array,
    R_world_body: Array,
    position: Array,
    cell: float,
    plane: float,
    maps: Map,
) -> float:
    """Count the readings around a body in `maps` (5, n, n): drone, free, height, share, trust.

    The maps hold zeros before. Returns the body's distance from the camera along its axis [m].
    """
    n = maps.shape[1]
    fx, fy = intrinsics[0], intrinsics[1]
    R, t = np.zeros((3, 3)), np.zeros(3)  # from camera to body
    distance = 0.0
    for i in range(3):
        for k in range(3):
            t[i] += R_world_body[k, i] * (t_world_camera[k] - position[k])
            for j in range(3):
                R[i, j] += R_world_body[k, i] * R_world_camera[k, j]
    for i in range(3):
        distance -= R[i, 2] * t[i]
    corners = np.empty((8, 2))
    if distance <= 0.0 or not _project_box(R, t, 0.5 * n * cell, plane, intrinsics, corners):
        return distance
    strides = (
        max(1, int(cell * fx / (_PER_CELL_U * distance))),
        max(1, int(cell * fy / (_PER_CELL_V * distance))),
    )
    flat = maps[:3].reshape(3 * n * n)
    _count(depth, nearest, intrinsics, R, t, corners, strides, n, cell, plane, flat)
    drone, free, share, trust = maps[0], maps[1], maps[3], maps[4]
    for i in range(n):
        for j in range(n):
            share[i, j] = min(drone[i, j] / FULL, 1.0)
            trust[i, j] = 1.0 if drone[i, j] > 0.0 else min(free[i, j], 1.0)
    return distance


@compiled
def _project_box(
    R: Array, t: Array, half: float, plane: float, intrinsics: tuple[float, float, float, float], out: Array
) -> bool:
    """Write the pixels (8, 2) of the corners of what can be drone; False when one is not before the camera.

    Corners are numbered by bits: x, y, z. R, t take camera coordinates to the body's.
    """
    fx, fy, cx, cy = intrinsics
    for k in range(8):
        dx = (half if k & 1 else -half) - t[0]
        dy = (half if k & 2 else -half) - t[1]
        dz = (plane + _THICK if k & 4 else plane) - t[2]
        depth = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz
        if depth < 0.05:
            return False
        out[k, 0] = fx * (R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz) / depth + cx
        out[k, 1] = fy * (R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz) / depth + cy
    return True


@compiled
def _span(corners: Array, v: float) -> tuple[float, float]:
    """Return from where to where [px] a row crosses the box: its silhouette is made of its edges."""
    low, high = np.inf, -np.inf
    for k in range(8):
        for bit in (1, 2, 4):
            if k & bit:
                continue
            v0, v1 = corners[k, 1], corners[k | bit, 1]
            # A row that only touches the box still reads the nearest of it.
            if max(v0, v1) < v - 1.0 or min(v0, v1) > v + 1.0:
                continue
            u0, u1 = corners[k, 0], corners[k | bit, 0]
            slope = (u1 - u0) / (v1 - v0) if abs(v1 - v0) > 1e-6 else 0.0
            for w in (v - 1.0, v + 1.0):
                at = min(max(w, min(v0, v1)), max(v0, v1))
                u = u0 + slope * (at - v0)
                low, high = min(low, u), max(high, u)
            if slope == 0.0:
                low, high = min(low, u1), max(high, u1)
    return low, high


@compiled
def _count(
    depth: NDArray[np.uint16],
    nearest: NDArray[np.uint16],
    intrinsics: tuple[float, float, float, float],
    R: Array,
    t: Array,
    corners: Array,
    strides: tuple[int, int],
    n: int,
    cell: float,
    plane: float,
    out: Map,
) -> None:
    """Add the readings inside a box to `out` (3 n n,): drone, free, height; R, t from camera to body."""
    f = np.float32
    fx, fy, cx, cy = intrinsics
    height, width = depth.shape
    inverse, middle = f(1.0 / cell), f(0.5 * n)
    side, cells = f(n), n * n
    # a reading stands for its pixel's shadow on the level plane
    scale = f(strides[0] * strides[1] / (cell * cell * fx * fy))
    tx, ty, tz = f(t[0]), f(t[1]), f(t[2] - plane)
    rx, ry, rz = f(R[0, 0]), f(R[1, 0]), f(R[2, 0])
    band, below, milli = f(BAND), f(BELOW), f(0.001)
    left = int(min(max(corners[:, 0].min(), 0.0), width))
    top = int(min(max(corners[:, 1].min(), 0.0), height))
    bottom = int(min(max(corners[:, 1].max() + 2.0, 0.0), height))
    readings, limits, x_m = np.empty(width, f), np.empty(width, f), np.empty(width, f)
    areas, overs, places = np.empty(width, f), np.empty(width, f), np.empty(width, np.int32)
    for u in range(width):
        x_m[u] = (left + u * strides[0] - cx) / fx
    for v in range(top, bottom, strides[1]):
        low, high = _span(corners, float(v))
        if low > high:
            continue
        first = max(math.ceil((low - 1.0 - left) / strides[0]), 0)
        last = int(min(high + 2.0, width))
        count = (last - left - first * strides[0] + strides[0] - 1) // strides[0]
        if count <= 0:
            continue
        row, row_nearest = depth[v], nearest[v]
        for k in range(count):
            u = left + (first + k) * strides[0]
            readings[k], limits[k] = row[u], row_nearest[u]
        across = x_m[first:]
        y_m = (v - cy) / fy
        ax, ay = f(R[0, 1] * y_m + R[0, 2]), f(R[1, 1] * y_m + R[1, 2])
        az = f(R[2, 1] * y_m + R[2, 2])
        # Without branches, so that it is done for many pixels at once.
        for k in range(count):
            reading, limit, x = readings[k], limits[k], across[k]
            falls = az + rz * x
            d = milli * reading
            over = tz + d * falls
            near = reading < limit
            seen = near & (over > -band)
            along = f(1.0) / falls
            crossing = -tz * along
            # What is nearer hides the cell. Foreground that reaches up to the body: a slice of it looks like
            # anything. Near the floor a body may be too close to the background to be told from it.
            hides = over > band
            reaches = near & (over > -below)
            floor = (over > -band) & (f(1000.0) * crossing >= limit)
            used = (reading > f(0.0)) & ~hides & (seen | ~(reaches | floor))
            d = d if seen else crossing
            xc = (tx + d * (ax + rx * x)) * inverse + middle
            yc = (ty + d * (ay + ry * x)) * inverse + middle
            inside = (xc >= f(0.0)) & (xc < side) & (yc >= f(0.0)) & (yc < side)
            place = np.int32(xc) * np.int32(n) + np.int32(yc) + (np.int32(0) if seen else np.int32(cells))
            places[k] = place if used & inside else np.int32(-1)
            areas[k] = -d * d * scale * along
            overs[k] = over
        for k in range(count):
            place = places[k]
            if place < 0:
                continue
            out[place] += areas[k]
            if place < cells:
                out[2 * cells + place] += areas[k] * (overs[k] + f(plane))
