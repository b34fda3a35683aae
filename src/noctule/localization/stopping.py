"""Compiled loops of `stops`: rays followed down through a body's layers of cells to where they stop."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from noctule.compiled import compiled
from noctule.geometry import Array
from noctule.localization.gathering import BELOW, Map

_SLACK = 0.03  # [m], a reading so far over the highest or under the lowest layer still stopped in it
# readings along a cell's sides at least; nearer drones are read in strides
_PER_CELL_U, _PER_CELL_V = 2.0, 1.0
_NOWHERE = 1e6  # [m], where a ray stopped of which nothing is known
_BELOW_ALL = -1e6  # [m], where one stopped that passed all layers


@compiled
def to_body(R_world_camera: Array, t_world_camera: Array, R_world_body: Array, position: Array) -> Array:
    """Return R (3, 3) and t (3,) from camera to body, side by side, (3, 4)."""
    out = np.zeros((3, 4))
    for i in range(3):
        for k in range(3):
            out[i, 3] += R_world_body[k, i] * (t_world_camera[k] - position[k])
            for j in range(3):
                out[i, j] += R_world_body[k, i] * R_world_camera[k, j]
    return out


@compiled
def window(
    shape: tuple[int, int], intrinsics: tuple[float, float, float, float], E: Array, box: Array
) -> tuple[int, int, int, int, float]:
    """Return the pixels (left, right, top, bottom) that may see a box, and its nearest corner's depth [m].

    `E` (3, 4) as `to_body` returns it; `box` (3, 2) [m] is low, high along x, y, z in the body. Nothing is
    seen of a box that is not before the camera.
    """
    fx, fy, cx, cy = intrinsics
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    nearest = np.inf
    p = np.empty(3)
    for corner in range(8):
        for i in range(3):
            p[i] = box[i, (corner >> i) & 1] - E[i, 3]
        x = E[0, 0] * p[0] + E[1, 0] * p[1] + E[2, 0] * p[2]
        y = E[0, 1] * p[0] + E[1, 1] * p[1] + E[2, 1] * p[2]
        z = E[0, 2] * p[0] + E[1, 2] * p[1] + E[2, 2] * p[2]
        nearest = min(nearest, z)
        if z < 0.05:
            return 0, 0, 0, 0, z
        u, v = fx * x / z + cx, fy * y / z + cy
        left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
    return (
        int(min(max(left, 0.0), shape[1])),
        int(min(max(right + 1.0, 0.0), shape[1])),
        int(min(max(top, 0.0), shape[0])),
        int(min(max(bottom + 1.0, 0.0), shape[0])),
        nearest,
    )


@compiled
def _strides(cell: float, fx: float, fy: float, depth: float) -> tuple[int, int]:
    return max(1, int(cell * fx / (_PER_CELL_U * depth))), max(1, int(cell * fy / (_PER_CELL_V * depth)))


@compiled
def _stop(reading: int, limit: int, over: float, falls: float, low: float, high: float) -> float:
    """Return the height [m] at which a ray stopped that begins at `over` and falls by `falls` a metre.

    Between `low` and `high`, or `_BELOW_ALL`, or `_NOWHERE`: no reading, something nearer hides what is
    there, foreground that reaches up to the body, or a background so close that no body is told from it.
    """
    if reading == 0:
        return _NOWHERE
    z = over + 0.001 * reading * falls
    if reading >= limit:
        return _BELOW_ALL if over + 0.001 * limit * falls <= low else _NOWHERE
    if z > high + _SLACK:
        return _NOWHERE
    if z >= low - _SLACK:
        return min(max(z, low), high)
    return _NOWHERE if z > low - BELOW else _BELOW_ALL


@compiled
def count_stops(
    depth: NDArray[np.uint16],
    nearest: NDArray[np.uint16],
    intrinsics: tuple[float, float, float, float],
    E: Array,
    cell: float,
    layer: float,
    low: float,
    hits: Map,
    passes: Map,
) -> None:
    """Count the rays that stop in cells (n, n, m) and that pass them, in place; `E` as for `window`."""
    n, m = hits.shape[0], hits.shape[2]
    half, high = 0.5 * n * cell, low + m * layer
    box = np.array([[-half, half], [-half, half], [low, high]])
    left, right, top, bottom, there = window(depth.shape, intrinsics, E, box)
    if left == right or top == bottom:
        return
    fx, fy, cx, cy = intrinsics
    stride_u, stride_v = _strides(cell, fx, fy, there)
    rays = stride_u * stride_v
    for v in range(top, bottom, stride_v):
        y = (v - cy) / fy
        for u in range(left, right, stride_u):
            x = (u - cx) / fx
            falls = E[2, 0] * x + E[2, 1] * y + E[2, 2]
            if falls >= 0.0:
                continue
            stop = _stop(depth[v, u], nearest[v, u], E[2, 3], falls, low, high)
            if stop == _NOWHERE:
                continue
            along_x = (E[0, 0] * x + E[0, 1] * y + E[0, 2]) / falls
            along_y = (E[1, 0] * x + E[1, 1] * y + E[1, 2]) / falls
            last = min(math.floor((stop - low) / layer), m - 1) if stop > low - 1.0 else -1
            for k in range(m - 1, max(last, 0) - 1, -1):
                z = stop if k == last else low + (k + 0.5) * layer
                fi = (E[0, 3] + (z - E[2, 3]) * along_x + half) / cell
                fj = (E[1, 3] + (z - E[2, 3]) * along_y + half) / cell
                if fi < 0.0 or fj < 0.0 or fi >= n or fj >= n:
                    continue
                if k == last:
                    hits[int(fi), int(fj), k] += rays
                else:
                    passes[int(fi), int(fj), k] += rays


@compiled
def weigh_stops(
    depth: NDArray[np.uint16],
    nearest: NDArray[np.uint16],
    intrinsics: tuple[float, float, float, float],
    E: Array,
    cell: float,
    layer: float,
    low: float,
    high: float,
    box: Array,
    weights: Map,
    crossed: NDArray[np.bool_],
) -> float:
    """Return the sum over rays of the weights of the cells that they pass and stop in.

    `weights` (a, b, m, 2), for a ray that passes and for one that stops, are of the cells in `box` (3, 2)
    [m]; all layers reach from `low` to `high` [m]. `crossed` (a, b) is where rays through the middle of the
    box can meet a weight. `E` as for `window`.
    """
    a, b, m = weights.shape[0], weights.shape[1], weights.shape[2]
    left, right, top, bottom, there = window(depth.shape, intrinsics, E, box)
    if left == right or top == bottom:
        return 0.0
    fx, fy, cx, cy = intrinsics
    stride_u, stride_v = _strides(cell, fx, fy, there)
    inverse = 1.0 / cell
    floor, middle = box[2, 0], 0.5 * (box[2, 0] + box[2, 1]) - E[2, 3]
    i0, j0 = (E[0, 3] - box[0, 0]) * inverse, (E[1, 3] - box[1, 0]) * inverse
    total = 0.0
    for v in range(top, bottom, stride_v):
        y = (v - cy) / fy
        for u in range(left, right, stride_u):
            x = (u - cx) / fx
            falls = E[2, 0] * x + E[2, 1] * y + E[2, 2]
            if falls >= 0.0:
                continue
            scale = inverse / falls
            along_i = (E[0, 0] * x + E[0, 1] * y + E[0, 2]) * scale
            along_j = (E[1, 0] * x + E[1, 1] * y + E[1, 2]) * scale
            fi, fj = i0 + middle * along_i, j0 + middle * along_j
            if fi < 0.0 or fj < 0.0 or fi >= a or fj >= b or not crossed[int(fi), int(fj)]:
                continue
            stop = _stop(depth[v, u], nearest[v, u], E[2, 3], falls, low, high)
            if stop == _NOWHERE:
                continue
            last = min(math.floor((stop - floor) / layer), m) if stop > low - 1.0 else -1
            for k in range(m - 1, max(last, 0) - 1, -1):
                z = (stop if k == last else floor + (k + 0.5) * layer) - E[2, 3]
                fi, fj = i0 + z * along_i, j0 + z * along_j
                if fi < 0.0 or fj < 0.0 or fi >= a or fj >= b:
                    continue
                total += weights[int(fi), int(fj), k, 1 if k == last else 0]
    return total * stride_u * stride_v
