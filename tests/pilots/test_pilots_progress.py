"""The law by progress in closed loop, on geometry instead of pictures."""

from dataclasses import replace

import numpy as np
import pytest
from geometric_flight import COVARIANCE, DT, LEVER, fly, links_between

from noctule.estimation.odometry import OdometryPose
from noctule.geometry import rot_z
from noctule.messages import Limits
from noctule.pilots.progress import LinkGeometry, ProgressLaw, Sighting
from noctule.pilots.settings import PilotSettings

LIMITS = Limits()
GATE = ((0.95, 0.35, 0.03), (0.95, -0.35, 0.03))
SEEDS = (0, 1, 2)


def scenario(name, seed):
    """Return targets and columns; y is drawn as in the experiments."""
    draw = np.random.default_rng([seed, 9]).uniform(-1.0, 1.0)
    if name == "single":
        return ((1.5, 0.2, 0.8, 0.1),), ()
    if name == "5.1":
        return ((1.5, 0.0, 0.5, 0.0),), ((0.95, 0.08 * draw, 0.025),)
    if name == "5.2":
        y, turn = 0.06 * draw, np.radians(30.0 if seed % 2 else -30.0)
        targets = ((1.5, 0.0, 1.0, 0.0), (2.0, 0.0, 1.0, 0.0), (3.5, 0.0, 1.0, 0.0), (4.5, 0.5, 0.5, turn))
        return targets, ((0.9, y, 0.055), (2.9, -y, 0.025))
    if name == "gate":
        return ((1.8, 0.0, 1.0, 0.0),), GATE
    if name == "pair":
        return ((2.2, 0.0, 1.0, 0.0),), ((1.0, 0.1, 0.03), (1.3, -0.2, 0.03))
    return ((2.2, 0.0, 1.0, 0.0),), ((1.1, 0.08 * draw, 0.15),)  # "wide": the law expects 0.08 m


def check_limits(flown):
    linear, angular = flown.steps
    assert linear <= LIMITS.acceleration * DT
    assert angular <= LIMITS.yaw_acceleration * DT


@pytest.mark.parametrize("report", [True, False], ids=["reported", "unreported"])
@pytest.mark.parametrize("name", ["single", "5.1", "5.2", "gate", "pair", "wide"])
def test_targets_are_reached_without_contact_and_without_a_step_in_the_command(name, report):
    for seed in SEEDS:
        flown = fly(*scenario(name, seed), seed=seed, report=report)
        assert flown.outcome == "reached", seed
        assert flown.error <= 0.03
        assert flown.yaw_error <= 0.5
        assert flown.clearance >= 0.10
        check_limits(flown)


@pytest.mark.parametrize("late", [10, 16])
def test_pictures_that_come_late_cost_neither_the_end_nor_the_clearance(late):
    settings = PilotSettings(picture_latency_s=late * DT)
    for name in ("5.1", "5.2"):
        flown = fly(*scenario(name, 1), seed=1, late=late, settings=settings)
        assert flown.outcome == "reached"
        assert flown.error <= 0.03
        assert flown.clearance >= 0.10
        check_limits(flown)


def test_the_columns_of_the_scenarios_are_really_in_the_way():
    for name in ("5.1", "5.2", "pair", "wide"):
        assert fly(*scenario(name, 0), seed=0, blind=True).outcome == "collided"


@pytest.mark.parametrize("depth", [1.6, 6.4])
def test_a_scene_of_another_depth_changes_the_time_but_not_the_end(depth):
    for seed in SEEDS:
        flown = fly(*scenario("5.1", seed), seed=seed, depth=depth)
        assert flown.outcome == "reached"
        # Noise of t is in mean depths, so in a deeper scene the same noise is more metres.
        assert flown.error <= 0.03 * max(depth / 3.2, 1.0)
        assert flown.clearance >= 0.10
        check_limits(flown)


def wrong_between(begin, end):
    """Sightings that are mirrored and turned for a while, and agree with each other."""

    def tamper(t, sighting):
        if not begin <= t < end:
            return sighting
        mirrored = sighting.t_heading * [1.0, -1.0, 1.0] + np.array([0.1, 0.2, 0.0])
        return replace(sighting, t_heading=mirrored, yaw=sighting.yaw + 0.3)

    return tamper


