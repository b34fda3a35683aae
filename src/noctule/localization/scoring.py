"""Compiled inner loops of `registration`: what cells show, and the scores of supposed poses."""

from __future__ import annotations

import math

from noctule.geometry import Array
from noctule.localization.evidence import Map
from noctule.vision.homography.compiled import compiled

FULL = 0.3
"""A cell covered this far by drone counts as drone. Sides turned to the camera fill the cells at their foot;
well below one half, cells on the far side fill as early, and the two biases cancel.
"""


@compiled
def shares(drone: Map, free: Map, full: float, share: Map, trust: Map) -> None:
    """Write how far each cell is drone (0 to 1) and how far that counts (0: unknown); all (n, n)."""
    n = drone.shape[0]
    for i in range(n):
        for j in range(n):
            share[i, j] = min(drone[i, j] / full, 1.0)
            trust[i, j] = 1.0 if drone[i, j] > 0.0 else min(free[i, j], 1.0)


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


@compiled
def judge(
    share: Map, trust: Map, drone: Map, free: Map, expected: Map, weight: Map, cell: float, pose: Array
) -> tuple[float, float, float]:
    """Return the score of a pose, what its seen cells would score if right, and their weight."""
    n, m = share.shape[0], drone.shape[0]
    c, s = math.cos(pose[2]) / cell, math.sin(pose[2]) / cell
    score, nominal, seen = 0.0, 0.0, 0.0
    for i in range(n):
        x = (i + 0.5 - 0.5 * n) * cell - pose[0]
        for j in range(n):
            t = trust[i, j]
            if t == 0.0:
                continue
            y = (j + 0.5 - 0.5 * n) * cell - pose[1]
            fi, fj = c * x + s * y + 0.5 * m, c * y - s * x + 0.5 * m
            if fi < 0.0 or fj < 0.0 or fi >= m or fj >= m:
                continue
            a, b = int(fi), int(fj)
            score += t * (share[i, j] * drone[a, b] + (1.0 - share[i, j]) * free[a, b])
            nominal += t * expected[a, b]
            seen += t * weight[a, b]
    return score, nominal, seen
