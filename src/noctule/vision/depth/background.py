"""The empty room as a depth camera sees it: what is nearer than that is foreground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from noctule.settings import Settings
from noctule.vision.depth.errors import check_depth
from noctule.vision.depth.tiles import count_tiles

Depth = NDArray[np.uint16]  # (height, width) [mm], 0 where there is no reading
Mask = NDArray[np.bool_]
Millimetres = NDArray[np.float32]

_LEAST_SEEN = 0.25  # of the tiles with a background that must be seen, so that all of them may fit


class BackgroundSettings(Settings):
    """How a background is learned."""

    step_at_1m: float = Field(
        default=2.85, ge=0.0, le=50.0, description="[mm], the sensor's depth step at 1 m; grows with z^2"
    )
    deviations: float = Field(
        default=4.0, ge=2.0, le=20.0, description="foreground is nearer by this many deviations"
    )
    min_share: float = Field(
        default=0.05, ge=0.0, le=1.0, description="a pixel is known when it had a reading in so many frames"
    )
    min_known: float = Field(
        default=0.3, ge=0.0, le=1.0, description="of the picture that must be known; less is refused"
    )


@dataclass(frozen=True, slots=True)
class Background:
    """The empty room, learned from valid readings only; a pixel is foreground iff 0 < depth < nearest."""

    mean: Millimetres  # (height, width) [mm], 0 where there never was a reading
    deviation: Millimetres  # (height, width) [mm], at least half the sensor's step there
    count: NDArray[np.int32]  # (height, width), readings
    nearest: Depth  # (height, width) [mm], depths below are foreground
    frames: int  # learned from
    deviations: float  # multiple of the deviation that a reading may differ by

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width [px]."""
        return self.nearest.shape[0], self.nearest.shape[1]

    def foreground(self, depth: Depth) -> Mask:
        """Return which pixels of a depth image are foreground; a pixel without a reading never is.

        Raises DepthFormatError for a frame of another size or type.
        """
        check_depth(depth, self.shape)
        return np.asarray((depth > 0) & (depth < self.nearest))


def deviation_floor(depth: Millimetres, step_at_1m: float) -> Millimetres:
    """Return the least deviation [mm] that readings at `depth` [mm] can be trusted to: half the depth step.

    A pixel may sit on one step while the background is learned and on the next one afterwards.
    """
    return np.asarray(np.maximum(0.5 * step_at_1m * (1e-3 * depth) ** 2, 1.0), dtype=np.float32)


def fits(background: Background, depth: Depth) -> float:
    """Return the share of the visible background that is where it was learned, 0 to 1.

    Judged in tiles of 32 x 32 pixels, by the mean difference of their readings, which shows a turn of the
    camera of less than a degree where single readings cannot. A tile that is mostly foreground (a person, a
    drone) has no say, but at least a quarter of the picture must have one. What the camera cannot see,
    it cannot tell: a camera that moved sideways over a bare level floor fits.

    Raises DepthFormatError for a frame of another size or type.
    """
    check_depth(depth, background.shape)
    there, seen, agreeing = count_tiles(
        depth, background.mean, background.deviation, background.count, 0.5 * background.frames,
        background.deviations,
    )  # fmt: skip
    return agreeing / max(seen, 1.0, _LEAST_SEEN * there)
