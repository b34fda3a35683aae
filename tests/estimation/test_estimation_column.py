import numpy as np
import pytest

from noctule.estimation.column import (
    ColumnPrior,
    begin_column,
    column_distance2,
    move_column,
    update_column,
)
from noctule.geometry import wrap_angle

PRIOR = ColumnPrior()
DT = 1.0 / 30.0


def edges_of(centre, radius):
    """Return the bearings of both edges of a column at `centre` (2,) seen from the origin."""
    d, b = np.hypot(*centre), np.arctan2(centre[1], centre[0])
    half = np.arcsin(radius / d)
    return b + half, b - half


def approach(radius, ticks, start=(2.0, 0.3), v=(0.4, 0.0), turn_rate=0.0, rng=None, prior=PRIOR):
    centre = np.array(start)
    column = begin_column(*edges_of(centre, radius), prior)
    for _ in range(ticks):
        step, turn = np.array(v) * DT, turn_rate * DT
        c, s = np.cos(turn), np.sin(turn)
        centre = np.array([[c, s], [-s, c]]) @ (centre - step)
        column = move_column(column, step, turn, DT, prior)
        noise = np.zeros(2) if rng is None else rng.normal(0.0, 0.001, 2)
        left, right = edges_of(centre, radius)
        column = update_column(column, (left + noise[0], right + noise[1]), prior)
    return column, centre


def test_before_motion_the_direction_is_known_and_the_distance_is_the_assumed_widths():
    column = begin_column(*edges_of(np.array([3.0, 1.0]), 0.08), PRIOR)
    assert column.x[0] == pytest.approx(np.arctan2(1.0, 3.0))
    # Twice as wide as assumed, so it looks half as far.
    assert column.distance == pytest.approx(np.hypot(3.0, 1.0) / 2.0, rel=0.01)
    assert np.sqrt(column.P[1, 1]) >= 0.7


@pytest.mark.parametrize("radius", [0.01, 0.025, 0.055, 0.15])
def test_looming_tells_distance_and_width_without_knowing_the_width(radius):
    column, centre = approach(radius, 90, rng=np.random.default_rng(3))
    assert column.distance == pytest.approx(np.hypot(*centre), rel=0.2)
    assert column.radius == pytest.approx(radius, rel=0.2)


def test_turning_alone_tells_nothing_of_the_distance():
    column, centre = approach(0.05, 60, v=(0.0, 0.0), turn_rate=0.3)
    assert np.sqrt(column.P[1, 1]) > 0.5
    assert column.x[0] == pytest.approx(np.arctan2(centre[1], centre[0]), abs=0.005)


def test_standing_still_does_not_pretend_to_learn():
    column, _ = approach(0.15, 300, v=(0.0, 0.0))
    assert np.sqrt(column.P[1, 1]) > 0.5


def test_a_column_out_of_sight_is_dead_reckoned_around_the_vehicle():
    column, centre = approach(0.05, 90, start=(2.0, 0.3))
    for _ in range(45):  # past it
        step = np.array([0.6, 0.0]) * DT
        centre = centre - step
        column = move_column(column, step, 0.0, DT, PRIOR)
    assert centre[0] < 0.0
    assert column.centre == pytest.approx(centre, abs=0.08)
    assert column.unseen == pytest.approx(1.5)


def test_the_prediction_agrees_with_finite_differences():
    column = begin_column(0.3, 0.2, PRIOR)
    step, turn = np.array([0.05, -0.03]), 0.04
    still = ColumnPrior(drift=0.0)
    P = move_column(column, step, turn, DT, still).P
    F = np.empty((3, 3))
    for j in range(3):
        e = np.zeros(3)
        e[j] = 1e-6
        plus = move_column(type(column)(column.x + e, column.P), step, turn, DT, still).x
        minus = move_column(type(column)(column.x - e, column.P), step, turn, DT, still).x
        F[:, j] = (plus - minus) / 2e-6
    assert P == pytest.approx(F @ column.P @ F.T, abs=1e-9)


def test_one_edge_is_enough_to_keep_the_bearing():
    column, centre = approach(0.05, 60)
    moved = move_column(column, np.array([0.02, 0.0]), 0.0, DT, PRIOR)
    left, _ = edges_of(centre - np.array([0.02, 0.0]), 0.05)
    after = update_column(moved, (left, None), PRIOR)
    assert abs(wrap_angle(after.x[0] - np.arctan2(centre[1], centre[0] - 0.02))) < 0.01
    assert after.unseen == 0.0


def test_no_edge_changes_nothing():
    column, _ = approach(0.05, 10)
    assert update_column(column, (None, None), PRIOR) is column


def test_detections_are_told_apart_by_bearing():
    near, _ = approach(0.025, 30)
    own = edges_of(near.centre, 0.025)
    other = (own[0] + 0.3, own[1] + 0.3)
    assert column_distance2(near, own, PRIOR) < 1.0
    assert column_distance2(near, other, PRIOR) > 16.0


def test_detections_in_one_direction_are_told_apart_by_size():
    near, _ = approach(0.05, 60)
    left, right = edges_of(near.centre, 0.05)
    middle, quarter = (left + right) / 2.0, (left - right) / 8.0
    assert column_distance2(near, (middle + quarter, middle - quarter), PRIOR) > 16.0


def test_a_column_at_the_border_of_the_picture_is_told_by_its_one_edge():
    near, _ = approach(0.05, 60)
    left, right = edges_of(near.centre, 0.05)
    assert column_distance2(near, (left, None), PRIOR) < 1.0
    assert column_distance2(near, (None, right), PRIOR) < 1.0
    assert column_distance2(near, (left + 0.5, None), PRIOR) > 16.0
    assert column_distance2(near, (None, None), PRIOR) == np.inf


def test_covariances_stay_symmetric_and_positive():
    column, _ = approach(0.05, 120, rng=np.random.default_rng(4))
    assert column.P == pytest.approx(column.P.T, abs=1e-12)
    assert np.linalg.eigvalsh(column.P).min() > 0.0
