"""A path that the ceiling camera cannot see, or where something stands, is refused before take-off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from noctule.camera import CEILING_CAMERA
from noctule.control.paths import line, plan
from noctule.flight.mission import MissionFileError, bundled_missions, load_mission, parse_mission
from noctule.flight.path_view import UnseenPathError, behind, require_free, unseen
from noctule.localization.site import Site, SiteCamera
from noctule.simulation.ceiling import CeilingSpec, DepthStage
from noctule.vision.depth import learn_background

LINE = """
[[space_path.segments]]
kind = "line"
points = [[0.0, 0.0, 1.0], {end}]
"""
MOVE = "fly lower or nearer to its middle there, or move the camera"


def refused(end: str, rest: str = "") -> str:
    with pytest.raises((UnseenPathError, MissionFileError)) as caught:
        parse_mission(LINE.format(end=end) + rest, "my.toml")
    return str(caught.value)


def test_the_place_where_the_picture_is_left_is_told_with_how_far_it_is_from_it():
    assert refused("[2.5, 0.0, 1.0]") == (
        "my.toml: space_path: it is at s = 1.06 m (1.06, 0.00, 1.00) "
        f"nearer than 0.10 m to the edge of the ceiling camera's picture; {MOVE}"
    )
    assert refused("[0.5, 0.0, 1.0]", "[start]\nx = -1.6\ny = 1.8\n") == (
        f"my.toml: start: it is at (-1.60, 1.80, 1.00) 0.25 m outside of the ceiling camera's picture; {MOVE}"
    )


def test_a_path_too_near_to_the_camera_or_too_far_for_it_is_refused():
    near = refused("[0.3, 0.0, 1.2]", "[ceiling]\nnearest_m = 2.3\n")
    assert near.endswith(
        "m below the ceiling camera, which measures from 2.3 m on; fly lower there, or hang it higher"
    )
    far = refused("[0.3, 0.0, 0.8]", "[ceiling]\nfarthest_m = 2.5\n")
    assert far.endswith(
        "m from the ceiling camera, which measures up to 2.5 m; fly higher there, or hang it lower"
    )


def test_a_start_outside_of_the_fence_is_refused():
    assert refused("[0.5, 0.0, 1.0]", "[start]\nz = 3.5\n").startswith(
        "my.toml: start: it is outside of the fence at (0.00, 0.00, 3.50); expected x "
    )


def test_what_a_flight_by_pictures_alone_does_is_not_the_ceiling_cameras_business():
    far = "[start]\nx = 2.0\n[path]\nposes = [[2.5, 0.0, 1.0, 0.0]]\n"
    assert parse_mission(far, "my.toml").space_path is None
    for name in bundled_missions():
        assert load_mission(name).name == name


def test_what_is_seen_is_what_lies_in_the_picture_at_a_depth_that_is_measured():
    rng = np.random.default_rng(1)
    places = rng.uniform([-2.0, -2.0, 0.3], [2.0, 2.0, 3.2], (300, 3))
    for place in places:
        x = CEILING_CAMERA.to_camera(place[None])[0]
        p = CEILING_CAMERA.project(place[None])[0]
        found = unseen(CEILING_CAMERA, 0.5, 8.0, place[None])
        if found is None:
            assert (p > 0.0).all()
            assert (p < [639.0, 479.0]).all()
            assert x[2] >= 0.6
        elif x[2] > 0.6:
            # Refused for the picture's sake: 0.1 m farther from its middle it is outside, or nearly so.
            assert CEILING_CAMERA.inside(place[None])[0] < 0.1


@pytest.fixture(scope="module")
def site() -> Site:
    stage = DepthStage(CeilingSpec(), 0)
    background = learn_background(stage.frame(k / 30.0, None).depth for k in range(12))
    mean = background.mean.copy()
    # Something 1.3 m high was there: nearer than the floor in part of the picture.
    u, v = CEILING_CAMERA.project(np.array([[0.5, 0.0, 1.0]]))[0].astype(int)
    mean[v - 20 : v + 21, u - 20 : u + 21] = 2000.0
    return Site(SiteCamera(CEILING_CAMERA), replace(background, mean=mean), None, None)


def test_a_path_into_what_stood_in_the_empty_room_is_refused_with_its_place(site):
    with pytest.raises(UnseenPathError) as caught:
        require_free(site, plan(line((-0.5, 0.0, 1.0), (0.8, 0.0, 1.0))), "my.toml")
    said = str(caught.value)
    assert said.startswith("my.toml: space_path: something stood at s = ")
    assert said.endswith(
        "when the empty room was learned; expected 0.2 m free around it: "
        "fly elsewhere, or clear the place and learn the background again"
    )
    require_free(site, plan(line((-0.5, 0.0, 1.0), (-0.1, 0.0, 1.0))), "my.toml")
    # Above it there is room.
    require_free(site, plan(line((0.0, 0.0, 1.9), (0.8, 0.0, 1.9))), "my.toml")


def test_below_the_floor_is_behind_it_and_unknown_places_are_not(site):
    assert behind(site, np.array([[0.0, 0.0, -0.3], [0.0, 0.0, 0.3]])).tolist() == [True, False]
    assert not behind(site, np.array([[9.0, 9.0, 1.0], [0.2, -0.8, 9.0]])).any()
