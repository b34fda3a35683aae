"""Upright SIFT: Lowe's scale-space points and gradient histograms, without orientation and without doubling.

A drone's camera is upright, so turning every patch to its main gradient costs time and distinctiveness for
nothing, and the doubled first octave takes four fifths of the time. Points keep Lowe's sub-pixel refinement;
octaves are made by dropping every second pixel from (0, 0), so there is no bias between them.
Source: D. Lowe, Distinctive image features from scale-invariant keypoints, 2004; the square root of the
descriptor is Arandjelovic and Zisserman's (RootSIFT, 2012).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from noctule.geometry import Array
from noctule.vision.spreading import Index, bucket

Image = NDArray[np.float32]

SIGMA = 1.0  # [px], blur of the first level
LAYERS = 3  # layers per octave in which points are looked for
CONTRAST = 1.7  # gray levels of 255, least |difference of Gaussians|
EDGE = 10.0  # largest ratio of the principal curvatures
OCTAVES = 5
_CAMERA_BLUR = 0.5  # [px], what a sharp picture has already
_BORDER = 5  # [px] of the octave
_SIDE = 16  # samples along a patch
_SPACING = 0.75  # between samples, in units of the point's scale
_STEP = 2.0 ** (1.0 / LAYERS)


@dataclass(frozen=True, slots=True)
class ScaleSpace:
    """Blurred copies of a picture: `levels[octave]` is (LAYERS + 3, height / 2^octave, width / 2^octave)."""

    levels: tuple[Image, ...]


@dataclass(frozen=True, slots=True)
class ScalePoints:
    """Extrema of the difference of Gaussians."""

    p: Array  # (n, 2) [px] of the picture
    octave: NDArray[np.int64]  # (n,)
    layer: Array  # (n,) within the octave, refined
    strength: Array  # (n,) |difference of Gaussians|, gray levels


def scale_space(brightness: NDArray[np.uint8]) -> ScaleSpace:
    """Blur a gray picture (height, width) octave by octave."""
    base = cv2.GaussianBlur(brightness.astype(np.float32), (0, 0), math.sqrt(SIGMA**2 - _CAMERA_BLUR**2))
    octaves: list[Image] = []
    while len(octaves) < OCTAVES and min(base.shape) > 4 * _BORDER:
        levels = np.empty((LAYERS + 3, *base.shape), dtype=np.float32)
        levels[0] = base
        for i in range(1, LAYERS + 3):
            more = SIGMA * _STEP ** (i - 1) * math.sqrt(_STEP**2 - 1.0)
            cv2.GaussianBlur(levels[i - 1], (0, 0), more, dst=levels[i])
        octaves.append(levels)
        base = levels[LAYERS][::2, ::2]
    return ScaleSpace(tuple(octaves))


@njit(cache=True, nogil=True)
def _mark(D: Image, k: int, y: int, border: int, marks: NDArray[np.uint8], contrast: float) -> None:
    """Mark the pixels of a row that are strong and beat their four neighbours; of equals the first wins."""
    n = len(marks)
    least = np.float32(contrast)
    v, above, below = D[k, y, border:], D[k, y - 1, border:], D[k, y + 1, border:]
    before, after = D[k, y, border - 1 :], D[k, y, border + 1 :]
    for i in range(n):  # without branches, so that it compiles to vector instructions
        c = v[i]
        high = (c > least) & (c > before[i]) & (c > above[i]) & (c >= after[i]) & (c >= below[i])
        low = (c < -least) & (c < before[i]) & (c < above[i]) & (c <= after[i]) & (c <= below[i])
        marks[i] = high | low


@njit(cache=True, nogil=True)
def _is_extremum(D: Image, k: int, y: int, x: int) -> bool:
    v = D[k, y, x]
    for dk in (-1, 0, 1):
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                other = D[k + dk, y + dy, x + dx]
                if (v > 0.0 and other > v) or (v < 0.0 and other < v):
                    return False
    return True


@njit(cache=True, nogil=True)
def _refined_extrema(D: Image, contrast: float, edge: float, border: int, out: Array) -> int:
    """Write (x, y, layer, strength) of the stable extrema of D (layers, h, w) to `out`; return how many."""
    layers, height, width = D.shape
    marks = np.empty(width - 2 * border, dtype=np.uint8)
    n = 0
    for k0 in range(1, layers - 1):
        for y0 in range(border, height - border):
            _mark(D, k0, y0, border, marks, contrast)
            for x0 in range(border, width - border):
                if marks[x0 - border] == 0 or not _is_extremum(D, k0, y0, x0):
                    continue
                k, y, x = k0, y0, x0
                for _ in range(5):
                    c = float(D[k, y, x])
                    gx = 0.5 * (D[k, y, x + 1] - D[k, y, x - 1])
                    gy = 0.5 * (D[k, y + 1, x] - D[k, y - 1, x])
                    gk = 0.5 * (D[k + 1, y, x] - D[k - 1, y, x])
                    xx = D[k, y, x + 1] + D[k, y, x - 1] - 2.0 * c
                    yy = D[k, y + 1, x] + D[k, y - 1, x] - 2.0 * c
                    kk = D[k + 1, y, x] + D[k - 1, y, x] - 2.0 * c
                    xy = 0.25 * (
                        D[k, y + 1, x + 1] - D[k, y + 1, x - 1] - D[k, y - 1, x + 1] + D[k, y - 1, x - 1]
                    )
                    xk = 0.25 * (
                        D[k + 1, y, x + 1] - D[k + 1, y, x - 1] - D[k - 1, y, x + 1] + D[k - 1, y, x - 1]
                    )
                    yk = 0.25 * (
                        D[k + 1, y + 1, x] - D[k + 1, y - 1, x] - D[k - 1, y + 1, x] + D[k - 1, y - 1, x]
                    )
                    # Cofactors of the symmetric Hessian; the step is minus its inverse times the gradient.
                    a, b, e = yy * kk - yk * yk, xk * yk - xy * kk, xy * yk - xk * yy
                    f, g, h = xx * kk - xk * xk, xy * xk - xx * yk, xx * yy - xy * xy
                    det = xx * a + xy * b + xk * e
                    if det == 0.0:
                        break
                    dx = -(a * gx + b * gy + e * gk) / det
                    dy = -(b * gx + f * gy + g * gk) / det
                    dk = -(e * gx + g * gy + h * gk) / det
                    if max(abs(dx), abs(dy), abs(dk)) <= 0.6:
                        strength = abs(c + 0.5 * (gx * dx + gy * dy + gk * dk))
                        curved = (xx + yy) ** 2 * edge < (edge + 1.0) ** 2 * h  # false when h <= 0
                        if strength > contrast and curved and n < len(out):
                            out[n, 0], out[n, 1], out[n, 2], out[n, 3] = x + dx, y + dy, k + dk, strength
                            n += 1
                        break
                    if max(abs(dx), abs(dy), abs(dk)) > 3.0:
                        break
                    x, y, k = x + round(dx), y + round(dy), k + round(dk)
                    if not (
                        0 < k < layers - 1 and border <= x < width - border and border <= y < height - border
                    ):
                        break
    return n


def scale_points(space: ScaleSpace) -> ScalePoints:
    """Find the points of a scale space, refined in place and scale, those on edges left out."""
    rows, octave = [np.empty((0, 4))], [np.empty(0, dtype=np.int64)]
    for o, levels in enumerate(space.levels):
        differences = np.empty((len(levels) - 1, *levels.shape[1:]), dtype=np.float32)
        for i in range(len(differences)):
            cv2.subtract(levels[i + 1], levels[i], differences[i])
        out = np.empty((levels[0].size // 16 + 16, 4))
        n = _refined_extrema(differences, CONTRAST, EDGE, _BORDER, out)
        rows.append(out[:n] * [2.0**o, 2.0**o, 1.0, 1.0])
        octave.append(np.full(n, o, dtype=np.int64))
    found = np.concatenate(rows)
    return ScalePoints(found[:, :2].copy(), np.concatenate(octave), found[:, 2].copy(), found[:, 3].copy())


def _cell_weights() -> Image:
    """Weights (256, 16) of a patch's samples in its 4 x 4 cells: bilinear, under a wide Gaussian."""
    offset = np.arange(_SIDE) - (_SIDE - 1) / 2.0
    cell = (np.arange(4) - 1.5) * (_SIDE / 4)
    along = np.maximum(0.0, 1.0 - np.abs(offset[:, None] - cell) / (_SIDE / 4))
    fall = np.exp(-(offset**2) / (2.0 * (_SIDE / 2) ** 2))[:, None]
    return np.asarray(np.kron(along * fall, along * fall), dtype=np.float32)


