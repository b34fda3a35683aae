"""Links: what two pictures share is counted, its spread and the motion between them are told."""

from __future__ import annotations

import numpy as np
import pytest
from vision_homography_scenes import FOCAL, HEIGHT, WIDTH, make_pair

from noctule.camera import PinholeCamera, level_camera_rotation
from noctule.geometry import rot_y
from noctule.vision.links import covered, measure_link

CAMERA = PinholeCamera.centred(WIDTH, HEIGHT, FOCAL)


def measured(pair, **options):
    return measure_link(CAMERA.to_pixels(pair.m_ref), CAMERA.to_pixels(pair.m_cur), CAMERA, **options)


def mean_inverse_depth_ahead(pair) -> float:
    """Of the points in the second camera: the depths there follow from the motion."""
    metres = pair.t / np.mean(1.0 / pair.depth)
    x = np.column_stack([pair.m_ref, np.ones(len(pair.m_ref))]) * pair.depth[:, None]
    return float(np.mean(1.0 / (x @ rot_y(pair.yaw).T + metres)[:, 2]))


@pytest.mark.parametrize("seed", range(4))
def test_baseline_and_turn_are_those_of_the_motion(seed):
    pair = make_pair("room", 80, np.random.default_rng(seed), baseline=0.5)
    link = measured(pair)
    assert link.shared == 80
    metres = np.linalg.norm(pair.t) / np.mean(1.0 / pair.depth)
    assert link.baseline == pytest.approx(metres * mean_inverse_depth_ahead(pair), rel=0.15)
    assert link.yaw == pytest.approx(pair.yaw, abs=np.radians(0.5))
    assert link.conditioned
    assert link.share > 0.9
    assert 0.1 < link.noise < 1.0


def test_a_turn_on_the_spot_has_no_baseline_and_is_well_conditioned():
    pair = make_pair("room", 80, np.random.default_rng(1), baseline=0.0)
    link = measured(pair)
    assert link.baseline == 0.0
    assert link.conditioned
    assert link.yaw == pytest.approx(pair.yaw, abs=np.radians(0.3))


def test_points_that_have_nothing_to_do_with_each_other_are_no_link():
    rng = np.random.default_rng(2)
    a, b = (rng.uniform(0.0, 1.0, (60, 2)) * [WIDTH, HEIGHT] for _ in range(2))
    link = measure_link(a, b, CAMERA)
    assert not link.conditioned
    assert link.share < 0.5


def test_without_points_the_link_says_why():
    nothing = np.empty((0, 2))
    assert measure_link(nothing, nothing, CAMERA).reason == "no points are shared"
    link = measure_link(nothing, nothing, CAMERA, reason="3 features look alike, 14 are needed")
    assert (link.shared, link.conditioned) == (0, False)
    assert link.reason == "3 features look alike, 14 are needed"


def test_four_points_are_counted_but_tell_no_motion():
    p = np.array([[100.0, 100.0], [600.0, 120.0], [300.0, 400.0], [700.0, 300.0]])
    link = measure_link(p, p + 3.0, CAMERA)
    assert (link.shared, link.conditioned, link.baseline) == (4, False, 0.0)
    assert link.displacement == pytest.approx(np.hypot(3.0, 3.0))


def test_the_roll_and_pitch_that_were_reported_are_taken_out():
    pair = make_pair("room", 100, np.random.default_rng(5), baseline=0.4)
    tilted = np.column_stack([pair.m_cur, np.ones(len(pair.m_cur))]) @ level_camera_rotation(0.1, -0.05)
    p = CAMERA.to_pixels(tilted[:, :2] / tilted[:, 2:3])
    level, known = (
        measured(pair),
        measure_link(CAMERA.to_pixels(pair.m_ref), p, CAMERA, ((0.0, 0.0), (0.1, -0.05))),
    )
    assert known.yaw == pytest.approx(level.yaw, abs=1e-6)
    assert known.baseline == pytest.approx(level.baseline, abs=1e-5)


def test_the_parts_of_the_picture_are_counted_once_each():
    assert covered(np.empty((0, 2)), CAMERA) == 0
    assert covered(np.array([[0.0, 0.0], [5.0, 5.0], [WIDTH - 1.0, HEIGHT - 1.0]]), CAMERA) == 2
    x, y = np.meshgrid(np.arange(0.0, WIDTH, 20.0), np.arange(0.0, HEIGHT, 20.0))
    assert covered(np.column_stack([x.ravel(), y.ravel()]), CAMERA) == 24


def test_the_picture_with_the_worse_spread_counts():
    rng = np.random.default_rng(3)
    wide = rng.uniform(0.0, 1.0, (60, 2)) * [WIDTH, HEIGHT]
    narrow = 20.0 + 0.1 * wide
    assert measure_link(wide, narrow, CAMERA).cells == 1
    assert measure_link(narrow, wide, CAMERA).cells == 1
