"""Distances from the curve that a flight was to follow."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.flight.cross_track import Arc, Line, Reference, cross_track, level_curve, polyline
from noctule.geometry import Pose

START = Pose(np.array([1.0, 2.0, 1.0]), 0.5 * np.pi)
OVAL = ((2.0, 0.0), (np.pi * 0.5, 2.0)) * 2  # straights of 2 m, half circles of radius 0.5 m
LENGTH = 4.0 + np.pi
angles = st.floats(-np.pi, np.pi)


def along(s):
    """Walk the oval in tiny steps: no formula shared with the code under test."""
    position, heading = START.position.copy(), START.yaw
    left = s
    for length, curvature in OVAL * 2:
        steps = 4000
        go = min(left, length)
        for _ in range(steps):
            ds = go / steps
            middle = heading + 0.5 * ds * curvature
            position = position + ds * np.array([np.cos(middle), np.sin(middle), 0.0])
            heading += ds * curvature
        left -= go
        if left <= 0.0:
            break
    return position, heading


def test_a_straight_is_measured_to_its_side_beyond_its_ends_and_in_height():
    line = Line(np.array([0.0, 0.0, 1.0]), np.array([2.0, 0.0, 1.0]))
    points = np.array([[1.0, 0.3, 1.4], [-3.0, 0.0, 5.0], [2.6, 0.8, 1.0], [0.5, 0.0, 1.0]])
    assert line.distance(points) == pytest.approx([0.5, 5.0, 1.0, 0.0])


def test_a_straight_without_length_is_its_point():
    point = np.array([1.0, 1.0, 1.0])
    assert Line(point, point).distance(np.array([[1.0, 4.0, 5.0]])) == pytest.approx([5.0])


@given(angles, st.floats(0.05, 2.0), st.floats(-2.0 * np.pi, 2.0 * np.pi), st.floats(0.0, 3.0), angles)
def test_an_arc_is_as_far_away_as_the_nearest_of_many_points_on_it(begin, radius, sweep, far, bearing):
    centre = np.array([0.3, -0.7, 1.0])
    arc = Arc(centre, radius * np.array([np.cos(begin), np.sin(begin)]), sweep)
    on_it = begin + sweep * np.linspace(0.0, 1.0, 2001)
    circle = centre + radius * np.column_stack([np.cos(on_it), np.sin(on_it), np.zeros(2001)])
    point = centre + np.array([far * np.cos(bearing), far * np.sin(bearing), 0.2])
    nearest = np.linalg.norm(circle - point, axis=1).min()
    assert arc.distance(point[None])[0] == pytest.approx(nearest, abs=0.004)
    assert arc.distance(point[None])[0] <= nearest + 1e-9


@pytest.mark.parametrize("s", [0.0, 1.3, 2.0, 2.4, 3.5, 4.1, 5.9, 7.0, LENGTH])
def test_on_the_oval_the_distance_is_zero_and_beside_it_what_was_stepped_aside(s):
    curve = Reference(level_curve(START, OVAL), 30)
    point, heading = along(s)
    outward = np.array([np.sin(heading), -np.cos(heading), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    points = np.array([point, point + 0.2 * outward, point - 0.2 * outward, point + 0.3 * outward + 0.4 * up])
    assert curve.distance(points) == pytest.approx([0.0, 0.2, 0.2, 0.5], abs=1e-6)


def test_the_oval_closes():
    pieces = level_curve(START, OVAL)
    assert len(pieces) == 4
    end, heading = along(LENGTH)
    np.testing.assert_allclose(end, START.position, atol=1e-6)
    assert np.cos(heading - START.yaw) == pytest.approx(1.0)


def test_a_curve_to_the_right_has_a_negative_curvature():
    (arc,) = level_curve(Pose(np.zeros(3), 0.0), ((0.5 * np.pi, -1.0),))
    assert arc.distance(np.array([[1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])) == pytest.approx([0.0, 1.0])


def test_a_polyline_flown_twice_is_measured_once():
    a, b, c = np.zeros(3), np.array([1.0, 0.0, 0.0]), np.array([1.0, 1.0, 0.0])
    assert len(polyline([a, b, c, a, b, c, a])) == 3
    curve = Reference(polyline([a, b, c]), 3)
    assert curve.distance(np.array([[0.5, 0.1, 0.0], [1.2, 0.5, 0.0]])) == pytest.approx([0.1, 0.2])


def straight(images_per_lap):
    return Reference((Line(np.zeros(3), np.array([10.0, 0.0, 0.0])),), images_per_lap)


def test_figures_are_over_all_ticks_and_over_those_of_each_lap():
    times = [5.0, 5.1, 5.3, 5.4, 5.8]
    positions = np.array([[1, 0.1, 0], [2, 0.3, 0], [3, 0, 0.5], [4, -0.1, 0], [5, 0, 0]], dtype=float)
    found = cross_track(straight(2), times, positions, [0, 1, 2, 3, 3])
    assert found["cross_track_max_m"] == pytest.approx(0.5)
    assert found["cross_track_mean_m"] == pytest.approx(0.2)
    first, second = found["laps"]
    # The first ends when the second begins: no time is lost between them.
    assert first == pytest.approx({"cross_track_max_m": 0.3, "cross_track_mean_m": 0.2, "duration_s": 0.3})
    assert second == pytest.approx({"cross_track_max_m": 0.5, "cross_track_mean_m": 0.2, "duration_s": 0.5})


def test_a_single_lap_is_the_flight():
    found = cross_track(straight(3), [0.0, 0.5], np.array([[0.0, 0.2, 0.0], [1.0, 0.4, 0.0]]), [0, 2])
    (lap,) = found["laps"]
    assert lap == {**{k: found[k] for k in ("cross_track_max_m", "cross_track_mean_m")}, "duration_s": 0.5}


def test_a_lap_is_not_begun_again_by_looking_back_for_an_image():
    found = cross_track(straight(2), [0.0, 1.0, 2.0, 3.0], np.zeros((4, 3)), [0, 2, 1, 3])
    assert [lap["duration_s"] for lap in found["laps"]] == [1.0, 2.0]


@pytest.mark.parametrize(("reference", "n"), [(None, 2), (straight(3), 0)])
def test_without_a_curve_or_a_truth_nothing_is_known(reference, n):
    found = cross_track(reference, [0.0, 1.0], np.zeros((n, 3)), [0, 0])
    assert found == {"cross_track_max_m": None, "cross_track_mean_m": None, "laps": None}
