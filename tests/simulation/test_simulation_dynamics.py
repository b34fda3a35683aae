import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.geometry import rot_z, tilt
from noctule.simulation import dynamics
from noctule.simulation.dynamics import (
    GRAVITY,
    STEP,
    STEPS_PER_SECOND,
    FirstOrderModel,
    IdentifiedModel,
    Motion,
    UnknownModelError,
    advance,
    fall,
    make_model,
)
from noctule.simulation.spec import LimitsSpec, VehicleSpec

CALM = (0.0, 0.0, 0.0)
TABLE_1 = (4.7202, 0.2660, 6.2330, 0.5328, 2.6504, 2.5761, 2.3788, 1.5216)
FREE = LimitsSpec(acceleration=10.0, yaw_acceleration=50.0)
MODELS = ("first_order", "identified")
speed = st.floats(-0.5, 0.5)


def run(spec: VehicleSpec, command: tuple, seconds: float, motion: Motion | None = None) -> Motion:
    motion = motion or Motion(0.0, 0.0, 1.0, 0.0)
    model = make_model(spec)
    for _ in range(round(seconds * STEPS_PER_SECOND)):
        advance(motion, model, spec, command, CALM)
    return motion


def test_the_first_order_model_covers_63_percent_in_one_lag() -> None:
    motion = run(VehicleSpec(lag=0.3, limits=FREE), (0.5, 0.0, 0.0, 0.5), 0.3)
    assert motion.heading_velocity()[3] == pytest.approx(0.5 * (1 - math.exp(-1)), rel=0.01)
    straight = run(VehicleSpec(lag=0.3, limits=FREE), (0.5, -0.2, 0.1, 0.0), 0.3)
    expected = (1 - math.exp(-1)) * np.array([0.5, -0.2, 0.1])
    assert np.allclose([straight.vx, straight.vy, straight.vz], expected, rtol=0.01)


def test_the_identified_model_is_equation_2_with_table_1() -> None:
    model = make_model(VehicleSpec(model="identified"))
    assert isinstance(model, IdentifiedModel)
    assert model.input_gains == TABLE_1[0::2]
    assert model.drags == TABLE_1[1::2]
    velocity, command = (0.3, -0.2, 0.1, 0.4), (0.1, 0.1, -0.1, 0.0)
    u = np.array(model.inputs(velocity, command))
    expected = np.array(TABLE_1[0::2]) * u - np.array(TABLE_1[1::2]) * np.array(velocity)
    assert np.allclose(model.acceleration(velocity, command), expected)


@given(st.tuples(*[st.floats(-5, 5)] * 4), st.tuples(*[st.floats(-5, 5)] * 4))
def test_the_inputs_of_the_identified_model_stay_within_one(velocity: tuple, command: tuple) -> None:
    model = IdentifiedModel(TABLE_1[0::2], TABLE_1[1::2], 0.3)
    assert all(-1.0 <= u <= 1.0 for u in model.inputs(velocity, command))


@pytest.mark.parametrize("model", MODELS)
def test_a_model_settles_on_the_command(model: str) -> None:
    command = (0.4, -0.3, 0.2, 0.0)
    motion = run(VehicleSpec(model=model), command, 4.0)
    assert np.allclose(motion.heading_velocity(), command, atol=1e-3)


@pytest.mark.parametrize("model", MODELS)
def test_a_turning_vehicle_keeps_its_heading_velocity_close(model: str) -> None:
    # The acceleration is the world's, resolved on body axes: a turn makes the velocity lag in direction.
    command = (0.5, 0.0, 0.0, 0.5)
    motion = run(VehicleSpec(model=model), command, 6.0)
    forward, left, _, _ = motion.heading_velocity()
    gain = 1.0 / 0.3 if model == "first_order" else None
    if gain is not None:
        # Steady state of v' = gain (v_c - v) seen from axes that turn at w: (gain + i w) v = gain v_c.
        v = gain * 0.5 / complex(gain, 0.5)
        assert forward == pytest.approx(v.real, abs=2e-3)
        assert left == pytest.approx(v.imag, abs=2e-3)
    else:
        assert left < 0.0 < forward


@pytest.mark.parametrize("model", MODELS)
@given(command=st.tuples(speed, speed, speed, speed), yaw=st.floats(-3.0, 3.0))
@settings(max_examples=20, deadline=None)
def test_the_acceleration_limit_holds_at_every_step(model: str, command: tuple, yaw: float) -> None:
    spec = VehicleSpec(model=model, limits=LimitsSpec(acceleration=0.7, yaw_acceleration=1.1))
    motion, law = Motion(0.0, 0.0, 1.0, yaw), make_model(spec)
    for _ in range(60):
        before = np.array([motion.vx, motion.vy, motion.vz]), motion.yaw_rate
        advance(motion, law, spec, command, CALM)
        change = np.array([motion.vx, motion.vy, motion.vz]) - before[0]
        assert np.linalg.norm(change) <= 0.7 * STEP + 1e-12
        assert abs(motion.yaw_rate - before[1]) <= 1.1 * STEP + 1e-12


