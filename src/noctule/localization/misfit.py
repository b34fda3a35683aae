"""Compiled measures of how well a template fits: of all its cells, and of those that tell quarter turns."""

from __future__ import annotations

import math

import numpy as np

from noctule.compiled import compiled
from noctule.geometry import Array
from noctule.localization.fitting import LEAST, fit_surface
from noctule.localization.gathering import Map

# of a cell's maps, side by side: one place in memory for all that a cell is asked
LOG_DRONE, LOG_FREE, EXPECTED, WEIGHT, PROBABILITY, CERTAINTY, SOLID, HEIGHT = range(8)


@compiled
def assess(
    share: Map,
    trust: Map,
    drone: Map,
    height: Map,
    cells: Map,
    cell: float,
    pose: Array,
    hold: float,
    height_sd: float,
    surface: Array,
) -> tuple[float, float, float, float, float, float]:
    """Fit the surface at a pose (3,) to `surface` (3,), and measure how well all fits there.

    `cells` (m, m, 8) are the template's; `hold` and `surface` as in `fit_surface`. Returns the score, what
    the seen cells would score if the pose were right, their weight, the misfit of the outline and of the
    surface per cell (half squares over variances; beyond three of `height_sd` [m], the spread of a cell's
    height, a cell is something else), and the cells used for the surface.
    """
    n, m = share.shape[0], cells.shape[0]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    inverse = 1.0 / cell
    tops = np.empty((share.size, 4))
    count = 0
    score, nominal, seen, outline = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        x = (i + 0.5 - 0.5 * n) * cell - pose[0]
        for j in range(n):
            t = trust[i, j]
            if t == 0.0:
                continue
            y = (j + 0.5 - 0.5 * n) * cell - pose[1]
            qx, qy = c * x + s * y, c * y - s * x
            fi, fj = qx * inverse + 0.5 * m, qy * inverse + 0.5 * m
            if fi < 0.0 or fj < 0.0 or fi >= m or fj >= m:
                continue
            there = cells[int(fi), int(fj)]
            if there[WEIGHT] == 0.0:
                continue
            share_here = share[i, j]
            score += t * (share_here * there[LOG_DRONE] + (1.0 - share_here) * there[LOG_FREE])
            nominal += t * there[EXPECTED]
            seen += t * there[WEIGHT]
            outline += t * there[CERTAINTY] * (share_here - there[PROBABILITY]) ** 2
            if drone[i, j] >= LEAST and there[SOLID] > 0.0:
                tops[count, 0], tops[count, 1] = qx, qy
                tops[count, 2] = height[i, j] / drone[i, j] - there[HEIGHT]
                tops[count, 3] = min(drone[i, j], 1.0) * there[SOLID]
                count += 1
    used = fit_surface(tops[:count], hold, surface)
    relief, total = 0.0, 0.0
    most = (3.0 * height_sd) ** 2
    for k in range(count):
        r = tops[k, 2] - (surface[0] + surface[1] * tops[k, 0] + surface[2] * tops[k, 1])
        relief += tops[k, 3] * min(r * r, most)
        total += tops[k, 3]
    relief /= height_sd**2 * max(total, 1.0)
    return score, nominal, seen, 0.5 * outline / max(seen, 1.0), 0.5 * relief, used


@compiled
def contrast(
    share: Map,
    trust: Map,
    drone: Map,
    height: Map,
    telling: Array,
    cell: float,
    pose: Array,
    surface: Array,
    height_sd: float,
) -> float:
    """Return the misfit at a pose of the cells `telling` (k, 6).

    These are x, y [m], probability, height [m], and weights of outline (over its variance) and surface.
    """
    n = share.shape[0]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    outline, relief = 0.0, 0.0
    most = (3.0 * height_sd) ** 2
    for k in range(len(telling)):
        qx, qy = telling[k, 0], telling[k, 1]
        fi = (pose[0] + c * qx - s * qy) / cell + 0.5 * n
        fj = (pose[1] + s * qx + c * qy) / cell + 0.5 * n
        if fi < 0.0 or fj < 0.0 or fi >= n or fj >= n:
            continue
        i, j = int(fi), int(fj)
        difference = share[i, j] - telling[k, 2]
        outline += telling[k, 4] * trust[i, j] * difference * difference
        if drone[i, j] >= LEAST:
            plane = telling[k, 3] + surface[0] + surface[1] * qx + surface[2] * qy
            r = height[i, j] / drone[i, j] - plane
            relief += telling[k, 5] * min(drone[i, j], 1.0) * min(r * r, most)
    return 0.5 * (outline + relief / height_sd**2)
