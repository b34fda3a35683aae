"""Heading by the inertial ellipse of the blob in the image, as published."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from noctule.localization.heading.sighting import Sighting
from noctule.localization.heading.turns import HALF_TURN, nearest_turn
from noctule.messages import HeadingMeasurement
from noctule.vision.depth.moments import ellipse

_ROUND = 1.0 - 1e-6  # a shape with b/a above this has no major axis


@dataclass(frozen=True, slots=True)
class EllipseHeading:
    """Takes the major axis of the blob's ellipse for the line from tail to nose.

    Section 3.2 of Santos et al., eq. (22) corrected to theta = atan2(2 mu11, mu20 - mu02) / 2. The image of
    a tilted camera squeezes the shape along one direction, so an error that depends on the heading and on
    the place remains; the methods in the world plane do not have it.
    """

    name: ClassVar[str] = "ellipse"
    period: ClassVar[float] = HALF_TURN
    axis: float = 0.0  # [rad], where the major axis lies on a drone whose heading is 0
    sd: float = np.radians(12.0)  # [rad], without hull; with it the ellipse says nothing

    def measure(self, sighting: Sighting, predicted: float) -> HeadingMeasurement | None:
        """Return the heading in the half turn nearest to `predicted` [rad], None for a round blob."""
        shape = ellipse(sighting.blob)
        if shape.b >= _ROUND * shape.a:
            return None
        theta = shape.theta
        # The direction in the image plane, seen in the world from above.
        x, y, _ = sighting.camera.R_world_camera @ np.array([np.cos(theta), np.sin(theta), 0.0])
        yaw = nearest_turn(float(np.arctan2(y, x)) - self.axis, predicted, HALF_TURN)
        return HeadingMeasurement(sighting.frame.stamp, yaw, self.sd**2, self.name)
