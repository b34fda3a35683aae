"""The supervisor's table, every combination of it, and the fence."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.flight.fence import DeadReckoning, Fence, bound_by_fence
from noctule.flight.supervisor import (
    ACTIONS,
    HOVER_CONDITIONS,
    LAND_CONDITIONS,
    Action,
    Bounds,
    Condition,
    Inputs,
    State,
    conditions,
    next_state,
    supervise,
)
from noctule.geometry import rot_z
from noctule.messages import Command, FlightState, Limits, VehicleState, Whereabouts

DT = 1.0 / 30.0
LIMITS = Limits()
ALL = [
    (state, frozenset(c for c, on in zip(Condition, mask, strict=True) if on))
    for state in State
    for mask in product((False, True), repeat=len(Condition))
]


def test_every_state_and_every_set_of_conditions_follows_the_order_of_gravity():
    assert len(ALL) == 5 * 2**11
    for state, now in ALL:
        after, why = next_state(state, now)
        if state == State.EMERGENCY or Condition.EMERGENCY in now:
            assert after == State.EMERGENCY
        elif state == State.LANDED or Condition.ON_GROUND in now:
            assert after == State.LANDED
        elif state == State.LANDING or now & set(LAND_CONDITIONS):
            assert after == State.LANDING
        elif now & set(HOVER_CONDITIONS):
            assert after == State.HOVER
        else:
            assert (after, why) == (State.FLYING, None)


def test_whatever_decides_is_true_or_is_where_the_flight_already_was():
    for state, now in ALL:
        after, why = next_state(state, now)
        assert why is None or why in now or after == state


def test_emergency_landed_and_landing_are_never_left_for_flight():
    for state, now in ALL:
        after, _ = next_state(state, now)
        if state in (State.EMERGENCY, State.LANDED):
            assert after in (state, State.EMERGENCY)
        if state == State.LANDING:
            assert after in (State.LANDING, State.LANDED, State.EMERGENCY)


def test_hover_ends_when_its_cause_does():
    assert next_state(State.HOVER, frozenset({Condition.PICTURE_STALE}))[0] == State.HOVER
    assert next_state(State.HOVER, frozenset())[0] == State.FLYING


def test_every_state_has_an_action():
    assert set(ACTIONS) == set(State)


@pytest.mark.parametrize(
    ("changed", "condition"),
    [
        ({"emergency_asked": True}, Condition.EMERGENCY),
        ({"flight_state": FlightState.EMERGENCY}, Condition.EMERGENCY),
        ({"flight_state": FlightState.LANDED}, Condition.ON_GROUND),
        ({"flight_state": FlightState.LANDING}, Condition.VEHICLE_LANDING),
        ({"land_asked": True}, Condition.LAND_ASKED),
        ({"hover_asked": True}, Condition.HOVER_ASKED),
        ({"battery": 0.05}, Condition.BATTERY_LOW),
        ({"command_age": 0.25}, Condition.COMMAND_EXPIRED),
        ({"picture_age": 0.6}, Condition.PICTURE_STALE),
        ({"depth_age": 12.1}, Condition.DEPTH_STALE),
        ({"state_age": 0.6}, Condition.STATE_STALE),
    ],
)
def test_each_input_alone_raises_its_condition_alone(changed, condition):
    assert conditions(Inputs(Command(), DT, **changed), Bounds()) == {condition}


def test_ages_at_their_limits_and_an_unknown_battery_are_fine():
    inputs = Inputs(Command(), DT, command_age=0.2, picture_age=0.5, state_age=0.5, battery=None)
    assert conditions(inputs, Bounds()) == frozenset()
    assert conditions(Inputs(Command(), DT, battery=0.1), Bounds()) == frozenset()


@pytest.mark.parametrize("name", ["command_age", "picture_age", "state_age", "depth_age"])
def test_blindness_is_first_hover_then_landing(name):
    limit = getattr(Bounds(), name)
    hover = supervise(State.FLYING, Inputs(Command(0.3), DT, **{name: limit + 1.0}), Command(), Bounds())
    land = supervise(State.HOVER, Inputs(Command(0.3), DT, **{name: limit + 3.1}), Command(), Bounds())
    assert (hover.state, hover.action) == (State.HOVER, Action.HOVER)
    assert (land.state, land.action) == (State.LANDING, Action.LAND)
    assert land.reason == "no picture, depth frame, report or command came for too long"


def test_a_command_within_all_bounds_passes_unchanged():
    ruling = supervise(State.FLYING, Inputs(Command(0.1, 0.01, 0.0, 0.02), DT), Command(0.09), Bounds())
    assert ruling.command == Command(0.1, 0.01, 0.0, 0.02)
    assert (ruling.action, ruling.reason) == (Action.PASS, "")


def test_a_command_that_is_not_finite_is_braked_not_sent():
    ruling = supervise(State.FLYING, Inputs(Command(float("nan")), DT), Command(0.3), Bounds())
    assert (ruling.state, ruling.reason) == (State.HOVER, "the pilot's command is not finite")
    assert 0.0 < ruling.command.forward < 0.3


def test_an_emergency_sends_nothing_and_says_so():
    ruling = supervise(State.FLYING, Inputs(Command(0.3), DT, emergency_asked=True), Command(0.3), Bounds())
    assert (ruling.action, ruling.command) == (Action.EMERGENCY, Command())


speeds = st.floats(-3.0, 3.0)
commands = st.builds(Command, speeds, speeds, speeds, speeds)
inside = st.builds(
    Command, st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(-0.5, 0.5), st.floats(-0.8, 0.8)
)
inputs = st.builds(
    Inputs,
    wanted=commands,
    dt=st.just(DT),
    command_age=st.floats(0.0, 5.0),
    picture_age=st.floats(0.0, 5.0),
    state_age=st.floats(0.0, 5.0),
    flight_state=st.sampled_from([FlightState.FLYING, FlightState.LANDING]),
    battery=st.none() | st.floats(0.0, 1.0),
    position=st.tuples(st.floats(-12, 12), st.floats(-12, 12), st.floats(0, 4)).map(np.array),
    yaw=st.floats(-3.1, 3.1),
    margin=st.floats(0.0, 1.0),
    hover_asked=st.booleans(),
    land_asked=st.booleans(),
)
moving = st.sampled_from([State.FLYING, State.HOVER, State.LANDING])


@settings(deadline=None)
@given(moving, inputs, inside)
def test_no_command_ever_steps_beyond_the_acceleration_limit_whoever_decides(state, told, previous):
    ruling = supervise(state, told, previous, Bounds())
    change = ruling.command.as_array() - previous.as_array()
    assert np.linalg.norm(change[:3]) <= LIMITS.acceleration * DT
    assert abs(change[3]) <= LIMITS.yaw_acceleration * DT


@settings(deadline=None)
@given(moving, inputs, inside)
def test_no_command_is_faster_than_the_limits(state, told, previous):
    sent = supervise(state, told, previous, Bounds()).command.as_array()
    assert (np.abs(sent) <= LIMITS.speeds + 1e-12).all()


@settings(deadline=None)
@given(inputs, inside)
def test_the_supervisors_own_commands_always_brake(told, previous):
    ruling = supervise(State.LANDING, told, previous, Bounds())
    if ruling.action == Action.LAND:
        assert np.linalg.norm(ruling.command.as_array()[:3]) <= np.linalg.norm(previous.as_array()[:3])


def test_braking_ends_in_hover_exactly():
    command = Command(0.6, -0.2, 0.1, 0.8)
    for _ in range(30):
        command = supervise(State.HOVER, Inputs(Command(), DT, hover_asked=True), command, Bounds()).command
    assert command == Command()


def test_the_fence_is_never_crossed_by_a_pilot_that_flies_straight_at_it():
    fence = Fence((-1.0, -1.0, 0.2), (1.0, 1.0, 2.0), 0.0, 0.0)
    bounds = Bounds(fence=fence)
    rng = np.random.default_rng(3)
    for _ in range(12):
        yaw = rng.uniform(-3, 3)
        heading = rng.normal(size=3)
        wanted = Command(*(3.0 * heading / np.linalg.norm(heading)), 0.0)
        position, command = np.array([0.0, 0.0, 1.0]), Command()
        for _ in range(300):
            told = Inputs(wanted, DT, position=position, yaw=yaw)
            command = supervise(State.FLYING, told, command, bounds).command
            position = position + rot_z(yaw) @ command.as_array()[:3] * DT
        assert (position > np.array(fence.low) - 0.02).all()
        assert (position < np.array(fence.high) + 0.02).all()
        assert np.abs(position - [0, 0, 1.1]).max() > 0.85  # it did fly up to a side


def test_outside_the_fence_the_way_back_is_free_and_the_way_out_is_shut():
    fence = Fence((-1.0, -1.0, 0.0), (1.0, 1.0, 2.0))
    outside = np.array([1.5, 0.0, 1.0])
    back = bound_by_fence(np.array([-0.3, 0.2, 0.0, 0.4]), outside, 0.0, 0.0, fence, LIMITS)
    out = bound_by_fence(np.array([0.3, 0.2, 0.0, 0.4]), outside, 0.0, 0.0, fence, LIMITS)
    np.testing.assert_allclose(back, [-0.3, 0.2, 0.0, 0.4])
    np.testing.assert_allclose(out, [0.0, 0.2, 0.0, 0.4], atol=1e-12)


def test_the_margin_narrows_the_fence_in_the_plane_but_not_in_height():
    fence = Fence((-1.0, -1.0, 0.0), (1.0, 1.0, 2.0))
    near = np.array([0.8, 0.0, 1.8])
    up_and_on = np.array([0.4, 0.0, 0.4, 0.0])
    free = bound_by_fence(up_and_on, near, 0.0, 0.0, fence, LIMITS)
    narrow = bound_by_fence(up_and_on, near, 0.0, 0.3, fence, LIMITS)
    np.testing.assert_allclose(free, up_and_on)
    np.testing.assert_allclose(narrow, [0.0, 0.0, 0.4, 0.0], atol=1e-12)


def test_dead_reckoning_adds_up_the_reported_velocity_along_the_reported_heading():
    place = DeadReckoning(np.array([1.0, 2.0, 1.0]), np.pi / 2)
    state = VehicleState(0.0, FlightState.FLYING, yaw=0.3, v_body=np.array([0.5, 0.0, 0.0]), height=1.4)
    for _ in range(10):
        place = place.advance(state, np.zeros(4), 0.1)
    # A compass that starts at 0.3 rad is aligned to the mission's heading at the first report.
    np.testing.assert_allclose(place.position, [1.0, 2.5, 1.4], atol=1e-12)
    assert place.travelled == pytest.approx(0.5)


def test_dead_reckoning_takes_the_command_for_what_is_not_reported():
    place = DeadReckoning(np.zeros(3), 0.0)
    silent = VehicleState(0.0, FlightState.FLYING)
    place = place.advance(silent, np.array([0.4, 0.0, 0.1, 0.5]), 1.0)
    assert place.yaw == pytest.approx(0.5)
    np.testing.assert_allclose(place.position, rot_z(0.5) @ [0.4, 0.0, 0.1])


def test_dead_reckoning_goes_on_from_where_a_located_pilot_holds_the_vehicle_to_be():
    known = Whereabouts(1.0, np.array([2.0, 1.0, 1.5]), np.pi / 2, np.zeros(4), 0.02, 0.1, np.zeros(4))
    here = DeadReckoning.at(known)
    assert here.margin(Fence()) == pytest.approx(0.06)
    # The vehicle's own heading is off by a quarter turn, and stays so.
    state = VehicleState(1.0, FlightState.FLYING, yaw=0.0, v_body=np.array([0.5, 0.0, 0.0]))
    later = here.advance(state, np.zeros(4), 1.0)
    assert later.position == pytest.approx([2.0, 1.5, 1.5])
    assert later.margin(Fence()) == pytest.approx(0.06 + 0.005 + 0.01)


def test_the_margin_grows_with_time_and_with_distance():
    fence = Fence(margin_per_second=0.01, margin_per_metre=0.1)
    still = VehicleState(0.0, FlightState.FLYING, v_body=np.zeros(3))
    moving_on = VehicleState(0.0, FlightState.FLYING, v_body=np.array([1.0, 0.0, 0.0]))
    waited = DeadReckoning(np.zeros(3), 0.0).advance(still, np.zeros(4), 2.0)
    flown = waited.advance(moving_on, np.zeros(4), 3.0)
    assert waited.margin(fence) == pytest.approx(0.02)
    assert flown.margin(fence) == pytest.approx(0.05 + 0.3)
