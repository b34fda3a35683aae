"""Heading by two coloured markers, red on the nose and blue on the tail: a full turn, where colour is on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.geometry import Array
from noctule.localization.heading.sighting import SLAB, Sighting
from noctule.localization.heading.turns import FULL_TURN, nearest_turn
from noctule.messages import HeadingMeasurement
from noctule.vision.columns import ColumnColour, colour_mask

_RED = ColumnColour(hue=0.0, tolerance=18.0, min_saturation=0.5, min_value=0.2)
_BLUE = ColumnColour(hue=225.0, tolerance=25.0, min_saturation=0.5, min_value=0.2)
_POWER = 1.25  # by which the sd falls with the pixels of the smaller marker: measured
_MOST = 4.0  # times `pixels`; no better beyond


@dataclass(frozen=True, slots=True)
class MarkerHeading:
    """Measures the heading from the tail's marker to the nose's.

    Eq. (28) of Santos et al., corrected to atan2: the full turn is known. The centres of the markers are
    taken to the world with their depth first, so that no slant of the picture is left in the angle. HSV is
    searched in the region of interest around the blob only.
    """

    name: ClassVar[str] = "markers"
    period: ClassVar[float] = FULL_TURN
    front: ColumnColour = _RED
    back: ColumnColour = _BLUE
    shortest: float = 0.05  # [m], between the markers, seen from above
    longest: float = 0.60  # [m]
    min_pixels: int = 6  # of each marker
    axis: float = 0.0  # [rad], the line from back to front on a drone whose heading is 0
    sd: float = np.radians(1.05)  # [rad], at `reference` between markers of `pixels` each
    reference: float = 0.19  # [m]
    pixels: float = 100.0

    def measure(self, sighting: Sighting, predicted: float = 0.0) -> HeadingMeasurement | None:
        """Return the heading in the turn nearest to `predicted` [rad], None unless both markers are seen."""
        if sighting.frame.colour is None:
            return None
        front = self._find(sighting, self.front)
        back = self._find(sighting, self.back)
        if front is None or back is None:
            return None
        along = front[0][:2] - back[0][:2]
        length = float(np.hypot(*along))
        if not self.shortest <= length <= self.longest:
            return None
        yaw = nearest_turn(float(np.arctan2(along[1], along[0])) - self.axis, predicted, FULL_TURN)
        # What is far has fewer pixels, and each of them a coarser depth.
        fewest = min(front[1], back[1], _MOST * self.pixels)
        sd = self.sd * self.reference / length * (self.pixels / fewest) ** _POWER
        return HeadingMeasurement(sighting.frame.stamp, yaw, sd**2, self.name)

    def _find(self, sighting: Sighting, colour: ColumnColour) -> tuple[Array, int] | None:
        """Return the centre (3,) [m] in the world of the largest patch of a colour, and its pixels."""
        assert sighting.frame.colour is not None
        blob = sighting.blob
        window = np.s_[max(blob.top, 0) : blob.bottom, max(blob.left, 0) : blob.right]
        rgb = np.ascontiguousarray(sighting.frame.colour[window])
        hsv = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV_FULL), dtype=np.uint8)
        depth = sighting.frame.depth[window] * 1e-3
        # Holes in the depth are common on a small marker; what is clearly at another depth is not on it.
        near = (depth == 0.0) | (np.abs(depth - blob.depth) < SLAB)
        mask = np.where(near, colour_mask(hsv, colour), 0).astype(np.uint8)
        patch = _largest(mask, self.min_pixels)
        if patch is None:
            return None
        rows, columns = np.nonzero(patch)
        measured = depth[patch & (depth > 0.0)]
        # The mean, not the median: far away the sensor steps by centimetres, and noise averages that out.
        z = float(measured.mean()) if len(measured) else blob.depth
        p = np.array([[columns.mean() + window[1].start, rows.mean() + window[0].start]])
        return np.asarray(sighting.camera.to_world(p, np.array([z]))[0]), len(rows)


def _largest(mask: NDArray[np.uint8], min_pixels: int) -> NDArray[np.bool_] | None:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count < 2:
        return None
    best = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    if stats[best, cv2.CC_STAT_AREA] < min_pixels:
        return None
    return np.asarray(labels == best)
