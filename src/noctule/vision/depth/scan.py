"""The compiled pass over a depth frame: foreground, connected pieces and their moments at once."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from noctule.geometry import Array

# Columns of the runs: first pixel, pixel behind the last, row, parent in the union-find forest (later the
# label), sum of depths, sum of column times depth.
START, END, ROW, PARENT, DEPTH, U_DEPTH = range(6)
COLUMNS = 17  # of the table that `scan` returns, in the order of the fields of Blob without label and depth


@njit(cache=True, error_model="numpy")
def _root(runs: NDArray[np.int64], i: int) -> int:
    while runs[i, PARENT] != i:
        runs[i, PARENT] = runs[runs[i, PARENT], PARENT]
        i = runs[i, PARENT]
    return i


@njit(cache=True, error_model="numpy")
def _touch(
    above: NDArray[np.uint16],
    here: NDArray[np.uint16],
    run: NDArray[np.int64],
    upper: NDArray[np.int64],
    step: int,
) -> bool:
    """Return whether a pixel of `run` and one of `upper`, 8-neighbours, differ by at most `step` [mm]."""
    for u in range(max(run[START], upper[START] - 1), min(run[END], upper[END] + 1)):
        for w in range(max(upper[START], u - 1), min(upper[END], u + 2)):
            if abs(np.int64(here[u]) - np.int64(above[w])) <= step:
                return True
    return False


@njit(cache=True, error_model="numpy")
def _find_runs(
    depth: NDArray[np.uint16],
    nearest: NDArray[np.uint16],
    region: tuple[int, int, int, int],
    step: int,
    runs: NDArray[np.int64],
) -> int:
    """Fill `runs`, joined to those of the row above; return how many there are."""
    left, top, right, bottom = region
    # A row's comparison is one vectorised loop; eight pixels at a time are then skipped as a word.
    mask = np.zeros((right - left + 15) // 8 * 8, dtype=np.uint8)
    words = mask.view(np.uint64)
    n = above_first = above_end = 0
    for v in range(top, bottom):
        z, limit = depth[v, left:right], nearest[v, left:right]
        for u in range(right - left):
            mask[u] = (z[u] > 0) & (z[u] < limit[u])
        first, p = n, above_first
        seen = np.uint64(0)
        for k in range(words.shape[0]):
            seen |= words[k]
        if seen == 0:
            above_first = above_end = n
            continue
        u = 0
        for k in range(words.shape[0]):
            if words[k] == 0 or u >= 8 * (k + 1):
                continue
            u = max(u, 8 * k)
            while u < 8 * (k + 1):
                if mask[u] == 0:
                    u += 1
                    continue
                start = u
                u += 1
                while mask[u] != 0 and abs(np.int64(z[u]) - np.int64(z[u - 1])) <= step:
                    u += 1
                total = moment = np.int64(0)
                for w in range(start, u):  # on its own, so that it is vectorised
                    total += np.int64(z[w])
                    moment += w * np.int64(z[w])
                run = runs[n]
                run[START], run[END], run[ROW], run[PARENT] = start + left, u + left, v, n
                run[DEPTH], run[U_DEPTH] = total, moment + left * total
                while p < above_end and runs[p, END] < run[START]:
                    p += 1
                q = p
                while q < above_end and runs[q, START] <= run[END]:
                    a, b = _root(runs, n), _root(runs, q)
                    if a != b and _touch(depth[v - 1], depth[v], run, runs[q], step):
                        runs[max(a, b), PARENT] = min(a, b)
                    q += 1
                n += 1
        above_first, above_end = first, n
    return n


@njit(cache=True, error_model="numpy")
def _sums(first: int, end: int) -> tuple[int, int, int]:
    """Return the sums of u, u^2 and u^3 over first <= u < end."""
    a, b = first * (first - 1) // 2, end * (end - 1) // 2
    square = (end - 1) * end * (2 * end - 1) // 6 - (first - 1) * first * (2 * first - 1) // 6
    return b - a, square, b * b - a * a


@njit(cache=True, error_model="numpy")
def _central(m: NDArray[np.int64], out: Array) -> None:
    """Take raw moments m00, m10, m01, m20, m11, m02, m30, m21, m12, m03 to centroid and central moments.

    Moved to the pixel nearest the centroid in integers first, so that nothing is lost by cancellation.
    """
    n = m[0]
    a, b = round(m[1] / n), round(m[2] / n)
    m10, m01 = m[1] - a * n, m[2] - b * n
    m20 = m[3] - 2 * a * m[1] + a * a * n
    m11 = m[4] - a * m[2] - b * m[1] + a * b * n
    m02 = m[5] - 2 * b * m[2] + b * b * n
    m30 = m[6] - 3 * a * m[3] + 3 * a * a * m[1] - a * a * a * n
    m21 = m[7] - 2 * a * m[4] + a * a * m[2] - b * m[3] + 2 * a * b * m[1] - a * a * b * n
    m12 = m[8] - 2 * b * m[4] + b * b * m[1] - a * m[5] + 2 * a * b * m[2] - a * b * b * n
    m03 = m[9] - 3 * b * m[5] + 3 * b * b * m[2] - b * b * b * n
    x, y = m10 / n, m01 / n
    out[0], out[1] = a + x, b + y
    out[2], out[3], out[4] = m20 - x * m10, m11 - x * m01, m02 - y * m01
    out[5] = m30 - 3.0 * x * m20 + 2.0 * x * x * m10
    out[6] = m21 - 2.0 * x * m11 - y * m20 + 2.0 * x * x * m01
    out[7] = m12 - 2.0 * y * m11 - x * m02 + 2.0 * y * y * m10
    out[8] = m03 - 3.0 * y * m02 + 2.0 * y * y * m01


@njit(cache=True, error_model="numpy")
def scan(
    depth: NDArray[np.uint16],
    nearest: NDArray[np.uint16],
    region: tuple[int, int, int, int],
    step: int,
    min_area: int,
    intrinsics: tuple[float, float, float, float],
    labels: NDArray[np.int32],
) -> Array:
    """Return a row for each blob, (n, COLUMNS), and write 1 to n into `labels` (all 0 before).

    `region` is (left, top, right, bottom) [px], `intrinsics` (fx, fy, cx, cy) [px], `step` in [mm].
    """
    # Room for every pixel as its own run; what is not written to costs nothing.
    runs = np.empty(((region[2] - region[0]) * (region[3] - region[1]), 6), dtype=np.int64)
    n_runs = _find_runs(depth, nearest, region, step, runs)
    area = np.zeros(n_runs, dtype=np.int64)
    for i in range(n_runs):
        runs[i, PARENT] = runs[runs[i, PARENT], PARENT]  # the least of a tree is its root and comes first
        area[runs[i, PARENT]] += runs[i, END] - runs[i, START]
    label = np.zeros(n_runs, dtype=np.int64)
    n = 0
    for i in range(n_runs):
        if area[i] >= min_area:
            n += 1
            label[i] = n
    raw = np.zeros((n, 13), dtype=np.int64)
    table = np.empty((n, COLUMNS))
    for i in range(n_runs):
        k = label[runs[i, PARENT]] - 1
        if k < 0:
            continue
        start, end, v = runs[i, START], runs[i, END], runs[i, ROW]
        labels[v, start:end] = k + 1
        row, m = table[k], raw[k]
        if m[0] == 0:
            row[1], row[2], row[3] = start, v, end
        row[1], row[3], row[4] = min(row[1], start), max(row[3], end), v + 1
        width = end - start
        s1, s2, s3 = _sums(start, end)
        m[0] += width
        m[1] += s1
        m[2] += v * width
        m[3] += s2
        m[4] += v * s1
        m[5] += v * v * width
        m[6] += s3
        m[7] += v * s2
        m[8] += v * v * s1
        m[9] += v * v * v * width
        m[10] += runs[i, DEPTH]
        m[11] += runs[i, U_DEPTH]
        m[12] += v * runs[i, DEPTH]
    fx, fy, cx, cy = intrinsics
    for k in range(n):
        m, row = raw[k], table[k]
        _central(m, row[5:14])
        row[0] = m[0]
        metres = 1e-3 / m[0]
        row[14] = metres * (m[11] - cx * m[10]) / fx
        row[15] = metres * (m[12] - cy * m[10]) / fy
        row[16] = metres * m[10]
    return table
