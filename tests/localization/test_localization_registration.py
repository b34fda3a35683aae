import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from localization_flights import (
    CAMERA,
    HOME,
    background,
    drone,
    matcher,
    random_pose,
    scene,
    template,
)
from localization_rays import BOX, PERSON, TRAY, Thing, cast

from noctule.geometry import Pose, tilt, wrap_angle
from noctule.localization import fitting, placing
from noctule.localization.evidence import Grid, gather
from noctule.localization.registration import ALL, Scene, acquire, align, register
from noctule.localization.template import Template, TemplateError, TemplateSums, build_template, finish
from noctule.localization.tracker import turned

ANGLES = st.floats(-3.0, 3.0)


def off(pose: Pose, rng: np.random.Generator) -> Pose:
    return Pose(pose.position + rng.normal(0.0, 0.01, 3), pose.yaw + rng.normal(0.0, 0.05))


def errors(found: Pose, true: Pose) -> np.ndarray:
    return np.array([*(found.position - true.position), wrap_angle(found.yaw - true.yaw)])


@pytest.fixture(scope="module")
def answers():
    rng = np.random.default_rng(3)
    out = []
    for i in range(25):
        true = random_pose(rng)
        out.append((true, register(scene(drone(true), seed=500 + i), off(true, rng))))
    return out


def test_the_template_shows_the_body_and_not_the_air_beside_it():
    t = template()
    middle = t.grid.n // 2
    assert t.probability[middle, middle] > 0.95
    assert t.probability[2, 2] == 0.0
    assert t.probability[middle + round(0.19 / t.grid.cell), middle] > 0.8  # the nose
    assert 0.2 < t.extent < 0.32