@pytest.mark.parametrize("begin", [0.0, 2.5])
def test_a_target_seen_wrongly_for_a_second_is_found_again(begin):
    target = ((1.5, 0.3, 0.8, 0.0),)
    flown = fly(target, seed=3, tamper=wrong_between(begin, begin + 1.0))
    right = fly(target, seed=3)
    # The second was believed: the flight went another way for a while.
    assert np.abs(flown.commands[:150] - right.commands[:150]).max() > 0.05
    assert flown.outcome == "reached"
    assert flown.error <= 0.03
    assert flown.yaw_error <= 0.5
    check_limits(flown)


def test_a_single_outlier_is_refused_and_hardly_moves_the_command():
    def once(t, sighting):
        return wrong_between(0.0, 99.0)(t, sighting) if abs(t - 2.0) < DT / 2 else sighting

    target = ((1.5, 0.3, 0.8, 0.0),)
    flown, calm = fly(target, seed=4, tamper=once), fly(target, seed=4)
    n = min(len(flown.commands), len(calm.commands))
    assert (flown.commands[:n] != calm.commands[:n]).any()  # it did arrive
    change = np.linalg.norm((flown.commands - calm.commands[: len(flown.commands)])[:120, :3], axis=1)
    assert change.max() <= LIMITS.acceleration * DT
    check_limits(flown)


def test_the_flight_waits_at_an_image_until_the_next_one_is_in_sight():
    targets = ((1.0, 0.0, 1.0, 0.0), (2.0, 0.3, 1.0, 0.0))
    known_at = 9.0
    flown = fly(targets, seed=5, tamper=lambda t, s: s if s.index == 0 or t >= known_at else None)
    waiting = flown.stamps < known_at
    assert (flown.images[waiting] == 0).all()
    last = flown.positions[waiting][-1]
    assert np.linalg.norm(last - np.array(targets[0][:3])) < 0.15
    assert flown.outcome == "reached"
    assert flown.images[-1] == 1
    check_limits(flown)


def test_a_path_is_passed_without_stopping_at_its_images():
    targets = tuple((x, 0.0, 1.0, 0.0) for x in (0.8, 1.6, 2.4))
    flown = fly(targets, seed=6)
    cruise = flown.positions[:, 0] > 0.5
    cruise &= flown.positions[:, 0] < 1.7
    assert (np.linalg.norm(flown.commands[cruise, :3], axis=1) > 0.3).all()
    assert flown.outcome == "reached"
    assert sorted(set(flown.images)) == [0, 1, 2]


def test_a_flight_repeats_bit_for_bit():
    a, b = (fly(*scenario("5.1", 1), seed=1) for _ in range(2))
    assert (a.commands == b.commands).all()
    assert a.duration == b.duration


def pose_at(stamp, x=0.0, yaw=0.0, v=(0.0, 0.0, 0.0)):
    return OdometryPose(stamp, np.array([x, 0.0, 0.0]), yaw, np.array(v))


def sighting(index, to_camera, pose, yaw=0.0):
    return Sighting(index, pose, np.asarray(to_camera, dtype=float), yaw, COVARIANCE)


def law_on(links=(), **groups):
    return ProgressLaw(PilotSettings.model_validate(groups), LIMITS, LEVER, tuple(links))


def test_the_first_sighting_of_an_image_takes_depth_and_bias_from_the_one_before():
    law = law_on([LinkGeometry(np.array([0.3, 0.0, 0.0]), 0.5)])
    pose = pose_at(0.0)
    law.sight(sighting(0, [0.1, 0.0, 0.0], pose))
    known = law.targets[0]
    law.targets[0] = replace(known, x=np.array([*known.x[:3], 0.25, known.x[4], 0.01, -0.02, 0.0]))
    law.sight(sighting(1, [0.8, 0.0, 0.0], pose))
    assert law.targets[1].depth == pytest.approx(2.0)  # half of 4 m
    assert law.targets[1].velocity_bias == pytest.approx([0.01, -0.02, 0.0])


def test_the_next_direction_is_the_links_until_the_next_image_is_seen():
    law = law_on([LinkGeometry(np.array([0.3, 0.3, 0.0]), 1.0)])
    pose = pose_at(0.0, yaw=0.2)
    law.sight(sighting(0, [0.3, 0.0, 0.0], pose, yaw=0.2))  # the image looks along the odometry's x
    expected = rot_z(-0.2) @ np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    assert law.segment(pose).next_direction == pytest.approx(expected)
    law.sight(sighting(1, rot_z(-0.2) @ [0.3, 0.5, 0.0] + [0.3, 0.0, 0.0], pose, yaw=0.2))
    seen = law.segment(pose).next_direction
    assert seen @ expected < 0.99
    assert np.linalg.norm(seen) == pytest.approx(1.0)


