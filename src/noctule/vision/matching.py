"""Which features of two pictures belong together: nearest neighbours, then robust geometry."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.camera import PinholeCamera
from noctule.errors import NoctuleError
from noctule.geometry import Array
from noctule.vision.features import Features
from noctule.vision.spreading import Index, spread

__all__ = ["FeatureKindError", "Matches", "match", "match_robust", "robust_geometry", "spread"]

_SCALE = 500.0  # OpenCV's robust estimators have absolute tolerances made for pixels


class FeatureKindError(NoctuleError):
    """Features of two kinds cannot be compared."""


@dataclass(frozen=True, slots=True)
class Matches:
    """Points that two pictures share, or the reason why there are none."""

    p_ref: Array  # (n, 2) [px]
    p_current: Array  # (n, 2) [px]
    n_ratio: int  # matches that passed the ratio test, before geometry
    quality: Array  # (n,) in [0, 1], one minus the ratio of nearest to second nearest distance
    reason: str = ""  # empty when the matches are good

    def __len__(self) -> int:
        """Return how many matches there are."""
        return len(self.p_ref)


def _unit_vectors(features: Features) -> NDArray[np.float32]:
    if features.descriptors.dtype == np.uint8:
        # Bits as +-1: the squared distance of two such unit vectors is 4 / bits times their Hamming distance.
        signs = 2.0 * np.unpackbits(features.descriptors.view(np.uint8), axis=1).astype(np.float32) - 1.0
        return np.asarray(signs / np.sqrt(np.float32(max(signs.shape[1], 1))), dtype=np.float32)
    return np.asarray(features.descriptors, dtype=np.float32)


def _match_with_ratio(ref: Features, current: Features, ratio: float) -> tuple[Index, Index, Array]:
    if ref.kind != current.kind:
        raise FeatureKindError(
            f"matching: the key image has {ref.kind!r} features and the live picture {current.kind!r}; "
            "both must be of one kind: teach the path again or change the kind"
        )
    if len(ref) < 2 or len(current) < 2:
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp), np.empty(0)
    squared = np.maximum(2.0 - 2.0 * (_unit_vectors(ref) @ _unit_vectors(current).T), 0.0)
    forward = np.argmin(squared, axis=1)
    back = np.argmin(squared, axis=0)
    rows = np.arange(len(ref))
    nearest = squared[rows, forward].astype(np.float64)
    squared[rows, forward] = np.inf
    second = squared.min(axis=1).astype(np.float64)
    relative = nearest / np.maximum(second, 1e-12)
    if ref.descriptors.dtype != np.uint8:
        relative = np.sqrt(relative)  # L2 is the root of what was computed, Hamming is proportional to it
    good = (back[forward] == rows) & (relative < ratio)
    return rows[good], forward[good], 1.0 - relative[good]


def match(ref: Features, current: Features, ratio: float = 0.8) -> tuple[Index, Index]:
    """Return indices (n,) into `ref` and `current` of mutual nearest neighbours that pass the ratio test.

    L2 for "sift", Hamming for "orb". Raises FeatureKindError.
    """
    index_ref, index_current, _ = _match_with_ratio(ref, current, ratio)
    return index_ref, index_current


def robust_geometry(m_ref: Array, m_current: Array, threshold: float = 0.004) -> NDArray[np.bool_]:
    """Return which pairs (n, 2), (n, 2) of normalised points agree with one rigid scene, (n,) bool.

    `threshold` is a distance in normalised units (0.004 is 2 px at a focal length of 500 px). A pair counts
    when it fits the essential matrix or the homography: in a planar scene, under pure rotation or with a
    tiny baseline the first is undetermined, in depth the second is. With fewer than eight pairs nothing can
    be said: all False.
    """
    n = len(m_ref)
    if n < 8:
        return np.zeros(n, dtype=np.bool_)
    parameters = cv2.UsacParams()
    parameters.randomGeneratorState = 1
    parameters.threshold = threshold * _SCALE
    parameters.score = cv2.SCORE_METHOD_MAGSAC
    parameters.maxIterations = 2000
    a = np.ascontiguousarray(m_ref, dtype=np.float64) * _SCALE
    b = np.ascontiguousarray(m_current, dtype=np.float64) * _SCALE
    K = np.diag([_SCALE, _SCALE, 1.0])
    none = np.zeros(4)
    _, by_epipolar = cv2.findEssentialMat(a, b, K, K, none, none, parameters)
    _, by_plane = cv2.findHomography(a, b, parameters)
    keep = np.zeros(n, dtype=np.bool_)
    for mask in (by_epipolar, by_plane):
        if mask is not None and len(mask) == n:
            keep |= np.asarray(mask).ravel() != 0
    return keep


def match_robust(
    ref: Features,
    current: Features,
    camera_ref: PinholeCamera,
    camera_current: PinholeCamera | None = None,
    ratio: float = 0.8,
    threshold: float = 2.0,
    fewest: int = 14,
) -> Matches:
    """Match two pictures' features: ratio test, then robust geometry with a `threshold` [px].

    Too few matches (below `fewest`) are no exception: the result is empty and says why. Between unrelated
    photographs up to eleven features agreed by chance, hence the default. Deterministic.
    """
    index_ref, index_current, quality = _match_with_ratio(ref, current, ratio)
    n_ratio = len(index_ref)
    nothing = np.empty((0, 2))
    if n_ratio < max(fewest, 8):
        reason = f"{n_ratio} features look alike, {max(fewest, 8)} are needed"
        return Matches(nothing, nothing, n_ratio, np.empty(0), reason)
    p_ref, p_current = ref.p[index_ref], current.p[index_current]
    other = camera_current or camera_ref
    keep = robust_geometry(
        camera_ref.normalise(p_ref), other.normalise(p_current), threshold / float(np.mean(camera_ref.focal))
    )
    if int(keep.sum()) < fewest:
        reason = (
            f"{int(keep.sum())} of {n_ratio} features that look alike fit one geometry, {fewest} are needed"
        )
        return Matches(nothing, nothing, n_ratio, np.empty(0), reason)
    return Matches(p_ref[keep], p_current[keep], n_ratio, quality[keep])