def test_the_template_knows_the_height_of_what_is_seen():
    t = template()
    assert t.height[t.grid.n // 2, t.grid.n // 2] == pytest.approx(0.05, abs=0.004)
    assert t.surface == pytest.approx(0.045, abs=0.006)


def test_a_template_is_the_same_after_its_arrays():
    again = Template.from_arrays(template().arrays())
    assert again.grid == template().grid
    assert again.frames == 50
    for name in ("probability", "variance", "height", "weight", "log_drone", "log_free"):
        np.testing.assert_array_equal(getattr(again, name), getattr(template(), name))


def test_a_template_keeps_its_slant_and_one_without_has_none():
    arrays = replace(template(), slant=-0.008).arrays()
    assert Template.from_arrays(arrays).slant == -0.008
    del arrays["slant"]
    assert Template.from_arrays(arrays).slant == 0.0


@pytest.mark.parametrize("slant", [[math.nan], [0.0, 0.0], []])
def test_a_slant_that_is_no_number_is_refused(slant):
    with pytest.raises(TemplateError) as refused:
        Template.from_arrays({**template().arrays(), "slant": np.array(slant)})
    assert str(refused.value) == "not a template: its slant is not one number; learn it again"


def test_arrays_of_something_else_are_refused():
    arrays = template().arrays()
    del arrays["height"], arrays["weight"]
    with pytest.raises(TemplateError) as refused:
        Template.from_arrays(arrays)
    assert str(refused.value) == "not a template: height, weight missing; learn it again"


@pytest.mark.parametrize("spoil", ["nan", "shape", "cell"])
def test_a_spoiled_template_is_refused(spoil):
    arrays = {k: v.copy() for k, v in template().arrays().items()}
    if spoil == "nan":
        arrays["variance"][3, 3] = np.nan
    elif spoil == "shape":
        arrays["height"] = arrays["height"][:-1]
    else:
        arrays["grid"][0] = 0.0
    with pytest.raises(TemplateError) as refused:
        Template.from_arrays(arrays)
    assert str(refused.value) == (
        "not a template: its maps are not finite squares of one size; learn it again"
    )


def test_frames_without_a_drone_make_no_template():
    with pytest.raises(TemplateError) as refused:
        build_template([(cast(CAMERA, seed=1), HOME)] * 4, background().nearest, CAMERA)
    assert str(refused.value) == (
        "no template: 0 cm^2 were drone in most of 4 frames, expected at least 100; are the poses right, and "
        "does the drone fly alone?"
    )


def test_a_level_surface_covers_each_of_its_cells_once():
    s = scene(Thing(HOME, TRAY), seed=None)
    e = gather(s.depth, s.nearest, CAMERA, HOME, Grid(0.02, 30, 0.02))
    inside = e.drone[6:24, 8:22]
    assert inside.mean() == pytest.approx(1.0, abs=0.03)
    np.testing.assert_allclose(e.height[6:24, 8:22] / inside, 0.02, atol=0.002)


def test_pixels_without_depth_are_evidence_of_nothing():
    s = scene(drone(HOME), seed=None)
    e = gather(np.zeros_like(s.depth), s.nearest, CAMERA, HOME, Grid(0.01, 70, 0.0))
    assert e.drone.sum() == 0.0
    assert e.free.sum() == 0.0


def test_what_something_nearer_hides_is_unknown():
    lid = Thing(Pose(HOME.position + np.array([0.0, 0.0, 0.5]), 0.0), TRAY)
    grid = Grid(0.01, 10, 0.0)
    s = scene(drone(HOME), lid, seed=None)
    e = gather(s.depth, s.nearest, CAMERA, Pose(HOME.position + np.array([0.0, 0.15, 0.0]), 0.0), grid)
    assert e.drone.sum() + e.free.sum() < 0.2 * grid.n**2
    assert register(s, HOME).visible < 0.6


def test_the_floor_seen_beside_the_drone_is_free():
    s = scene(seed=None)
    e = gather(s.depth, s.nearest, CAMERA, HOME, Grid(0.02, 20, 0.0))
    assert e.drone.sum() == 0.0
    assert e.free.mean() == pytest.approx(1.0, abs=0.05)


def test_close_to_the_floor_background_is_not_taken_for_free():
    s = scene(seed=None)
    low = Pose(np.array([0.1, 0.1, 0.03]), 0.0)
    e = gather(s.depth, s.nearest, CAMERA, low, Grid(0.02, 20, 0.0))
    assert e.free.sum() == 0.0


def test_a_pose_is_found_to_millimetres_and_a_degree(answers):
    e = np.array([errors(found.pose, true) for true, found in answers])
    spread = e.std(axis=0)
    assert np.hypot(*spread[:2]) < 0.005
    assert spread[2] < 0.002
    assert np.degrees(spread[3]) < 1.0
    assert np.abs(e.mean(axis=0)[:3]).max() < 0.006


def test_tilt_is_seen(answers):
    roll = np.array([found.pose.roll - true.roll for true, found in answers])
    pitch = np.array([found.pose.pitch - true.pitch for true, found in answers])
    assert np.degrees([roll.std(), pitch.std()]).max() < 1.2


def test_the_covariance_promises_what_is_kept(answers):
    e = np.array([errors(found.pose, true) for true, found in answers])
    e -= e.mean(axis=0)
    nees = [x @ np.linalg.solve(found.covariance, x) / 4.0 for x, (_, found) in zip(e, answers, strict=True)]
    assert 0.2 < np.mean(nees) < 3.0


def test_the_drone_scores_as_expected_and_fits(answers):
    assert np.mean([found.ratio for _, found in answers]) == pytest.approx(1.0, abs=0.1)
    assert max(found.relief for _, found in answers) < 1.0
    assert max(found.outline for _, found in answers) < 0.6


def test_a_person_beside_the_drone_does_not_move_it():
    rng = np.random.default_rng(5)
    for i in range(8):
        true = random_pose(rng)
        way = rng.uniform(-math.pi, math.pi)
        beside = true.position[:2] + 0.55 * np.array([math.cos(way), math.sin(way)])
        person = Thing(Pose(np.array([*beside, 0.0]), way), PERSON)
        found = register(scene(drone(true), person, seed=700 + i), off(true, rng))
        assert np.linalg.norm(found.pose.position - true.position) < 0.015
        assert abs(math.degrees(wrap_angle(found.pose.yaw - true.yaw))) < 3.0


@pytest.mark.parametrize("turn", [-35.0, 35.0])
def test_a_heading_predicted_badly_is_searched_for(turn):
    found = register(scene(drone(HOME)), Pose(HOME.position, HOME.yaw + math.radians(turn)))
    assert abs(math.degrees(wrap_angle(found.pose.yaw - HOME.yaw))) < 2.0


def test_a_height_predicted_badly_is_mended():
    found = register(scene(drone(HOME)), Pose(HOME.position + np.array([0.0, 0.0, 0.09]), HOME.yaw))
    assert found.pose.position[2] == pytest.approx(HOME.position[2], abs=0.005)
    np.testing.assert_allclose(found.pose.position[:2], HOME.position[:2], atol=0.008)


@pytest.mark.parametrize("yaw", [-2.9, -1.4, 0.2, 1.7, 3.0])
def test_without_a_heading_it_is_found_up_to_a_half_turn(yaw):
    true = Pose(HOME.position, yaw)
    found = acquire(scene(drone(true)), HOME.position + np.array([0.03, -0.02, 0.01]))
    np.testing.assert_allclose(found.pose.position, true.position, atol=0.02)
    assert abs(wrap_angle(2.0 * (found.pose.yaw - yaw))) < 0.15


def test_right_and_wrong_headings_say_as_much_and_the_opposite():
    rng = np.random.default_rng(4)
    right, wrong = [], []
    for i in range(8):
        true = random_pose(rng)
        s = scene(drone(true), seed=40 + i)
        right.append(register(s, true).half_turn)
        wrong.append(register(s, Pose(true.position, wrap_angle(true.yaw + math.pi))).half_turn)
    assert np.mean(right) > 5.0
    assert np.mean(wrong) == pytest.approx(-np.mean(right), rel=0.3)


def test_poses_with_the_wrong_heading_are_astray_as_the_template_says():
    rng = np.random.default_rng(6)
    off = []
    for i in range(12):
        true = random_pose(rng)
        wrong = turned(true)
        found = register(scene(drone(true), seed=80 + i), wrong).pose
        at = wrong.R_world_body.T @ (found.position - true.position)
        off.append([*at[:2], found.pitch - wrong.pitch])
    ahead, aside, nose_down = np.mean(off, axis=0)
    x, y, _ = matcher().astray[0]
    assert abs(x) > 0.002
    assert (ahead, aside) == (pytest.approx(x, abs=0.001), pytest.approx(y, abs=0.001))
    assert nose_down == pytest.approx(-math.atan(matcher().astray[1, 1]), abs=0.001)


@pytest.mark.parametrize("solids", [TRAY, BOX])
def test_another_flat_thing_does_not_score(solids):
    found = acquire(scene(Thing(Pose(np.array([0.1, 0.2, 1.0]), 0.5), solids)), np.array([0.1, 0.2, 1.0]))
    assert found.ratio < 0.5 or found.outline > 0.6


def test_a_head_and_shoulders_have_another_relief():
    person = Thing(Pose(np.array([0.1, 0.2, 0.0]), 0.5), PERSON)
    found = acquire(scene(person), np.array([0.1, 0.2, 1.4]))
    assert found.relief > 1.2 or found.outline > 0.6 or found.visible < 0.5


def test_a_shape_that_is_its_own_half_turn_has_no_evidence_of_it():
    def even(a: np.ndarray) -> np.ndarray:
        return 0.5 * (a + a[..., ::-1, ::-1])

    rng = np.random.default_rng(1)
    sums = TemplateSums.empty()
    for i in range(6):
        true = random_pose(rng)
        s = scene(drone(true), seed=i)
        sums = sums.add(gather(s.depth, s.nearest, CAMERA, true, sums.grid))
    same = TemplateSums(
        sums.grid,
        sums.frames,
        *(even(a) for a in (sums.share, sums.square, sums.seen, sums.height, sums.area)),
    )
    symmetric = type(matcher()).of(finish(same))
    assert register(Scene(s.depth, s.nearest, CAMERA, symmetric), true).half_turn == 0.0


def test_learning_aligns_a_frame_to_the_template():
    rng = np.random.default_rng(8)
    true = random_pose(rng)
    answer = align(
        matcher(), cast(CAMERA, (drone(true),), seed=3), background().nearest, CAMERA, off(true, rng)
    )
    assert np.linalg.norm(answer.pose.position - true.position) < 0.012


def test_the_same_frame_gives_the_same_answer_bit_for_bit():
    s = scene(drone(HOME))
    a, b = register(s, HOME), register(s, HOME)
    assert a.score == b.score
    np.testing.assert_array_equal(a.pose.position, b.pose.position)
    np.testing.assert_array_equal(a.covariance, b.covariance)


def test_all_headings_are_tried_in_even_steps():
    assert np.allclose(np.diff(ALL), ALL[1])
    assert len(ALL) % 4 == 0


@settings(deadline=None)  # the first call compiles
@given(st.lists(st.floats(-2.0, 2.0), min_size=12, max_size=12))
def test_three_equations_are_solved(values):
    J, b = np.array(values[:9]).reshape(3, 3), np.array(values[9:])
    A = J.T @ J + 0.1 * np.eye(3)
    x = np.empty(3)
    assert fitting.solve3(A, b, x)
    np.testing.assert_allclose(A @ x, b, atol=1e-9)


def test_equations_without_an_answer_are_refused():
    assert not fitting.solve3(np.zeros((3, 3)), np.ones(3), np.empty(3))
    assert not fitting.solve3(np.diag([1.0, 1.0, -1.0]), np.ones(3), np.empty(3))


@given(ANGLES, st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-0.05, 0.05))
def test_a_fit_of_nothing_leaves_the_pose(yaw, roll, pitch, x):
    pose = Pose(np.array([x, 1.0, 2.0]), yaw, roll, pitch)
    got = placing.moved(pose.R_world_body, pose.position, np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(got, [x, 1.0, 2.0, wrap_angle(yaw), roll, pitch], atol=1e-9)


@given(ANGLES, st.floats(0.0, 0.9), st.floats(0.4, 3.0), st.floats(-0.02, 0.02))
def test_a_slanting_ray_draws_along_itself_and_a_steep_one_hardly(bearing, slope, under, slant):
    eye, along = np.array([0.3, -0.7, 3.2]), np.array([math.cos(bearing), math.sin(bearing)])
    off = placing.slanted(slant, eye, eye + under * np.array([*(slope * along), -1.0]))
    np.testing.assert_allclose(off, [*(slant * slope**3 * along), 0.0], atol=1e-12)


def test_no_ray_is_taken_for_more_slanting_than_half_a_right_angle():
    eye = np.array([0.0, 0.0, 2.0])
    np.testing.assert_array_equal(placing.slanted(0.01, eye, eye), 0.0)
    np.testing.assert_allclose(placing.slanted(0.01, eye, np.array([0.5, 0.0, 2.1])), [0.01, 0.0, 0.0])
    np.testing.assert_allclose(placing.slanted(0.01, eye, np.array([0.0, -3.0, 0.5])), [0.0, -0.01, 0.0])


@given(ANGLES, st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_a_surface_that_rises_to_the_nose_and_left_turns_the_body_so(yaw, roll, pitch):
    flat = Pose(np.zeros(3), 0.0)
    normal = tilt(roll, pitch)[:, 2]
    slopes = np.array([0.01, -normal[0] / normal[2], -normal[1] / normal[2]])
    got = placing.moved(flat.R_world_body, flat.position, np.array([0.02, 0.0, yaw]), slopes)
    normal_found = Pose(np.zeros(3), got[3], got[4], got[5]).R_world_body[:, 2]
    c, s = math.cos(yaw), math.sin(yaw)
    expected = np.array([c * normal[0] - s * normal[1], s * normal[0] + c * normal[1], normal[2]])
    np.testing.assert_allclose(normal_found, expected, atol=0.012)  # slopes one after the other: second order
    np.testing.assert_allclose(got[:3], [0.02, 0.0, 0.01], atol=1e-12)
