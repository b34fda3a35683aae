"""Compiled fits of `registration`: the template's edges in the evidence, and its surface."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from noctule.compiled import compiled
from noctule.geometry import Array
from noctule.localization.gathering import Map

FLOOR = 0.03  # added to the variance of a cell's share: what a template of means cannot know
LEAST = 0.2  # of a cell that is drone, so that its height says something
_FAR = 0.025  # [m], after so large a move the cells that matter are listed again


@compiled
def solve3(A: Array, b: Array, x: Array) -> bool:
    """Solve A x = b for a symmetric positive definite (3, 3) matrix; False when it is not."""
    if A[0, 0] <= 0.0:
        return False
    l00 = math.sqrt(A[0, 0])
    l10, l20 = A[1, 0] / l00, A[2, 0] / l00
    d1 = A[1, 1] - l10 * l10
    if d1 <= 0.0:
        return False
    l11 = math.sqrt(d1)
    l21 = (A[2, 1] - l20 * l10) / l11
    d2 = A[2, 2] - l20 * l20 - l21 * l21
    if d2 <= 0.0:
        return False
    l22 = math.sqrt(d2)
    y0 = b[0] / l00
    y1 = (b[1] - l10 * y0) / l11
    y2 = (b[2] - l20 * y0 - l21 * y1) / l22
    x[2] = y2 / l22
    x[1] = (y1 - l21 * x[2]) / l11
    x[0] = (y0 - l10 * x[1] - l20 * x[2]) / l00
    return True


@compiled
def edge_cells(share: Map, trust: Map, edges: NDArray[np.uint8], cell: float, pose: Array, out: Array) -> int:
    """Write (x, y [m], share, trust) of the seen cells at the template's edges to `out`; return how many."""
    n, m = share.shape[0], edges.shape[0]
    c, s = math.cos(pose[2]) / cell, math.sin(pose[2]) / cell
    count = 0
    for i in range(n):
        x = (i + 0.5 - 0.5 * n) * cell
        for j in range(n):
            if trust[i, j] == 0.0:
                continue
            y = (j + 0.5 - 0.5 * n) * cell
            dx, dy = x - pose[0], y - pose[1]
            fi, fj = c * dx + s * dy + 0.5 * m, c * dy - s * dx + 0.5 * m
            if fi < 0.0 or fj < 0.0 or fi >= m or fj >= m or edges[int(fi), int(fj)] == 0:
                continue
            out[count, 0], out[count, 1], out[count, 2], out[count, 3] = x, y, share[i, j], trust[i, j]
            count += 1
    return count


@compiled
def refine(
    share: Map,
    trust: Map,
    probability: Map,
    variance: Map,
    edges: NDArray[np.uint8],
    cell: float,
    pose: Array,
    steps: int,
    information: Array,
) -> int:
    """Refine `pose` (3,) of the template in the evidence, in place, by Fisher scoring.

    The pose is x, y [m], heading [rad]. Gauss-Newton on the share of drone in a cell against the template's
    probability there, weighted by how much the cell's share varied while the template was learned. Writes the
    information (3, 3), in the template's own axes, and returns the steps taken.
    """
    m = probability.shape[0]
    inverse = 1.0 / cell
    cells = np.empty((share.size, 4))
    gradient, e, last = np.zeros(3), np.zeros(3), np.zeros(3)
    moved = 2.0 * _FAR
    count = 0
    for step in range(steps):
        if moved > _FAR:
            count = edge_cells(share, trust, edges, cell, pose, cells)
            moved = 0.0
        c, s = math.cos(pose[2]), math.sin(pose[2])
        g0, g1, g2, a00, a01, a02, a11, a12, a22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(count):
            x, y = cells[k, 0] - pose[0], cells[k, 1] - pose[1]
            qx, qy = c * x + s * y, c * y - s * x
            fi, fj = qx * inverse + 0.5 * (m - 1), qy * inverse + 0.5 * (m - 1)
            if fi < 0.0 or fj < 0.0 or fi >= m - 1 or fj >= m - 1:
                continue
            a, b = int(fi), int(fj)
            fi -= a
            fj -= b
            p00, p01 = probability[a, b], probability[a, b + 1]
            p10, p11 = probability[a + 1, b], probability[a + 1, b + 1]
            low, high = p00 + fj * (p01 - p00), p10 + fj * (p11 - p10)
            px = (high - low) * inverse
            py = (p01 - p00 + fi * (p11 - p10 - p01 + p00)) * inverse
            # The template moves by +e when the cell's place in it moves by -e.
            residual = low + fi * (high - low) - cells[k, 2]
            w = cells[k, 3] / (variance[a, b] + FLOOR)
            turn = py * qx - px * qy
            wx, wy, wt = w * px, w * py, w * turn
            g0 += wx * residual
            g1 += wy * residual
            g2 += wt * residual
            a00 += wx * px
            a01 += wx * py
            a02 += wx * turn
            a11 += wy * py
            a12 += wy * turn
            a22 += wt * turn
        gradient[0], gradient[1], gradient[2] = g0, g1, g2
        information[0, 0], information[1, 1], information[2, 2] = a00, a11, a22
        information[0, 1] = information[1, 0] = a01
        information[0, 2] = information[2, 0] = a02
        information[1, 2] = information[2, 1] = a12
        if not solve3(information, gradient, e):
            return step
        shrink = 1.0 / max(math.hypot(e[0], e[1]) / 0.02, abs(e[2]) / 0.12, 1.0)
        if e[0] * last[0] + e[1] * last[1] + 0.06 * e[2] * last[2] < 0.0:
            shrink *= 0.5  # it went too far, and would swing for long
        e[0], e[1], e[2] = shrink * e[0], shrink * e[1], shrink * e[2]
        last[:] = e
        pose[0] += c * e[0] - s * e[1]
        pose[1] += s * e[0] + c * e[1]
        pose[2] += e[2]
        size = math.hypot(e[0], e[1]) + 0.25 * abs(e[2])
        moved += size
        if size < 6e-4:
            return step + 1
    return steps


