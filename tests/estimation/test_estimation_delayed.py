"""Late, doubled, missing and out of order: the filter answers as if it had been told in time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.estimation.contributions import Contribution, contribution_of
from noctule.estimation.delayed import DelayedFilter, FilterSettings
from noctule.estimation.events import Input
from noctule.estimation.filter_state import FilterError, start_at
from noctule.estimation.kalman_filter import correct, predict
from noctule.estimation.measurements import Component, Measurement, linearise
from noctule.estimation.network_study import PRIOR, made_up_flight
from noctule.estimation.vehicle_model import VehicleModel

MODEL = VehicleModel.identified(delay=0.02)
SETTINGS = FilterSettings()
FLIGHT = made_up_flight(60, 0, MODEL, SETTINGS.noise)
EVENTS = [*FLIGHT.inputs, *FLIGHT.measurements]


def told(events, model=MODEL, options=SETTINGS):
    filter_ = DelayedFilter(FLIGHT.start, model, options)
    for event in events:
        filter_.insert(event)
    return filter_


def in_order(events):
    return told(
        sorted(events, key=lambda e: (e.stamp + MODEL.delay * isinstance(e, Input), e.source, e.sequence))
    )


def yaw(z, stamp, sequence=0, sd=0.05, source="markers"):
    return Measurement(stamp, np.array([Component.YAW]), np.array([z]), np.array([[sd**2]]), source, sequence)


def test_in_order_it_is_the_plain_kalman_filter():
    options = FilterSettings(gate=None)
    filter_ = told(FLIGHT.measurements, None, options)
    x, P, now = FLIGHT.start.x, FLIGHT.start.P, 0.0
    for z in FLIGHT.measurements:
        x, P = predict(
            x,
            P,
            z.stamp - now,
            np.zeros(4),
            np.zeros(4),
            np.zeros(4),
            options.noise_without_commands.densities,
        )
        now = z.stamp
        x, P = correct(x, P, *linearise(x, z.components, z.z), z.R)
    end = filter_.estimate()
    assert np.array_equal(end.x, x)
    assert np.array_equal(end.P, P)


@settings(max_examples=40, deadline=None)
@given(st.permutations(range(len(EVENTS))), st.lists(st.integers(0, len(EVENTS) - 1), max_size=20), st.data())
def test_any_order_with_any_doubles_gives_the_estimate_of_the_right_order(order, doubles, data):
    lost = data.draw(st.sets(st.integers(0, len(EVENTS) - 1), max_size=40))
    kept = [k for k in order if k not in lost]
    doubles = [k for k in doubles if k not in lost]
    expected = in_order([EVENTS[k] for k in sorted(kept)])
    filter_ = told([EVENTS[k] for k in kept + doubles])
    assert filter_.newest - expected.oldest <= SETTINGS.window
    here, there = filter_.estimate(1.0), expected.estimate(1.0)
    assert np.abs(here.x - there.x).max() < 1e-9
    assert np.abs(here.P - there.P).max() < 1e-9
    assert filter_.refusals == expected.refusals
    assert filter_.dropped["duplicate"] == len(doubles)


def test_a_late_measurement_changes_the_present_as_if_it_had_been_there():
    late = FLIGHT.measurements[20]
    filter_ = told([e for e in EVENTS if e is not late])
    without = filter_.estimate().x
    assert filter_.insert(late)
    assert np.abs(filter_.estimate().x - without).max() > 0.0
    assert np.abs(filter_.estimate().x - told(EVENTS).estimate().x).max() < 1e-12


def test_what_is_older_than_the_window_is_counted_and_dropped():
    filter_ = DelayedFilter(start_at(0.0, np.zeros(3), 0.0, PRIOR), None, FilterSettings(window=0.5))
    assert filter_.insert(yaw(0.0, 0.1))
    assert filter_.insert(yaw(0.0, 2.0, 1))
    before = filter_.estimate().x
    assert filter_.oldest == 0.1
    assert not filter_.insert(yaw(0.5, 0.05, 2))
    assert not filter_.insert(yaw(0.0, 0.1))  # a double of what was folded away
    assert filter_.dropped == {"too late": 2}
    assert np.array_equal(filter_.estimate().x, before)


def test_a_measurement_within_the_window_is_taken_when_nothing_was_there():
    filter_ = DelayedFilter(start_at(0.0, np.zeros(3), 0.0, PRIOR), None, FilterSettings(window=0.5))
    filter_.insert(yaw(0.0, 2.0))
    assert filter_.insert(yaw(0.0, 1.6, 1))


def test_what_is_remembered_has_an_end():
    filter_ = DelayedFilter(start_at(0.0, np.zeros(3), 0.0, PRIOR), None, FilterSettings(most_events=16))
    for k in range(100):
        filter_.insert(yaw(0.0, 0.001 * (k + 1), k))
    assert len(filter_.snapshot().events) == 15
    unbounded = DelayedFilter(start_at(0.0, np.zeros(3), 0.0, PRIOR))
    for k in range(100):
        unbounded.insert(yaw(0.0, 0.001 * (k + 1), k))
    assert np.array_equal(filter_.estimate().P, unbounded.estimate().P)


def test_folding_away_the_past_leaves_the_present_as_it_was():
    short, long = (DelayedFilter(FLIGHT.start, MODEL, FilterSettings(window=w)) for w in (0.1, 10.0))
    for event in sorted(EVENTS, key=lambda e: e.stamp):
        short.insert(event)
        long.insert(event)
    assert len(short.snapshot().events) < len(long.snapshot().events)
    assert np.array_equal(short.estimate().x, long.estimate().x)
    assert short.refusals == long.refusals


def test_a_stamp_in_the_future_is_refused_before_it_makes_everyone_late():
    filter_ = DelayedFilter(start_at(0.0, np.zeros(3), 0.0, PRIOR))
    assert not filter_.insert(yaw(0.0, 1e6), now=1.0)
    assert filter_.dropped == {"from the future": 1}
    assert filter_.insert(yaw(0.0, 1.05, 1), now=1.0)


def test_the_same_time_and_count_from_two_sources_are_two_measurements():
    filter_ = DelayedFilter(start_at(0.0, np.zeros(3), 0.0, PRIOR))
    assert filter_.insert(yaw(0.0, 0.1, source="a"))
    assert filter_.insert(yaw(0.0, 0.1, source="b"))
    assert not filter_.insert(yaw(0.0, 0.1, source="b"))
    assert filter_.dropped == {"duplicate": 1}


def test_a_command_takes_effect_after_its_delay_and_is_believed_for_its_time():
    start = start_at(0.0, np.zeros(3), 0.0, PRIOR)
    model = VehicleModel.velocity_loop(0.2, delay=0.1)
    filter_ = DelayedFilter(start, model, FilterSettings(input_timeout=0.3))
    filter_.insert(Input(0.0, np.array([1.0, 0.0, 0.0, 0.0])))
    assert filter_.estimate(0.1).x[4] == 0.0
    assert filter_.estimate(0.25).x[4] == pytest.approx(1.0 - np.exp(-0.15 / 0.2))
    ended = filter_.estimate(0.4).x[4]
    assert ended == pytest.approx(1.0 - np.exp(-0.3 / 0.2))
    assert filter_.estimate(0.9).x[4] == ended
    assert filter_.estimate(0.9).sd[4] > filter_.estimate(0.4).sd[4]


def test_a_command_that_nobody_knows_leaves_constant_velocity():
    model = VehicleModel.velocity_loop(0.2)
    filter_ = DelayedFilter(start_at(0.0, np.zeros(3), 0.0, PRIOR), model)
    filter_.insert(Input(0.0, np.array([1.0, 0.0, 0.0, 0.0])))
    filter_.insert(Input(0.1, None, sequence=1))
    assert filter_.estimate(0.3).x[4] == filter_.estimate(0.1).x[4] > 0.3


def test_an_estimate_between_events_is_predicted_and_changes_nothing():
    filter_ = told(EVENTS)
    before = filter_.estimate().x
    middle = filter_.estimate(0.5 * (filter_.oldest + filter_.newest))
    assert filter_.oldest < middle.stamp < filter_.newest
    ahead = filter_.estimate(filter_.newest + 0.2)
    assert ahead.sd[0] > filter_.estimate().sd[0]
    assert np.array_equal(filter_.estimate().x, before)


def test_what_is_known_before_an_event_leaves_it_out():
    filter_ = told(EVENTS)
    z = FLIGHT.measurements[30]
    without = told([e for e in EVENTS if e.stamp < z.stamp]).estimate(z.stamp)
    assert np.array_equal(filter_.before(z).x, without.x)


def test_before_the_beginning_nothing_is_estimated():
    filter_ = DelayedFilter(start_at(2.0, np.zeros(3), 0.0))
    with pytest.raises(FilterError) as told_:
        filter_.estimate(1.5)
    assert str(told_.value) == (
        "estimate at 1.500 s asked, the filter remembers from 2.000 s on; "
        "ask earlier or make its window longer"
    )


def test_a_filter_made_of_a_snapshot_knows_the_same_and_counts_nothing_twice():
    filter_ = told(EVENTS, options=FilterSettings(window=0.2))
    copy = DelayedFilter.of_snapshot(filter_.snapshot(), MODEL, FilterSettings(window=0.2))
    assert np.array_equal(copy.estimate().x, filter_.estimate().x)
    assert np.array_equal(copy.estimate().P, filter_.estimate().P)
    for event in EVENTS:
        assert not copy.insert(event)
    assert np.array_equal(copy.estimate(1.0).x, filter_.estimate(1.0).x)


def test_a_contribution_of_another_size_is_dropped():
    filter_ = DelayedFilter(start_at(0.0, np.zeros(3), 0.0, PRIOR, 9))
    other = contribution_of(start_at(0.0, np.zeros(3), 0.0, PRIOR).x, yaw(0.0, 0.1))
    assert not filter_.insert(other)
    assert filter_.dropped == {"other state": 1}


@pytest.mark.parametrize("number", [np.inf, 1e300, np.nan])
def test_numbers_that_nothing_can_be_made_of_leave_the_state_alone(number):
    filter_ = DelayedFilter(start_at(0.0, np.zeros(3), 0.0, PRIOR), None, FilterSettings(gate=None))
    I = np.full((11, 11), number)  # noqa: E741
    filter_.insert(Contribution(0.1, "mad", 0, np.full(11, number), I, 0.0, 0.0))
    expected = filter_.estimate(0.1).P
    filter_.insert(yaw(number, 0.1, source="worse"))
    end = filter_.estimate(0.2)
    assert np.isfinite(end.x).all()
    assert np.isfinite(expected).all()
    assert np.linalg.eigvalsh(end.P)[0] > 0.0
    assert filter_.refusals["mad: unusable"] == 1


def test_an_event_without_a_time_is_refused():
    with pytest.raises(FilterError) as told_:
        DelayedFilter(start_at(0.0, np.zeros(3), 0.0)).insert(yaw(0.0, np.nan))
    assert str(told_.value) == "event of 'markers' at nan s; expected a finite stamp"


def test_a_command_that_is_no_number_is_refused():
    with pytest.raises(FilterError) as told_:
        Input(1.0, np.array([0.0, np.nan, 0.0, 0.0]))
    assert str(told_.value) == ("input of 'commands' at 1 s: [0.0, nan, 0.0, 0.0]; expected 4 finite numbers")
