"""Points of one key image, followed through the live pictures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from noctule.geometry import Array
from noctule.vision.homography import HomographyEstimate
from noctule.vision.matching import spread

_PATIENCE = 6  # ticks in a row that a point may disagree with the others before it is dropped
_SAME = 2.0  # [px] in the key image: two points nearer than this are one


@dataclass(frozen=True, slots=True)
class TrackSet:
    """Corresponding points of a key image and the newest picture."""

    index: int
    p_ref: Array  # (n, 2) [px] in the key image
    p: Array  # (n, 2) [px] in the newest picture
    bad: NDArray[np.intp]  # (n,) ticks in a row as an outlier
    matched: float  # [s], exposure of the picture that was matched last
    estimate: HomographyEstimate | None = None  # of the last tick, to start the next one from

    def __len__(self) -> int:
        """Return how many points there are."""
        return len(self.p)

    def kept(self, mask: NDArray[np.bool_]) -> TrackSet:
        """Return the set with only the points of `mask` (n,)."""
        return replace(self, p_ref=self.p_ref[mask], p=self.p[mask], bad=self.bad[mask])

    def judged(self, estimate: HomographyEstimate, good: NDArray[np.bool_]) -> TrackSet:
        """Note the estimate, and drop the points that have not been `good` (n,) for too long."""
        bad = np.where(good, 0, self.bad + 1)
        return replace(self, bad=bad, estimate=estimate).kept(bad < _PATIENCE)

    def joined(self, p_ref: Array, p: Array, matched: float, shape: tuple[int, int], most: int) -> TrackSet:
        """Add freshly matched points (m, 2); a point that is already tracked is replaced.

        A fresh match carries no drift, so it takes the place of a track of the same feature. At most `most`
        well-spread points of the picture of `shape` (height, width) are kept.
        """
        if len(self.p_ref) and len(p_ref):
            nearest = np.linalg.norm(self.p_ref[:, None, :] - p_ref[None, :, :], axis=2).min(axis=1)
            old = self.kept(nearest > _SAME)
        else:
            old = self
        both = replace(
            self,
            p_ref=np.vstack([p_ref, old.p_ref]),
            p=np.vstack([p, old.p]),
            bad=np.concatenate([np.zeros(len(p), dtype=np.intp), old.bad]),
            matched=matched,
        )
        if len(both) <= most:
            return both
        chosen = np.zeros(len(both), dtype=np.bool_)
        # A point that agreed so far is worth more than a neighbour that does not.
        weights = np.asarray(1.0 / (1.0 + both.bad), dtype=np.float64)
        chosen[spread(both.p, shape[1], shape[0], most, weights)] = True
        return both.kept(chosen)


def empty_tracks(index: int) -> TrackSet:
    """Return a set without points."""
    none = np.empty((0, 2))
    return TrackSet(index, none, none, np.zeros(0, dtype=np.intp), -np.inf)
