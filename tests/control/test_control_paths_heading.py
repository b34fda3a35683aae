"""Where the nose points: the rules, and the reference that turns there without a jump."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.control.paths import (
    AlongPath,
    FacePoint,
    FixedHeading,
    GivenHeading,
    PathShapeError,
    TurnSettings,
    ellipse,
    line,
    loc_1,
    plan,
    spline,
    with_headings,
)
from noctule.control.paths.heading import TurnReference, heading_at
from noctule.geometry import wrap_angle

ELLIPSE = loc_1().path
GIVEN = GivenHeading.of(np.array([0.0, 1.0, 2.5]), np.array([3.0, -3.0, -2.0]))


@pytest.mark.parametrize("rule", [AlongPath(), FacePoint(0.3, 0.2), FacePoint(3.0, -2.0), GIVEN])
def test_the_turn_along_the_path_is_the_derivative_of_the_heading(rule):
    h = 2e-3
    for s in np.linspace(0.013, 2.4, 60):
        here = heading_at(rule, ELLIPSE.at(s), s)
        near = [heading_at(rule, ELLIPSE.at(v), v)[0] for v in (s - h, s + h)]
        if rule is GIVEN and abs(s - 1.0) < 2 * h:
            continue
        assert wrap_angle(near[1] - near[0]) / (2 * h) == pytest.approx(here[1], abs=0.06)


def test_along_the_path_is_where_the_path_goes_and_a_point_is_looked_at():
    path = line((0, 0, 1), (1, 1, 1))
    assert heading_at(AlongPath(), path.at(0.5), 0.5) == (pytest.approx(math.pi / 4), 0.0)
    assert heading_at(FacePoint(1.0, 0.0), path.at(0.0), 0.0)[0] == pytest.approx(0.0)
    assert heading_at(FixedHeading(4.0), path.at(0.5), 0.5) == (pytest.approx(4.0 - 2 * math.pi), 0.0)


def test_a_vertical_piece_and_the_point_itself_have_no_heading():
    path = line((0, 0, 1), (0, 0, 2))
    assert heading_at(AlongPath(), path.at(0.5), 0.5) is None
    assert heading_at(FacePoint(0.0, 0.0), path.at(0.5), 0.5) is None


def test_given_headings_go_the_short_way_and_around_a_closed_path_back():
    assert heading_at(GIVEN, ELLIPSE.at(0.5), 0.5)[0] == pytest.approx(wrap_angle(3.0 + (math.pi - 3.0)))
    assert heading_at(GIVEN, ELLIPSE.at(9.0), 9.0)[0] == pytest.approx(-2.0)
    path = spline([(0, 0, 1), (1, 0, 1), (1, 1, 1)], closed=True)
    rule = with_headings(path, np.array([0.0, 1.0, 2.0]), np.array([0.0, 2.0, -2.0]))
    assert rule.s[-1] == path.length
    assert wrap_angle(float(rule.yaw[-1])) == pytest.approx(0.0)
    assert float(rule.yaw[-1]) == pytest.approx(2 * math.pi)  # 0, 2, 4.28, 6.28: always the short way


def test_a_point_on_the_path_cannot_be_looked_at():
    with pytest.raises(PathShapeError) as caught:
        plan(ellipse((0, 0, 1), (0.5, 0.8)), heading=FacePoint(0.5, 0.0))
    assert str(caught.value) == (
        "path: it passes 0.00 m from the point to look at, at s = 0.00 m (0.50, 0.00, 1.00); "
        "look at one that is farther off"
    )


def turned(start, target, seconds, settings=TurnSettings(), dt=1 / 30, rate=0.0):
    reference, found = TurnReference(start), []
    for k in range(round(seconds / dt)):
        reference = reference.step(wrap_angle(target + rate * k * dt), rate, dt, settings)
        found.append((reference.yaw, reference.rate, reference.acceleration))
    return np.array(found)


@given(st.floats(-3.1, 3.1), st.floats(-3.1, 3.1))
def test_it_turns_the_short_way_within_its_limits_and_does_not_overshoot(start, target):
    settings = TurnSettings()
    found = turned(start, target, 8.0, settings)
    assert np.abs(found[:, 1]).max() <= settings.rate + 1e-12
    assert np.abs(found[:, 2]).max() <= settings.acceleration + 1e-9
    assert wrap_angle(found[-1, 0] - target) == pytest.approx(0.0, abs=1e-4)
    way = wrap_angle(target - start)
    moved = np.array([wrap_angle(y - start) for y in found[:, 0]]) if abs(way) < 2.5 else None
    if moved is not None:
        assert (np.sign(way) * moved).max() <= abs(way) + 0.01
        assert (np.sign(way) * moved).min() >= -1e-9


def test_half_a_turn_goes_counterclockwise_and_takes_about_four_seconds():
    found = turned(0.0, math.pi, 6.0)
    assert found[5, 1] > 0.0
    done = np.flatnonzero([abs(wrap_angle(y - math.pi)) < 0.02 for y in found[:, 0]])[0] / 30
    assert 3.0 < done < 4.6


def test_it_follows_a_turning_target_without_lag():
    found = turned(0.0, 0.0, 8.0, rate=0.7)
    assert found[-1, 1] == pytest.approx(0.7, abs=1e-6)
    last = 0.7 * (round(8.0 * 30) - 1) / 30
    assert wrap_angle(found[-1, 0] - last) == pytest.approx(0.0, abs=0.03)


def test_at_the_first_tick_nothing_turns():
    assert TurnReference(0.3, 0.2).step(1.0, 0.0, 0.0, TurnSettings()) == TurnReference(0.3, 0.2, 0.0)
