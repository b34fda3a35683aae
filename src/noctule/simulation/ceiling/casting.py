"""Rays through pixels against boxes, ellipsoids and tubes: exact depths, compiled.

Depth is kept as nearness 1/z, which is what the sensor's disparity is proportional to, and in which the
nearer of two surfaces is the larger.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from noctule.camera import PinholeCamera
from noctule.geometry import Array

Image = NDArray[np.float32]
Hit = tuple[float, float, float, float]  # depth, negative for none, and the surface's normal

_FAR = 1e9
_NEAR_PLANE = 0.05  # [m], corners nearer than this are taken as being there, for the bounding rectangle


class Canvas:
    """What rays hit: nearness, how strongly it sends infrared back, and whose surface it is."""

    def __init__(self, camera: PinholeCamera) -> None:
        size = (camera.height, camera.width)
        self._eye = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        self.nearness = np.zeros(size, np.float32)  # [1/m], 0 where nothing is hit
        self.echo = np.zeros(size, np.float32)  # reflectance x cosine between normal and ray
        self.owner = np.full(size, -1, np.int16)  # row of the part, -1 for none
        self.spans = np.zeros(
            (camera.height, 2), np.int32
        )  # columns that may have changed, one past the last

    def copy_from(self, other: Canvas) -> None:
        """Become equal to `other`, with nothing owned by a part and nothing changed."""
        np.copyto(self.nearness, other.nearness)
        np.copyto(self.echo, other.echo)
        self.owner.fill(-1)
        self.spans[:] = (self.owner.shape[1], 0)

    def cast(self, rows: Array, chance: NDArray[np.uint16]) -> None:
        """Draw parts (n, COLUMNS) in camera coordinates (RDF).

        `chance` (height, width) is what opacity is compared with, 0 to 65535.
        """
        _cast(rows, self._eye, chance, self.nearness, self.echo, self.owner, self.spans)


@njit(cache=True, nogil=True, error_model="numpy")
def _bounds(row: Array, eye: Array, width: int, height: int) -> tuple[int, int, int, int]:
    u0, u1, v0, v1 = _FAR, -_FAR, _FAR, -_FAR
    nearest = _FAR
    for k in range(8):
        a = row[13] if k & 1 else -row[13]
        b = row[14] if k & 2 else -row[14]
        c = row[15] if k & 4 else -row[15]
        x = row[1] + row[4] * a + row[5] * b + row[6] * c
        y = row[2] + row[7] * a + row[8] * b + row[9] * c
        z = row[3] + row[10] * a + row[11] * b + row[12] * c
        nearest = min(nearest, z)
        z = max(z, _NEAR_PLANE)
        u, v = eye[0] * x / z + eye[2], eye[1] * y / z + eye[3]
        u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
    if nearest < _NEAR_PLANE:  # a part beside or behind the eye: its rectangle tells nothing
        return 0, width, 0, height
    left, right = max(0, math.ceil(max(u0, -1.0))), min(width, math.floor(min(u1, width + 1.0)) + 1)
    top, bottom = max(0, math.ceil(max(v0, -1.0))), min(height, math.floor(min(v1, height + 1.0)) + 1)
    return left, right, top, bottom


@njit(cache=True, nogil=True, error_model="numpy")
def _box(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, hx: float, hy: float, hz: float
) -> Hit:
    """Return (t, normal) of the first hit of o + t d, t < 0 for none; in the part's axes."""
    enter, leave, axis = -_FAR, _FAR, 0
    for k in range(3):
        o, d, h = (ox, dx, hx) if k == 0 else ((oy, dy, hy) if k == 1 else (oz, dz, hz))
        if abs(d) < 1e-12:
            if abs(o) > h:
                return -1.0, 0.0, 0.0, 0.0
            continue
        near, far = (-h - o) / d, (h - o) / d
        if near > far:
            near, far = far, near
        if near > enter:
            enter, axis = near, k
        leave = min(leave, far)
    if enter > leave or enter <= 0.0:
        return -1.0, 0.0, 0.0, 0.0
    return enter, 1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 1.0 if axis == 2 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _ellipsoid(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, hx: float, hy: float, hz: float
) -> Hit:
    ax, ay, az, bx, by, bz = ox / hx, oy / hy, oz / hz, dx / hx, dy / hy, dz / hz
    aa, ab = bx * bx + by * by + bz * bz, ax * bx + ay * by + az * bz
    root = ab * ab - aa * (ax * ax + ay * ay + az * az - 1.0)
    if root <= 0.0:
        return -1.0, 0.0, 0.0, 0.0
    t = (-ab - math.sqrt(root)) / aa
    nx, ny, nz = (ax + t * bx) / hx, (ay + t * by) / hy, (az + t * bz) / hz
    n = math.sqrt(nx * nx + ny * ny + nz * nz)
    return t, nx / n, ny / n, nz / n


