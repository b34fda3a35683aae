"""The compiled pass over a depth frame: foreground, connected pieces and their moments at once."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from noctule.geometry import Array

# Columns of the runs: first pixel, pixel behind the last, row, sum of depths, sum of column times depth.
START, END, ROW, DEPTH, U_DEPTH = range(5)
COLUMNS = 17  # of the table that `scan` returns, in the order of the fields of Blob without label and depth
MAX_LABEL = 65535


@njit(cache=True, error_model="numpy")
def _root(parent: NDArray[np.int64], i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, error_model="numpy")
def _touch(
    depth: NDArray[np.uint16], v: int, start: int, end: int, upper_start: int, upper_end: int, step: int
) -> bool:
    """Return whether two runs, in row v and above, have 8-neighbours that differ by at most `step` [mm]."""
    for u in range(max(start, upper_start - 1), min(end, upper_end + 1)):
        z = np.int64(depth[v, u])
        for w in range(max(upper_start, u - 1), min(upper_end, u + 2)):
            if abs(z - np.int64(depth[v - 1, w])) <= step:
                return True
    return False


@njit(cache=True, error_model="numpy")
def _find_runs(
    depth: NDArray[np.uint16],
    nearest: NDArray[np.uint16],
    region: tuple[int, int, int, int],
    step: int,
    runs: NDArray[np.int64],
    parent: NDArray[np.int64],
) -> int:
    """Fill `runs` and join them to those of the row above in `parent`; return how many there are.

    No array is sliced within a row: counting the references to slices costs more than the pixels do.
    """
    left, top, right, bottom = region
    # A row's comparison is one vectorised loop; eight pixels at a time are then skipped as a word.
    mask = np.zeros((right - left + 15) // 8 * 8, dtype=np.uint8)
    words = mask.view(np.uint64)
    n = above_first = above_end = 0
    for v in range(top, bottom):
        row, limit = depth[v, left:right], nearest[v, left:right]
        for u in range(right - left):
            mask[u] = (row[u] > 0) & (row[u] < limit[u])
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
                start = u + left
                z = np.int64(row[u])
                total, moment = z, start * z
                u += 1
                while mask[u] != 0:
                    following = np.int64(row[u])
                    if abs(following - z) > step:
                        break
                    z = following
                    total += z
                    moment += (u + left) * z
                    u += 1
                end = u + left
                runs[n, START], runs[n, END], runs[n, ROW] = start, end, v
                runs[n, DEPTH], runs[n, U_DEPTH] = total, moment
                parent[n] = n
                while p < above_end and runs[p, END] < start:
                    p += 1
                q = p
                while q < above_end and runs[q, START] <= end:
                    a, b = _root(parent, n), _root(parent, q)
                    if a != b and _touch(depth, v, start, end, runs[q, START], runs[q, END], step):
                        parent[max(a, b)] = min(a, b)
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
    labels: NDArray[np.uint16],
) -> Array:
    """Return a row for each blob, (n, COLUMNS), and write 1 to n into `labels` (all 0 before).

    `region` is (left, top, right, bottom) [px], `intrinsics` (fx, fy, cx, cy) [px], `step` in [mm].
    """
    # Room for every pixel as its own run; what is not written to costs nothing.
    room = (region[2] - region[0]) * (region[3] - region[1])
    runs, parent = np.empty((room, 5), dtype=np.int64), np.empty(room, dtype=np.int64)
    n_runs = _find_runs(depth, nearest, region, step, runs, parent)
    area = np.zeros(n_runs, dtype=np.int64)
    for i in range(n_runs):
        parent[i] = parent[parent[i]]  # the least of a tree is its root and comes first
        area[parent[i]] += runs[i, END] - runs[i, START]
    label = np.zeros(n_runs, dtype=np.int64)
    n = 0
    for i in range(n_runs):
        if area[i] >= min_area and n < MAX_LABEL:
            n += 1
            label[i] = n
    raw = np.zeros((n, 13), dtype=np.int64)
    table = np.empty((n, COLUMNS))
    for i in range(n_runs):
        k = label[parent[i]] - 1
        if k < 0:
            continue
        start, end, v = runs[i, START], runs[i, END], runs[i, ROW]
        for u in range(start, end):
            labels[v, u] = k + 1
        if raw[k, 0] == 0:
            table[k, 1], table[k, 2], table[k, 3] = start, v, end
        table[k, 1], table[k, 3], table[k, 4] = min(table[k, 1], start), max(table[k, 3], end), v + 1
        width = end - start
        s1, s2, s3 = _sums(start, end)
        raw[k, 0] += width
        raw[k, 1] += s1
        raw[k, 2] += v * width
        raw[k, 3] += s2
        raw[k, 4] += v * s1
        raw[k, 5] += v * v * width
        raw[k, 6] += s3
        raw[k, 7] += v * s2
        raw[k, 8] += v * v * s1
        raw[k, 9] += v * v * v * width
        raw[k, 10] += runs[i, DEPTH]
        raw[k, 11] += runs[i, U_DEPTH]
        raw[k, 12] += v * runs[i, DEPTH]
    fx, fy, cx, cy = intrinsics
    for k in range(n):
        m = raw[k]
        _central(m, table[k, 5:14])
        table[k, 0] = m[0]
        metres = 1e-3 / m[0]
        table[k, 14] = metres * (m[11] - cx * m[10]) / fx
        table[k, 15] = metres * (m[12] - cy * m[10]) / fy
        table[k, 16] = metres * m[10]
    return table
