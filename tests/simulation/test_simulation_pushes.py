"""Pushes, and the onboard loop that believes what the vehicle measures."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from noctule.geometry import Pose
from noctule.messages import Command, FlightState
from noctule.simulation import NavdataSpec, PushSpec, VehicleSpec, WorldSpec, world_from_toml
from noctule.simulation.aircraft import Aircraft
from noctule.simulation.dynamics import STEP, STEPS_PER_SECOND

BIASED = NavdataSpec(velocity_bias=0.05, wander_time=3600.0)
HARD = PushSpec(time_s=1.0, acceleration_m_s2=(4.5, 0.0, 0.0), yaw_rad_s2=3.0)


def aircraft(seed: int = 0, flying: bool = True, yaw: float = 0.0, **spec: object) -> Aircraft:
    start = Pose(np.array([0.0, 0.0, 1.0]), yaw)
    return Aircraft(VehicleSpec(**spec), start, flying, tuple(np.random.SeedSequence(seed).spawn(2)))


def steps(craft: Aircraft, seconds: float) -> None:
    for _ in range(round(seconds * STEPS_PER_SECOND)):
        craft.step()


def velocity(craft: Aircraft) -> np.ndarray:
    return np.array([craft.motion.vx, craft.motion.vy, craft.motion.vz, craft.motion.yaw_rate])


def test_a_push_begins_at_its_time() -> None:
    craft = aircraft(pushes=(HARD,))
    steps(craft, 1.0)
    assert not velocity(craft).any()
    craft.step()
    np.testing.assert_allclose(velocity(craft), [4.5 * STEP, 0.0, 0.0, 3.0 * STEP])


def test_a_push_lasts_its_seconds_and_then_the_loop_takes_its_speed_away() -> None:
    craft = aircraft(pushes=(HARD,))
    steps(craft, 1.2)
    # a = push - v / lag, v = push lag (1 - exp(-t / lag)), until the autopilot is at its limit of 1 m/s^2.
    assert 0.7 < craft.motion.vx < 0.9
    assert craft.motion.yaw_rate == pytest.approx(3.0 * 0.3 * (1.0 - math.exp(-0.2 / 0.3)), rel=0.05)
    fastest = craft.motion.vx
    craft.step()
    assert craft.motion.vx < fastest
    steps(craft, 5.0)
    assert np.abs(velocity(craft)).max() < 1e-3


def test_a_push_is_in_world_axes_whatever_the_heading() -> None:
    craft = aircraft(yaw=2.0, pushes=(PushSpec(time_s=0.0, acceleration_m_s2=(0.0, 2.0, 1.0)),))
    craft.step()
    np.testing.assert_allclose(velocity(craft), [0.0, 2.0 * STEP, STEP, 0.0], atol=1e-15)


def test_the_autopilots_limit_does_not_hold_a_push_back() -> None:
    craft = aircraft(pushes=(PushSpec(time_s=0.0, acceleration_m_s2=(20.0, 0.0, 0.0)),))
    steps(craft, 0.2)
    assert craft.motion.vx > 0.2 * (20.0 - 1.0) - 1e-9


def test_pushes_that_overlap_add_up() -> None:
    half = PushSpec(time_s=0.1, acceleration_m_s2=(1.0, -0.5, 0.25), yaw_rad_s2=0.5)
    whole = PushSpec(time_s=0.1, acceleration_m_s2=(2.0, -1.0, 0.5), yaw_rad_s2=1.0)
    twice, once = aircraft(pushes=(half, half)), aircraft(pushes=(whole,))
    steps(twice, 0.5)
    steps(once, 0.5)
    np.testing.assert_allclose(velocity(twice), velocity(once), atol=1e-12)
    assert velocity(once)[0] > 0.1


def test_a_push_shorter_than_a_step_is_one_step_long() -> None:
    craft = aircraft(pushes=(PushSpec(time_s=0.0, seconds=0.0001, acceleration_m_s2=(3.0, 0.0, 0.0)),))
    craft.step()
    fastest = craft.motion.vx
    craft.step()
    assert fastest == pytest.approx(3.0 * STEP)
    assert craft.motion.vx < fastest


def test_a_vehicle_on_the_floor_is_not_pushed() -> None:
    craft = aircraft(flying=False, pushes=(HARD,))
    steps(craft, 2.0)
    assert not velocity(craft).any()


@settings(max_examples=10, deadline=None)
@given(when=st.floats(0.1, 0.8))
def test_until_it_is_pushed_a_flight_is_the_same_bit_for_bit(when: float) -> None:
    push = PushSpec(time_s=when, acceleration_m_s2=(1.0, 1.0, 1.0))
    plain, pushed = aircraft(gusts=0.6), aircraft(gusts=0.6, pushes=(push,))
    for craft in (plain, pushed):
        craft.send(Command(0.3, -0.1, 0.05, 0.2), 5.0)
        for _ in range(round(when * STEPS_PER_SECOND)):
            craft.step()
    assert plain.motion == pushed.motion
    plain.step()
    pushed.step()
    assert plain.motion != pushed.motion


def test_pushes_are_read_from_a_world_file() -> None:
    text = "[[vehicle.pushes]]\ntime_s = 43.0\nacceleration_m_s2 = [4.5, 0.0, -1.0]\n"
    (push,) = world_from_toml(text).vehicle.pushes
    assert push == PushSpec(time_s=43.0, seconds=0.2, acceleration_m_s2=(4.5, 0.0, -1.0), yaw_rad_s2=0.0)
    spec = WorldSpec(vehicle=VehicleSpec(pushes=(push,)))
    assert WorldSpec.model_validate_json(spec.model_dump_json()) == spec


@pytest.mark.parametrize(
    "wrong", [{"time_s": -1.0}, {"seconds": 0.0}, {"acceleration_m_s2": (60.0, 0.0, 0.0)}]
)
def test_pushes_beyond_reason_are_refused(wrong: dict) -> None:
    with pytest.raises(ValidationError):
        PushSpec.model_validate({"time_s": 1.0, "acceleration_m_s2": (1.0, 0.0, 0.0), **wrong})


def test_the_loop_holds_the_velocity_that_the_vehicle_measures() -> None:
    craft = aircraft(navdata=BIASED)
    craft.send(Command(0.2, 0.0, 0.0, 0.0), 100.0)
    steps(craft, 5.0)
    assert craft.navdata is not None
    bias = craft.navdata.velocity_bias
    assert np.abs(bias).max() > 0.01
    np.testing.assert_allclose(velocity(craft)[:3] + bias, [0.2, 0.0, 0.0], atol=2e-3)


def test_the_bias_turns_with_the_vehicle() -> None:
    craft = aircraft(navdata=BIASED, yaw=math.pi / 2.0)
    craft.send(Command(), 100.0)
    steps(craft, 5.0)
    assert craft.navdata is not None
    forward, left, _ = craft.navdata.velocity_bias
    np.testing.assert_allclose(velocity(craft)[:2], [left, -forward], atol=2e-3)


def test_the_identified_vehicle_drifts_by_its_loops_share_of_the_response() -> None:
    craft = aircraft(model="identified", navdata=BIASED)
    craft.send(Command(), 100.0)
    steps(craft, 10.0)
    assert craft.navdata is not None
    drags = np.array(craft.spec.k[1:6:2])
    share = 1.0 - craft.spec.lag * drags
    np.testing.assert_allclose(velocity(craft)[:3], -share * craft.navdata.velocity_bias, atol=2e-3)


def test_a_vehicle_may_be_asked_to_know_its_velocity() -> None:
    plain = aircraft(gusts=0.5)
    sure = aircraft(gusts=0.5, navdata=BIASED, loop_on_measured=False)
    unsure = aircraft(gusts=0.5, navdata=BIASED)
    for craft in (plain, sure, unsure):
        steps(craft, 1.0)
    assert plain.motion == sure.motion != unsure.motion


def test_without_a_loop_of_its_own_a_vehicle_does_not_care_what_it_measures() -> None:
    motions = []
    for loop in (True, False):
        # Drag alone is quicker than this lag.
        craft = aircraft(model="identified", lag=5.0, gusts=0.6, navdata=BIASED, loop_on_measured=loop)
        craft.send(Command(0.5, -0.3, 0.1, 0.2), 100.0)
        steps(craft, 3.0)
        motions.append(craft.motion)
    assert motions[0] == motions[1]


@pytest.mark.parametrize("model", ["first_order", "identified"])
@pytest.mark.parametrize("seed", range(4))
def test_a_vehicle_with_a_bad_bias_takes_off_to_its_height_and_lands(model: str, seed: int) -> None:
    bad = NavdataSpec(velocity_bias=0.15)
    craft = aircraft(seed, flying=False, model=model, navdata=bad, gusts=0.3, lag=0.3)
    assert craft.report().flight_state is FlightState.LANDED
    assert craft.report().height == pytest.approx(0.06, abs=0.08)
    craft.arm()
    craft.takeoff(1.2)
    steps(craft, 0.5)
    assert craft.report().flight_state is FlightState.TAKING_OFF
    for _ in range(10 * STEPS_PER_SECOND):
        craft.step()
        if craft.flight_state is FlightState.FLYING:
            break
    assert craft.report().flight_state is FlightState.FLYING
    assert craft.motion.z == pytest.approx(1.2, abs=0.03)
    craft.land()
    steps(craft, 12.0)
    assert craft.report().flight_state is FlightState.LANDED
    assert craft.report().height == pytest.approx(0.06, abs=0.08)
    assert not velocity(craft).any()