@njit(cache=True, nogil=True, error_model="numpy")
def _tube(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, r: float, inner: float, h: float
) -> Hit:
    best, nx, ny, nz = _FAR, 0.0, 0.0, 0.0
    if abs(dz) > 1e-12:
        t = ((h if dz < 0.0 else -h) - oz) / dz
        x, y = ox + t * dx, oy + t * dy
        s = x * x + y * y
        if t > 0.0 and inner * inner <= s <= r * r:
            best, nz = t, 1.0
    aa, ab, oo = dx * dx + dy * dy, ox * dx + oy * dy, ox * ox + oy * oy
    if aa > 1e-16:
        root = ab * ab - aa * (oo - r * r)
        if root > 0.0:
            t = (-ab - math.sqrt(root)) / aa
            if 0.0 < t < best and abs(oz + t * dz) <= h:
                best, nx, ny, nz = t, (ox + t * dx) / r, (oy + t * dy) / r, 0.0
        root = ab * ab - aa * (oo - inner * inner)
        if inner > 0.0 and root > 0.0:  # the far inside of a ring
            t = (-ab + math.sqrt(root)) / aa
            if 0.0 < t < best and abs(oz + t * dz) <= h:
                best, nx, ny, nz = t, (ox + t * dx) / inner, (oy + t * dy) / inner, 0.0
    if best == _FAR:
        return -1.0, 0.0, 0.0, 0.0
    return best, nx, ny, nz


@njit(cache=True, nogil=True, error_model="numpy")
def _cast(
    rows: Array,
    eye: Array,
    chance: NDArray[np.uint16],
    nearness: Image,
    echo: Image,
    owner: NDArray[np.int16],
    spans: NDArray[np.int32],
) -> None:
    height, width = nearness.shape
    fx, fy, cx, cy = eye
    for i in range(len(rows)):
        p = rows[i]
        left, right, top, bottom = _bounds(p, eye, width, height)
        if left >= right or top >= bottom:
            continue
        kind, hx, hy, hz, inner = int(p[0]), p[13], p[14], p[15], p[16]
        limit, reflectance = p[17] * 65536.0, p[18]
        # The eye in the part's axes.
        ox = -(p[4] * p[1] + p[7] * p[2] + p[10] * p[3])
        oy = -(p[5] * p[1] + p[8] * p[2] + p[11] * p[3])
        oz = -(p[6] * p[1] + p[9] * p[2] + p[12] * p[3])
        for v in range(top, bottom):
            spans[v, 0], spans[v, 1] = min(spans[v, 0], left), max(spans[v, 1], right)
            my = (v - cy) / fy
            bx, by, bz = p[7] * my + p[10], p[8] * my + p[11], p[9] * my + p[12]
            for u in range(left, right):
                mx = (u - cx) / fx
                dx, dy, dz = bx + p[4] * mx, by + p[5] * mx, bz + p[6] * mx
                if kind == 0:
                    t, nx, ny, nz = _box(ox, oy, oz, dx, dy, dz, hx, hy, hz)
                elif kind == 1:
                    t, nx, ny, nz = _ellipsoid(ox, oy, oz, dx, dy, dz, hx, hy, hz)
                else:
                    t, nx, ny, nz = _tube(ox, oy, oz, dx, dy, dz, hx, inner, hz)
                # d has z = 1 in camera axes, so t is the depth along the optical axis.
                if t <= 0.0 or t * nearness[v, u] >= 1.0 or chance[v, u] >= limit:
                    continue
                nearness[v, u] = 1.0 / t
                cosine = abs(nx * dx + ny * dy + nz * dz) / math.sqrt(mx * mx + my * my + 1.0)
                echo[v, u] = reflectance * cosine
                owner[v, u] = i
