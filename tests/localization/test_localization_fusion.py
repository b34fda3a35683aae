"""The network of the drone's sensors: how it begins, which half turn it takes, what it is told."""

import math

import numpy as np
import pytest

from noctule.estimation.delayed import FilterSettings
from noctule.estimation.sensors import HeadingCorrection, OnboardSensors, RoomSensor, Sensors
from noctule.estimation.vehicle_model import VehicleModel
from noctule.localization.fusion import Fusion
from noctule.messages import FlightState, HeadingMeasurement, PoseMeasurement, VehicleState

TRUE = VehicleModel.identified()
P = np.diag([0.004, 0.004, 0.004, 0.015]) ** 2


def report(stamp: float, yaw: float | None) -> VehicleState:
    return VehicleState(stamp, FlightState.FLYING, yaw=yaw, v_body=np.zeros(3), height=1.0)


def pose_at(stamp: float, yaw: float) -> PoseMeasurement:
    return PoseMeasurement(stamp, np.array([0.0, 0.0, 1.0]), yaw, P, "registration")


def test_a_fusion_begins_with_the_half_turn_that_the_vehicle_says():
    fusion = Fusion(("onboard", "depth"), TRUE, Sensors())
    fusion.pose(pose_at(0.0, 0.1), True, 0.04)
    assert not fusion.begun  # nothing was reported yet
    fusion.report(report(0.0, 0.6), 0.06)
    assert fusion.faced(pose_at(0.1, 0.1 + math.pi)).yaw == pytest.approx(0.1)
    fusion.pose(pose_at(0.1, 0.1 + math.pi), False, 0.14)
    assert fusion.begun
    assert fusion.estimate(0.2).yaw == pytest.approx(0.1, abs=0.01)
    assert fusion.faced(pose_at(0.2, 0.1 - math.pi)).yaw == pytest.approx(0.1)


def test_a_fusion_of_a_vehicle_without_a_heading_waits_for_one_that_is_certain_from_above():
    fusion = Fusion(("onboard", "depth"), TRUE, Sensors())
    fusion.report(report(0.0, None), 0.05)
    fusion.pose(pose_at(0.0, 0.1), False, 0.06)
    assert not fusion.begun
    assert fusion.prediction(0.1) is None
    fusion.pose(pose_at(0.1, 0.1), True, 0.14)
    assert fusion.begun


def begun(sensors: Sensors = Sensors(), nodes=("onboard", "depth"), yaw: float = 0.1) -> Fusion:
    fusion = Fusion(nodes, TRUE, sensors)
    fusion.report(report(0.0, yaw), 0.05)
    fusion.pose(pose_at(0.05, yaw), True, 0.09)
    return fusion


def test_what_the_site_was_calibrated_to_is_taken_off():
    sensors = Sensors(
        onboard=OnboardSensors(heading=HeadingCorrection(constant=0.4)),
        depth=RoomSensor(position_bias=(0.1, 0.0, 0.0)),
    )
    fusion = Fusion(("onboard", "depth"), TRUE, sensors)
    fusion.report(report(0.0, 1.7), 0.05)  # it says 1.7, it is 1.3
    assert fusion.faced(pose_at(0.05, -0.2)).yaw == pytest.approx(-0.2)  # by 1.7 it would be the other one
    fusion.pose(pose_at(0.05, 1.3), True, 0.09)
    np.testing.assert_allclose(fusion.estimate(0.1).position, [-0.1, 0.0, 1.0], atol=0.01)


def test_a_command_moves_the_prediction_as_the_model_says():
    fusion = begun()
    for k in range(30):
        fusion.command(0.1 + k / 30.0, np.array([0.2, 0.0, 0.0, 0.0]))
    ahead = fusion.prediction(1.1)
    assert ahead is not None
    assert ahead.pose.position[0] > 0.3
    assert ahead.covariance.shape == (4, 4)


def test_markers_are_a_node_of_their_own():
    fusion = begun(nodes=("onboard", "depth", "markers"))
    before = fusion.estimate(0.2)
    fusion.heading(HeadingMeasurement(0.2, 0.1, 0.0001, "markers"), 0.25)
    assert fusion.estimate(0.2).sd[3] < before.sd[3]


def test_before_it_begins_everything_but_the_heading_is_forgotten():
    fusion = Fusion(("onboard", "depth"), TRUE, Sensors())
    fusion.command(0.0, np.zeros(4))
    fusion.heading(HeadingMeasurement(0.0, 0.1, 0.0001, "markers"), 0.05)
    assert not fusion.begun
    assert fusion.refusals == {}


def test_a_wild_pose_is_refused_and_counted():
    fusion = begun()
    fusion.report(report(0.1, 0.1), 0.15)
    wild = PoseMeasurement(0.2, np.array([3.0, 0.0, 1.0]), 0.1, P, "registration")
    fusion.pose(wild, True, 0.25)
    assert fusion.refusals == {"registration: position gate": 1}
    assert abs(fusion.estimate(0.3).position[0]) < 0.05


def test_the_biases_walk_as_the_calibration_found_and_the_rest_is_the_settings():
    settings = FilterSettings(window=2.0)
    sensors = Sensors(onboard=OnboardSensors(heading_walk=0.5))
    calm, lively = Fusion(("depth",), None, Sensors(), settings), Fusion(("depth",), None, sensors, settings)
    for fusion in (calm, lively):
        fusion.report(report(0.0, 0.1), 0.0)
        fusion.pose(pose_at(0.0, 0.1), True, 0.04)
    assert lively.estimate(1.0).sd[8] > 1.2 * calm.estimate(1.0).sd[8]
    assert lively.estimate(1.0).sd[0] == calm.estimate(1.0).sd[0]


def fly_ahead(fusion: Fusion, said: float, seconds: float = 3.0, speed: float = 0.3) -> None:
    """Fly along x with the nose ahead; the vehicle says the heading `said` [rad]."""
    for k in range(int(30 * seconds)):
        t = k / 30.0
        v = np.array([speed, 0.0, 0.0])
        fusion.report(VehicleState(t, FlightState.FLYING, yaw=said, v_body=v, height=1.0), t + 0.05)
        # The view from above has lost the half turn too.
        pose = PoseMeasurement(t, np.array([speed * t, 0.0, 1.0]), math.pi, P, "registration")
        fusion.pose(pose, True, t + 0.05)


@pytest.mark.parametrize("said", [0.2, 3.0, -2.6])
def test_a_half_turn_that_contradicts_the_way_it_flies_is_mended(said):
    fusion = Fusion(("onboard", "depth"), TRUE, Sensors())
    fly_ahead(fusion, said)
    assert abs(fusion.estimate(3.0).yaw) < 0.05
    assert fusion.turns == int(abs(said) > math.pi / 2)


def test_a_drone_that_hovers_says_nothing_of_its_half_turn():
    fusion = Fusion(("onboard", "depth"), TRUE, Sensors())
    fly_ahead(fusion, 3.0, speed=0.03)
    assert fusion.turns == 0
    assert abs(fusion.estimate(3.0).yaw) > 3.0


def test_a_pose_later_than_what_is_remembered_is_dropped():
    fusion = Fusion(("onboard", "depth"), TRUE, Sensors())
    fly_ahead(fusion, 0.2)
    before = fusion.estimate(3.0)
    fusion.pose(pose_at(0.1, 0.0), True, 3.0)
    assert fusion.prediction(0.1) is not None
    np.testing.assert_array_equal(fusion.estimate(3.0).x, before.x)
