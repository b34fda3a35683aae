import math

import numpy as np
import pytest

from noctule.devices.protocols import DeviceError
from noctule.geometry import Pose
from noctule.messages import Command, FlightState
from noctule.simulation.aircraft import Aircraft
from noctule.simulation.dynamics import STEPS_PER_SECOND, Motion
from noctule.simulation.sensors import StateSensors
from noctule.simulation.spec import VehicleSpec
from noctule.simulation.vehicle import SimulatedVehicle


def aircraft(flying: bool = True, seed: int = 0, **spec: float) -> Aircraft:
    start = Pose(np.array([0.0, 0.0, 1.0]), 0.0)
    return Aircraft(VehicleSpec(**spec), start, flying, tuple(np.random.SeedSequence(seed).spawn(2)))


def steps(craft: Aircraft, seconds: float) -> None:
    for _ in range(round(seconds * STEPS_PER_SECOND)):
        craft.step()


def test_a_flight_may_begin_in_hover() -> None:
    craft = aircraft()
    steps(craft, 5.0)
    assert craft.flight_state is FlightState.FLYING
    assert np.allclose(craft.pose.position, [0.0, 0.0, 1.0])


def test_a_flight_may_begin_on_the_floor_whatever_the_start_height() -> None:
    craft = aircraft(flying=False)
    assert craft.flight_state is FlightState.LANDED
    assert craft.pose.position[2] == pytest.approx(0.06)


def test_the_command_takes_effect_after_its_latency() -> None:
    craft = aircraft(command_latency=0.1)
    craft.send(Command(forward=0.5), 1.0)
    steps(craft, 0.1)
    assert craft.motion.vx == 0.0
    steps(craft, 1.0 / STEPS_PER_SECOND)
    assert craft.motion.vx > 0.0


def test_a_newer_command_replaces_an_older_one() -> None:
    craft = aircraft()
    craft.send(Command(forward=0.5), 5.0)
    craft.send(Command(left=0.5), 5.0)
    steps(craft, 2.0)
    assert craft.motion.vx == 0.0
    assert craft.motion.vy == pytest.approx(0.5, abs=0.01)


def test_a_command_lives_exactly_as_long_as_it_is_valid() -> None:
    craft = aircraft()
    craft.send(Command(forward=0.5), 0.5)
    steps(craft, 0.5)
    at_expiry = craft.motion.vx
    steps(craft, 1.0 / STEPS_PER_SECOND)
    assert craft.motion.vx < at_expiry


def test_an_expired_command_hovers_for_the_grace_and_then_lands() -> None:
    craft = aircraft(land_after=1.0)
    craft.send(Command(forward=0.3), 0.2)
    steps(craft, 1.15)
    assert craft.flight_state is FlightState.FLYING
    assert abs(craft.motion.vx) < 0.03
    steps(craft, 0.1)
    assert craft.flight_state is FlightState.LANDING
    steps(craft, 6.0)
    assert craft.flight_state is FlightState.LANDED


def test_a_vehicle_that_was_never_commanded_hovers_on() -> None:
    craft = aircraft(land_after=0.5)
    steps(craft, 10.0)
    assert craft.flight_state is FlightState.FLYING


def test_limits_cut_each_axis_by_itself() -> None:
    sent = aircraft().send(Command(0.7, -0.1, -0.9, 0.1), 0.2)
    assert sent == Command(0.6, -0.1, -0.5, 0.1)


def test_the_refusals_say_what_to_do() -> None:
    craft = aircraft(flying=False)
    with pytest.raises(DeviceError) as caught:
        craft.takeoff(1.0)
    assert str(caught.value) == (
        "simulated vehicle: cannot take off, it is not armed; expected landed and armed: call arm() first"
    )
    craft.arm()
    with pytest.raises(DeviceError) as caught:
        craft.takeoff(0.01)
    assert str(caught.value) == "simulated vehicle: cannot take off to 0.01 m; expected more than 0.06 m"
    with pytest.raises(DeviceError) as caught:
        craft.send(Command(math.nan), 0.2)
    assert str(caught.value) == (
        "simulated vehicle: command (nan, 0.0, 0.0, 0.0) for 0.2 s; "
        "expected finite numbers and a time above 0"
    )
    flying = aircraft()
    flying.emergency()
    with pytest.raises(DeviceError) as caught:
        flying.arm()
    assert str(caught.value) == (
        "simulated vehicle: cannot arm while it falls, height 1.00 m; wait until it lies on the floor"
    )
    with pytest.raises(DeviceError) as caught:
        SimulatedVehicle(flying, connected=False).state()
    assert str(caught.value) == (
        "simulated vehicle: not connected; call connect() first, or use it in a with block"
    )


def test_arming_on_the_floor_resets_an_emergency() -> None:
    craft = aircraft()
    craft.emergency()
    steps(craft, 2.0)
    craft.arm()
    assert craft.flight_state is FlightState.LANDED
    craft.takeoff(0.8)
    steps(craft, 6.0)
    assert craft.flight_state is FlightState.FLYING
    assert craft.motion.z == pytest.approx(0.8, abs=0.03)


