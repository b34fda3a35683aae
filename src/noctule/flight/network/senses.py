"""What a node makes of what its sensor says: the site's calibration taken off, the half turn chosen.

The same as `localization.fusion`, without a centre. Headings of the vehicle reach the depth camera's node as
contributions of the vehicle's: its own estimate knows them, and chooses the half turn. The node of the
vehicle compares the way it flies with what it says; when these point opposite ways it turns the yaw of all
nodes by half a turn, again by contributions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from noctule.estimation.contributions import half_turned
from noctule.estimation.filter_state import YAW, StateEstimate, heading_bias_index
from noctule.estimation.measurements import Component, Measurement, of_heading, of_pose, of_vehicle_state
from noctule.estimation.sensors import Sensors
from noctule.geometry import wrap_angle
from noctule.localization.vehicle_heading import VehicleHeading, faced
from noctule.messages import HeadingMeasurement, PoseMeasurement, VehicleState

if TYPE_CHECKING:
    from noctule.flight.network.member import Member

YAW_KNOWN = 0.6  # [rad], deviation above which the estimate says nothing of the half turn
PATIENCE = 2.0  # [s], that a vehicle has to say its heading before the view from above is believed alone
_UNTURNED = Sensors()


@dataclass(frozen=True, slots=True)
class Sight:
    """Where a camera saw the vehicle."""

    pose: PoseMeasurement
    certain: bool  # of the half turn, from above


Sensed = VehicleState | Sight | HeadingMeasurement


class Senses:
    """Makes measurements of what the sensors of one process say, for its node; no clock.

    Parameters
    ----------
    name : of the node, which its measurements carry; headings of markers carry their own source
    sensors : the site's calibration
    """

    def __init__(self, name: str, sensors: Sensors = _UNTURNED) -> None:
        self._name = name
        self._sensors = sensors
        self._vehicle = VehicleHeading(sensors.onboard)
        self._compared = False  # the vehicle's heading with what the others knew before
        self._unfaced: float | None = None  # [s], since when poses come whose half turn nobody tells
        self._count = 0

    @property
    def turns(self) -> int:
        """How often the half turn held was found wrong by the way the vehicle flies."""
        return self._vehicle.turns

    def take(self, sensed: Sensed, member: Member, now: float) -> list[bytes]:
        """Hand what a sensor said to the node; return the messages to share."""
        if isinstance(sensed, VehicleState):
            return self._report(sensed, member, now)
        measured = self._sight(sensed, member, now) if isinstance(sensed, Sight) else self._heading(sensed)
        return _shared(member.measure(measured, now))

    def _report(self, state: VehicleState, member: Member, now: float) -> list[bytes]:
        told = self._vehicle.told(state)
        if not (self._compared or told.yaw is None or member.joining(now)):
            # One that is started again in flight has forgotten that its headings are turned.
            self._compared = True
            known = member.known(told.stamp)
            if _knows_yaw(known) and abs(wrap_angle(told.yaw - _said(known))) > 0.5 * np.pi:
                self._vehicle.turn()
                told = self._vehicle.told(state)
        measured = of_vehicle_state(told, self._sensors.onboard.noise, self._next(), self._name)
        if measured is None:
            member.reason = "the vehicle reports nothing"
            return []
        shared = _shared(member.measure(measured, now))
        known = member.known(told.stamp)
        if not member.joining(now) and _knows_yaw(known) and self._vehicle.contradicted(told, known):
            # From now on: what was exposed before is still to come, and is faced as it was then.
            parts = half_turned(member.known(now), self._name, self._next())
            self._count += len(parts)
            shared += [message for part in parts for message in _shared(member.add(part, now))]
        return shared

    def _sight(self, sight: Sight, member: Member, now: float) -> Measurement:
        pose = replace(self._sensors.depth.corrected(sight.pose), source=self._name)
        known = member.known(pose.stamp)
        if _knows_yaw(known):
            self._unfaced = None
            return of_pose(faced(pose, known.yaw), self._next())
        self._unfaced = now if self._unfaced is None else self._unfaced
        measured = of_pose(pose, self._next())
        if sight.certain and now - self._unfaced >= PATIENCE:
            return measured
        return measured.part(measured.components != Component.YAW)

    def _heading(self, heading: HeadingMeasurement) -> Measurement:
        return of_heading(self._sensors.markers.corrected_heading(heading), self._next())

    def _next(self) -> int:
        self._count += 1
        return self._count


def _shared(message: bytes | None) -> list[bytes]:
    return [] if message is None else [message]


def _knows_yaw(known: StateEstimate) -> bool:
    return bool(known.P[YAW, YAW] <= YAW_KNOWN**2)


def _said(known: StateEstimate) -> float:
    """Return the heading [rad] that the vehicle should say."""
    bias = heading_bias_index(known.x.size)
    return known.yaw + (float(known.x[bias]) if bias >= 0 else 0.0)
