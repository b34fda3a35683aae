"""Heading by angular harmonics of the shape in the world plane: second ("plane", "axis") and fourth.

The mean of zeta^k over the surface, with zeta = x + i y in metres about the centroid, turns k times as fast
as the body: its angle over k is the heading up to 1/k of a turn. For k = 2 it holds the second moments:
zeta^2 = (x^2 - y^2) + 2 i x y, so half its angle is the major axis, eq. (22) corrected, but of the thing
itself and not of its slanted picture. For k = 4 it sees the cross of the four rotors, which with a hull is
far more pronounced than the drone's length.

A point at a distance r from the middle counts by r^power. With the power equal to k these are plain moments,
which the rotors rule; with 0 every point counts by its direction alone, and rotors that come and go do not
turn the axis of the body.
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
    power: float  # of its distance from the middle by which a point counts
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
        harmonic = angular_harmonic(points[:, :2], surface, self.order, self.power)
        if abs(harmonic) < self.min_strength:
            return None
        yaw = nearest_turn(float(np.angle(harmonic)) / self.order - self.axis, predicted, self.period)
        return HeadingMeasurement(sighting.frame.stamp, yaw, self.sd**2, self.name)


def angular_harmonic(xy: Array, weights: Array, order: int, power: float) -> complex:
    """Return the mean of e^(i order phi) over a surface in polar coordinates: a number in the unit disc.

    Parameters
    ----------
    xy
        Points (n, 2) [m] of a surface seen from above.
    weights
        Surface that each stands for (n,) [m^2].
    order
        How often the result turns while the surface turns once.
    power
        A point also counts by its distance from the middle to this power.
    """
    mean = weights @ xy / weights.sum()
    zeta = (xy - mean) @ np.array([1.0, 1j])
    radius = np.abs(zeta)
    direction = zeta / np.where(radius > 0.0, radius, 1.0)
    counted = weights * radius**power
    return complex(counted @ direction**order / counted.sum())


# Deviations are those of a drone without hull; `learning.headings` measures those of a given drone.
PLANE = ShapeHeading("plane", 2, 2.0, 0.0, np.radians(9.5), 0.02)
"""Second moments in the world plane; the drone is longer than wide."""

AXIS = ShapeHeading("axis", 2, 0.0, 0.0, np.radians(5.0), 0.02)
"""The second harmonic of the directions alone: the body's axis, whatever is seen of the rotors."""

HARMONIC = ShapeHeading("harmonic", 4, 4.0, 0.5 * QUARTER_TURN, np.radians(7.0), 0.05)
"""The fourth harmonic; rotors lie half a quarter turn off the nose. 7 deg without hull, 0.9 deg with it."""
