"""What the vehicle says of its heading, and which half turn of what is seen from above it bears out.

The view from above tells the half turn in most frames, but where it errs it errs for seconds. What the
vehicle says of its heading, off by up to 30 deg, tells it at the start, later the estimate does. And the way
the camera sees it fly is compared with the velocity that it says: while these point opposite ways, the half
turn held is the wrong one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from noctule.estimation.filter_state import StateEstimate
from noctule.estimation.sensors import OnboardSensors
from noctule.geometry import wrap_angle
from noctule.localization.heading.turns import HALF_TURN, nearest_turn
from noctule.messages import PoseMeasurement, VehicleState

_MOVES = 0.1  # [m/s], slower than this nothing is said of the half turn
_PER_REPORT, _CERTAIN = 2.0, 20.0  # log-likelihood ratios


def faced(pose: PoseMeasurement, known: float | None) -> PoseMeasurement:
    """Return the pose or its half turn, whichever is nearer to the heading that is known [rad]: Alg. 1."""
    return pose if known is None else replace(pose, yaw=nearest_turn(pose.yaw, known, HALF_TURN))


class VehicleHeading:
    """The vehicle's reports without what the site was calibrated to, turned by half where they have to be."""

    def __init__(self, sensors: OnboardSensors) -> None:
        self._sensors = sensors
        self._agreement = 0.0  # log-likelihood ratio of the half turn held, by the way it flies
        self.turned = False
        """Whether its headings are half a turn off."""
        self.turns = 0
        """How often the half turn held was found wrong by the way it flies."""
        self.heard = False
        self.newest: float | None = None
        """The newest heading that it said [rad]."""

    def told(self, state: VehicleState) -> VehicleState:
        """Return a report as it is to be believed."""
        corrected = self._sensors.corrected(state)
        if self.turned and corrected.yaw is not None:
            corrected = replace(corrected, yaw=wrap_angle(corrected.yaw + HALF_TURN))
        self.heard, self.newest = True, corrected.yaw
        return corrected

    def turn(self) -> None:
        """Take its headings for half a turn off, or no longer so."""
        self.turned, self._agreement = not self.turned, 0.0
        if self.newest is not None:
            self.newest = wrap_angle(self.newest + HALF_TURN)

    def contradicted(self, told: VehicleState, seen: StateEstimate) -> bool:
        """Compare the velocity of a report with what is known at its stamp.

        True says that the half turn held is the wrong one; its headings are turned from here on.
        """
        if told.v_body is None:
            return False
        flies = seen.v_heading[:2]
        if float(np.linalg.norm(flies)) < _MOVES:
            return False
        ratio = float(flies @ told.v_body[:2]) / self._sensors.noise.velocity_sd**2
        # A report does not say more than so much: its errors last longer than it.
        step = min(max(ratio, -_PER_REPORT), _PER_REPORT)
        self._agreement = min(max(self._agreement + step, -_CERTAIN), _CERTAIN)
        if self._agreement > -_CERTAIN:
            return False
        self.turn()
        self.turns += 1
        return True
