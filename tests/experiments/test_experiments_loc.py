"""loc-detection and loc-pose: what is judged, and how."""

import math

import numpy as np
import pytest

from noctule.experiments.loc_detection import Tally, company, longest
from noctule.experiments.loc_pose import APPROACH, Errors, approach, beside
from noctule.geometry import Pose, wrap_angle

POSE = Pose(np.array([0.2, -0.1, 1.2]), 0.4, 0.01, -0.02)


@pytest.mark.parametrize("hull", [False, True])
def test_the_person_stands_as_near_as_asked_and_not_in_the_drone(hull):
    rng = np.random.default_rng(3)
    people = [beside(rng, POSE, hull) for _ in range(300)]
    away = np.array([math.hypot(p.x - POSE.position[0], p.y - POSE.position[1]) for p in people])
    assert 0.40 <= away.min() < 0.42
    assert 0.73 < away.max() <= 0.75
    for person, distance in zip(people, away, strict=True):
        toward = math.atan2(POSE.position[1] - person.y, POSE.position[0] - person.x)
        if distance < 0.45:  # the shoulders would reach the rotors
            assert abs(wrap_angle(person.yaw - toward)) < 1e-9


def test_an_approach_ends_at_the_pose_and_moves_slowly():
    way = approach(np.random.default_rng(1), POSE)
    assert len(way) == APPROACH + 1
    assert np.allclose(way[-1].position, POSE.position)
    assert way[-1].yaw == pytest.approx(POSE.yaw)
    assert np.linalg.norm(way[0].position - POSE.position) == pytest.approx(0.1)
    assert {(p.roll, p.pitch) for p in way} == {(POSE.roll, POSE.pitch)}


def test_a_heading_half_a_turn_off_is_counted_and_does_not_spoil_the_spread():
    errors = Errors(np.zeros((4, 3)), np.array([0.01, -0.01, 0.01, -0.01]), np.array([1.0, 1.0, 0.0, 1.0]))
    figures = errors.figures()
    assert figures["half_turn_right"] == 0.75
    assert figures["yaw_sd_deg"] == pytest.approx(math.degrees(0.01))


def test_without_a_calibrated_offset_the_mean_is_taken_out_and_with_one_it_counts():
    position = np.array([[0.03, 0.0, 0.02], [0.03, 0.002, 0.02], [0.03, -0.002, 0.02]])
    errors = Errors(position, np.zeros(3), np.ones(3))
    assert errors.figures()["xy_rms_m"] == pytest.approx(0.002 * math.sqrt(2.0 / 3.0))
    assert errors.figures(np.zeros(3))["xy_rms_m"] > 0.03
    assert errors.figures()["z_sd_m"] == pytest.approx(0.0)


def test_poses_that_were_not_measured_are_left_out_and_counted():
    errors = Errors(np.array([[0.0, 0.0, 0.0], [np.nan] * 3]), np.array([0.0, np.nan]), np.array([1.0, 0.0]))
    assert errors.figures()["measured"] == 0.5
    assert errors.figures()["half_turn_right"] == 1.0
    nothing = Errors(np.full((2, 3), np.nan), np.full(2, np.nan), np.zeros(2))
    assert nothing.figures() == {"measured": 0.0}


def test_only_the_drone_means_that_it_was_accepted_once_and_nothing_else():
    drone, tray = POSE.position, POSE.position + np.array([0.5, 0.0, 0.0])
    tally = Tally()
    for accepted in ([drone], [drone, tray], [tray], [], [drone]):
        tally.add(accepted, drone, 0.001)
    apart = np.array([True, True, True, True, False])
    figures = tally.figures(apart)
    assert figures["detected"] == 0.5
    assert figures["only_drone"] == 0.25
    assert figures["false_per_frame"] == pytest.approx(2.0 / 5.0)
    assert figures["longest_false_s"] == pytest.approx(2.0 / 30.0)
    assert figures["frame_ms"] == pytest.approx(1.0)


def test_the_longest_run_is_found():
    assert longest(np.array([True, False, True, True, False])) == 2
    assert longest(np.zeros(3, dtype=bool)) == 0


def test_the_company_is_a_person_a_box_and_a_carried_tray():
    things = [thing.at(2.0) for thing in company(np.random.default_rng(5))]
    assert [thing.kind for thing in things] == ["person", "box", "tray"]
    assert 0.9 <= things[2].z <= 1.2
