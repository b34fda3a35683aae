"""Heading by the shape's angular harmonics in the world plane: the second ("plane"), the fourth ("harmonic").

The mean of zeta^k over the surface, with zeta = x + i y in metres about the centroid, turns k times as fast
as the body: its angle over k is the heading up to 1/k of a turn. For k = 2 it holds the second moments:
zeta^2 = (x^2 - y^2) + 2 i x y, so half its angle is the major axis, eq. (22) corrected, but of the thing
itself and not of its slanted picture. For k = 4 it sees the cross of the four rotors, which is far more
pronounced than the drone's length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noctule.geometry import Array
from noctule.localization.heading.sighting import Sighting, world_points
from noctule.localization.heading.turns import FULL_TURN, QUARTER_TURN, nearest_turn
from noctule.messages import HeadingMeasurement

_MIN_POINTS = 50


@dataclass(frozen=True, slots=True)
class ShapeHeading:
    """Measures the heading by one angular harmonic."""

    name: str
    order: int  # of the harmonic, so the heading is known up to 1/order of a turn
    axis: float  # [rad], where the harmonic's peak lies on a drone whose heading is 0
    sd: float  # [rad], of the heading so measured
    min_strength: float  # 0 to 1, a flatter shape tells nothing

    @property
    def period(self) -> float:
        """1/order of a turn [rad]."""
        return FULL_TURN / self.order

    def measure(self, sighting: Sighting, predicted: float) -> HeadingMeasurement | None:
        """Return the heading nearest to `predicted` [rad], or None where the shape is too round to tell."""
        points, surface = world_points(sighting)
        if len(points) < _MIN_POINTS:
            return None
        harmonic = angular_harmonic(points[:, :2], surface, self.order)
        if abs(harmonic) < self.min_strength:
            return None
        yaw = nearest_turn(float(np.angle(harmonic)) / self.order - self.axis, predicted, self.period)
        return HeadingMeasurement(sighting.frame.stamp, yaw, self.sd**2, self.name)


def angular_harmonic(xy: Array, weights: Array, order: int) -> complex:
    """Return the weighted mean of zeta^order over that of |zeta|^order: a number within the unit disc.

    Parameters
    ----------
    xy
        Points (n, 2) [m] of a surface seen from above.
    weights
        Surface that each stands for (n,) [m^2].
    order
        How often the result turns while the surface turns once.
    """
    mean = weights @ xy / weights.sum()
    zeta = (xy - mean) @ np.array([1.0, 1j])
    raised = zeta**order
    return complex(weights @ raised / (weights @ np.abs(raised)))


PLANE = ShapeHeading("plane", 2, 0.0, np.radians(6.5), 0.02)
"""Second moments in the world plane; the drone is longer than wide."""

HARMONIC = ShapeHeading("harmonic", 4, 0.5 * QUARTER_TURN, np.radians(2.75), 0.05)
"""The fourth harmonic; rotors lie half a quarter turn off the nose."""