def test_landing_disarms() -> None:
    craft = aircraft()
    craft.land()
    steps(craft, 6.0)
    with pytest.raises(DeviceError):
        craft.takeoff(1.0)


def test_a_command_cannot_push_through_the_floor() -> None:
    craft = aircraft()
    for _ in range(100):
        craft.send(Command(up=-0.5), 0.2)
        steps(craft, 0.05)
        assert craft.motion.z >= 0.06
    assert craft.flight_state is FlightState.FLYING


def test_gusts_move_the_vehicle_by_as_much_as_their_strength_says() -> None:
    craft = aircraft(gusts=1.0)
    velocities = []
    for _ in range(60 * STEPS_PER_SECOND):
        craft.step()
        velocities.append(craft.motion.vx)
    # White noise of sd 1 held for a step, through a lag of 0.3 s: variance dt lag / 2.
    expected = math.sqrt(0.3 / (2.0 * STEPS_PER_SECOND))
    assert np.std(velocities) == pytest.approx(expected, rel=0.2)


def test_gusts_do_not_depend_on_what_is_flown() -> None:
    idle, busy = aircraft(gusts=1.0), aircraft(gusts=1.0)
    busy.send(Command(up=0.2), 100.0)
    steps(idle, 3.0)
    steps(busy, 3.0)
    assert idle.motion.vx == pytest.approx(busy.motion.vx, abs=1e-12)
    assert idle.motion.z != busy.motion.z


def test_the_same_seed_gives_the_same_flight_and_another_seed_another() -> None:
    ends = []
    for seed in (1, 1, 2):
        craft = aircraft(gusts=1.0, seed=seed, attitude_sd=0.01)
        craft.send(Command(forward=0.2), 10.0)
        steps(craft, 2.0)
        ends.append((craft.motion, craft.report().roll))
    assert ends[0] == ends[1]
    assert ends[0] != ends[2]


def reports(motion: Motion, count: int, seed: int = 0, **spec: float) -> list:
    sensors = StateSensors(VehicleSpec(**spec), np.random.SeedSequence(seed))
    return [sensors.report(motion, k / 30.0, FlightState.FLYING) for k in range(count)]


def test_the_attitude_error_has_the_promised_spread_and_a_bias() -> None:
    motion, sd = Motion(0.0, 0.0, 1.0, 0.0, roll=0.1, pitch=-0.2), 0.02
    starts = [reports(motion, 1, seed, attitude_sd=sd)[0] for seed in range(400)]
    first = np.array([(r.roll - 0.1, r.pitch + 0.2) for r in starts])
    assert np.std(first) == pytest.approx(sd, rel=0.1)
    assert abs(np.mean(first)) < 0.15 * sd
    # Over a long flight the slow part wanders with half the variance around a bias that stays.
    long = np.array([[r.roll for r in reports(motion, 9000, s, attitude_sd=sd)] for s in range(4)])
    assert np.mean(np.std(long, axis=1)) == pytest.approx(sd / math.sqrt(2.0), rel=0.3)


def test_without_attitude_error_the_attitude_is_exact() -> None:
    state = reports(Motion(0.0, 0.0, 1.0, 0.0, roll=0.1, pitch=-0.2), 3)[-1]
    assert (state.roll, state.pitch) == (0.1, -0.2)


def test_velocity_is_reported_in_the_heading_frame_with_bias_and_noise() -> None:
    motion = Motion(0.0, 0.0, 1.0, math.pi / 2.0, vy=0.4)
    exact = reports(motion, 1, velocity_noise=0.0, velocity_bias=0.0)[0]
    assert np.allclose(exact.v_body, [0.4, 0.0, 0.0])
    noisy = np.array([r.v_body for r in reports(motion, 2000, velocity_noise=0.05, velocity_bias=0.0)])
    assert np.allclose(noisy.std(axis=0), 0.05, rtol=0.1)
    biased = reports(motion, 2, velocity_noise=0.0, velocity_bias=0.1)
    assert np.array_equal(biased[0].v_body, biased[1].v_body)
    assert not np.allclose(biased[0].v_body, [0.4, 0.0, 0.0], atol=1e-3)


def test_reported_yaw_drifts_and_stays_wrapped() -> None:
    states = reports(Motion(0.0, 0.0, 1.0, 3.1), 3000, yaw_drift=0.02)
    yaws = np.array([s.yaw for s in states])
    assert np.all((yaws > -math.pi) & (yaws <= math.pi))
    assert abs(np.unwrap(yaws)[-1] - 3.1) > 0.01


def test_the_state_is_reported_at_its_rate() -> None:
    craft = aircraft(report_rate=30.0)
    stamps = set()
    for _ in range(STEPS_PER_SECOND):
        craft.step()
        stamps.add(craft.report().stamp)
    assert len(stamps) in (30, 31)
    assert craft.report().stamp == pytest.approx(1.0)
