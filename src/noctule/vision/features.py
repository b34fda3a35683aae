"""Features of a picture: where they are, and what they look like. Pixels have integer centres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.errors import NoctuleError
from noctule.geometry import Array

Pixels = NDArray[np.uint8]


class UnknownFeatureKindError(NoctuleError):
    """A kind of feature that no detector is registered for."""


@dataclass(frozen=True, slots=True)
class Features:
    """Points of one picture with their descriptors, the strongest first."""

    p: Array  # (n, 2) [px], the centre of the top left pixel is (0, 0)
    descriptors: (
        NDArray[np.float32] | Pixels
    )  # (n, d): float32 of unit length for "sift", uint8 bits for "orb"
    kind: str

    def __len__(self) -> int:
        """Return how many points there are."""
        return len(self.p)


def gray(pixels: Pixels) -> Pixels:
    """Return the brightness (height, width) of an RGB picture (height, width, 3); a gray one as it is."""
    if pixels.ndim == 2:
        return np.ascontiguousarray(pixels)
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def bucket(p: Array, strength: Array, shape: tuple[int, int], limit: int) -> NDArray[np.intp]:
    """Return the indices of at most `limit` points, strong and well spread, in a fixed order.

    The picture of `shape` (height, width) [px] is cut into square cells; the strongest point of every
    cell comes before the second strongest of any.
    """
    order = np.lexsort((p[:, 0], p[:, 1], -strength))
    if len(order) == 0:
        return order
    side = max(1.0, float(np.sqrt(4.0 * shape[0] * shape[1] / max(limit, 1))))
    cells = np.floor(p[order] / side).astype(np.int64)
    key = cells[:, 1] * (int(shape[1] / side) + 2) + cells[:, 0]
    by_cell = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[by_cell], prepend=key[by_cell][0] - 1))
    sizes = np.diff(first, append=len(key))
    rank = np.empty(len(key), dtype=np.int64)
    rank[by_cell] = np.arange(len(key)) - np.repeat(first, sizes)
    return order[np.argsort(rank, kind="stable")[:limit]]


def _keypoint_arrays(keypoints: list[cv2.KeyPoint]) -> tuple[Array, Array]:
    p = np.array([k.pt for k in keypoints], dtype=np.float64).reshape(-1, 2)
    return p, np.array([k.response for k in keypoints], dtype=np.float64)


def _sift(brightness: Pixels, limit: int) -> Features:
    # The precise upscale removes a bias of a quarter pixel that the default has.
    detector = cv2.SIFT.create(nfeatures=2 * limit, enable_precise_upscale=True)
    keypoints, raw = detector.detectAndCompute(brightness, None)
    if raw is None:
        return Features(np.empty((0, 2)), np.empty((0, 128), dtype=np.float32), "sift")
    p, strength = _keypoint_arrays(keypoints)
    chosen = bucket(p, strength, brightness.shape, limit)
    root = np.sqrt(raw[chosen] / np.maximum(raw[chosen].sum(axis=1, keepdims=True), 1e-9))
    return Features(p[chosen], root, "sift")


def _orb(brightness: Pixels, limit: int) -> Features:
    keypoints, raw = cv2.ORB.create(nfeatures=2 * limit).detectAndCompute(brightness, None)
    if raw is None:
        return Features(np.empty((0, 2)), np.empty((0, 32), dtype=np.uint8), "orb")
    p, strength = _keypoint_arrays(keypoints)
    chosen = bucket(p, strength, brightness.shape, limit)
    return Features(p[chosen], raw[chosen], "orb")


DETECTORS: dict[str, Callable[[Pixels, int], Features]] = {"sift": _sift, "orb": _orb}
"""Detectors by name; a new kind is one function and one entry here."""


def detect(pixels: Pixels, kind: str = "sift", limit: int = 800) -> Features:
    """Find at most `limit` features of a gray (height, width) or RGB (height, width, 3) picture.

    They are spread over the picture (see `bucket`) and their order depends on nothing but the picture.
    A picture without texture gives no features. Raises UnknownFeatureKindError.
    """
    detector = DETECTORS.get(kind)
    if detector is None:
        raise UnknownFeatureKindError(
            f"feature kind: found {kind!r}, expected one of {', '.join(sorted(DETECTORS))}; change the kind"
        )
    return detector(gray(pixels), limit)
