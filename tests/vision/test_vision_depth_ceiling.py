"""Backgrounds and blobs on frames of the simulated ceiling camera, with its shadows, steps and holes."""

import dataclasses

import numpy as np
import pytest

from noctule.geometry import Pose
from noctule.simulation.ceiling import CeilingSpec, DepthStage, ThingPose
from noctule.vision.depth import MovingBackgroundError, find_blobs, fits, learn_background

STAGE = DepthStage(CeilingSpec(hull=True), 0)
CAMERA = STAGE.camera.intrinsics
POSE = Pose(np.array([0.2, 0.1, 1.3]), 0.6)


@pytest.fixture(scope="module")
def background():
    return learn_background(STAGE.frame(k / 30.0, None).depth for k in range(40))


def test_the_empty_room_is_learned_and_has_no_blobs(background):
    for k in range(5):
        depth = STAGE.frame(100.0 + k, None).depth
        assert find_blobs(depth, background, CAMERA)[1] == ()
        assert fits(background, depth) > 0.98


def test_the_drone_is_found_where_it_is(background):
    _, blobs = find_blobs(STAGE.frame(110.0, POSE).depth, background, CAMERA)
    drone = max(blobs, key=lambda blob: blob.area)
    found = STAGE.camera.R_world_camera @ drone.points + STAGE.camera.t_world_camera
    np.testing.assert_allclose(found, POSE.position, atol=0.08)  # of its top and rims, seen at a slant


def test_a_person_beside_the_drone_is_another_blob(background):
    person = ThingPose("person", 0.6, 0.5)
    alone = max(blob.area for blob in find_blobs(STAGE.frame(120.0, POSE).depth, background, CAMERA)[1])
    _, blobs = find_blobs(STAGE.frame(120.0, POSE, [person]).depth, background, CAMERA)
    u, v = STAGE.camera.project(POSE.position[None])[0]
    drone = min(blobs, key=lambda blob: np.hypot(blob.centroid[0] - u, blob.centroid[1] - v))
    assert drone.area == pytest.approx(alone, rel=0.1)
    u, v = STAGE.camera.project(np.array([[0.6, 0.5, 1.5]]))[0]
    others = [blob for blob in blobs if blob is not drone and blob.area > 2000]
    assert any(blob.left < u < blob.right and blob.top < v < blob.bottom for blob in others)


def test_a_person_who_walks_through_is_refused():
    frames = (
        STAGE.frame(130.0 + k / 30.0, None, [ThingPose("person", -1.5 + 0.05 * k, 0.0)]).depth
        for k in range(40)
    )
    with pytest.raises(MovingBackgroundError):
        learn_background(frames)


@pytest.mark.parametrize("changed", [{"pitch_deg": 2.0}, {"roll_deg": -2.0}, {"z_m": 0.04}])
def test_a_camera_that_was_knocked_no_longer_fits_and_people_do_not_matter(background, changed):
    spec = CeilingSpec(hull=True)
    knocked = DepthStage(spec.model_copy(update={k: getattr(spec, k) + v for k, v in changed.items()}), 0)
    people = [ThingPose("person", 0.6, 0.5), ThingPose("person", -0.4, -0.3, 1.0)]
    assert fits(background, knocked.frame(140.0, POSE, people).depth) < 0.5
    assert fits(background, STAGE.frame(140.0, POSE, people).depth) > 0.95


def test_a_drone_that_stands_on_the_floor_is_foreground(background):
    standing = dataclasses.replace(POSE, position=np.array([0.2, 0.1, 0.08]))
    _, blobs = find_blobs(STAGE.frame(150.0, standing).depth, background, CAMERA)
    assert max(blob.area for blob in blobs) > 500
