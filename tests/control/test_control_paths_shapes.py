"""The shapes of paths: each node where the formula has it, unit speed, and no way to make nonsense."""

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from noctule.control.paths import PathJoinError, PathShapeError, arc, eight, ellipse, joined, line, polyline
from noctule.control.paths.space_path import SpacePath, turn
from noctule.control.paths.splines import spline

CURVES = {
    "line": line((0, 0, 1), (1, 2, 1.5)),
    "arc": arc((0.2, 0.1, 1.0), 0.5, 0.3, 2.0, climb=0.4),
    "ellipse": ellipse((0.08, 0.1, 1.2), (0.5, 0.8), 0.12),
    "eight": eight((0.08, 0.1, 1.2), (0.45, 0.8), 0.1),
    "spline": spline([(0, 0, 1), (1, 0.2, 1), (1.2, 1, 1.3), (0, 1.5, 1)]),
    "ring": spline([(0, 0, 1), (1, 0.2, 1), (1.2, 1, 1.3), (0, 1.5, 1)], closed=True),
    "rounded": polyline([(0, 0, 1), (1, 0, 1), (1, 1, 1.2), (0, 1, 1)], radius=0.2),
    "square": polyline([(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], radius=0.2, closed=True),
}
places = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


@pytest.fixture(params=CURVES, name="path")
def _path(request):
    return CURVES[request.param]


def test_between_any_two_lengths_lies_as_much_path(path):
    s = np.linspace(0.0, path.length, 4001)
    p = np.array([path.at(v).position for v in s])
    steps = np.linalg.norm(np.diff(p, axis=0), axis=1)
    np.testing.assert_allclose(steps, np.diff(s), rtol=2e-4)


def test_the_tangent_is_the_derivative_of_the_position(path):
    h = 1e-4
    for s in np.linspace(0.02, path.length - 0.02, 57):
        slope = (path.at(s + h).position - path.at(s - h).position) / (2 * h)
        point = path.at(s)
        np.testing.assert_allclose(point.tangent, slope, atol=1e-3)
        assert np.linalg.norm(point.tangent) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["arc", "ellipse", "eight", "spline", "ring"])
def test_the_curvature_is_the_derivative_of_the_tangent(name):
    path, h = CURVES[name], 2e-3
    for s in np.linspace(0.02, path.length - 0.02, 41):
        bend = (path.at(s + h).tangent - path.at(s - h).tangent) / (2 * h)
        np.testing.assert_allclose(path.at(s).curvature, bend, atol=0.08)


def test_the_ellipse_is_that_of_the_experiments():
    path = CURVES["ellipse"]
    theta = np.linspace(0.0, math.tau, 2001)
    want = np.stack([0.08 + 0.5 * np.cos(theta), 0.1 + 0.8 * np.sin(theta), 1.2 + 0.12 * np.sin(theta)], 1)
    assert max(np.linalg.norm(want - p, axis=1).min() for p in path.position[::7]) < 2e-3
    np.testing.assert_allclose(path.position[0], [0.58, 0.1, 1.2], atol=1e-12)
    inside = ((path.position[:, 0] - 0.08) / 0.5) ** 2 + ((path.position[:, 1] - 0.1) / 0.8) ** 2
    np.testing.assert_allclose(inside, 1.0, atol=1e-9)
    np.testing.assert_allclose(path.position[:, 2] - 1.2, 0.15 * (path.position[:, 1] - 0.1), atol=1e-9)


def test_the_eight_is_that_of_the_experiments_and_crosses_itself_from_above():
    path = CURVES["eight"]
    sin, cos = (path.position[:, 1] - 0.1) / 0.8, (path.position[:, 2] - 1.2) / 0.1
    np.testing.assert_allclose(sin**2 + cos**2, 1.0, atol=1e-9)
    np.testing.assert_allclose(path.position[:, 0] - 0.08, 0.9 * sin * cos, atol=1e-9)
    first, second = path.at(0.0).position, path.at(path.length / 2).position
    np.testing.assert_allclose(first[:2], second[:2], atol=1e-6)
    assert turn(path.at(0.0).tangent, path.at(path.length / 2).tangent) > 1.0


@pytest.mark.parametrize("name", ["ellipse", "eight", "ring", "square"])
def test_a_closed_path_goes_on_smoothly_over_its_seam(name):
    path = CURVES[name]
    assert path.closed
    before, after = path.at(path.length - 1e-6), path.at(path.length + 1e-6)
    np.testing.assert_allclose(before.position, after.position, atol=1e-5)
    np.testing.assert_allclose(before.tangent, after.tangent, atol=1e-3)
    np.testing.assert_allclose(path.at(2.3 * path.length).position, path.at(0.3 * path.length).position)
    assert path.corners.size == 0


