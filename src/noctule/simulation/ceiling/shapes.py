"""Boxes, ellipsoids and tubes: what everything that the ceiling camera sees is put together from."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from noctule.geometry import Array

Triple = tuple[float, float, float]


class Shape(IntEnum):
    """What a part looks like in its own axes; `half` are its half extents."""

    BOX = 0
    ELLIPSOID = 1
    TUBE = 2  # along z, outer radius half[0] (= half[1]); a cylinder when its inner radius is 0


COLUMNS = 22
"""A part as a row: shape; centre (3); rotation (9), part to frame; half (3); inner radius; opacity;
reflectance; RGB (3)."""
OPACITY, REFLECTANCE, RED = 17, 18, 19
"""Places in a row."""


@dataclass(frozen=True, slots=True)
class Part:
    """A convex body (or a ring) with one surface."""

    shape: Shape
    centre: Triple  # [m]
    half: Triple  # [m]
    rotation: Array | None = None  # (3, 3), part to frame
    inner: float = 0.0  # [m], inner radius of a tube
    opacity: float = 1.0  # share of the rays that come back
    reflectance: float = 0.5  # of infrared, 0 to 1
    rgb: Triple = (0.5, 0.5, 0.5)  # 0 to 1


def pack(parts: list[Part]) -> Array:
    """Return the parts as rows (n, COLUMNS)."""
    rows = np.empty((len(parts), COLUMNS))
    for row, p in zip(rows, parts, strict=True):
        rotation = np.eye(3) if p.rotation is None else p.rotation
        row[:] = [
            *(p.shape, *p.centre, *rotation.ravel(), *p.half),
            *(p.inner, p.opacity, p.reflectance, *p.rgb),
        ]
    return rows


def moved(rows: Array, R: Array, t: Array) -> Array:
    """Return the rows (n, COLUMNS) with x -> R x + t."""
    out = rows.copy()
    out[:, 1:4] = rows[:, 1:4] @ R.T + t
    out[:, 4:13] = (R @ rows[:, 4:13].reshape(-1, 3, 3)).reshape(-1, 9)
    return out


def along(start: Triple, end: Triple) -> tuple[Triple, Array, float]:
    """Return (middle, rotation (3, 3) that takes z to the way from start to end, half its length)."""
    a, b = np.array(start), np.array(end)
    length = float(np.linalg.norm(b - a))
    z = (b - a) / length
    x = _cross(np.array([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0]), z)
    x /= np.linalg.norm(x)
    x0, y0, z0 = ((a + b) / 2.0).tolist()
    return (x0, y0, z0), np.column_stack([x, _cross(z, x), z]), length / 2.0


def _cross(a: Array, b: Array) -> Array:
    """Return a x b of (3,) each, as numpy does it in fifteen times the time."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