_CELLS = _cell_weights()


def _histograms(level: Image, p: Array, step: Array) -> Image:
    """Return gradient histograms (n, 128) of patches of `level` around p (n, 2), a sample every `step`."""
    n, side = len(p), _SIDE + 2  # one more sample on each side for the gradient
    reach = np.arange(side, dtype=np.float32) - np.float32((side - 1) / 2.0)
    reach = step.astype(np.float32)[:, None] * reach
    centre = p.astype(np.float32)
    x = np.repeat((centre[:, :1] + reach)[:, None, :], side, axis=1).reshape(-1, side)
    y = np.repeat((centre[:, 1:] + reach)[:, :, None], side, axis=2).reshape(-1, side)
    cut = cv2.remap(level, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(n, side, side)
    gx = (cut[:, 1:-1, 2:] - cut[:, 1:-1, :-2]).reshape(n, -1)
    gy = (cut[:, 2:, 1:-1] - cut[:, :-2, 1:-1]).reshape(n, -1)
    size, angle = cv2.cartToPolar(gx, gy)
    angle *= np.float32(8.0 / (2.0 * np.pi))
    histograms = np.empty((n, 16, 8), dtype=np.float32)
    for b in range(8):
        away = np.abs(angle - np.float32(b))
        share = np.maximum(np.float32(1.0) - np.minimum(away, np.float32(8.0) - away), np.float32(0.0))
        histograms[:, :, b] = (share * size) @ _CELLS
    return histograms.reshape(n, 128)


def describe(space: ScaleSpace, points: ScalePoints) -> Image:
    """Return RootSIFT descriptors (n, 128) of unit length, upright."""
    raw = np.zeros((len(points.p), 128), dtype=np.float32)
    layer = np.clip(np.rint(points.layer), 1, LAYERS).astype(np.int64)
    for o, levels in enumerate(space.levels):
        for k in range(1, LAYERS + 1):
            mine = np.flatnonzero((points.octave == o) & (layer == k))
            if len(mine):
                step = _SPACING * SIGMA * _STEP ** points.layer[mine]
                raw[mine] = _histograms(levels[k], points.p[mine] / 2.0**o, step)
    length = np.linalg.norm(raw, axis=1, keepdims=True)
    clipped = np.minimum(raw / np.maximum(length, 1e-9), np.float32(0.2))
    total = clipped.sum(axis=1, keepdims=True)
    return np.asarray(np.sqrt(clipped / np.maximum(total, 1e-9)), dtype=np.float32)


def upright_sift(brightness: NDArray[np.uint8], limit: int) -> tuple[Array, Image]:
    """Return points (n, 2) [px] and descriptors (n, 128) of a gray picture, n <= `limit`."""
    space = scale_space(brightness)
    every = scale_points(space)
    chosen: Index = bucket(every.p, every.strength, (brightness.shape[0], brightness.shape[1]), limit)
    points = ScalePoints(every.p[chosen], every.octave[chosen], every.layer[chosen], every.strength[chosen])
    return points.p, describe(space, points)
