"""Which minima of the `upright` cost are answers: an exactly planar view with a free attitude has two."""

from __future__ import annotations

import numpy as np

from noctule.geometry import Array
from noctule.vision.homography.result import HomographyEstimate
from noctule.vision.homography.upright_model import TX, TZ, YAW

ALTERNATIVE_COST = 9.0
"""An answer that costs this much more than the best, three standard deviations, is no longer kept."""
SWITCH_COST = 4.0
"""A kept answer that costs this much less than the one followed takes its place."""

Minimum = tuple[float, Array]
"""A cost, and the parameters (8,) where it is reached."""


def distinct(minima: list[Minimum]) -> list[Minimum]:
    """Return the minima, best first, without those that repeat a better one."""
    kept: list[Minimum] = []
    for cost, p in sorted(minima, key=lambda minimum: minimum[0]):
        near = 0.01 + 0.03 * float(np.abs(p[TX : TZ + 1]).max())
        if all(abs(p[YAW] - q[YAW]) > 0.01 or np.abs(p - q)[TX : TZ + 1].max() > near for _, q in kept):
            kept.append((cost, p))
    return kept


def still_open(minima: list[Minimum]) -> list[Minimum]:
    """Return the answer that is followed and the alternatives that are still open, in this order.

    An alternative that costs clearly less takes the first place; one that costs clearly more, or has run into
    the answer that is followed, is dropped.
    """
    if len(minima) == 1:
        return minima
    best = min(minima, key=lambda minimum: minimum[0])
    first = best if best[0] < minima[0][0] - SWITCH_COST else minima[0]
    others = [
        minimum for minimum in minima if minimum is not first and minimum[0] < best[0] + ALTERNATIVE_COST
    ]
    return [first, *(other for other in distinct(others) if len(distinct([first, other])) == 2)]


def nearest_first(minima: list[Minimum], start: HomographyEstimate | None) -> list[Minimum]:
    """Return the minima that explain the points about as well as the best, the nearest to `start` first."""
    best = min(cost for cost, _ in minima)
    kept = [minimum for minimum in minima if minimum[0] < best + ALTERNATIVE_COST]
    if start is not None and len(kept) > 1:
        kept.sort(key=lambda minimum: float(np.linalg.norm((minimum[1] - start.parameters)[: TZ + 1])))
    return kept
