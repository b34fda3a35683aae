"""The noise of the matches, read from the residuals across the epipolar lines, where no depth can hide it."""

from __future__ import annotations

import math

from noctule.compiled import compiled
from noctule.geometry import Array

PRIOR_NOISE = 4e-4
"""Noise of both images together that is assumed with few points, in normalised units: 0.2 px at
f = 510 px."""
PRIOR_POINTS = 2.0
"""How many points the assumption weighs."""
OUTLIER_WIDTH = 0.3
"""Outliers are spread evenly over this width, in normalised units."""
NORMAL_FACTOR = 1.634
"""Standard deviation of a normal distribution over the scale of the Cauchy distribution that fits it best."""


@compiled
def estimate_noise(across: Array, noise: float, used: float, rounds: int) -> float:
    """Return the noise of residuals (n,) that hold outliers, by expectation maximisation from `noise`.

    Inliers follow Cauchy's distribution (SIFT's errors have such tails), outliers a uniform one; `used` is
    the number of residuals that the fit itself has used up.
    """
    n = len(across)
    scale = noise / NORMAL_FACTOR
    share = 0.8
    members = float(n)
    for _ in range(rounds):
        members, squares = 0.0, 0.0
        flat = (1.0 - share) / OUTLIER_WIDTH
        for j in range(n):
            z2 = (across[j] / scale) ** 2
            peaked = share / ((1.0 + z2) * math.pi * scale)
            member = peaked / (peaked + flat)
            members += member
            squares += member * 2.0 / (1.0 + z2) * across[j] * across[j]
        share = (members + 1.0) / (n + 2.0)
        dof = max(members - used, 1.0)
        seen = NORMAL_FACTOR * NORMAL_FACTOR * squares / dof
        total = (PRIOR_POINTS * PRIOR_NOISE * PRIOR_NOISE + dof * seen) / (PRIOR_POINTS + dof)
        scale = math.sqrt(total) / NORMAL_FACTOR
    return scale * NORMAL_FACTOR
