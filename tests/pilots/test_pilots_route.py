"""Routes over a visual path."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pilots_pictures import CAMERA
from vision_photographs import motion, view

from noctule.camera import CameraMount
from noctule.pilots.route import FEWEST, RouteError, backwards, laps, unroll
from noctule.pilots.visual_path import KeyImage, KeyLink, VisualPath
from noctule.vision.features import detect


def image(name, photograph="chelsea", right=0.0):
    pixels = view(photograph, motion(right=right), seed=int(right) + 3)
    return KeyImage(name, pixels, detect(pixels))


@pytest.fixture(scope="module")
def path():
    """Three pictures of one place, a little apart: the last one sees what the first one saw."""
    images = tuple(image(f"{k}.png", right=10.0 * k) for k in range(3))
    links = tuple(KeyLink(np.full((4, 2), 10.0 * k), np.full((4, 2), 10.0 * k + 1.0)) for k in range(2))
    return VisualPath(CAMERA, CameraMount(), images, links)


def test_the_route_of_a_single_lap_is_the_path_itself(path):
    assert laps(3, 1) == (0, 1, 2)
    assert unroll(path, laps(3, 1)) is path


def test_laps_begin_again_at_the_first_image_and_backwards_is_the_end_first():
    assert laps(3, 2) == (0, 1, 2, 0, 1, 2)
    assert backwards((0, 1, 2)) == (2, 1, 0)


@given(st.integers(1, 20), st.integers(1, 5))
def test_backwards_twice_is_the_route_again(n, n_laps):
    route = laps(n, n_laps)
    assert len(route) == n * n_laps
    assert backwards(backwards(route)) == route


def test_backwards_a_link_is_turned_round(path):
    back = unroll(path, (2, 1, 0))
    assert [i.name for i in back.images] == ["2.png", "1.png", "0.png"]
    for link, stored in zip(back.links, reversed(path.links), strict=True):
        np.testing.assert_array_equal(link.p_ref, stored.p_next)
        np.testing.assert_array_equal(link.p_next, stored.p_ref)


def test_a_lap_closes_by_a_match_of_the_last_image_with_the_first(path):
    twice = unroll(path, laps(3, 2))
    assert [i.name for i in twice.images] == ["0.png", "1.png", "2.png"] * 2
    assert len(twice.links) == 5
    assert (twice.links[0], twice.links[1]) == path.links
    closing = twice.links[2]
    assert len(closing.p_ref) == len(closing.p_next) >= FEWEST
    # From the last picture to the first everything moves by those 20 px.
    moved = np.abs(closing.p_next - closing.p_ref)
    assert np.median(moved[:, 0]) == pytest.approx(20.0, abs=0.5)
    assert np.median(moved[:, 1]) < 0.5
    # What is flown again is not matched again.
    assert twice.links[3] is twice.links[0]


@settings(max_examples=15)  # each matches pictures
@given(
    st.lists(st.integers(0, 2), min_size=1, max_size=8).filter(lambda r: all(a != b for a, b in pairwise(r)))
)
def test_an_unrolled_path_has_the_images_of_the_route_and_a_link_between_each_two(path, route):
    flown = unroll(path, route)
    assert [i.name for i in flown.images] == [f"{k}.png" for k in route]
    assert len(flown.links) == len(route) - 1


def test_a_path_that_does_not_end_where_it_begins_is_refused_for_laps(path):
    elsewhere = image("far.png", "astronaut")
    images = (*path.images, elsewhere)
    nothing = np.empty((0, 2))
    far = VisualPath(CAMERA, path.mount, images, (*path.links, KeyLink(nothing, nothing)))
    with pytest.raises(RouteError) as error:
        unroll(far, laps(4, 2))
    said = str(error.value)
    assert said.startswith("route: image '0.png' cannot follow 'far.png', they show different places: ")
    assert said.endswith(f"{FEWEST} are needed; for laps teach a path that ends where it begins")
    assert "\n" not in said


@pytest.mark.parametrize(
    ("route", "line"),
    [
        ((), "route: it has no images, expected one at least; name the images to fly"),
        ((0, 3), "route: there is no image 3, the path has the images 0 to 2; take one of those"),
        ((0, -1), "route: there is no image -1, the path has the images 0 to 2; take one of those"),
        (
            (1, 1),
            "route: image '1.png' would follow itself, expected another one; "
            "laps need a path of two images at least",
        ),
    ],
)
def test_a_route_that_cannot_be_flown_is_refused(path, route, line):
    with pytest.raises(RouteError) as error:
        unroll(path, route)
    assert str(error.value) == line
