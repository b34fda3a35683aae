"""Detection by Hu's moment invariants: the blob has the shape of one of the drone's in the manual flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from noctule.camera import FixedCamera
from noctule.geometry import Array
from noctule.localization.detection.samples import FlightSamples, check_samples
from noctule.localization.detection.splinters import join_splinters
from noctule.vision.depth.blob import Blob
from noctule.vision.depth.moments import hu_moments, shape_distance

_CANDIDATES = 80  # frames, evenly spread over the flight, that a pattern is chosen from


@dataclass(frozen=True, slots=True)
class HuPatterns:
    """Accepts a blob whose shape is near to that of a pattern.

    Section 3.1.1 of Santos et al., (16) to (18) corrected. It knows no size, so it also accepts whatever has
    a drone's outline; and a blob of which a hole or a border takes a part has another shape.
    """

    name: ClassVar[str] = "hu"
    patterns: Array  # (k, 7), Hu's invariants
    threshold: float  # a distance (16) below this is the drone's

    def distance(self, blob: Blob) -> float:
        """Return the distance (16) to the nearest pattern."""
        return _distance(self.patterns, hu_moments(blob))

    def propose(self, blobs: Sequence[Blob], camera: FixedCamera) -> tuple[Blob, ...]:
        """Return the blobs whose shape is near to a pattern."""
        whole, _ = join_splinters(blobs, camera)
        return tuple(blob for blob in whole if self.distance(blob) < self.threshold)


def fit_hu(
    samples: FlightSamples, patterns: int = 3, share: float = 0.98, margin: float = 0.05
) -> HuPatterns:
    """Choose the frames that stand for the others best, and the threshold that holds `share` of the flight.

    Each pattern is the frame that brings the sum of distances to the nearest pattern down most; the threshold
    is widened by `margin` of itself. Raises as `check_samples`.
    """
    check_samples(samples)
    rows = np.linspace(0, len(samples) - 1, min(_CANDIDATES, len(samples))).round().astype(int)
    phi = samples.hu[rows]
    distances = np.array([[shape_distance(a, b) for b in phi] for a in phi])
    # A shape without third moments is infinitely far from every other: as far as the farthest will do.
    finite = distances[np.isfinite(distances)]
    distances = np.where(np.isfinite(distances), distances, finite.max(initial=1.0))
    chosen: list[int] = []
    nearest = np.full(len(phi), np.inf)
    for _ in range(min(patterns, len(phi))):
        chosen.append(int(np.argmin(np.minimum(nearest, distances).sum(axis=1))))
        nearest = np.minimum(nearest, distances[chosen[-1]])
    taken = phi[chosen]
    threshold = float(np.quantile([_distance(taken, p) for p in samples.hu], share, method="higher"))
    return HuPatterns(taken, (1.0 + margin) * threshold)


def _distance(patterns: Array, phi: Array) -> float:
    return min(shape_distance(pattern, phi) for pattern in patterns)