def test_an_open_path_ends_at_its_ends():
    path = CURVES["line"]
    np.testing.assert_allclose(path.at(-1.0).position, (0, 0, 1))
    np.testing.assert_allclose(path.at(99.0).position, (1, 2, 1.5))
    np.testing.assert_allclose(path.end.position, (1, 2, 1.5))


def test_an_arc_keeps_its_radius_and_climbs_evenly():
    path = CURVES["arc"]
    np.testing.assert_allclose(np.hypot(path.position[:, 0] - 0.2, path.position[:, 1] - 0.1), 0.5)
    np.testing.assert_allclose(np.diff(path.position[:, 2]), 0.4 / (len(path.s) - 1), rtol=1e-6)
    clockwise = arc((0, 0, 1), 1.0, 0.0, -math.pi / 2)
    np.testing.assert_allclose(clockwise.end.position, (0, -1, 1), atol=1e-12)


@given(st.lists(places, min_size=3, max_size=8), st.booleans())
def test_a_spline_goes_through_all_of_its_waypoints(points, closed):
    p = np.array(points)
    chords = np.linalg.norm(np.diff(np.vstack([p, p[:1]]), axis=0), axis=1)
    if (chords < 0.05).any() or np.linalg.matrix_rank(p - p.mean(0), tol=0.2) < 2:
        return
    try:
        path = spline(p, closed)
    except PathShapeError:  # it turns back on itself
        assume(False)
    for point in p:
        gap, along = point - path.position, path.tangent
        off = gap - (gap * along).sum(axis=1, keepdims=True) * along
        near = np.linalg.norm(gap, axis=1) < 0.006
        assert near.any()
        assert np.linalg.norm(off[near], axis=1).min() < 2e-3
    np.testing.assert_allclose(path.position[0], p[0], atol=1e-9)
    np.testing.assert_allclose(path.position[-1], p[0] if closed else p[-1], atol=1e-9)


def test_the_curvature_of_a_spline_does_not_jump():
    for name in ("spline", "ring"):
        path = CURVES[name]
        jumps = np.linalg.norm(np.diff(path.curvature, axis=0), axis=1)
        assert jumps.max() < 0.5  # of up to 5 1/m
    np.testing.assert_allclose(CURVES["ring"].curvature[0], CURVES["ring"].curvature[-1], atol=1e-6)


@given(st.floats(0.05, 0.45), st.floats(0.2, 2.9))
def test_rounded_corners_have_their_radius_and_no_corner_is_left(radius, angle):
    reach = 1.0 + radius * math.tan(angle / 2.0)
    tip = np.array([reach, 0.0, 1.0])
    end = tip + reach * np.array([math.cos(angle), math.sin(angle), 0.0])
    path = polyline([(0, 0, 1), tip, end], radius=radius)
    assert path.corners.size == 0
    bends = np.linalg.norm(path.curvature, axis=1)
    assert bends.max() == pytest.approx(1.0 / radius, rel=1e-9)
    assert path.length == pytest.approx(2.0 + radius * angle, rel=1e-3)


def test_corners_that_are_not_rounded_are_told():
    path = polyline([(0, 0, 1), (1, 0, 1), (1, 1, 1)])
    np.testing.assert_allclose(path.corners, [1.0])
    np.testing.assert_allclose(path.at(1.0 - 1e-9).tangent, (1, 0, 0), atol=1e-9)
    np.testing.assert_allclose(path.at(1.0 + 1e-9).tangent, (0, 1, 0), atol=1e-9)
    ring = polyline([(0, 0, 1), (1, 0, 1), (0, 1, 1)], closed=True)
    np.testing.assert_allclose(ring.corners, [0.0, 1.0, 1.0 + math.sqrt(2)])


def test_pieces_that_meet_smoothly_are_one_path_without_corners():
    path = joined([line((0, 0, 1), (1, 0, 1)), arc((1, 0.5, 1), 0.5, -math.pi / 2, math.pi)])
    assert path.length == pytest.approx(1.0 + 0.5 * math.pi)
    assert path.corners.size == 0
    assert (np.diff(path.s) > 0.0).all()


def fails(call):
    with pytest.raises(PathShapeError) as caught:
        call()
    return str(caught.value)


def test_what_is_too_long_is_refused_before_its_nodes_are_made():
    far = [(20 * (k % 2), 0.01 * k, 1) for k in range(101)]
    way = line((0, 0, 1), (90, 0, 1))
    back = line((90, 0, 1), (0, 0, 1))
    tracemalloc.start()
    for call, length in (
        (lambda: line((0, 0, 1), (3000, 0, 1)), 3000),
        (lambda: line((0, 0, 1), (1e12, 0, 1)), 10**12),
        (lambda: polyline(far), 2000),
        (lambda: polyline(far, 0.001, closed=True), 2000),
        (lambda: polyline([(1000 * (k % 2), k, 1) for k in range(41)], 0.1), 40000),
        (lambda: joined([way, back] * 12), 2160),
    ):
        said = fails(call)
        assert said.endswith(" m long; expected at most 2000 m")
        assert f" {length} m" in said
    # Wide arcs between near points are no path, however many there are.
    zigzag = [(0.02 * (k % 2), 0.001 * k, 1) for k in range(1000)]
    assert "too near to be rounded by 1000 m" in fails(lambda: polyline(zigzag, 1000.0))
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()
    assert polyline([(20 * (k % 2), 0.0, 1) for k in range(100)]).length == pytest.approx(1980.0)