@given(yaw=st.floats(-3.1, 3.1), forward=st.floats(-0.6, 0.6), left=st.floats(-0.6, 0.6))
@settings(max_examples=25, deadline=None)
def test_the_flight_does_not_depend_on_the_heading(yaw: float, forward: float, left: float) -> None:
    spec = VehicleSpec()
    along_x = run(spec, (forward, left, 0.1, 0.2), 0.5)
    turned = run(spec, (forward, left, 0.1, 0.2), 0.5, Motion(0.0, 0.0, 1.0, yaw))
    expected = rot_z(yaw) @ np.array([along_x.x, along_x.y, along_x.z])
    assert np.allclose([turned.x, turned.y, turned.z], expected, atol=1e-9)
    assert (turned.roll, turned.pitch) == pytest.approx((along_x.roll, along_x.pitch), abs=1e-9)


def test_the_tilt_gives_the_thrust_that_the_acceleration_needs() -> None:
    # A long lag makes a nearly constant acceleration, to which roll and pitch settle.
    spec = VehicleSpec(lag=5.0, tilt_lag=0.02)
    motion = run(spec, (0.6, -0.4, 0.2, 0.0), 0.3)
    wanted = (np.array([0.6, -0.4, 0.2]) - np.array([motion.vx, motion.vy, motion.vz])) / 5.0
    thrust = tilt(motion.roll, motion.pitch)[:, 2]
    force = wanted + np.array([0.0, 0.0, GRAVITY])
    assert np.allclose(thrust, force / np.linalg.norm(force), atol=2e-4)
    assert motion.pitch > 0.0
    assert motion.roll > 0.0


def test_the_tilt_lags_behind_the_acceleration() -> None:
    spec = VehicleSpec(tilt_lag=0.1)
    early = run(spec, (0.6, 0.0, 0.0, 0.0), 0.02).pitch
    late = run(spec, (0.6, 0.0, 0.0, 0.0), 0.2).pitch
    assert 0.0 < early < 0.35 * late


def test_a_hovering_vehicle_is_level_and_still() -> None:
    motion = run(VehicleSpec(), (0.0, 0.0, 0.0, 0.0), 1.0)
    assert motion == Motion(0.0, 0.0, 1.0, 0.0)


def test_a_gust_pushes_and_the_vehicle_leans_against_it() -> None:
    spec, motion = VehicleSpec(), Motion(0.0, 0.0, 1.0, 0.0)
    model = make_model(spec)
    for _ in range(600):
        advance(motion, model, spec, (0.0, 0.0, 0.0, 0.0), (0.4, 0.0, 0.0))
    # At rest under a steady push the loop leaves push times lag as velocity and leans by the push.
    assert motion.vx == pytest.approx(0.4 * 0.3, rel=0.01)
    assert motion.pitch == pytest.approx(math.atan2(-0.4, GRAVITY), rel=0.01)


def test_a_vehicle_without_motors_falls_and_stays_on_the_floor() -> None:
    motion = Motion(0.0, 0.0, 1.0, 0.3, vx=0.5, roll=0.1)
    for _ in range(60):
        fall(motion, 0.06)
    assert motion.vz == pytest.approx(-GRAVITY * 60 * STEP)
    assert motion.z == pytest.approx(1.0 - 0.5 * GRAVITY * 0.2**2, abs=0.01)
    for _ in range(300):
        fall(motion, 0.06)
    assert motion.z == 0.06
    assert (motion.vx, motion.vz, motion.roll) == (0.0, 0.0, 0.0)


def test_an_unknown_model_is_named_with_the_known_ones() -> None:
    with pytest.raises(UnknownModelError) as caught:
        make_model(VehicleSpec(model="first_oder"))
    assert str(caught.value) == (
        "vehicle model 'first_oder' is not known; did you mean first_order?; "
        "a package adds one as an entry point of the group 'noctule.vehicle_models'"
    )


def test_an_unknown_model_that_is_like_none_is_told_them_all() -> None:
    with pytest.raises(
        UnknownModelError, match="'zeppelin' is not known; expected one of: first_order, identified; "
    ):
        make_model(VehicleSpec(model="zeppelin"))


def test_a_package_adds_a_model_as_an_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    class Point:
        name = "sluggish"

        def load(self) -> object:
            return lambda spec: FirstOrderModel(10.0 * spec.lag)

    monkeypatch.setattr(dynamics, "entry_points", lambda group: [Point()])
    assert make_model(VehicleSpec(model="sluggish", lag=0.2)) == FirstOrderModel(2.0)
