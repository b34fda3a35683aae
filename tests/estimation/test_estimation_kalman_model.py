"""The vehicle model of the filter: equation (2), its Jacobian, its noise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.estimation.filter_state import (
    FilterError,
    Prior,
    StateEstimate,
    start_at,
    state_names,
    state_size,
)
from noctule.estimation.vehicle_model import (
    TABLE_1,
    ProcessNoise,
    VehicleModel,
    axis_step,
    process_covariance,
    transition,
)
from noctule.geometry import rot_z

MODEL = VehicleModel.identified()
U = np.array([0.2, -0.1, 0.3, 0.4])
X = np.array([0.4, -0.2, 1.1, 0.7, 0.5, -0.3, 0.1, 0.6, 0.05, 0.02, -0.03])
numbers = st.floats(-1.5, 1.5)


def integrated(x, u, model, seconds, steps=4000):
    """Integrate the continuous equation (2) with the midpoint rule: yaw moves while the vehicle does."""

    def rate(x):
        R = rot_z(x[3])
        body = np.append(R.T @ x[4:7], x[7])
        a = model.input_gains * u - model.drags * body
        return np.concatenate([x[4:8], R @ a[:3], a[3:], np.zeros(x.size - 8)])

    dt = seconds / steps
    for _ in range(steps):
        x = x + dt * rate(x + 0.5 * dt * rate(x))
    return x


def noise_by_van_loan(drags, densities, dt):
    """Return Q of the eight moving numbers at yaw 0 from one matrix exponential, by its power series."""
    A = np.zeros((8, 8))
    A[:4, 4:] = np.eye(4)
    A[4:, 4:] = -np.diag(drags)
    q = np.zeros((8, 8))
    q[range(4, 8), range(4, 8)] = densities[[0, 0, 1, 2]]
    M = np.block([[-A, q], [np.zeros((8, 8)), A.T]]) * dt
    E, term = np.eye(16), np.eye(16)
    for k in range(1, 40):
        term = term @ M / k
        E = E + term
    return E[8:, 8:].T @ E[:8, 8:]


def test_the_model_holds_table_1_axis_by_axis():
    assert np.array_equal(MODEL.input_gains, TABLE_1[0::2])
    assert np.array_equal(MODEL.drags, TABLE_1[1::2])


def test_a_step_of_a_camera_period_follows_the_continuous_equation():
    x1, _ = transition(X, 1 / 30, U, MODEL.input_gains, MODEL.drags)
    assert np.allclose(x1, integrated(X, U, MODEL, 1 / 30), atol=2e-6)


def test_a_step_without_turning_is_exact_however_long():
    u, x = U * [1, 1, 1, 0], X * (np.arange(11) != 7)
    x1, _ = transition(x, 0.7, u, MODEL.input_gains, MODEL.drags)
    assert np.allclose(x1, integrated(x, u, MODEL, 0.7), atol=1e-7)


def test_without_a_known_command_the_velocity_stays():
    nothing = np.zeros(4)
    x1, _ = transition(X, 0.5, nothing, nothing, nothing)
    assert np.allclose(x1[:4], X[:4] + 0.5 * X[4:8], atol=1e-15)
    assert np.allclose(x1[4:], X[4:], atol=1e-15)


def test_a_velocity_loop_settles_at_the_velocity_asked_for():
    model = VehicleModel.velocity_loop(0.3)
    x1, _ = transition(np.zeros(8), 5.0, np.array([0.4, -0.1, 0.2, 0.0]), model.input_gains, model.drags)
    assert np.allclose(x1[4:7], [0.4, -0.1, 0.2], atol=1e-6)
    assert x1[0] == pytest.approx(0.4 * (5.0 - 0.3), abs=1e-6)


@settings(deadline=None)
@given(st.lists(numbers, min_size=11, max_size=11), st.floats(0.001, 0.3))
def test_the_jacobian_is_that_of_finite_differences(values, dt):
    x = np.array(values)
    _, F = transition(x, dt, U, MODEL.input_gains, MODEL.drags)
    for j in range(11):
        d = 1e-6 * (np.arange(11) == j)
        up, _ = transition(x + d, dt, U, MODEL.input_gains, MODEL.drags)
        down, _ = transition(x - d, dt, U, MODEL.input_gains, MODEL.drags)
        assert np.allclose(F[:, j], (up - down) / 2e-6, atol=1e-7)


@pytest.mark.parametrize("dt", [1e-4, 0.01, 0.05, 0.3])
def test_the_process_noise_is_that_of_van_loan(dt):
    densities = np.array([0.02, 0.01, 0.03, 1e-5, 1e-5])
    Q = process_covariance(0.0, dt, MODEL.drags, densities, 8)
    expected = noise_by_van_loan(MODEL.drags, densities, dt)
    assert np.allclose(Q, expected, rtol=1e-8, atol=1e-18)


def test_the_process_noise_turns_with_the_vehicle():
    densities = ProcessNoise().densities
    straight = process_covariance(0.0, 0.2, MODEL.drags, densities, 8)
    turned = process_covariance(0.8, 0.2, MODEL.drags, densities, 8)
    T = np.kron(np.eye(2), np.block([[rot_z(0.8), np.zeros((3, 1))], [np.zeros((1, 3)), np.eye(1)]]))
    assert np.allclose(turned, T @ straight @ T.T, atol=1e-15)
    assert np.array_equal(turned, turned.T)


def test_the_noise_of_two_half_steps_is_that_of_the_whole():
    densities, x = ProcessNoise().densities, X * (np.arange(11) != 7)
    u = U * [1, 1, 1, 0]
    half = process_covariance(x[3], 0.1, MODEL.drags, densities, 11)
    whole = process_covariance(x[3], 0.2, MODEL.drags, densities, 11)
    x_half, F = transition(x, 0.1, u, MODEL.input_gains, MODEL.drags)
    x_whole, _ = transition(x, 0.2, u, MODEL.input_gains, MODEL.drags)
    _, F2 = transition(x_half, 0.1, u, MODEL.input_gains, MODEL.drags)
    two = F2[np.ix_(range(8), range(8))] @ half[:8, :8] @ F2[np.ix_(range(8), range(8))].T + half[:8, :8]
    # The yaw column of F carries the turn's noise into the direction of flight, which Q leaves out.
    moving = [0, 1, 2, 4, 5, 6]
    assert np.allclose(two[np.ix_(moving, moving)], whole[np.ix_(moving, moving)], rtol=1e-3, atol=1e-7)
    assert np.allclose(transition(x_half, 0.1, u, MODEL.input_gains, MODEL.drags)[0], x_whole, atol=1e-14)
    assert F.shape == (11, 11)


@settings(deadline=None)
@given(st.floats(1e-12, 50.0), st.floats(1e-5, 0.4))
def test_series_and_closed_form_meet(k, dt):
    below, above = axis_step(0.4999999999 / dt, dt), axis_step(0.5 / dt, dt)
    assert np.allclose(below, above, rtol=1e-8)
    e, g, h, pp, pv, vv = axis_step(k, dt)
    assert e > 0.0 < g <= dt * (1 + 1e-12)
    assert 0.0 < h <= 0.5 * dt * dt * (1 + 1e-12)
    assert pp * vv - pv * pv > 0.0


@pytest.mark.parametrize(("heading", "velocity", "size"), [(0, 0, 8), (1, 0, 9), (0, 1, 10), (1, 1, 11)])
def test_the_size_says_which_biases_there_are(heading, velocity, size):
    assert state_size(bool(heading), bool(velocity)) == size
    names = state_names(size)
    assert len(names) == size
    assert ("heading_bias" in names) == bool(heading)
    assert ("left_bias" in names) == bool(velocity)
    densities = np.array([1.0, 1.0, 1.0, 2.0, 3.0])
    Q = process_covariance(0.0, 0.5, MODEL.drags, densities, size)
    expected = [1.0] * heading + [1.5, 1.5] * velocity
    assert np.diag(Q)[8:].tolist() == expected


def test_a_start_is_at_rest_with_the_deviations_of_the_prior():
    start = start_at(2.0, np.array([1.0, 2.0, 3.0]), 4.0, Prior(position=0.1, yaw=0.2), 9)
    assert start.position.tolist() == [1.0, 2.0, 3.0]
    assert start.yaw == pytest.approx(4.0 - 2 * np.pi)
    assert not start.v_world.any()
    assert start.yaw_rate == 0.0
    assert start.sd[:4] == pytest.approx([0.1, 0.1, 0.1, 0.2])
    assert isinstance(start, StateEstimate)


def test_a_state_of_seven_numbers_is_refused():
    with pytest.raises(FilterError) as told:
        start_at(0.0, np.zeros(3), 0.0, size=7)
    assert str(told.value) == "state of 7 numbers; expected 8, 9, 10 or 11: choose which biases it keeps"


def test_a_start_that_is_nowhere_is_refused():
    with pytest.raises(FilterError) as told:
        start_at(0.0, np.array([np.nan, 0.0, 0.0]), 0.0)
    assert str(told.value) == (
        "start at position [nan, 0.0, 0.0] m, yaw 0 rad with deviations from 0.05 to 1; "
        "expected finite numbers and deviations above 0"
    )


def test_a_model_of_three_axes_is_refused():
    with pytest.raises(FilterError) as told:
        VehicleModel(np.ones(3), np.ones(4))
    assert str(told.value) == ("vehicle model: input gains (3,) and drags (4,); expected (4,) and (4,)")


def test_a_model_that_speeds_up_by_itself_is_refused():
    with pytest.raises(FilterError) as told:
        VehicleModel(np.ones(4), np.array([1.0, -0.5, 1.0, 1.0]), 0.02)
    assert str(told.value) == (
        "vehicle model: drags [1.0, -0.5, 1.0, 1.0] 1/s, delay 0.02 s; "
        "expected finite numbers, none below 0: identify the vehicle again"
    )
