"""The compiled judgement of `background.fits`: tile by tile, whether what is seen is where it was learned."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from noctule.compiled import compiled

STRIDE, TILE = 4, 8  # every 4th pixel is looked at, in tiles of 8 x 8 of these
_SHARE = 0.25  # of a tile's pixels that must be known, and be seen, so that it has a say
_NEAR = 0.5  # share of the pixels seen that something nearer may hide
_FAR = 0.2  # share of them that may be farther than the background


@compiled
def count_tiles(
    depth: NDArray[np.uint16],
    mean: NDArray[np.float32],
    deviation: NDArray[np.float32],
    count: NDArray[np.int32],
    enough: float,
    deviations: float,
) -> tuple[int, int, int]:
    """Return how many tiles have a background, how many see it, and in how many it is where it was.

    `depth`, `mean` and `deviation` are (height, width) [mm]. Background is what has `enough` readings in
    `count`; a reading may differ from it by `deviations`, and the mean of a tile's by one of them. What is
    left over at the right and bottom edge is not counted.
    """
    rows = len(range(0, depth.shape[0], STRIDE)) // TILE
    columns = len(range(0, depth.shape[1], STRIDE)) // TILE
    there, seen, agreeing = 0, 0, 0
    for i in range(rows):
        for j in range(columns):
            known, judged, near, far, inside = 0, 0, 0, 0, 0
            drift, allowed = 0.0, 0.0
            for a in range(i * TILE * STRIDE, (i + 1) * TILE * STRIDE, STRIDE):
                for b in range(j * TILE * STRIDE, (j + 1) * TILE * STRIDE, STRIDE):
                    if count[a, b] < enough:
                        continue
                    known += 1
                    if depth[a, b] == 0:
                        continue
                    judged += 1
                    away = np.float64(depth[a, b]) - mean[a, b]
                    limit = deviations * deviation[a, b]
                    if away < -limit:
                        near += 1
                    elif away > limit:
                        far += 1
                    else:
                        inside += 1
                        drift += away
                        allowed += deviation[a, b]
            if known < _SHARE * TILE * TILE:
                continue
            there += 1
            if judged < _SHARE * TILE * TILE or near >= _NEAR * judged:
                continue
            seen += 1
            if far <= _FAR * judged and inside > 0 and abs(drift) <= allowed:
                agreeing += 1
    return there, seen, agreeing
