"""How fast a path may be flown, and what is refused, with the place."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.control.paths import (
    AlongPath,
    FixedHeading,
    PathShapeError,
    SpeedSettings,
    Stop,
    arc,
    ellipse,
    joined,
    line,
    loc_1,
    loc_2,
    loc_3,
    plan,
    polyline,
)
from noctule.control.paths.heading import turn_per_metre
from noctule.control.paths.speed import approach_speed, braking_distance, speed_profile
from noctule.messages import Limits

KEYHOLE = joined([line((0, 0, 1), (1, 0, 1)), arc((1, 0.1, 1), 0.1, -math.pi / 2, math.pi),
                  line((1, 0.2, 1), (0, 0.2, 1))])  # fmt: skip


def fails(call):
    with pytest.raises(PathShapeError) as caught:
        call()
    return str(caught.value)


@given(st.floats(0.1, 2.0), st.floats(0.1, 3.0), st.floats(0.05, 3.0))
def test_a_profile_keeps_every_limit_at_every_node(cruise, acceleration, lateral):
    settings = SpeedSettings(cruise=cruise, acceleration=acceleration, lateral=lateral, slowest=0.01)
    for path in (KEYHOLE, loc_2().path):
        v = speed_profile(path, settings).v
        assert v.max() <= cruise
        bend = np.linalg.norm(path.curvature, axis=1)
        assert (v**2 * bend <= lateral * (1 + 1e-9)).all()
        assert (np.abs(np.diff(v**2)) <= 2 * acceleration * np.diff(path.s) * (1 + 1e-6) + 1e-12).all()
        if path.closed:
            assert v[0] == pytest.approx(v[-1])


def test_it_is_no_slower_than_it_must_be():
    v = speed_profile(KEYHOLE, SpeedSettings(cruise=0.6, acceleration=0.5, lateral=0.9)).v
    assert v[0] == 0.6
    assert v.min() == pytest.approx(0.3)  # sqrt(0.9 * 0.1)
    braking = (0.6**2 - 0.3**2) / (2 * 0.5)
    before = np.interp(1.0 - braking - 0.01, KEYHOLE.s, v)
    assert before == pytest.approx(0.6)
    assert np.interp(1.0 - braking / 2, KEYHOLE.s, v) == pytest.approx(math.sqrt(0.36 - 0.135), abs=2e-3)


def test_a_turning_heading_and_a_climb_slow_it_down():
    settings = SpeedSettings(cruise=0.5, turn_rate=0.8)
    path = ellipse((0, 0, 1), (0.5, 0.8))
    along = speed_profile(path, settings, turn_per_metre(AlongPath(), path))
    assert along.v.min() == pytest.approx(0.8 / 3.2, rel=1e-3)  # the curvature is b / a^2 at the ends
    assert speed_profile(path, settings).v.min() == 0.5
    steep = line((0, 0, 0.5), (0.3, 0, 0.9))
    assert speed_profile(steep, SpeedSettings(cruise=0.5, climb=0.2)).v.max() == pytest.approx(0.25)


def test_a_cruise_of_its_own_holds_where_it_is_given():
    path = line((0, 0, 1), (4, 0, 1))
    cruise = np.where(path.s <= 2.0, 0.2, 0.6)
    v = speed_profile(path, SpeedSettings(acceleration=1.0), cruise=cruise).v
    assert np.interp(1.0, path.s, v) == pytest.approx(0.2)
    assert np.interp(2.08, path.s, v) == pytest.approx(math.sqrt(0.04 + 0.16), abs=0.02)
    assert v[-1] == pytest.approx(0.6)


def test_the_experiments_are_flown_at_their_speed_throughout():
    for made in (loc_1(), loc_2(), loc_3()):
        assert made.profile.v.min() == made.profile.v.max() == 0.3
        assert made.total == math.inf
    assert [(s.time, s.seconds) for s in loc_1().timed] == [(40.0, 30.0)]
    assert [(s.time, s.seconds, s.yaw, s.turn_after) for s in loc_2().timed] == [(40.0, 30.0, math.pi, 4.0)]
    assert [(s.time, s.seconds) for s in loc_3().timed] == [(40.0, 12.0)]


def test_infeasible_speed_and_curvature_are_refused_with_the_place():
    tight = joined([line((0, 0, 1), (1, 0, 1)), arc((1, 0.002, 1), 0.002, -math.pi / 2, 1.0)])
    assert fails(lambda: plan(tight)) == (
        "path: its curvature at s = 1.00 m (1.00, 0.00, 1.00), a radius of 0.002 m allows 0.045 m/s, "
        "less than the slowest of 0.05 m/s; make it wider or allow more there"
    )
    assert fails(lambda: plan(KEYHOLE, SpeedSettings(cruise=0.6, slow_down=False), FixedHeading())) == (
        "path: its curvature at s = 1.00 m (1.00, 0.00, 1.00) allows 0.32 m/s of the 0.60 m/s asked; "
        "fly slower, make it wider, or let it slow down"
    )
    assert fails(lambda: plan(KEYHOLE, SpeedSettings(cruise=0.9), limits=Limits(forward=0.8))) == (
        "path: 0.90 m/s at s = 0.00 m (0.00, 0.00, 1.00) is 0.90 m/s of level flight, "
        "the vehicle is allowed 0.6 m/s; fly slower there"
    )
    hill = joined([line((0, 0, 1), (1, 0, 1)), line((1, 0, 1), (1.0, 0, 2))])
    stop = (Stop(0.0, s=1.0),)
    assert fails(lambda: plan(hill, SpeedSettings(cruise=0.55), stops=stop, limits=Limits())) == (
        "path: 0.55 m/s at s = 1.00 m (1.00, 0.00, 1.00) is 0.55 m/s of climb, "
        "the vehicle is allowed 0.5 m/s; fly slower there"
    )


def test_a_corner_needs_a_stop():
    corner = polyline([(0, 0, 1), (1, 0, 1), (1, 1, 1)])
    assert fails(lambda: plan(corner)) == (
        "path: a corner of 90 deg at s = 1.00 m (1.00, 0.00, 1.00) cannot be flown through; "
        "stop there (s = 1.00) or round it"
    )
    assert plan(corner, stops=(Stop(0.0, s=1.0),)).total == pytest.approx(2.0)
    ring = polyline([(0, 0, 1), (1, 0, 1), (0.5, 0.866025, 1)], closed=True)
    stops = tuple(Stop(0.0, s=float(s)) for s in (1, 2, 3, 4, 5))
    assert plan(ring, stops=stops, laps=2).total == pytest.approx(6.0, abs=1e-5)
    assert fails(lambda: plan(ring, stops=stops[:2] + stops[3:], laps=2)).startswith(
        "path: a corner of 120 deg"
    )
    assert fails(lambda: plan(ring, stops=stops[:3], laps=None)) == (
        "path: a corner at s = 0.00 m (0.00, 0.00, 1.00) on a path without end would need a stop in every "
        "lap; round it or give a number of laps"
    )


def test_stops_and_laps_that_do_not_exist_are_refused():
    path = line((0, 0, 1), (1, 0, 1))
    assert fails(lambda: plan(path, stops=(Stop(1.0, s=2.5),))) == (
        "stop: s = 2.50 m is beyond the end of the path at 1.00 m; stop earlier"
    )
    assert fails(lambda: plan(path, laps=2)) == (
        "path: laps are flown around a closed path, and this one has two ends"
    )
    assert fails(lambda: plan(loc_1().path, laps=0)) == "path: 0 laps, expected 1 or more"
    assert fails(lambda: Stop(1.0)) == "stop: give either its time or its place s"
    assert fails(lambda: Stop(1.0, time=1.0, s=1.0)) == "stop: give either its time or its place s"
    assert fails(lambda: Stop(-1.0, time=2.0)) == (
        "stop: its times and places are [-1.0, 2.0, 0.0]; expected numbers, none below 0"
    )


@given(st.floats(0.0, 3.0), st.floats(0.1, 3.0), st.floats(0.5, 8.0))
def test_the_braking_distance_is_that_of_the_approach(speed, acceleration, gain):
    settings = SpeedSettings(acceleration=acceleration, stop_gain=gain)
    assert approach_speed(braking_distance(speed, settings), settings) == pytest.approx(speed, abs=1e-9)


def test_an_approach_brakes_evenly_and_comes_back_from_beyond():
    settings = SpeedSettings()
    d, t = braking_distance(0.8, settings), 0.0
    start = d
    while d > 0.01:
        before = approach_speed(d, settings)
        d, t = d - 0.001 * before, t + 0.001
        assert 0.0 < before - approach_speed(d, settings) <= 0.5 * 0.001 * 1.01
    assert start / 0.8 < t < 3.0
    assert approach_speed(-0.05, settings) == -approach_speed(0.05, settings) < 0.0