def test_the_last_segment_has_no_next_direction():
    law = law_on()
    law.sight(sighting(0, [0.3, 0.0, 0.0], pose_at(0.0)))
    assert law.segment(pose_at(0.0)).next_direction is None


def test_a_next_image_seen_too_long_ago_is_not_switched_to():
    law = law_on([LinkGeometry(np.array([0.3, 0.0, 0.0]), 1.0)])
    law.sight(sighting(1, [0.3, 0.0, 0.0], pose_at(0.0)))
    law.sight(sighting(0, [0.0, 0.0, 0.0], pose_at(0.6)))  # it is here already
    law.step(pose_at(0.6), np.zeros(4), DT)
    assert law.k == 0
    law.sight(sighting(1, [0.3, 0.0, 0.0], pose_at(0.6)))
    law.step(pose_at(0.6), np.zeros(4), DT)
    assert law.k == 1


def test_ten_sightings_in_a_row_that_disagree_are_believed_and_nine_are_not():
    law, here = law_on(), pose_at(0.0)
    for i in range(30):
        law.sight(sighting(0, [0.5, 0.0, 0.0], pose_at(i * DT)))
    for i in range(9):
        assert not law.sight(sighting(0, [0.5, 0.3, 0.0], pose_at(1.0 + i * DT), yaw=0.3))
    assert law.segment(here).turn == pytest.approx(0.0, abs=0.01)
    law.sight(sighting(0, [0.5, 0.3, 0.0], pose_at(1.0 + 9 * DT), yaw=0.3))
    assert law.segment(here).turn == pytest.approx(-0.3, abs=0.01)
    assert law.rejected[0] == 0


def test_links_of_the_helper_are_seen_from_the_earlier_image():
    turned = (0.0, 0.0, 1.0, np.pi / 2)
    link = links_between([turned, (0.0, 3.2, 1.0, np.pi / 2)], 3.2)[0]
    assert link.t_heading == pytest.approx([1.0, 0.0, 0.0])


def test_arrival_needs_the_place_to_be_held():
    law = law_on(progress={"arrive_hold_s": 0.4})
    for i in range(11):
        law.sight(sighting(0, [0.0, 0.0, 0.0], pose_at(i * DT)))
        law.step(pose_at(i * DT), np.zeros(4), DT)
        assert not law.arrived
    for i in range(11, 16):
        law.sight(sighting(0, [0.0, 0.0, 0.0], pose_at(i * DT)))
        law.step(pose_at(i * DT), np.zeros(4), DT)
    assert law.arrived


def test_passing_through_the_place_is_no_arrival():
    law = law_on(progress={"arrive_hold_s": 0.0})
    moving = OdometryPose(0.0, np.zeros(3), 0.0, np.array([0.4, 0.0, 0.0]))
    law.sight(sighting(0, [0.0, 0.0, 0.0], moving))
    law.step(moving, np.zeros(4), DT)
    assert not law.arrived


def test_a_curve_is_flown_along_its_images_past_a_column():
    targets = ((1.0, 0.0, 1.0, 0.0), (1.8, 0.5, 1.0, 0.8), (1.9, 1.4, 1.0, 1.57))
    for seed in SEEDS:
        flown = fly(targets, ((1.4, 0.1, 0.03),), seed=seed)
        assert flown.outcome == "reached"
        assert flown.error <= 0.03
        assert flown.yaw_error <= 0.5
        assert flown.clearance >= 0.10
        check_limits(flown)


def test_pictures_in_which_the_target_is_missing_for_a_moment_do_no_harm():
    flown = fly(*scenario("5.1", 2), seed=2, tamper=lambda t, s: None if t % 3.0 > 2.6 else s)
    assert flown.outcome == "reached"
    assert flown.error <= 0.03
    assert flown.clearance >= 0.10
    check_limits(flown)


def test_a_flight_stops_and_hovers_at_the_images_it_is_told_to():
    targets = ((0.8, 0.0, 1.0, 0.0), (1.6, 0.0, 1.0, 0.0), (2.4, 0.0, 1.0, 0.0))
    settings = PilotSettings(hover_at=(1,), hover_s=3.0)
    flown = fly(targets, seed=2, settings=settings)
    straight = fly(targets, seed=2)
    assert flown.outcome == "reached"
    assert 3.0 < flown.duration - straight.duration < 8.0
    # For three seconds it is nowhere but at the second image.
    near = np.linalg.norm(flown.positions - np.array(targets[1][:3]), axis=1) < 0.04
    assert near.sum() * DT >= 3.0
    check_limits(flown)
