from itertools import pairwise

import numpy as np
import pytest
from pilots_cloud import CAMERA, MOUNT, OPTICS, cloud, inside, pixels
from pilots_pictures import path_of, picture_of
from pydantic import ValidationError

from noctule.camera import CameraMount
from noctule.messages import Limits, Picture
from noctule.pilots import PilotSettings, make_matcher, make_pilot
from noctule.pilots.factory import LAWS, link_geometries
from noctule.pilots.law import Optics
from noctule.pilots.link_estimates import LinkEstimates
from noctule.pilots.noctule_law import NoctuleLaw
from noctule.pilots.published import PublishedLaw
from noctule.pilots.settings import DetourSettings, ProgressGains, PublishedGains
from noctule.pilots.visual_path import KeyImage, KeyLink, VisualPath
from noctule.vision.features import Features

DT = 1.0 / 30.0
BLANK = np.zeros((4, 4, 3), dtype=np.uint8)
NO_FEATURES = Features(np.empty((0, 2)), np.empty((0, 128), dtype=np.float32), "sift")
GROUPS = (PublishedGains, ProgressGains, DetourSettings, PilotSettings)


def path_through(points, *places, tilts=None, mount=MOUNT, noise=0.1):
    """A path of blank pictures whose links are the points that neighbours share."""
    tilts = tilts or [(0.0, 0.0)] * len(places)
    rng = np.random.default_rng(1)
    seen = [pixels(points, *place, *tilt) for place, tilt in zip(places, tilts, strict=True)]
    links = []
    for a, b in pairwise(seen):
        both = inside(a) & inside(b)
        links.append(KeyLink(*(p[both] + rng.normal(0.0, noise, (both.sum(), 2)) for p in (a, b))))
    images = tuple(KeyImage(f"{i}", BLANK, NO_FEATURES, *tilt) for i, tilt in enumerate(tilts))
    return VisualPath(CAMERA, mount, images, tuple(links))


def harmonic_depth(points, place):
    """The mean depth of the points in the picture from a place, as the estimator has it."""
    z = points[:, 0] - place[0][0] - MOUNT.t_body_camera[0]  # the heading is 0 wherever this is used
    return 1.0 / np.mean(1.0 / z)


@pytest.mark.parametrize(("law", "kind"), [("noctule", NoctuleLaw), ("published", PublishedLaw)])
def test_the_law_of_the_settings_is_built_with_its_own_estimator(law, kind):
    path = path_through(cloud(), ([0.0, 0.0, 1.0], 0.0), ([0.5, 0.0, 1.0], 0.0))
    pilot = make_pilot(PilotSettings(law=law), path, Limits(), DT)
    assert isinstance(pilot.law, kind)
    assert pilot.law.target == 0
    assert pilot.perception.method == {"noctule": "upright", "published": "generic"}[law]
    assert pilot.phase == "matching"
    assert set(LAWS) == {"noctule", "published"}


def test_a_pilot_can_fly_to_a_single_image():
    for law in LAWS:
        pilot = make_pilot(PilotSettings(law=law), path_of("astronaut"), Limits(), DT)
        assert pilot.law.target == 0


def test_the_vehicles_lag_is_expected_by_odometry_and_detour():
    path = path_through(cloud(), ([0.0, 0.0, 1.0], 0.0))
    pilot = make_pilot(PilotSettings(vehicle_lag=0.7), path, Limits(), DT)
    assert pilot.odometry.lag == 0.7
    assert pilot.law.progress.detour.lag == 0.7


@pytest.mark.parametrize(
    ("to", "yaw"),
    [([0.5, 0.0, 1.0], 0.0), ([0.3, 0.4, 1.0], 0.0), ([0.4, -0.1, 0.7], 0.0), ([0.4, 0.2, 1.1], 0.2)],
    ids=["ahead", "left", "down", "turned"],
)
def test_a_link_points_from_an_image_to_the_next(to, yaw):
    points, first = cloud(80), ([0.0, 0.0, 1.0], 0.0)
    link = link_geometries(LinkEstimates(path_through(points, first, (to, yaw)), OPTICS, 0.0))[0]
    lever = MOUNT.t_body_camera
    turned = np.array([np.cos(yaw) * lever[0], np.sin(yaw) * lever[0], 0.0])
    way = np.array(to) + turned - np.array(first[0]) - lever
    direction = link.t_heading / np.linalg.norm(link.t_heading)
    assert np.degrees(np.arccos(direction @ way / np.linalg.norm(way))) < 1.5


