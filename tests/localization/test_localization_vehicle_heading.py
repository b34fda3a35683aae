"""What the vehicle says of its heading, and the half turn that it bears out."""

import math

import numpy as np
import pytest

from noctule.estimation.filter_state import start_at
from noctule.estimation.sensors import HeadingCorrection, OnboardSensors
from noctule.localization.vehicle_heading import VehicleHeading, faced
from noctule.messages import FlightState, PoseMeasurement, VehicleState


def report(forward: float | None = None, yaw: float | None = 0.1, left: float = 0.0) -> VehicleState:
    v = None if forward is None else np.array([forward, left, 0.0])
    return VehicleState(1.0, FlightState.FLYING, yaw=yaw, v_body=v)


def flying(vx: float, vy: float = 0.0, yaw: float = 0.0):
    known = start_at(1.0, np.zeros(3), yaw)
    known.x[4:6] = vx, vy
    return known


@pytest.mark.parametrize(("seen", "known", "expected"), [(3.0, 0.2, 3.0 - math.pi), (0.1, 0.4, 0.1)])
def test_a_pose_is_faced_as_what_is_known(seen, known, expected):
    pose = PoseMeasurement(0.0, np.zeros(3), seen, np.eye(4), "registration")
    assert faced(pose, known).yaw == pytest.approx(expected)
    assert faced(pose, None) is pose


def test_what_it_says_too_much_is_taken_off_before_it_is_turned():
    heading = VehicleHeading(OnboardSensors(heading=HeadingCorrection(constant=0.4)))
    assert not heading.heard
    assert heading.told(report(yaw=1.0)).yaw == pytest.approx(0.6)
    heading.turn()
    assert heading.newest == pytest.approx(0.6 - math.pi)
    assert heading.told(report(yaw=1.0)).yaw == pytest.approx(0.6 - math.pi)
    assert heading.heard


def test_a_vehicle_without_a_heading_can_be_turned_all_the_same():
    heading = VehicleHeading(OnboardSensors())
    heading.told(report(yaw=None))
    heading.turn()
    assert (heading.newest, heading.turned) == (None, True)


@pytest.mark.parametrize("said", [(-0.3, 0.0), (-0.2, -0.2)])
def test_flying_the_other_way_than_it_says_contradicts_the_half_turn_after_some_reports(said):
    heading = VehicleHeading(OnboardSensors())
    told = [heading.contradicted(report(said[0], left=said[1]), flying(0.3, 0.1)) for _ in range(10)]
    assert told == [False] * 9 + [True]
    assert (heading.turned, heading.turns) == (True, 1)


def test_reports_that_agree_have_to_be_outweighed_but_not_for_ever():
    heading = VehicleHeading(OnboardSensors())
    for _ in range(1000):
        assert not heading.contradicted(report(0.3), flying(0.3))
    assert sum(1 for _ in range(20) if heading.contradicted(report(-0.3), flying(0.3))) == 1


@pytest.mark.parametrize(
    ("told", "known"),
    [
        (report(None), flying(0.3)),  # it says no velocity
        (report(-0.3), flying(0.05)),  # it hovers
        (report(0.0, left=0.3), flying(0.3)),  # across: neither half turn fits
        (report(0.3), flying(-0.3, yaw=math.pi)),  # seen with the nose at its tail, and turned so
    ],
)
def test_what_says_nothing_of_the_half_turn_does_not_contradict_it(told, known):
    heading = VehicleHeading(OnboardSensors())
    assert not any(heading.contradicted(told, known) for _ in range(100))
    assert heading.turns == 0
