import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.geometry import Pose, wrap_angle
from noctule.localization.half_turn import CERTAIN, MOST, Facing, HalfTurn
from noctule.localization.registration import Registration
from noctule.localization.tracker import Prediction, Track, facing_as, merged, turned

USUAL = 5.0
EVIDENCE = st.lists(st.floats(-50.0, 50.0), max_size=200)
ANGLES = st.floats(-math.pi, math.pi)


def summed(values: list[float], start: HalfTurn | None = None) -> tuple[HalfTurn, int]:
    total, turns = start or HalfTurn(), 0
    for value in values:
        total, around = total.add(value)
        turns += around
    return total, turns


def seen(position: list[float], yaw: float, half_turn: float = USUAL) -> Registration:
    pose = Pose(np.array(position), wrap_angle(yaw))
    return Registration(pose, np.eye(4) * 1e-6, 100.0, 1.0, 0.8, 0.3, 0.3, half_turn)


def test_usual_evidence_decides_within_half_a_second():
    for frames in range(1, 16):
        total, _ = summed([USUAL] * frames)
        if total.facing is Facing.CERTAIN:
            assert 2 <= frames <= 6
            return
    pytest.fail("never decided")


def test_a_wrong_start_is_turned_around_once_and_is_no_slip():
    total, turns = HalfTurn(), 0
    for _ in range(5):
        total, around = total.add(-USUAL if turns == 0 else USUAL)
        turns += around
    assert turns == 1
    assert total.facing is Facing.CERTAIN
    assert not total.slipped
    assert total.evidence >= CERTAIN


def test_a_slip_is_noticed_in_six_to_nine_frames_however_long_it_was_right():
    for right in (10, 100000):
        total, _ = summed([USUAL] * min(right, 1000))
        for frames in range(1, 20):
            total, around = total.add(-USUAL)
            if around:
                assert 6 <= frames <= 9
                assert total.slipped
                break
        else:
            pytest.fail("the slip was not noticed")


def test_at_the_bound_one_frame_in_three_is_weighed_and_all_once_one_disagrees():
    total, due = summed([USUAL] * 5)[0], []
    for _ in range(12):
        due.append(total.due)
        total, around = total.add(USUAL if total.due else None)
        assert not around
        assert total.evidence == MOST
        assert total.facing is Facing.CERTAIN
    assert due == [False, False, True] * 4
    total = total.add(None)[0].add(None)[0].add(-USUAL)[0]
    assert total.due
    assert summed([USUAL] * 3)[0].due  # certain, but not yet at the bound
    assert HalfTurn().due


@pytest.mark.parametrize("since", [0, 1, 2])
def test_a_slip_at_the_bound_is_noticed_in_a_third_of_a_second_whichever_frame_it_falls_on(since):
    total = summed([USUAL] * 10)[0]
    for _ in range(since):
        total, _ = total.add(None)
    for frames in range(1, 20):
        total, around = total.add(-USUAL if total.due else None)
        if around:
            assert 8 <= frames <= 10
            assert total.slipped
            return
    pytest.fail("the slip was not noticed")


def test_after_a_slip_the_next_frame_is_no_slip():
    total, _ = summed([USUAL] * 10 + [-USUAL] * 8)
    assert total.slipped
    assert not total.add(USUAL)[0].slipped


def test_one_frame_alone_decides_nothing():
    total, turns = summed([500.0])
    assert total.facing is Facing.UNDECIDED
    assert turns == 0


@given(EVIDENCE)
def test_the_sum_is_bounded(values):
    total, _ = summed(values)
    assert abs(total.evidence) <= MOST


@given(st.lists(st.floats(-0.09, 0.09), max_size=90))
def test_a_shape_that_leaves_it_open_stays_undecided(values):
    assert summed(values)[0].facing is Facing.UNDECIDED


@given(EVIDENCE)
def test_certainty_is_never_lost_only_turned(values):
    total, _ = summed(values, HalfTurn(MOST, Facing.CERTAIN))
    assert total.facing is Facing.CERTAIN


def test_noise_about_usual_evidence_does_not_turn_a_drone_around():
    rng = np.random.default_rng(2)
    for _ in range(30):
        _, turns = summed(list(rng.normal(USUAL, 3.0, 1800)), HalfTurn(MOST, Facing.CERTAIN))
        assert turns == 0