def test_the_depth_ratio_is_that_of_the_two_scenes():
    points, first, second = cloud(80), ([0.0, 0.0, 1.0], 0.0), ([0.8, 0.0, 1.0], 0.0)
    path = path_through(points, first, second)
    shared = points[inside(pixels(points, *first)) & inside(pixels(points, *second))]
    depths = [harmonic_depth(shared, place) for place in (first, second)]
    link = link_geometries(LinkEstimates(path, OPTICS, 0.0))[0]
    assert depths[1] < 0.85 * depths[0]
    assert link.depth_ratio == pytest.approx(depths[1] / depths[0], rel=0.05)
    assert link.t_heading[0] == pytest.approx(0.8 / depths[1], rel=0.05)


def test_images_at_one_place_have_a_depth_ratio_within_bounds():
    place = ([0.0, 0.0, 1.0], 0.0)
    link = link_geometries(LinkEstimates(path_through(cloud(), place, place), OPTICS, 0.0))[0]
    assert 0.3 <= link.depth_ratio <= 3.0
    assert np.linalg.norm(link.t_heading) < 0.01


def test_the_attitude_of_every_key_image_is_taken_out_of_the_links():
    mount = CameraMount(stabilised=False)
    tilted = path_through(
        cloud(80),
        ([0.0, 0.0, 1.0], 0.0),
        ([0.5, 0.0, 1.0], 0.0),
        tilts=[(0.03, -0.02), (-0.02, 0.05)],
        mount=mount,
    )
    link = link_geometries(LinkEstimates(tilted, Optics(CAMERA, mount), 0.0))[0]
    direction = link.t_heading / np.linalg.norm(link.t_heading)
    assert direction[0] > np.cos(np.radians(1.5))
    untold = link_geometries(LinkEstimates(tilted, OPTICS, 0.0))[0].t_heading
    assert untold[0] / np.linalg.norm(untold) < np.cos(np.radians(5.0))


def test_every_link_of_a_path_is_told():
    places = [([0.4 * i, 0.0, 1.0], 0.0) for i in range(4)]
    assert len(link_geometries(LinkEstimates(path_through(cloud(80), *places), OPTICS, 0.0))) == 3


def test_the_matcher_is_what_the_worker_runs():
    found = make_matcher(PilotSettings(), path_of("astronaut"))(Picture(1.5, picture_of("astronaut")), 0)
    assert (found.stamp, found.key_index, found.reason) == (1.5, 0, "")
    assert len(found.p_ref) == len(found.p_current) > 50


def test_an_unknown_law_is_refused_with_the_names_of_the_known_ones():
    with pytest.raises(ValidationError) as caught:
        PilotSettings.model_validate({"law": "impossible"})
    assert caught.value.errors()[0]["msg"] == "Input should be 'published' or 'noctule'"


def numbers():
    for group in GROUPS:
        for name, told in group.model_fields.items():
            if told.annotation in (int, float, float | None):
                yield pytest.param(group, name, id=f"{group.__name__}.{name}")


@pytest.mark.parametrize(("group", "name"), list(numbers()))
def test_every_number_out_of_range_is_refused(group, name):
    for value in (-1.0, 1e4, float("nan"), float("inf")):
        with pytest.raises(ValidationError) as caught:
            group.model_validate({name: value})
        assert caught.value.errors()[0]["loc"] == (name,)


@pytest.mark.parametrize("group", GROUPS)
def test_every_setting_is_described_and_unknown_ones_are_refused(group):
    described = [
        f.description for f in group.model_fields.values() if not hasattr(f.annotation, "model_fields")
    ]
    assert all(described)
    with pytest.raises(ValidationError, match="Extra inputs are not permitted"):
        group.model_validate({"speed": 1.0})


def test_settings_cannot_be_changed_in_flight():
    with pytest.raises(ValidationError, match="frozen"):
        PilotSettings().min_points = 8


def test_a_gain_that_grows_with_the_error_is_refused_before_the_flight():
    with pytest.raises(ValidationError, match=r"lambda_inf is 0\.1 and lambda_0 0\.05; the gain"):
        PilotSettings.model_validate({"published": {"lambda_0": 0.05}})


def test_more_points_needed_than_are_tracked_is_refused_before_the_flight():
    with pytest.raises(
        ValidationError, match="min_points is 100 and max_points 60; at least min_points have"
    ):
        PilotSettings(min_points=100)