def test_a_curve_too_tight_to_be_flown_is_told_with_its_radius():
    assert fails(lambda: arc((0, 0, 1), 0.002, 0.0, math.pi)) == (
        "path: the curve at (0.00, 0.00, 1.00) has a radius of 0.0020 m, too tight to be flown; "
        "make it wider than 0.01 m"
    )
    assert arc((0, 0, 1), 0.02, 0.0, math.pi).length == pytest.approx(0.02 * math.pi)


def test_mistakes_are_told_with_what_was_expected():
    assert fails(lambda: line((0, 0, 1), (0, 0, 1))) == (
        "line: it begins and ends at [0.0, 0.0, 1.0]; expected two points that differ"
    )
    assert fails(lambda: line((0, 0), (0, 0, 1))) == "line: [0.0, 0.0], expected 3 finite numbers"
    assert fails(lambda: arc((0, 0, 1), 0.0, 0.0, 1.0)) == (
        "arc: radius 0 m, sweep 1 rad; expected above 0 and not 0"
    )
    assert fails(lambda: ellipse((0, 0, 1), (0.5, -1.0))) == (
        "ellipse: half axes 0.5 and -1 m; expected both above 0"
    )
    assert fails(lambda: spline([(0, 0, 1), (0, 0, 1), (1, 0, 1)])) == (
        "spline: waypoint 2 is where waypoint 1 is; leave one out"
    )
    assert fails(lambda: spline([(0, 0, 1), (1, 0, 1), (0, 0, 1.0)])) == (
        "path: the curve turns back on itself at (1.00, 0.00, 1.00); lead it around"
    )
    assert fails(lambda: spline([(0, 0, 1)])) == (
        "spline: waypoints (1, 3), expected (2 or more, 3) finite numbers"
    )
    assert fails(lambda: spline(np.zeros((3000, 3)))) == (
        "spline: 3000 waypoints, expected at most 2000; thin them out"
    )
    assert fails(lambda: polyline([(0, 0, 1)])) == "line: 1 points, expected at least 2"
    assert fails(lambda: polyline([(0, 0, 1), (0, 0, 1)])) == (
        "line: point 2 is where point 1 is; leave one of them out"
    )
    assert fails(lambda: polyline([(0, 0, 1), (0, 0, 1), (1, 1, 1)], 0.1)) == (
        "line: point 2 is where a neighbour is; leave one of them out"
    )
    assert fails(lambda: polyline([(0, 0, 1), (1, 0, 1), (0, 0, 1)], 0.1)) == (
        "line: it turns back at point 2, which no radius rounds; stop there"
    )
    assert fails(lambda: polyline([(0, 0, 1), (1, 0, 1), (1, 0.3, 1), (0, 0.3, 1)], 0.2)) == (
        "line: points 2 and 3 are too near to be rounded by 0.2 m; give a smaller radius"
    )
    assert fails(lambda: joined([])) == "path: it has no pieces; expected at least one"
    assert fails(lambda: arc((0, 0, 0), 5000.0, 0, 3.0)) == (
        "path: it is 15000 m long; expected at most 2000 m"
    )
    nodes = np.zeros((3, 3))
    assert fails(lambda: SpacePath(np.arange(2.0), nodes, nodes, nodes)) == (
        "path of 2 nodes, arrays [(3, 3), (3, 3), (3, 3)]; expected 2 or more and (n, 3) each"
    )
    assert fails(lambda: SpacePath(np.arange(3.0), nodes * np.nan, nodes, nodes)) == (
        "path: its position holds values that are not finite; expected numbers"
    )


def test_pieces_that_do_not_meet_are_refused_with_the_piece():
    with pytest.raises(PathJoinError) as caught:
        joined([line((0, 0, 1), (1, 0, 1)), line((1, 0.1, 1), (2, 0, 1))])
    assert str(caught.value) == (
        "piece 2 begins 0.100 m from where piece 1 ends (1.000, 0.000, 1.000); let it begin there"
    )
    assert caught.value.piece == 1
    with pytest.raises(PathJoinError, match=r"^piece 1 is a closed path; it can only stand alone$"):
        joined([CURVES["eight"], CURVES["line"]])
