"""Every stop happens and lasts, wherever and whenever the others are; what cannot happen is refused."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.control.paths import (
    FixedHeading,
    SpeedSettings,
    Stop,
    StopError,
    duration,
    ellipse,
    line,
    loc_1,
    plan,
    polyline,
)
from noctule.control.paths.heading import TurnReference
from noctule.control.paths.progress import advance, begin

DT = 1 / 30
LINE = line((0, 0, 1), (3, 0, 1))
RING = ellipse((0, 0, 1), (0.5, 0.8))
SPEED = SpeedSettings(cruise=0.4, turn_rate=3.0)
BRAKED = 1.5  # [s], within which it has come to a stop from its cruise


def fly(made, seconds):
    """Return (t, progress, wanted) of every tick of a point that does what is wanted of it."""
    now, x, rows = begin(made, TurnReference(0.0)), np.zeros(8), []
    x[:3] = made.path.position[0]
    for k in range(round(seconds / DT)):
        now, wanted = advance(made, now, x, k * DT, DT)
        rows.append((k * DT, now, wanted))
        x[4:] = wanted.velocity
        x[4:7] += 3.0 * (wanted.pose[:3] - x[:3])
        x[:4] += DT * x[4:]
    return rows


def held(rows, s):
    """Return the times at which the point at `s` is held."""
    return [t for t, now, _ in rows if now.holding and now.gate == s]


def turned(rows):
    """Return the headings [rad] that stops have asked for, each with when it began to be wanted."""
    found, last = [], None
    for t, now, _ in rows:
        if now.yaw is not None and now.yaw != last:
            found.append((now.yaw, t))
        last = now.yaw
    return found


def on_the_line(*stops):
    return plan(LINE, SPEED, FixedHeading(0.0), stops)


def test_two_stops_at_the_same_place_come_one_after_the_other():
    rows = fly(on_the_line(Stop(2.0, s=1.0, yaw=1.0), Stop(3.0, s=1.0, yaw=2.0, turn_after=1.0)), 20.0)
    times = held(rows, 1.0)
    assert times[-1] - times[0] == pytest.approx(5.0, abs=0.1)
    assert np.diff(times).max() < 1.5 * DT
    assert [yaw for yaw, _ in turned(rows)] == [1.0, 2.0]
    assert turned(rows)[1][1] - turned(rows)[0][1] == pytest.approx(3.0, abs=0.1)
    points = np.array([w.pose[:3] for t, _, w in rows if times[0] <= t <= times[-1]])
    assert np.ptp(points, axis=0).max() == 0.0
    assert rows[-1][1].arrived


def test_stops_two_centimetres_apart_both_happen_and_nothing_moves_farther():
    rows = fly(on_the_line(Stop(2.0, s=1.0, yaw=1.0), Stop(3.0, s=1.02, yaw=2.0)), 20.0)
    first, second = held(rows, 1.0), held(rows, 1.02)
    assert first[-1] - first[0] == pytest.approx(2.0, abs=0.1)
    assert second[-1] - second[0] == pytest.approx(3.0, abs=0.1)
    assert [yaw for yaw, _ in turned(rows)] == [1.0, 2.0]
    x = np.array([w.pose[0] for t, _, w in rows if first[0] <= t <= second[-1]])
    assert (x.min(), x.max()) == (1.0, 1.02)


def test_three_stops_at_the_end_all_happen_before_it_has_arrived():
    rows = fly(on_the_line(*(Stop(1.0, s=3.0, yaw=yaw) for yaw in (0.5, 1.0, 1.5))), 20.0)
    begin = held(rows, 3.0)[0]
    assert next(t for t, now, _ in rows if now.arrived) - begin == pytest.approx(3.0, abs=0.15)
    assert [yaw for yaw, _ in turned(rows)] == [0.5, 1.0, 1.5]


@pytest.mark.parametrize(
    "inner", [Stop(3.0, time=5.0, yaw=2.0), Stop(3.0, time=5.0, yaw=2.0, turn_after=3.0)]
)
@pytest.mark.parametrize(
    ("outer", "end"),
    [(Stop(12.0, time=3.0, yaw=1.0), 15.0), (Stop(12.0, s=1.0, yaw=1.0), math.nan)],
)
def test_a_stop_in_time_within_another_stop_does_not_shorten_it(outer, end, inner):
    rows = fly(on_the_line(outer, inner), 26.0)
    gate = next(now.gate for _, now, _ in rows if now.holding)
    times = held(rows, gate)
    assert times[-1] == pytest.approx(times[0] + 12.0 if outer.time is None else end, abs=0.1)
    assert [yaw for yaw, _ in turned(rows)] == [1.0, 2.0]
    assert turned(rows)[1][1] == pytest.approx(5.0 + inner.turn_after, abs=0.05)


def test_the_turn_of_the_longer_stop_still_comes_after_the_shorter_one():
    stops = (Stop(12.0, time=3.0, yaw=1.0, turn_after=10.0), Stop(2.0, time=5.0, yaw=2.0, keep_yaw=False))
    rows = fly(on_the_line(*stops), 16.0)
    assert turned(rows) == [(2.0, pytest.approx(5.0, abs=0.05)), (1.0, pytest.approx(13.0, abs=0.05))]
    assert {now.yaw for t, now, _ in rows if 7.1 < t < 12.9} == {None}


def test_a_stop_in_time_just_before_a_place_does_not_replace_the_stop_there():
    free = fly(on_the_line(), 8.0)
    for ahead in (0.0, 0.01, 0.04, 0.1, 0.16, 0.2):  # from beyond the braking distance to none
        time = next(t for t, now, _ in free if now.s >= 1.0 - ahead)
        rows = fly(on_the_line(Stop(2.0, s=1.0, yaw=1.0), Stop(3.0, time=time, yaw=2.0)), 20.0)
        times = held(rows, 1.0)
        assert times[-1] - times[0] > 1.95
        assert {yaw for yaw, _ in turned(rows)} == {1.0, 2.0}
        assert max(t for t, now, _ in rows if now.holding and now.gate <= 1.0) > time + 2.95


def test_a_stop_in_time_shorter_than_a_tick_is_not_missed():
    rows = fly(on_the_line(Stop(0.01, time=3.012, yaw=1.0)), 16.0)
    assert [yaw for yaw, _ in turned(rows)] == [1.0]
    assert any(now.holding for t, now, _ in rows if t < 5.0)
    assert rows[-1][1].arrived


placed_stops = st.lists(
    st.tuples(st.sampled_from([0.0, 0.6, 0.61, 1.5, 1.525, 2.4]), st.floats(0.3, 3.0)), max_size=4
)
timed_stops = st.lists(
    st.tuples(st.integers(1, 30), st.floats(0.1, 6.0)), max_size=3, unique_by=lambda stop: stop[0]
)


@settings(max_examples=60)
@given(placed_stops, timed_stops)
def test_every_stop_lasts_and_every_turn_happens(placed, timed):
    at_places = [
        Stop(seconds, s=s, yaw=0.1 + 0.2 * k, turn_after=0.4 * seconds)
        for k, (s, seconds) in enumerate(placed)
    ]
    at_times = [Stop(seconds, time=0.5 * n, yaw=-0.1 - 0.2 * k) for k, (n, seconds) in enumerate(timed)]
    made = plan(RING, SPEED, FixedHeading(0.0), (*at_places, *at_times), laps=None)
    longest = sum(stop.seconds for stop in made.placed + made.timed)
    rows = fly(made, 16.0 + 0.5 * 30 + longest + BRAKED * (len(placed) + len(timed)))
    for s in {stop.s for stop in made.placed}:
        asked = sum(stop.seconds for stop in made.placed if stop.s == s)
        times = held(rows, s)
        assert len(times) * DT >= asked - 1e-6
        assert np.diff(times).max() < 1.5 * DT
    for stop in made.timed:
        inside = [now for t, now, _ in rows if stop.time + BRAKED <= t < stop.time + stop.seconds]
        assert all(now.holding for now in inside)
        assert len({now.gate for now in inside}) <= 1
    seen = dict(turned(rows))
    for stop in made.placed:
        assert stop.yaw in seen or _another_turned_then(stop, made, seen)
    for stop in made.timed:
        first = math.ceil(stop.time / DT - 1e-6) * DT
        assert seen.get(stop.yaw, math.nan) == pytest.approx(first, abs=1.01 * DT) or any(
            abs(t - first) <= 1.01 * DT for t in seen.values()
        )
    assert not rows[-1][1].holding
    assert rows[-1][1].placed == len(made.placed)


def _another_turned_then(stop, made, seen):
    """Return whether the turn may have been overtaken within the same tick, by one at a time."""
    return any(abs(seen.get(other.yaw, math.inf) - other.time) <= 2 * DT for other in made.timed)


@settings(max_examples=60)
@given(placed_stops, timed_stops)
def test_the_duration_is_that_of_the_flight(placed, timed):
    stops = [Stop(seconds, s=s) for s, seconds in placed]
    stops += [Stop(seconds, time=0.2 * n) for n, seconds in timed]
    made = on_the_line(*stops)
    wanted = duration(made)
    rows = fly(made, wanted + 20.0)
    # A stop in time just short of a place may be held at the place, or before it: then one follows the other.
    unsure = sum(seconds for _, seconds in timed) if placed else 0.0
    found = next(t for t, now, _ in rows if now.arrived)
    assert found == pytest.approx(wanted, abs=0.1 + 0.1 * len(stops) + unsure)


def test_the_duration_of_laps_of_varying_speed_is_that_of_the_flight():
    path = polyline([(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], 0.1, closed=True)
    made = plan(path, SPEED, FixedHeading(0.0), (Stop(2.0, s=4.0), Stop(1.0, time=15.0)), laps=3)
    assert made.profile.v.min() < 0.9 * made.profile.v.max()
    rows = fly(made, 45.0)
    assert next(t for t, now, _ in rows if now.arrived) == pytest.approx(duration(made), abs=0.5)
    assert duration(loc_1()) == math.inf


def refused(call):
    with pytest.raises(StopError) as caught:
        call()
    return str(caught.value)


def test_a_stop_that_could_not_do_what_it_says_is_refused():
    assert refused(lambda: Stop(2.0, s=1.0, yaw=1.0, turn_after=5.0)) == (
        "stop: turn_after = 5 s is beyond its end at 2 s; turn earlier or stop longer"
    )
    assert refused(lambda: Stop(2.0, s=1.0, yaw=1.0, turn_after=2.0, keep_yaw=False)) == (
        "stop: it turns at its end at 2 s and does not keep the heading; turn earlier or keep it"
    )
    for yaw in (None, 1.0):
        assert refused(lambda yaw=yaw: Stop(0.0, time=3.0, yaw=yaw)) == (
            "stop: seconds is 0 at a time; expected more than 0"
        )


def test_a_place_to_fly_to_and_on_from_at_once_may_turn_for_good():
    rows = fly(on_the_line(Stop(0.0, s=1.0, yaw=1.0)), 12.0)
    assert 1 <= len(held(rows, 1.0)) <= 2
    assert rows[-1][2].pose[3] == pytest.approx(1.0, abs=1e-3)


def test_a_stop_in_time_after_the_end_is_refused_with_when_that_is():
    assert refused(lambda: on_the_line(Stop(2.0, time=60.0))) == (
        "stop: time = 60 s is after the end of the path, which is reached after about 8.1 s; stop earlier"
    )
    # A stop before it puts the end off.
    assert on_the_line(Stop(60.0, s=1.0), Stop(2.0, time=60.0)).timed
    assert on_the_line(Stop(6.0, time=4.0), Stop(2.0, time=12.0)).timed
    assert "about 14." in refused(lambda: on_the_line(Stop(6.0, time=4.0), Stop(2.0, time=15.0)))
    assert "about 16." in refused(
        lambda: on_the_line(Stop(4.0, s=1.0), Stop(4.0, s=1.0), Stop(2.0, time=17.0))
    )
    assert plan(RING, SPEED, stops=(Stop(2.0, time=6000.0),), laps=None).timed
