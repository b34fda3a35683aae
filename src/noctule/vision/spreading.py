"""Choosing points that cover the picture; both ways are deterministic."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from noctule.geometry import Array

Index = NDArray[np.intp]


def bucket(p: Array, strength: Array, shape: tuple[int, int], limit: int) -> Index:
    """Return the indices of at most `limit` points (n, 2) [px], strong and well spread, in a fixed order.

    The picture of `shape` (height, width) [px] is cut into square cells, about four points for each; the
    strongest point of every cell comes before the second strongest of any.
    """
    order = np.lexsort((p[:, 0], p[:, 1], -strength))
    if len(order) == 0:
        return order
    side = max(1.0, float(np.sqrt(4.0 * shape[0] * shape[1] / max(limit, 1))))
    cells = np.floor(p[order] / side).astype(np.int64)
    key = cells[:, 1] * (int(shape[1] / side) + 2) + cells[:, 0]
    by_cell = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[by_cell], prepend=key[by_cell][0] - 1))
    sizes = np.diff(first, append=len(key))
    rank = np.empty(len(key), dtype=np.int64)
    rank[by_cell] = np.arange(len(key)) - np.repeat(first, sizes)
    return order[np.argsort(rank, kind="stable")[:limit]]


def spread(p: Array, width: int, height: int, most: int = 60, weights: Array | None = None) -> Index:
    """Return the indices, ascending, of at most `most` points (n, 2) [px], well spread over the picture.

    Greedy farthest point selection in the `width` x `height` picture, where the distance of a point is
    multiplied by its weight (n,) > 0 (1 without `weights`), so of two neighbours the better one stays. The
    picture's edge counts as half a neighbour: what is near it is soon gone.
    """
    n = len(p)
    if n <= most:
        return np.arange(n)
    scaled = np.asarray(p, dtype=np.float64) / max(width, height)
    weight = np.ones(n) if weights is None else np.asarray(weights, dtype=np.float64)
    far_corner = np.array([width - 1.0, height - 1.0]) / max(width, height)
    chosen = np.empty(most, dtype=np.intp)
    nearest = (2.0 * np.minimum(scaled, far_corner - scaled).min(axis=1)) ** 2
    for k in range(most):
        chosen[k] = np.argmax(nearest * weight**2)
        nearest = np.minimum(nearest, np.sum((scaled - scaled[chosen[k]]) ** 2, axis=1))
        nearest[chosen[: k + 1]] = -1.0
    return np.sort(chosen)
