"""Where the `upright` minimisation may start: three-point RANSAC over yaw, and the size of t by a median.

For a pair of views that differ by R_y(yaw) and t every point gives one equation, ((R m_ref) x m_cur)' t = 0.
Three points therefore have a common t only where the 3x3 determinant of those rows vanishes: its sign changes
over a grid of yaw are the candidates.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from noctule.compiled import compiled
from noctule.geometry import Array
from noctule.vision.homography.upright_model import (
    N_PARAMETERS,
    PITCH,
    ROLL,
    TX,
    TY,
    TZ,
    YAW,
    TwoViews,
    rotation,
)

YAW_LIMIT = 1.4
YAW_CELLS = 56
MAX_ROOTS = 6
N_DRAWS = 120
N_REFINED = 8
SAMPSON_LIMIT = 3.0
"""In standard deviations of the noise: 1.5 px with the default noise at f = 510 px."""
DISTINCT_YAW = 0.02
DISTINCT_COSINE = 0.98


@compiled
def epipolar_row(x: float, y: float, bx: float, by: float, bz: float, c: float, s: float, row: Array) -> None:
    """Write (R_y(yaw) (x, y, 1)) x b into `row` (3,); c and s are cos(yaw) and sin(yaw)."""
    ax, az = c * x + s, c - s * x
    row[0] = y * bz - az * by
    row[1] = az * bx - ax * bz
    row[2] = ax * by - y * bx


@compiled
def determinant(rows: Array) -> float:
    """Return the determinant of a (3, 3) array."""
    return float(
        rows[0, 0] * (rows[1, 1] * rows[2, 2] - rows[1, 2] * rows[2, 1])
        - rows[0, 1] * (rows[1, 0] * rows[2, 2] - rows[1, 2] * rows[2, 0])
        + rows[0, 2] * (rows[1, 0] * rows[2, 1] - rows[1, 1] * rows[2, 0])
    )


@compiled
def fill_rows(m_ref: Array, bearings: Array, triple: Array, yaw: float, rows: Array) -> float:
    """Write the three epipolar rows for `yaw` into `rows` (3, 3); return their determinant."""
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(3):
        j = triple[k]
        epipolar_row(m_ref[j, 0], m_ref[j, 1], bearings[k, 0], bearings[k, 1], bearings[k, 2], c, s, rows[k])
    return determinant(rows)


@compiled
def null_direction(rows: Array, d: Array) -> bool:
    """Write the unit vector that is orthogonal to the rows of a rank 2 (3, 3) array into `d`."""
    best = 0.0
    for i in range(3):
        a, b = rows[i], rows[(i + 1) % 3]
        cx, cy, cz = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
        size = cx * cx + cy * cy + cz * cz
        if size > best:
            best = size
            d[0], d[1], d[2] = cx, cy, cz
    if not best > 0.0:
        return False
    d /= math.sqrt(best)
    return True


@compiled
def sampson_score(R: Array, d: Array, m_ref: Array, m_cur: Array, limit: float) -> float:
    """Return the sum over points of min(Sampson distance^2 / limit^2, 1) for rotation R, direction d."""
    E = np.empty((3, 3))
    for k in range(3):
        E[0, k] = d[1] * R[2, k] - d[2] * R[1, k]
        E[1, k] = d[2] * R[0, k] - d[0] * R[2, k]
        E[2, k] = d[0] * R[1, k] - d[1] * R[0, k]
    total = 0.0
    for j in range(len(m_ref)):
        x, y, u, v = m_ref[j, 0], m_ref[j, 1], m_cur[j, 0], m_cur[j, 1]
        a0 = E[0, 0] * x + E[0, 1] * y + E[0, 2]
        a1 = E[1, 0] * x + E[1, 1] * y + E[1, 2]
        a2 = E[2, 0] * x + E[2, 1] * y + E[2, 2]
        b0 = E[0, 0] * u + E[1, 0] * v + E[2, 0]
        b1 = E[0, 1] * u + E[1, 1] * v + E[2, 1]
        algebraic = u * a0 + v * a1 + a2
        squared = algebraic * algebraic / ((a0 * a0 + a1 * a1 + b0 * b0 + b1 * b1 + 1e-30) * limit * limit)
        total += min(squared, 1.0)
    return total


@compiled
def sample_candidates(
    m_ref: Array, m_cur: Array, triples: NDArray[np.int64], tilts: Array, limit: float
) -> tuple[Array, Array]:
    """Return candidates (k, 6), each (yaw, d, roll, pitch), of `triples` and `tilts`, and their scores."""
    found = np.empty((len(triples) * MAX_ROOTS, 6))
    scores = np.empty(len(triples) * MAX_ROOTS)
    count = 0
    bearings = np.empty((3, 3))
    rows = np.empty((3, 3))
    d = np.empty(3)
    cell = 2.0 * YAW_LIMIT / YAW_CELLS
    for i in range(len(triples)):
        roll, pitch = tilts[i, 0], tilts[i, 1]
        R_tilt = rotation(0.0, roll, pitch)
        for k in range(3):
            u, v = m_cur[triples[i, k], 0], m_cur[triples[i, k], 1]
            for axis in range(3):
                bearings[k, axis] = R_tilt[0, axis] * u + R_tilt[1, axis] * v + R_tilt[2, axis]
        before = fill_rows(m_ref, bearings, triples[i], -YAW_LIMIT, rows)
        roots = 0
        for step in range(1, YAW_CELLS + 1):
            high = -YAW_LIMIT + step * cell
            value = fill_rows(m_ref, bearings, triples[i], high, rows)
            if before * value <= 0.0 and roots < MAX_ROOTS and before != value:
                low, f_low, f_high = high - cell, before, value
                yaw = low
                for _ in range(4):
                    yaw = low + (high - low) * f_low / (f_low - f_high)
                    f_mid = fill_rows(m_ref, bearings, triples[i], yaw, rows)
                    if f_low * f_mid <= 0.0:
                        high, f_high = yaw, f_mid
                        f_low *= 0.5
                    else:
                        low, f_low = yaw, f_mid
                        f_high *= 0.5
                if null_direction(rows, d):
                    found[count, 0] = yaw
                    found[count, 1:4] = d
                    found[count, 4], found[count, 5] = roll, pitch
                    scores[count] = sampson_score(rotation(yaw, roll, pitch), d, m_ref, m_cur, limit)
                    count += 1
                    roots += 1
            before = value
    return found[:count], scores[:count]


@compiled
def distinct_best(
    found: Array, scores: Array, n_best: int, yaw_gap: float, cosine: float
) -> NDArray[np.int64]:
    """Return the indices of the `n_best` best scores that differ by `yaw_gap` [rad] or in direction."""
    order = np.argsort(scores)
    kept = np.empty(n_best, dtype=np.int64)
    count = 0
    for index in order:
        fresh = True
        for k in range(count):
            other = kept[k]
            along = (
                found[index, 1] * found[other, 1]
                + found[index, 2] * found[other, 2]
                + found[index, 3] * found[other, 3]
            )
            if abs(found[index, 0] - found[other, 0]) < yaw_gap and abs(along) > cosine:
                fresh = False
                break
        if fresh:
            kept[count] = index
            count += 1
            if count == n_best:
                break
    return kept[:count]


@compiled
def sized_start(candidate: Array, m_ref: Array, m_cur: Array, limit: float, out: Array) -> None:
    """Write the parameters (8,) of a candidate (yaw, d, roll, pitch): t = median over points of rho, times d.

    rho solves m_cur x (R m_ref + rho d) = 0 by least squares; a point weighs with the square root of how well
    it determines rho, and outliers of the epipolar geometry do not count. A negative median turns d around.
    """
    n = len(m_ref)
    R = rotation(candidate[0], candidate[4], candidate[5])
    dx, dy, dz = candidate[1], candidate[2], candidate[3]
    depth = np.empty(n)
    weight = np.empty(n)
    for j in range(n):
        x, y, u, v = m_ref[j, 0], m_ref[j, 1], m_cur[j, 0], m_cur[j, 1]
        qx = R[0, 0] * x + R[0, 1] * y + R[0, 2]
        qy = R[1, 0] * x + R[1, 1] * y + R[1, 2]
        qz = R[2, 0] * x + R[2, 1] * y + R[2, 2]
        ex, ey = qx - u * qz, qy - v * qz
        gx, gy = dx - u * dz, dy - v * dz
        gg = gx * gx + gy * gy + 1e-12
        depth[j] = -(gx * ex + gy * ey) / gg
        across = (gx * ey - gy * ex) ** 2 / (gg * limit * limit * max(qz, 0.1) ** 2)
        weight[j] = math.sqrt(gg) / (1.0 + across * across)
    order = np.argsort(depth)
    half = 0.5 * weight.sum()
    reached = 0.0
    size = 0.0
    for j in order:
        reached += weight[j]
        if reached >= half:
            size = depth[j]
            break
    out[:] = 0.0
    out[YAW], out[ROLL], out[PITCH] = candidate[0], candidate[4], candidate[5]
    out[TX], out[TY], out[TZ] = size * dx, size * dy, size * dz


def cold_starts(
    views: TwoViews, attitude_sd: float, seed: int, n_draws: int = N_DRAWS, n_best: int = N_REFINED
) -> list[Array]:
    """Return parameters (8,) to start from: the best distinct ones of RANSAC, and the view that only turned.

    Roll and pitch of each draw come from their prior. The generator is made afresh from `seed` at each call.
    """
    rng = np.random.default_rng(seed)
    triples = rng.random((n_draws, len(views.m_ref))).argpartition(3, axis=1)[:, :3]
    tilts = rng.normal(0.0, 1.0, (n_draws, 2)) * attitude_sd
    limit = SAMPSON_LIMIT * views.noise
    found, scores = sample_candidates(views.m_ref, views.m_cur, triples, tilts, limit)
    starts = []
    for index in distinct_best(found, scores, n_best, DISTINCT_YAW, DISTINCT_COSINE):
        start = np.zeros(N_PARAMETERS)
        sized_start(found[index], views.m_ref, views.m_cur, limit, start)
        starts.append(start)
    turned = np.zeros(N_PARAMETERS)
    turned[YAW] = np.median(np.arctan(views.m_cur[:, 0]) - np.arctan(views.m_ref[:, 0]))
    return [*starts, turned]
