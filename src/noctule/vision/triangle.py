"""The three points that span the largest triangle, the support of a virtual plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from noctule.errors import NoctuleError
from noctule.geometry import Array


class TriangleError(NoctuleError):
    """No triangle can be made of these points."""


def convex_hull(points: Array) -> NDArray[np.int64]:
    """Return the indices of the corners of the convex hull of points (n, 2), counterclockwise for y up."""
    order = np.lexsort((points[:, 1], points[:, 0]))
    xy = points.tolist()

    def chain(indices: list[int]) -> list[int]:
        kept: list[int] = []
        for k in indices:
            while len(kept) > 1:
                (ax, ay), (bx, by), (cx, cy) = xy[kept[-2]], xy[kept[-1]], xy[k]
                if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) > 0.0:
                    break
                kept.pop()
            kept.append(k)
        return kept[:-1]

    indices = order.tolist()
    return np.array(chain(indices) + chain(indices[::-1]), dtype=np.int64)


def largest_triangle(points: ArrayLike) -> NDArray[np.int64]:
    """Return the indices (3,) of the points (n, 2) that span the triangle of the largest area.

    Its corners are corners of the convex hull. They are ordered as sortPoints of Toro-Arcila et al. orders
    them, as far as its two rules agree: the largest x first, the smallest x second. (Taking the extremes of
    x and y instead of the largest area contradicts the paper itself; the area holds here.)

    Raises
    ------
    TriangleError
        For other shapes, fewer than three points, or points on one line.

    """
    xy = np.asarray(points, dtype=np.float64)
    if xy.ndim != 2 or xy.shape[1] != 2 or len(xy) < 3 or not np.isfinite(xy).all():
        raise TriangleError(
            f"largest triangle: points of shape {xy.shape}, "
            "expected (n, 2) finite numbers with n at least 3; match more points"
        )
    hull = convex_hull(xy)
    corners = xy[hull]
    if len(hull) < 3:
        raise TriangleError(
            f"largest triangle: all {len(xy)} points lie on one line, expected points around an area; "
            "match other points"
        )
    edge = corners[None, :, :] - corners[:, None, :]  # (h, h, 2), from corner i to corner j
    doubled = np.abs(
        edge[:, :, None, 0] * edge[:, None, :, 1] - edge[:, :, None, 1] * edge[:, None, :, 0]
    )  # (h, h, h)
    corner_indices = np.array(np.unravel_index(int(np.argmax(doubled)), doubled.shape))
    by_x = sorted(hull[corner_indices].tolist(), key=lambda k: (-xy[k, 0], k))
    return np.array([by_x[0], by_x[2], by_x[1]], dtype=np.int64)
