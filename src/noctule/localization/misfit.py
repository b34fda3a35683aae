"""Compiled measures of how badly a template fits: of all its cells, and of those that tell the half turn."""

from __future__ import annotations

import math

from noctule.geometry import Array
from noctule.localization.evidence import Map
from noctule.localization.fitting import FLOOR
from noctule.vision.homography.compiled import compiled


@compiled
def misfit(
    share: Map,
    trust: Map,
    drone: Map,
    height: Map,
    probability: Map,
    variance: Map,
    weight: Map,
    solid: Map,
    surface: Map,
    cell: float,
    pose: Array,
    fitted: Array,
    height_sd: float,
) -> tuple[float, float, float]:
    """Return how badly outline and surface fit at a pose, and the weight of the surface's cells.

    Misfits are half sums of squares over variances; `weight` and `solid` weight the template's cells in the
    two. `fitted` (3,) is the surface's height offset [m] and slopes, `height_sd` [m] the spread of a cell's
    height; beyond three of it a cell is something else.
    """
    n, m = share.shape[0], probability.shape[0]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    inverse = 1.0 / cell
    outline, relief, total = 0.0, 0.0, 0.0
    most = (3.0 * height_sd) ** 2
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
            a, b = int(fi), int(fj)
            outline += weight[a, b] * t * (share[i, j] - probability[a, b]) ** 2 / (variance[a, b] + FLOOR)
            if drone[i, j] > 0.2 and solid[a, b] > 0.0:
                r = height[i, j] / drone[i, j] - surface[a, b] - (fitted[0] + fitted[1] * qx + fitted[2] * qy)
                w = solid[a, b] * min(drone[i, j], 1.0)
                relief += w * min(r * r, most)
                total += w
    return 0.5 * outline, 0.5 * relief / height_sd**2, total


@compiled
def contrast(
    share: Map,
    trust: Map,
    drone: Map,
    height: Map,
    probability: Map,
    variance: Map,
    surface: Map,
    telling: Array,
    cell: float,
    pose: Array,
    fitted: Array,
    height_sd: float,
) -> float:
    """Return the misfit of the cells `telling` (k, 4): i, j, weights of outline and surface."""
    n, m = share.shape[0], probability.shape[0]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    outline, relief = 0.0, 0.0
    most = (3.0 * height_sd) ** 2
    for k in range(len(telling)):
        a, b = int(telling[k, 0]), int(telling[k, 1])
        qx, qy = (a + 0.5 - 0.5 * m) * cell, (b + 0.5 - 0.5 * m) * cell
        fi = (pose[0] + c * qx - s * qy) / cell + 0.5 * n
        fj = (pose[1] + s * qx + c * qy) / cell + 0.5 * n
        if fi < 0.0 or fj < 0.0 or fi >= n or fj >= n:
            continue
        i, j = int(fi), int(fj)
        difference = share[i, j] - probability[a, b]
        outline += telling[k, 2] * trust[i, j] * difference * difference / (variance[a, b] + FLOOR)
        if drone[i, j] > 0.2:
            r = height[i, j] / drone[i, j] - surface[a, b] - (fitted[0] + fitted[1] * qx + fitted[2] * qy)
            relief += telling[k, 3] * min(drone[i, j], 1.0) * min(r * r, most)
    return 0.5 * (outline + relief / height_sd**2)