def test_a_steady_flight_is_predicted_to_millimetres():
    track = Track.start(0.0, Pose(np.zeros(3), 3.0))
    for k in range(1, 30):
        t = k / 30.0
        predicted = track.predict(t).pose
        at, yaw = [0.6 * t, -0.3 * t, 1.0 + 0.1 * t], 3.0 + 0.8 * t
        track = track.follow(t, seen([at[0], at[1], at[2] - 1.0], yaw))
    assert np.linalg.norm(predicted.position - [0.6 * t, -0.3 * t, 0.1 * t]) < 0.003
    assert abs(wrap_angle(predicted.yaw - yaw)) < 0.01
    np.testing.assert_allclose(track.velocity, [0.6, -0.3, 0.1], atol=0.02)


def test_the_heading_goes_on_through_any_number_of_turns():
    track, total = Track.start(0.0, Pose(np.zeros(3), 0.0)), 0.0
    for k in range(1, 400):
        before = track.pose.yaw
        track = track.follow(k / 30.0, seen([0.0, 0.0, 1.0], 0.05 * k))
        total += wrap_angle(track.pose.yaw - before)
    assert total == pytest.approx(0.05 * 399, abs=1e-6)
    assert track.yaw_rate == pytest.approx(1.5, abs=0.01)


def test_an_unseen_drone_is_supposed_to_slow_down_and_may_be_anywhere_near():
    track = Track(0.0, Pose(np.zeros(3), 0.0), np.array([1.0, 0.0, 0.0]), 0.0, HalfTurn())
    soon, late = track.predict(0.033), track.predict(2.0)
    assert soon.pose.position[0] == pytest.approx(0.031, abs=0.003)
    assert late.pose.position[0] < 0.31
    assert soon.covariance[0, 0] < 0.02**2
    assert late.covariance[0, 0] > 1.0
    assert late.covariance[3, 3] <= math.pi**2


def test_a_wild_answer_does_not_make_a_wild_velocity():
    track = Track.start(0.0, Pose(np.zeros(3), 0.0)).follow(0.001, seen([5.0, 5.0, 5.0], 3.0))
    assert np.linalg.norm(track.velocity) <= 4.0 + 1e-9
    assert abs(track.yaw_rate) <= 6.0


def test_a_track_turns_around_with_the_evidence_and_keeps_going_where_it_went():
    track = Track.start(0.0, Pose(np.zeros(3), 0.5))
    for k in range(1, 5):
        track = track.follow(k / 30.0, seen([0.01 * k, 0.0, 0.0], 0.5, half_turn=-5.0))
        if track.half_turn.facing is Facing.CERTAIN:
            break
    assert track.pose.yaw == pytest.approx(wrap_angle(0.5 + math.pi))
    assert track.velocity[0] > 0.1


@given(ANGLES, st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_half_a_turn_twice_is_none_and_keeps_the_tilt_in_the_world(yaw, roll, pitch):
    pose = Pose(np.zeros(3), yaw, roll, pitch)
    np.testing.assert_allclose(turned(pose).R_world_body[:, 2], pose.R_world_body[:, 2], atol=1e-12)
    np.testing.assert_allclose(turned(turned(pose)).R_world_body, pose.R_world_body, atol=1e-12)


@given(ANGLES, ANGLES)
def test_the_half_turn_nearest_the_prediction_is_chosen(yaw, predicted):
    assert abs(wrap_angle(facing_as(Pose(np.zeros(3), yaw), predicted).yaw - predicted)) <= math.pi / 2 + 1e-9


def test_a_filter_is_believed_but_for_the_half_turn_and_the_tilt():
    own = Track(0.0, Pose(np.zeros(3), 0.2, 0.05, -0.03), np.zeros(3), 0.0, HalfTurn())
    given_ = Prediction(Pose(np.array([0.1, 0.0, 0.0]), 0.3 - math.pi), np.eye(4))
    got = merged(own, 0.033, given_)
    assert got.pose.position[0] == 0.1
    assert got.pose.yaw == pytest.approx(0.3)
    assert got.pose.roll == pytest.approx(0.8 * 0.05)
    assert got.covariance is given_.covariance
    assert merged(own, 0.033, None).pose.yaw == pytest.approx(0.2)
