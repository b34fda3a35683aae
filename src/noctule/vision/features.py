"""Features of a picture: where they are, and what they look like. Pixels have integer centres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.errors import NoctuleError
from noctule.geometry import Array
from noctule.vision.sift import upright_sift
from noctule.vision.spreading import bucket

Pixels = NDArray[np.uint8]


class UnknownFeatureKindError(NoctuleError):
    """A kind of feature that no detector is registered for."""


@dataclass(frozen=True, slots=True)
class Features:
    """Points of one picture with their descriptors, the most useful first."""

    p: Array  # (n, 2) [px], the centre of the top left pixel is (0, 0)
    descriptors: NDArray[np.float32] | Pixels  # (n, d): of unit length for "sift", 8 bits a byte for "orb"
    kind: str

    def __len__(self) -> int:
        """Return how many points there are."""
        return len(self.p)


def gray(pixels: Pixels) -> Pixels:
    """Return the brightness (height, width) of an RGB picture (height, width, 3); a gray one as it is."""
    if pixels.ndim == 2:
        return np.ascontiguousarray(pixels)
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def _sift(brightness: Pixels, limit: int) -> Features:
    p, descriptors = upright_sift(brightness, limit)
    return Features(p, descriptors, "sift")


def _orb(brightness: Pixels, limit: int) -> Features:
    keypoints, bits = cv2.ORB.create(nfeatures=2 * limit).detectAndCompute(brightness, None)
    if bits is None:
        return Features(np.empty((0, 2)), np.empty((0, 32), dtype=np.uint8), "orb")
    p = np.array([k.pt for k in keypoints], dtype=np.float64)
    strength = np.array([k.response for k in keypoints], dtype=np.float64)
    chosen = bucket(p, strength, (brightness.shape[0], brightness.shape[1]), limit)
    return Features(p[chosen], np.asarray(bits, dtype=np.uint8)[chosen], "orb")


DETECTORS: dict[str, Callable[[Pixels, int], Features]] = {"sift": _sift, "orb": _orb}
"""Detectors by name; a new kind is one function and one entry here."""


def detect(pixels: Pixels, kind: str = "sift", limit: int = 800) -> Features:
    """Find at most `limit` features of a gray (height, width) or RGB (height, width, 3) picture.

    "sift" is upright: it matches pictures whose roll differs by up to about 15 degrees and whose scale by
    up to two, to 0.25 px (median). "orb" turns with the picture, but is good to 1 px only.
    They are spread over the picture (see `spreading.bucket`) and their order depends on nothing but the
    picture. A picture without texture gives no features. Raises UnknownFeatureKindError.
    """
    detector = DETECTORS.get(kind)
    if detector is None:
        raise UnknownFeatureKindError(
            f"feature kind: found {kind!r}, expected one of {', '.join(sorted(DETECTORS))}; change the kind"
        )
    return detector(gray(pixels), limit)