@compiled
def surface_cells(
    drone: Map, height: Map, solid: Map, surface: Map, cell: float, pose: Array, out: Array
) -> int:
    """Write (x, y in the template [m], height against the template's [m], weight) of cells with a surface.

    `pose` (3,) is x, y [m], heading [rad] of the template in the evidence; `solid` weights the template's
    cells, 0 where it has no surface. Returns how many cells were written to `out` (k, 4).
    """
    n, m = drone.shape[0], solid.shape[0]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    inverse = 1.0 / cell
    count = 0
    for i in range(n):
        x = (i + 0.5 - 0.5 * n) * cell - pose[0]
        for j in range(n):
            if drone[i, j] < LEAST:
                continue
            y = (j + 0.5 - 0.5 * n) * cell - pose[1]
            qx, qy = c * x + s * y, c * y - s * x
            fi, fj = qx * inverse + 0.5 * m, qy * inverse + 0.5 * m
            if fi < 0.0 or fj < 0.0 or fi >= m or fj >= m or solid[int(fi), int(fj)] == 0.0:
                continue
            a, b = int(fi), int(fj)
            out[count, 0], out[count, 1] = qx, qy
            out[count, 2] = height[i, j] / drone[i, j] - surface[a, b]
            out[count, 3] = min(drone[i, j], 1.0) * solid[a, b]
            count += 1
    return count


@compiled
def fit_surface(cells: Array, hold: float, out: Array) -> float:
    """Fit a plane through cells (k, 4) as `surface_cells` wrote them; `out` (3,) gets height [m] and slopes.

    Slopes are along the template's x and y; `hold` is the information that holds them at zero. Returns the
    cells used.
    """
    A, g, e = np.empty((3, 3)), np.empty(3), np.empty(3)
    total = 0.0
    # [m], Tukey's biweight, ever narrower: a thing beside the drone is ignored
    for width in (0.1, 0.04, 0.025):
        total = 0.0
        g0, g1, g2 = 0.0, -hold * out[1], -hold * out[2]
        a00, a01, a02, a11, a12, a22 = 1e-6, 0.0, 0.0, hold, 0.0, hold
        for k in range(len(cells)):
            qx, qy = cells[k, 0], cells[k, 1]
            r = cells[k, 2] - (out[0] + out[1] * qx + out[2] * qy)
            u = max(1.0 - (r / width) ** 2, 0.0)
            w = u * u * cells[k, 3]
            wx, wy = w * qx, w * qy
            total += w
            g0 += w * r
            g1 += wx * r
            g2 += wy * r
            a00 += w
            a01 += wx
            a02 += wy
            a11 += wx * qx
            a12 += wx * qy
            a22 += wy * qy
        g[0], g[1], g[2] = g0, g1, g2
        A[0, 0], A[1, 1], A[2, 2] = a00, a11, a22
        A[0, 1] = A[1, 0] = a01
        A[0, 2] = A[2, 0] = a02
        A[1, 2] = A[2, 1] = a12
        if total < 10.0 or not solve3(A, g, e):
            break
        for k in range(3):
            out[k] += e[k]
    return total
