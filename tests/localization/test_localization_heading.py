"""Headings of a single blob: each within its own accuracy, continuous through any number of turns."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from localization_sightings import drone_seen, flat

from noctule.camera import CEILING_CAMERA, FixedCamera
from noctule.geometry import rot_x, wrap_angle
from noctule.localization.heading.ellipse import EllipseHeading
from noctule.localization.heading.pose import blob_pose, blob_position
from noctule.localization.heading.shape import AXIS, HARMONIC, PLANE, ShapeHeading, angular_harmonic
from noctule.localization.heading.sighting import world_points
from noctule.localization.heading.turns import (
    FULL_TURN,
    HALF_TURN,
    QUARTER_TURN,
    mean_and_variance,
    nearest_turn,
)
from noctule.messages import HeadingMeasurement
from noctule.simulation.ceiling import ThingPose

ELLIPSE = EllipseHeading()
DOWN = FixedCamera(CEILING_CAMERA.intrinsics, rot_x(np.pi), np.array([0.0, 0.0, 3.3]))  # picture's top is +y


def oblong(yaw: float, length: float, width: float) -> np.ndarray:
    """Points of a flat rectangle, dense enough that no pixel of it is missed."""
    grid = np.stack(np.meshgrid(np.arange(-length, length, 0.003), np.arange(-width, width, 0.003)), axis=-1)
    c, s = np.cos(yaw), np.sin(yaw)
    return grid.reshape(-1, 2) @ np.array([[c, s], [-s, c]])


angles = st.floats(-50.0, 50.0)


@given(angles, angles, st.sampled_from([QUARTER_TURN, HALF_TURN, FULL_TURN]))
def test_the_nearest_turn_is_the_same_angle_and_the_nearest(measured, predicted, period) -> None:
    yaw = nearest_turn(measured, predicted, period)
    assert abs(yaw - predicted) <= 0.5 * period + 1e-9
    turns = (yaw - measured) / period
    assert turns == pytest.approx(round(turns), abs=1e-9)


@given(
    st.lists(st.floats(-0.7, 0.7), min_size=1, max_size=200),
    st.sampled_from([QUARTER_TURN, HALF_TURN, FULL_TURN]),
    angles,
)
def test_the_heading_is_continuous_through_any_number_of_turns(steps, period, start) -> None:
    """The yaw turns by less than half a period a frame, is measured up to the period, and is never lost."""
    true = start + np.cumsum(steps)
    followed, yaw = [], start
    for angle in true:
        measured = wrap_angle(angle * FULL_TURN / period) * period / FULL_TURN  # all that the method knows
        yaw = nearest_turn(measured, yaw, period)
        followed.append(yaw)
    assert np.allclose(followed, true, atol=1e-9)


def test_the_printed_algorithm_jumps_where_the_corrected_one_does_not() -> None:
    """Just past half a turn the axis reads -89 deg; the drone has turned by two degrees, not by 178."""
    assert np.degrees(nearest_turn(np.radians(-89.0), np.radians(89.0), HALF_TURN)) == pytest.approx(91.0)


@given(st.floats(-10.0, 10.0), st.sampled_from([QUARTER_TURN, HALF_TURN]), st.integers(0, 99))
def test_mean_and_variance_do_not_mind_where_an_angle_was_cut(mean, period, seed) -> None:
    rng = np.random.default_rng(seed)
    noise = 0.1 * rng.standard_normal(500)
    noise -= noise.mean()
    cut = mean + noise + period * rng.integers(-3, 4, 500)
    found, variance = mean_and_variance(cut, period)
    assert abs(nearest_turn(found - mean, 0.0, period)) < 0.003
    assert -0.5 * period <= found <= 0.5 * period
    assert variance == pytest.approx(noise.var(), rel=0.03)


@pytest.mark.parametrize("method", [ELLIPSE, PLANE])
@pytest.mark.parametrize("yaw", np.radians([-170.0, -90.0, -35.0, 0.0, 20.0, 89.0, 135.0]))
def test_a_rectangle_under_an_upright_camera_shows_its_axis_exactly(method, yaw) -> None:
    measured = method.measure(flat(oblong(yaw, 0.25, 0.1), DOWN), yaw)
    assert np.degrees(measured.yaw - yaw) == pytest.approx(0.0, abs=0.3)
    assert measured.variance == pytest.approx(method.sd**2)
    assert measured.stamp == 1.5
    assert measured.source == method.name


@pytest.mark.parametrize("yaw", np.radians([-160.0, -90.0, -35.0, 0.0, 20.0, 45.0]))
def test_under_a_tilted_camera_only_the_world_plane_keeps_the_axis(yaw) -> None:
    xy = oblong(yaw, 0.2, 0.12) + np.array([0.3, 0.8])
    sighting = flat(xy)
    assert np.degrees(PLANE.measure(sighting, yaw).yaw - yaw) == pytest.approx(0.0, abs=1.0)


def test_the_ellipse_in_a_tilted_picture_is_biased_by_the_heading_and_that_is_why_it_is_only_published() -> (
    None
):
    errors = [
        np.degrees(ELLIPSE.measure(flat(oblong(yaw, 0.2, 0.16) + np.array([0.3, 0.8])), yaw).yaw - yaw)
        for yaw in np.radians([-60.0, -30.0, 30.0, 60.0])
    ]
    assert max(abs(e) for e in errors) > 5.0


@pytest.mark.parametrize("yaw", np.radians([-140.0, -20.0, 3.0, 44.0, 120.0]))
def test_a_square_has_no_axis_but_a_fourth_harmonic(yaw) -> None:
    sighting = flat(oblong(yaw, 0.2, 0.2))
    assert PLANE.measure(sighting, yaw) is None
    # The corners of a square lie where the rotors of the drone lie.
    assert np.degrees(HARMONIC.measure(sighting, yaw).yaw - yaw) == pytest.approx(0.0, abs=0.5)


def test_a_disc_tells_no_method_of_the_world_plane_anything() -> None:
    xy = oblong(0.0, 0.2, 0.2)
    sighting = flat(xy[np.hypot(*xy.T) < 0.2])
    assert PLANE.measure(sighting, 0.0) is None
    assert HARMONIC.measure(sighting, 0.0) is None


def test_a_blob_of_a_few_pixels_tells_nothing() -> None:
    assert HARMONIC.measure(flat(oblong(0.0, 0.01, 0.005)), 0.0) is None


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("power", [0.0, 2.0, 4.0])
@given(turn=angles, seed=st.integers(0, 99))
def test_a_harmonic_turns_its_order_times_as_fast_as_the_shape(order, power, turn, seed) -> None:
    rng = np.random.default_rng(seed)
    xy, weights = rng.normal(size=(30, 2)), rng.uniform(0.5, 2.0, 30)
    c, s = np.cos(turn), np.sin(turn)
    turned = angular_harmonic(xy @ np.array([[c, s], [-s, c]]) + [3.0, -2.0], weights, order, power)
    expected = angular_harmonic(xy, weights, order, power) * np.exp(1j * order * turn)
    assert abs(turned - expected) < 1e-9
    assert abs(turned) <= 1.0


def rms_deg(methods, hull: bool) -> dict[str, float]:
    """Rms errors over headings, places and tilts of slow flight, without what one method leaves unsaid."""
    rng = np.random.default_rng(0)
    errors: dict[str, list[float]] = {method.name: [] for method in methods}
    for i in range(60):
        yaw = rng.uniform(-np.pi, np.pi)
        place, tilt = rng.uniform([-0.4, -0.6, 0.6], [0.5, 0.8, 1.8]), rng.normal(0.0, 0.05, 2)
        sighting = drone_seen(place, yaw, *tilt, stamp=200.0 + i, hull=hull)
        for method in methods:
            measured = method.measure(sighting, yaw)
            if measured is not None:
                errors[method.name].append(np.degrees(measured.yaw - yaw))
    return {name: float(np.sqrt(np.mean(np.square(e)))) for name, e in errors.items()}


def test_with_the_hull_only_the_fourth_harmonic_tells_the_heading() -> None:
    rms = rms_deg([ELLIPSE, AXIS, HARMONIC], hull=True)
    assert rms["harmonic"] < 2.0
    assert min(rms["ellipse"], rms["axis"]) > 10.0


def test_without_hull_the_axis_of_the_body_tells_it_best() -> None:
    """The ellipse is taken in the slanted picture, and moments are ruled by rotors that come and go."""
    rms = rms_deg([ELLIPSE, PLANE, AXIS], hull=False)
    assert rms["axis"] < 6.5
    assert rms["axis"] < rms["plane"] < rms["ellipse"]


def test_the_axis_of_a_method_is_taken_off() -> None:
    turned = ShapeHeading("plane", 2, 2.0, 0.3, 0.1, 0.02)
    sighting = flat(oblong(0.5, 0.25, 0.1))
    assert turned.measure(sighting, 0.0).yaw == pytest.approx(PLANE.measure(sighting, 0.0).yaw - 0.3)


def test_points_far_below_the_blob_s_middle_are_not_the_drone_s() -> None:
    """A box below that touches the drone in the picture, joined with it, does not enter its points."""
    box = ThingPose("box", 0.32, 0.0, size=(0.2, 0.2, 0.5))
    joined = drone_seen([0.0, 0.0, 1.2], 0.4, things=(box,), depth_step=None)
    alone = drone_seen([0.0, 0.0, 1.2], 0.4)
    assert joined.blob.area > 1.1 * alone.blob.area
    points, surface = world_points(joined)
    assert points[:, 2].min() > 1.0
    assert surface.sum() == pytest.approx(world_points(alone)[1].sum(), rel=0.1)


def test_the_pose_of_a_blob_is_the_middle_of_its_points_and_the_heading_s() -> None:
    sighting = drone_seen([0.3, -0.4, 1.1], 0.7)
    heading = HeadingMeasurement(2.5, 0.71, 0.002, "harmonic")
    offset = np.array([0.01, 0.0, -0.03])
    pose = blob_pose(sighting.blob, CEILING_CAMERA, heading, offset)
    assert np.allclose(pose.position, blob_position(sighting.blob, CEILING_CAMERA) + offset)
    assert np.abs(pose.position - [0.3, -0.4, 1.1]).max() < 0.03
    assert (pose.stamp, pose.yaw, pose.source) == (2.5, 0.71, "harmonic")
    assert pose.covariance[3, 3] == 0.002
    assert (np.linalg.eigvalsh(pose.covariance) > 0.0).all()
