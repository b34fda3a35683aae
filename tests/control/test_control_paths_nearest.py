"""The nearest point: right where it is looked for, and never on another branch."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.control.paths import ellipse, line, loc_1, loc_2, polyline, spline
from noctule.control.paths.nearest import WINDOW, nearest, nearest_anywhere

EIGHT, ELLIPSE = loc_2().path, loc_1().path
FLAT_EIGHT = spline([(0, 0, 1), (0.6, 0.5, 1), (0, 1, 1), (-0.6, 0.5, 1), (0, 0.001, 1), (0.6, -0.5, 1),
                     (0, -1, 1), (-0.6, -0.5, 1)], closed=True)  # fmt: skip
offsets = st.tuples(*[st.floats(-0.06, 0.06)] * 3).map(np.array)


@given(st.floats(0.0, 3.0), offsets, st.floats(-0.1, 0.1))
def test_the_foot_is_found_to_a_hundredth_of_a_millimetre(lap, offset, ahead):
    for path in (ELLIPSE, EIGHT):
        s0 = lap * path.length
        point = path.at(s0)
        across = offset - (offset @ point.tangent) * point.tangent
        s = nearest(path, point.position + across, s0 + ahead)
        found = path.at(s)
        # It is square to the path, or better: nearer than the one that was meant.
        gap = point.position + across - found.position
        assert abs(gap @ found.tangent) < 1e-5
        assert np.linalg.norm(gap) <= np.linalg.norm(across) + 1e-9


@given(st.floats(0.0, 1.0), offsets)
def test_it_agrees_with_a_search_of_everything_where_only_one_branch_is_near(lap, offset):
    path = ELLIPSE
    x = path.at(lap * path.length).position + offset
    s = nearest_anywhere(path, x)
    fine = np.array([path.at(v).position for v in np.linspace(s - 0.02, s + 0.02, 201)])
    best = np.linalg.norm(path.position - x, axis=1).min()
    assert np.linalg.norm(path.at(s).position - x) <= best + 1e-9
    assert np.linalg.norm(path.at(s).position - x) <= np.linalg.norm(fine - x, axis=1).min() + 1e-9


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("path", [EIGHT, FLAT_EIGHT], ids=["the experiments'", "level"])
def test_it_never_jumps_to_the_other_branch_of_an_eight(path, seed):
    rng = np.random.default_rng(seed)
    s, off = 0.0, np.zeros(3)
    for true in np.arange(0.0, 3.0 * path.length, 0.01):
        # A drone that strays by decimetres: at the crossing the other branch is then often the nearer one.
        off = 0.97 * off + rng.normal(0.0, 0.02, 3) * (1.0, 1.0, 0.2)
        point = path.at(true)
        across = off - (off @ point.tangent) * point.tangent
        across *= min(1.0, 0.12 / np.linalg.norm(across))  # the smallest radius is 0.16 m
        s = nearest(path, point.position + across, s)
        assert abs(s - true) < 0.13


def test_a_hairpin_is_flown_around_and_not_crossed():
    path = polyline([(0, 0, 1), (1, 0, 1), (1, 0.12, 1), (0, 0.12, 1)], radius=0.06)
    s = 0.0
    for x in np.linspace(0.0, 0.9, 91):
        s = nearest(path, np.array([x, 0.075, 1.0]), s)  # nearer to the way back than to the way there
        assert s == pytest.approx(x, abs=1e-6)


def test_the_search_goes_no_farther_than_its_window():
    path = line((0, 0, 1), (5, 0, 1))
    assert nearest(path, np.array([4.0, 0.2, 1.0]), 1.0) == pytest.approx(1.0 + WINDOW)
    assert nearest(path, np.array([0.0, 0.2, 1.0]), 1.0) == pytest.approx(1.0 - WINDOW)


def test_bounds_hold_back_and_ends_end():
    path = line((0, 0, 1), (5, 0, 1))
    assert nearest(path, np.array([1.2, 0.0, 1.0]), 1.0, high=1.1) == pytest.approx(1.1)
    assert nearest(path, np.array([0.8, 0.0, 1.0]), 1.0, low=0.9) == pytest.approx(0.9)
    assert nearest(path, np.array([-1.0, 0.0, 1.0]), 0.0) == 0.0
    assert nearest(path, np.array([9.0, 0.0, 1.0]), 4.9) == 5.0
    assert nearest(path, np.array([2.0, 0.0, 1.0]), 2.0, low=2.5, high=2.2) == 2.5


def test_the_length_counts_on_around_a_closed_path_both_ways():
    path = ELLIPSE
    s = 0.0
    for angle in np.arange(0.0, 3.0, 0.01):
        s = nearest(path, path.at(angle * path.length).position, s)
    assert s == pytest.approx(2.99 * path.length, abs=1e-4)
    for angle in np.arange(0.0, 1.0, 0.01):
        s = nearest(path, path.at((2.99 - angle) * path.length).position, s)
    assert s == pytest.approx(2.0 * path.length, abs=1e-4)


def test_in_the_centre_of_a_circle_it_stays_where_it_was():
    path = ellipse((0, 0, 1), (0.4, 0.4))
    for s in (0.1, 1.0, 2.2):
        assert abs(nearest(path, np.array([0.0, 0.0, 1.0]), s) - s) <= WINDOW
