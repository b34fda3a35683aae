"""A drone that stands on the floor: so low that single readings hardly tell it from the floor.

A reading is foreground when it is nearer than the background by four deviations, 6 cm on a floor 3.3 m away,
and the top of a drone on the floor is 5 to 8 cm above it. But it stands still: means of half a second are
off by one depth step of the sensor at the most, half of it the background's and half their own.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from noctule.compiled import compiled
from noctule.localization.template import Template
from noctule.messages import DepthFrame
from noctule.vision.depth.background import Background

LOW = 0.2  # [m], of the body's origin above the floor, below which a drone is measured so
WINDOW = 15  # frames, half a second
_DEVIATIONS = 2.0  # that a mean differs by: a deviation is half a depth step or more
_WITHIN = 2.5  # deviations about the median that are of one thing: at an edge the mean of two is nowhere
_LEAST = 5  # readings of a pixel, of `WINDOW`
_PLANE = -0.015  # [m], as in `Grid`: high enough that the floor is told to be below it


def near_floor(background: Background, template: Template) -> tuple[Background, Template]:
    """Return background and template to locate a drone on the floor with, in frames that are `steadied`.

    Where rays count as free is raised from the drone's underside, which is as low as the floor.
    """
    known = background.count >= 0.5 * background.frames
    mean = np.ceil(background.mean - _DEVIATIONS * background.deviation)
    nearest = np.where(known, np.maximum(mean, background.nearest), background.nearest).astype(np.uint16)
    return replace(background, nearest=nearest), replace(template, grid=replace(template.grid, plane=_PLANE))


def steadied(frames: Iterable[DepthFrame], background: Background) -> Iterator[DepthFrame]:
    """Yield, for each frame of something that stands still, the mean of the last half second of each pixel.

    Of the readings near their median; the first frames of the first half second yield nothing.
    """
    within = (_WITHIN * background.deviation).astype(np.float32)
    last: deque[NDArray[np.uint16]] = deque(maxlen=WINDOW)
    for frame in frames:
        last.append(frame.depth)
        if len(last) == WINDOW:
            yield DepthFrame(frame.stamp, _mean(np.stack(last, axis=-1), within))


@compiled
def _mean(readings: NDArray[np.uint16], within: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return the mean (h, w) of the readings (h, w, n) [mm] that are `within` (h, w) [mm] of their median."""
    height, width, n = readings.shape
    out = np.zeros((height, width), np.uint16)
    ordered = np.empty(n, np.uint16)
    for v in range(height):
        for u in range(width):
            count = 0
            for k in range(n):
                reading = readings[v, u, k]
                if reading == 0:
                    continue
                at = count
                while at > 0 and ordered[at - 1] > reading:
                    ordered[at] = ordered[at - 1]
                    at -= 1
                ordered[at] = reading
                count += 1
            if count < _LEAST:
                continue
            median, total, used = float(ordered[count // 2]), 0.0, 0
            for k in range(count):
                if abs(float(ordered[k]) - median) <= within[v, u]:
                    total += float(ordered[k])
                    used += 1
            if used > 0:
                out[v, u] = int(total / used + 0.5)
    return out
