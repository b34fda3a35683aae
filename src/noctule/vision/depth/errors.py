"""What can be wrong with the depth frames that a background is learned from or compared with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from noctule.errors import NoctuleError


class DepthFormatError(NoctuleError):
    """A depth frame that is not uint16 millimetres, or not of the expected size."""


class TooFewFramesError(NoctuleError):
    """Too few depth frames to learn a background from."""


class EmptyBackgroundError(NoctuleError):
    """A background in which too few pixels ever had a reading."""


class MovingBackgroundError(NoctuleError):
    """Something moved while the background was learned."""

    def __init__(self, box: tuple[int, int, int, int], area: int, moved: Sequence[int], frames: int) -> None:
        """Say where: `box` (left, top, right, bottom) and the greatest `area` [px], in the frames `moved`."""
        self.box, self.area, self.moved, self.frames = box, area, tuple(moved), frames
        left, top, right, bottom = box
        super().__init__(
            f"background: something moved between columns {left} and {right}, rows {top} and {bottom}, up to "
            f"{area} px at once, in {len(moved)} of {frames} frames (number {moved[0] + 1} to "
            f"{moved[-1] + 1}); expected an empty room that stands still; leave the camera's view, stop what "
            "moves there, and learn it again"
        )


def check_depth(depth: NDArray[np.uint16], shape: tuple[int, ...]) -> None:
    """Raise DepthFormatError unless `depth` is a uint16 image of `shape` (height, width)."""
    if depth.dtype == np.uint16 and depth.ndim == 2 and depth.shape == shape:
        return
    found = f"{'x'.join(map(str, depth.shape[1::-1] + depth.shape[2:]))} of {depth.dtype}"
    raise DepthFormatError(
        f"depth frame: found {found}, expected {shape[1]}x{shape[0]} of uint16 [mm]; set the camera's "
        "resolution and unit, or learn the background again with `noctule calibrate background`"
    )
