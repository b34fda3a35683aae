"""The largest triangle among points."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.vision.triangle import TriangleError, convex_hull, largest_triangle


def area(a, b, c):
    return 0.5 * abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


@given(st.integers(3, 14), st.integers(0, 10_000))
@settings(deadline=None, max_examples=60)
def test_no_triangle_is_larger_than_the_one_chosen(n, seed):
    points = np.random.default_rng(seed).normal(size=(n, 2))
    chosen = largest_triangle(points)
    assert area(*points[chosen]) == pytest.approx(
        max(area(*points[list(k)]) for k in combinations(range(n), 3))
    )


def test_the_first_corner_has_the_largest_x_and_the_second_the_smallest():
    points = np.array([[0.0, 0.0], [3.0, 1.0], [1.0, 4.0], [1.0, 1.0]])
    assert largest_triangle(points).tolist() == [1, 0, 2]


def test_a_point_inside_or_on_an_edge_is_no_corner_of_the_hull():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0], [1.0, 1.0]])
    assert sorted(convex_hull(points).tolist()) == [0, 2, 3, 4]


def test_the_choice_does_not_depend_on_the_order_of_the_points():
    points = np.random.default_rng(3).normal(size=(40, 2))
    shuffled = points[::-1]
    assert np.array_equal(points[largest_triangle(points)], shuffled[largest_triangle(shuffled)])


def test_points_on_a_line_are_refused_in_one_line():
    with pytest.raises(TriangleError) as error:
        largest_triangle(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [5.0, 5.0]]))
    assert str(error.value) == (
        "largest triangle: all 4 points lie on one line, expected points around an area; match other points"
    )


def test_two_points_are_refused_in_one_line():
    with pytest.raises(TriangleError) as error:
        largest_triangle(np.zeros((2, 2)))
    assert str(error.value) == (
        "largest triangle: points of shape (2, 2), "
        "expected (n, 2) finite numbers with n at least 3; match more points"
    )
