"""Compiled inner loops of the search in `registration`: scores of many supposed poses, in coarse blocks."""

from __future__ import annotations

import math

from noctule.compiled import compiled
from noctule.geometry import Array
from noctule.localization.gathering import Map


@compiled
def blocks(share: Map, trust: Map, size: int, cell: float, out: Array) -> int:
    """Write (x, y [m], share, trust) of blocks of size x size cells to `out` (k, 4); return how many."""
    n = share.shape[0]
    half = 0.5 * n * cell
    count = 0
    for bi in range(0, n - size + 1, size):
        for bj in range(0, n - size + 1, size):
            s, t = 0.0, 0.0
            for i in range(bi, bi + size):
                for j in range(bj, bj + size):
                    s += share[i, j] * trust[i, j]
                    t += trust[i, j]
            if t > 0.0:
                out[count, 0] = (bi + 0.5 * size) * cell - half
                out[count, 1] = (bj + 0.5 * size) * cell - half
                out[count, 2] = s / t
                out[count, 3] = t
                count += 1
    return count


@compiled
def correlate(
    points: Array, drone: Map, free: Map, cell: float, headings: Array, shift: int, reach: int, out: Array
) -> None:
    """Write scores (headings, 2 reach + 1, 2 reach + 1) of the template turned and shifted, to `out`.

    `points` (k, 4) as `blocks` wrote them; shifts are multiples of `shift` cells along the turned template's
    axes.
    """
    n = drone.shape[0]
    side = 2 * reach + 1
    out[:] = 0.0
    for h in range(len(headings)):
        c, s = math.cos(headings[h]) / cell, math.sin(headings[h]) / cell
        for k in range(len(points)):
            i0 = math.floor(c * points[k, 0] + s * points[k, 1] + 0.5 * n) + reach * shift
            j0 = math.floor(c * points[k, 1] - s * points[k, 0] + 0.5 * n) + reach * shift
            seen = points[k, 2] * points[k, 3]
            past = points[k, 3] - seen
            for a in range(side):
                i = i0 - a * shift
                if i < 0 or i >= n:
                    continue
                for b in range(side):
                    j = j0 - b * shift
                    if 0 <= j < n:
                        out[h, a, b] += seen * drone[i, j] + past * free[i, j]
