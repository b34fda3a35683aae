"""Points followed from picture to picture: pyramidal Lucas-Kanade, forward and back."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.geometry import Array
from noctule.vision.features import Pixels, gray

WINDOW = 17  # [px]
LEVELS = 3  # coarser levels above the picture itself
_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.02)
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Pyramid:
    """What tracking keeps of a picture from one tick to the next."""

    brightness: Pixels  # (height, width)

    @classmethod
    def of(cls, pixels: Pixels) -> Pyramid:
        """Make it of an RGB (height, width, 3) or gray (height, width) picture."""
        return cls(gray(pixels))

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width [px]."""
        return self.brightness.shape[0], self.brightness.shape[1]


def inside(p: Array, shape: tuple[int, int], margin: float = 0.0) -> Mask:
    """Return which points (n, 2) [px] are in a picture of `shape`, at least `margin` [px] from its edge."""
    height, width = shape
    return np.asarray(
        (p[:, 0] >= margin)
        & (p[:, 1] >= margin)
        & (p[:, 0] <= width - 1 - margin)
        & (p[:, 1] <= height - 1 - margin)
    )


def _flow(a: Pyramid, b: Pyramid, p: Array, start: Array, levels: int) -> tuple[Array, Mask]:
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        a.brightness,
        b.brightness,
        p.astype(np.float32).reshape(-1, 1, 2),
        start.astype(np.float32).reshape(-1, 1, 2),
        winSize=(WINDOW, WINDOW),
        maxLevel=levels,
        criteria=_CRITERIA,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        minEigThreshold=1e-4,
    )
    q = moved.reshape(-1, 2).astype(np.float64)
    return q, (status.ravel() == 1) & np.isfinite(q).all(axis=1)


def track(
    previous: Pyramid,
    current: Pyramid,
    p: Array,
    initial: Array | None = None,
    fb_limit: float = 0.7,
    jump_limit: float = 120.0,
) -> tuple[Array, Mask]:
    """Follow points (n, 2) [px] to `current`; return the new points (n, 2) and which are good (n,).

    A point is bad when it leaves the picture, has no texture, ends farther than `jump_limit` [px] from
    where it was expected (`initial`, or where it was), or when following it back ends farther than
    `fb_limit` [px] from its start.
    """
    if len(p) == 0:
        return np.empty((0, 2)), np.zeros(0, dtype=np.bool_)
    start = p if initial is None else initial
    p_new, found = _flow(previous, current, p, start, LEVELS)
    # Back from the same distance, so that the way back is a check of its own and not a start at the answer.
    p_back, returned = _flow(current, previous, p_new, p_new - (start - p), LEVELS)
    ok = found & returned & inside(p_new, current.shape)
    ok &= np.linalg.norm(p_back - p, axis=1) <= fb_limit
    ok &= np.linalg.norm(p_new - start, axis=1) <= jump_limit
    return p_new, ok


@dataclass(frozen=True, slots=True)
class Alignment:
    """Where points of a key image are in the live picture, and how far the pictures agree there."""

    p: Array  # (n, 2) [px] in the live picture
    ok: Mask  # (n,)
    score: Array  # (n,) normalised cross-correlation of the patches, -1 to 1


def _patches(picture: Pixels, p: Array, side: int = 15) -> NDArray[np.float32]:
    """Cut square patches around points (n, 2) [px], bilinear, (n, side * side)."""
    reach = np.arange(side, dtype=np.float32) - (side - 1) / 2.0
    x = (p[:, 0, None, None] + reach[None, None, :]).repeat(side, axis=1).reshape(-1, side)
    y = (p[:, 1, None, None] + reach[None, :, None]).repeat(side, axis=2).reshape(-1, side)
    cut = cv2.remap(
        picture, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(cut, dtype=np.float32).reshape(len(p), side * side)


def correlation(a: NDArray[np.float32], b: NDArray[np.float32]) -> Array:
    """Return the normalised cross-correlation of patches (n, k) and (n, k), (n,); 0 where one is flat."""
    a = a - a.mean(axis=1, keepdims=True)
    b = b - b.mean(axis=1, keepdims=True)
    norm = np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1))
    return np.asarray((a * b).sum(axis=1) / np.maximum(norm, 1e-3), dtype=np.float64)


def _affine(p: Array, q: Array) -> Array:
    """Return the (2, 3) affine map that takes p (n, 2) to q (n, 2), robust to a minority of bad pairs."""
    A = np.column_stack([p, np.ones(len(p))])
    weight = np.ones(len(p))
    X = np.zeros((3, 2))
    for _ in range(4):
        X[:] = np.linalg.lstsq(A * weight[:, None], q * weight[:, None], rcond=None)[0]
        residual = np.linalg.norm(A @ X - q, axis=1)
        weight = 1.0 / np.sqrt(1.0 + (residual / (2.0 * np.median(residual) + 0.5)) ** 2)
    return np.asarray(X.T)


def _warp(picture: Pyramid, warp: Array) -> Pyramid:
    height, width = picture.shape
    moved = cv2.warpAffine(
        picture.brightness, warp, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return Pyramid(np.asarray(moved, dtype=np.uint8))


def align(
    reference: Pyramid, current: Pyramid, p_ref: Array, p_initial: Array, least_score: float = 0.8
) -> Alignment:
    """Find points (n, 2) [px] of a key image in the live picture from a guess (n, 2) [px]; free of drift.

    The key image is first warped by the affine map that takes `p_ref` to `p_initial`, so that Lucas-Kanade
    sees two pictures of one scale; four points or more are needed. A point is good when the way forward and
    back closes and the patches correlate by `least_score` or more. Measured on photographs with 2 gray levels
    of noise and a guess that is 8 px off: scales from 0.5 to 2 keep more than 90 % of the points in view, to
    0.14 px (median). Plain `track` from the key image is good to 0.2 px at scales from 0.95 to 1.05, 0.4 px
    at 0.9 and 1.1, and loses a third of the points at 0.8 and 1.2. Neighbours at other depths than the
    average show other scales: the same limits hold for the ratio of theirs to the average.
    """
    if len(p_ref) < 4:
        n = len(p_ref)
        return Alignment(np.array(p_initial, dtype=np.float64), np.zeros(n, dtype=np.bool_), np.zeros(n))
    warp = _affine(p_ref, p_initial)
    warped = _warp(reference, warp)
    p_warped = np.column_stack([p_ref, np.ones(len(p_ref))]) @ warp.T
    p_new, ok = track(warped, current, p_warped, p_initial)
    ok &= inside(p_warped, current.shape)
    score = correlation(_patches(warped.brightness, p_warped), _patches(current.brightness, p_new))
    return Alignment(p_new, ok & (score >= least_score), score)
