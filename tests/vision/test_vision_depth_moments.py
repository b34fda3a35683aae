"""Shapes: ellipses against analytic ones, Hu's invariants against OpenCV's and against their invariance."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from vision_depth_rooms import CAMERA, plain_background

from noctule.vision.depth import Blob, ellipse, find_blobs, hu_moments, normalised_moments, shape_distance

SIZE = 240
V, U = np.mgrid[:SIZE, :SIZE].astype(float)
ANGLES = st.floats(-np.pi, np.pi)


def blob_of(mask):
    depth = np.where(mask, 1000, 0).astype(np.uint16)
    (blob,) = find_blobs(depth, plain_background(mask.shape), CAMERA, min_area=1)[1]
    return blob


def made(moments, area=400):
    """A blob of which only the moments matter."""
    return Blob(1, area, 0, 0, 1, 1, np.zeros(2), np.asarray(moments, float), np.zeros(3), 0.0)


def disc(a, b, theta, u=119.3, v=120.8):
    """Return a filled ellipse as a mask: semi-axes [px], angle of the first one from u toward v."""
    x, y = U - u, V - v
    c, s = np.cos(theta), np.sin(theta)
    return ((c * x + s * y) / a) ** 2 + ((c * y - s * x) / b) ** 2 <= 1.0


def hook(theta, scale=1.0, mirrored=False):
    """Return an L with unequal arms, turned and scaled about the centre of the picture."""
    corners = [(-30, -40), (-30, 50), (-10, 50), (-10, -10), (45, -10), (45, -40)]
    p = scale * np.array(corners, dtype=float)
    p[:, 1] *= -1.0 if mirrored else 1.0
    c, s = np.cos(theta), np.sin(theta)
    p = p @ np.array([[c, s], [-s, c]]) + SIZE / 2
    mask = np.zeros((SIZE, SIZE), dtype=np.uint8)
    cv2.fillPoly(mask, [np.round(p * 256).astype(np.int32)], 1, shift=8)
    return mask > 0


def axis_difference(a, b):
    """Return the angle between two lines."""
    return abs((a - b + np.pi / 2) % np.pi - np.pi / 2)


@settings(deadline=None, max_examples=60)
@given(st.floats(20, 100), st.floats(0.3, 0.8), ANGLES)
def test_a_filled_ellipse_gets_its_own_axes_and_angle_back(a, ratio, theta):
    found = ellipse(blob_of(disc(a, ratio * a, theta)))
    assert found.a == pytest.approx(a, abs=0.3)
    assert found.b == pytest.approx(ratio * a, abs=0.3)
    assert axis_difference(found.theta, theta) < np.radians(1.5)


def test_a_filled_rectangle_has_the_axes_of_its_second_moments():
    mask = np.zeros((60, 120), dtype=bool)
    mask[10:40, 10:110] = True
    found = ellipse(blob_of(mask))
    # For n pixels in a row the second moment is (n^2 - 1) / 12 a pixel.
    assert found.a == pytest.approx(2.0 * np.sqrt((100**2 - 1) / 12), rel=1e-12)
    assert found.b == pytest.approx(2.0 * np.sqrt((30**2 - 1) / 12), rel=1e-12)
    assert found.theta == 0.0


@given(st.floats(1.0, 1e4), st.floats(0.0, 0.99), st.floats(-1.5, 1.5))
def test_axes_and_angle_are_those_of_the_moments_eigenvectors(major, ratio, theta):
    axis = np.array([np.cos(theta), np.sin(theta)])
    other = np.array([-axis[1], axis[0]])
    M = major * np.outer(axis, axis) + ratio * major * np.outer(other, other)
    found = ellipse(made([400 * M[0, 0], 400 * M[0, 1], 400 * M[1, 1], 0, 0, 0, 0]))
    assert found.a == pytest.approx(2.0 * np.sqrt(major), rel=1e-9)
    assert found.b == pytest.approx(2.0 * np.sqrt(ratio * major), rel=1e-6, abs=1e-5 * np.sqrt(major))
    assert axis_difference(found.theta, theta) < 1e-6
    assert -np.pi / 2 <= found.theta <= np.pi / 2


def test_the_angle_goes_from_right_to_down_in_the_picture():
    mask = np.zeros((50, 50), dtype=np.uint8)
    cv2.line(mask, (5, 5), (45, 25), 1, 3)  # down to the right
    assert ellipse(blob_of(mask > 0)).theta == pytest.approx(np.arctan2(20, 40), abs=0.02)


def test_the_axis_turns_with_the_shape_all_the_way_round():
    turns = np.radians(np.arange(0, 360, 7))
    theta = np.array([ellipse(blob_of(hook(turn))).theta for turn in turns])
    offset = theta[0] - turns[0]
    assert max(axis_difference(t, turn + offset) for t, turn in zip(theta, turns, strict=True)) < 0.02
    # As printed, arctan(mu11 / (mu20 - mu02)) / 2 stays within a quarter turn and cannot follow.
    assert np.ptp(theta) > 0.9 * np.pi


def test_a_line_of_pixels_has_a_major_axis_only():
    mask = np.eye(30, dtype=bool)
    found = ellipse(blob_of(mask))
    assert found.b == pytest.approx(0.0, abs=1e-6)
    assert found.theta == pytest.approx(np.pi / 4)
    single = np.zeros((5, 5), dtype=bool)
    single[2, 2] = True
    assert ellipse(blob_of(single)).a == 0.0


@settings(deadline=None, max_examples=100)
@given(st.lists(st.tuples(st.integers(10, 230), st.integers(10, 230)), min_size=3, max_size=9))
def test_hu_s_moments_agree_with_opencv_s(corners):
    mask = np.zeros((SIZE, SIZE), dtype=np.uint8)
    cv2.fillPoly(mask, [np.array(corners, dtype=np.int32)], 1)
    assume(cv2.connectedComponents(mask, connectivity=8)[0] == 2)
    expected = cv2.HuMoments(cv2.moments(mask, binaryImage=True)).ravel()
    np.testing.assert_allclose(hu_moments(blob_of(mask > 0)), expected, rtol=1e-6, atol=1e-9)


def test_normalised_moments_divide_by_the_power_of_the_area_that_hu_gives():
    blob = blob_of(hook(0.4))
    m = cv2.moments(hook(0.4).astype(np.uint8), binaryImage=True)
    expected = [m[f"nu{order}"] for order in ("20", "11", "02", "30", "21", "12", "03")]
    np.testing.assert_allclose(normalised_moments(blob), expected, rtol=1e-9)


@settings(deadline=None, max_examples=40)
@given(ANGLES, st.floats(1.4, 2.0))
def test_hu_s_moments_stay_while_the_shape_turns_and_grows(theta, scale):
    # Smaller shapes are cut into so few pixels that phi4, of third order, is off by more.
    pattern = hu_moments(blob_of(hook(0.0, 1.6)))
    np.testing.assert_allclose(hu_moments(blob_of(hook(theta, scale)))[:4], pattern[:4], rtol=0.12)


@given(st.lists(st.floats(-0.5, 0.5), min_size=7, max_size=7), ANGLES)
def test_hu_s_moments_are_exactly_invariant_under_a_rotation_of_the_moments(values, theta):
    """Of moments in the plane as such, without a grid of pixels: rotate the point masses that make them."""
    rng = np.random.default_rng(abs(hash(tuple(values))) % 2**32)
    p, weight = rng.normal(size=(12, 2)), rng.uniform(1, 2, 12)

    def phi(q):
        x, y = (q - weight @ q / weight.sum()).T
        powers = ((2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
        return hu_moments(made([(weight * x**i * y**j).sum() for i, j in powers], area=30))

    R = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    mirrored = phi(p * [1.0, -1.0])
    np.testing.assert_allclose(phi(p @ R.T), phi(p), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(mirrored[:6], phi(p)[:6], rtol=1e-9, atol=1e-15)
    assert mirrored[6] == pytest.approx(-phi(p)[6], rel=1e-9, abs=1e-15)


def test_a_shape_is_nearer_to_itself_turned_than_to_another_one():
    pattern = hu_moments(blob_of(hook(0.0, 1.5)))
    same = shape_distance(pattern, hu_moments(blob_of(hook(2.0, 1.5))))
    box = shape_distance(pattern, hu_moments(blob_of(disc(80, 55, 0.3))))
    assert same < 0.1 < box


def test_the_distance_is_eq_16_with_the_absolute_values():
    a = np.array([0.2, 1e-3, -1e-4, 1e-5, 1e-9, 1e-7, -1e-8])
    b = np.array([0.3, 1e-3, -1e-4, 1e-5, 1e-9, 1e-7, -1e-8])
    assert shape_distance(a, b) == pytest.approx(abs(np.log(0.2) - np.log(0.3)) / abs(np.log(0.2)))
    # Printed without absolute values a smaller phi would count as nothing.
    assert shape_distance(b, a) == pytest.approx(abs(np.log(0.2) - np.log(0.3)) / abs(np.log(0.3)))
    # An invariant of the other sign is far away.
    assert shape_distance(a, a * [1, 1, 1, 1, 1, 1, -1]) == pytest.approx(2.0)


@given(st.lists(st.floats(-0.9, 0.9), min_size=7, max_size=7))
def test_no_shape_is_apart_from_itself(phi):
    assert shape_distance(np.array(phi), np.array(phi)) == 0.0


def test_invariants_that_are_rounding_have_no_say_but_their_absence_has():
    round_one = np.array([0.16, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    other = np.array([0.16, 0.0, 1e-19, 0.0, -1e-20, 1e-18, 1e-20])
    assert shape_distance(round_one, other) == 0.0
    lopsided = np.array([0.16, 1e-2, 1e-3, 1e-4, 1e-6, 1e-5, 1e-6])
    assert 1.0 < shape_distance(lopsided, round_one) < 10.0
    assert shape_distance(lopsided, np.zeros(7)) > 1.0  # a single pixel is no drone


def test_a_pattern_with_an_invariant_of_one_is_infinitely_far_from_all_others():
    pattern = np.array([1.0, 1e-2, 1e-3, 1e-4, 1e-6, 1e-5, 1e-6])
    assert shape_distance(pattern, pattern) == 0.0
    assert shape_distance(pattern, pattern * 1.01) == np.inf
