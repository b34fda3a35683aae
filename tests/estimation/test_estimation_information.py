"""The information filter is proved by equality with the Kalman filter."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.estimation.filter_state import StateEstimate, start_at
from noctule.estimation.information_filter import (
    InformationState,
    assimilate,
    assimilate_turned,
    contribution,
    information_predict,
    turned,
)
from noctule.estimation.kalman_filter import correct, predict
from noctule.estimation.measurements import linearise
from noctule.estimation.network_study import PRIOR, made_up_flight
from noctule.estimation.vehicle_model import ProcessNoise, VehicleModel

MODEL, NOISE = VehicleModel.identified(), ProcessNoise()
PARAMETERS = (MODEL.input_gains, MODEL.drags, NOISE.densities)


def random_spd(rng, n):
    A = rng.normal(size=(n, n))
    return A @ A.T + np.diag(10.0 ** rng.uniform(-2.0, 0.0, n))


@pytest.mark.parametrize("n", [8, 9, 10, 11])
def test_the_information_filter_equals_the_kalman_filter_through_a_flight(n):
    flight = made_up_flight(600, 3, MODEL, NOISE, n)
    x, P, now = flight.start.x, flight.start.P, 0.0
    information = InformationState.of(flight.start)
    y, Y = information.y, information.Y
    rng = np.random.default_rng(0)
    for z in flight.measurements:
        u = rng.uniform(-0.1, 0.1, 4)
        x, P = predict(x, P, z.stamp - now, u, *PARAMETERS)
        y, Y = information_predict(y, Y, z.stamp - now, u, *PARAMETERS)
        now = z.stamp
        residual, H = linearise(x, z.components, z.z)
        i, I = contribution(x, residual, H, z.R)  # noqa: E741
        x, P = correct(x, P, residual, H, z.R)
        y, Y = y + i, Y + I
        same = InformationState(now, y, Y).estimate
        assert np.abs(same.x - x).max() < 1e-9
        assert np.abs(same.P - P).max() < 1e-9
        assert np.array_equal(Y, Y.T)


def test_its_defaults_work():
    state = InformationState.of(start_at(0.0, np.zeros(3), 0.0))
    y, Y = information_predict(state.y, state.Y, 0.1, np.zeros(4), *PARAMETERS)
    assert np.isfinite(y).all()
    assert np.linalg.eigvalsh(Y)[0] > 0.0


def test_a_state_comes_back_from_its_information():
    rng = np.random.default_rng(1)
    estimate = StateEstimate(4.0, rng.normal(size=11), random_spd(rng, 11))
    back = InformationState.of(estimate).estimate
    assert back.stamp == 4.0
    assert np.allclose(back.x, estimate.x, atol=1e-10)
    assert np.allclose(back.P, estimate.P, atol=1e-10)


@settings(deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 8))
def test_assimilating_a_contribution_is_correcting_with_its_measurement(seed, m):
    rng = np.random.default_rng(seed)
    x, P = rng.normal(size=11), random_spd(rng, 11)
    H, R, residual = rng.normal(size=(m, 11)), random_spd(rng, m), rng.normal(size=m)
    i, I = contribution(x, residual, H, R)  # noqa: E741
    assert np.allclose(I, H.T @ np.linalg.inv(R) @ H)
    assert np.allclose(i, H.T @ np.linalg.inv(R) @ (residual + H @ x))
    x1, P1 = assimilate(x, P, i, I)
    x2, P2 = correct(x, P, residual, H, R)
    assert np.allclose(x1, x2, rtol=1e-6, atol=1e-7)
    assert np.allclose(P1, P2, rtol=1e-6, atol=1e-7)


def test_contributions_add_in_any_order():
    rng = np.random.default_rng(2)
    x, P = rng.normal(size=11), random_spd(rng, 11)
    parts = [
        contribution(x, rng.normal(size=2), rng.normal(size=(2, 11)), random_spd(rng, 2)) for _ in range(4)
    ]
    at_once = assimilate(x, P, sum(i for i, _ in parts), sum(part[1] for part in parts))
    one_by_one = (x, P)
    for i, I in reversed(parts):  # noqa: E741
        one_by_one = assimilate(*one_by_one, i, I)
    assert np.allclose(at_once[0], one_by_one[0], atol=1e-9)
    assert np.allclose(at_once[1], one_by_one[1], atol=1e-9)


def test_summing_estimates_instead_of_contributions_claims_too_much():
    state = start_at(0.0, np.zeros(3), 0.0, PRIOR)
    residual, H = linearise(state.x, np.array([0]), np.array([0.1]))
    i, I = contribution(state.x, residual, H, np.array([[0.25]]))  # noqa: E741
    once = assimilate(state.x, state.P, i, I)[1]
    Y = InformationState.of(state).Y
    estimates = np.linalg.inv(2.0 * (Y + I))  # both nodes' priors counted twice
    assert once[0, 0] == pytest.approx(0.125)
    assert estimates[0, 0] < once[0, 0]


@pytest.mark.parametrize(("yaw", "bias"), [(2 * np.pi, 0.0), (-6 * np.pi, 2 * np.pi), (0.0, -2 * np.pi)])
def test_a_contribution_of_another_count_of_turns_does_the_same(yaw, bias):
    rng = np.random.default_rng(3)
    sender, P = rng.normal(size=11), random_spd(rng, 11)
    receiver = sender.copy()
    receiver[3] += yaw
    receiver[8] += bias
    components, z = np.array([0, 3, 7]), np.array([0.3, sender[3] + 0.1, sender[3] + sender[8] - 0.1])
    residual, H = linearise(sender, components, z)
    i, I = contribution(sender, residual, H, np.diag([0.1, 0.2, 0.3]))  # noqa: E741
    expected, _ = assimilate(sender, P, i, I)
    moved = turned(i, I, receiver, float(sender[3]), float(sender[8]))
    found, _ = assimilate(receiver, P, moved, I)
    assert np.allclose(found - receiver, expected - sender, atol=1e-9)


def test_the_count_of_turns_matters_when_nobody_minds_it():
    state = start_at(0.0, np.zeros(3), 2 * np.pi + 0.1, PRIOR)
    elsewhere = start_at(0.0, np.zeros(3), 0.1, PRIOR)
    residual, H = linearise(elsewhere.x, np.array([3]), np.array([0.1]))
    i, I = contribution(elsewhere.x, residual, H, np.array([[1e-4]]))  # noqa: E741
    wrong, _ = assimilate(state.x, state.P, i, I)
    right, _ = assimilate(state.x, state.P, turned(i, I, state.x, 0.1, 0.0), I)
    assert abs(wrong[3] - state.x[3]) > 6.0
    assert right[3] == pytest.approx(state.x[3], abs=1e-12)


def test_a_state_without_a_heading_bias_turns_its_yaw_alone():
    state = start_at(0.0, np.zeros(3), -2 * np.pi, PRIOR, 8)
    i, I = contribution(np.zeros(8), np.array([0.2]), np.eye(8)[3:4].copy(), np.array([[0.5]]))  # noqa: E741
    moved = turned(i, I, state.x, 0.0, 0.0)
    assert moved[3] == pytest.approx(0.4 - 2.0 * 2 * np.pi)
    assert np.array_equal(turned(i, I, np.zeros(8), 0.0, 0.0), i)


@pytest.mark.parametrize(("deviations", "used"), [(990.0, True), (1010.0, False)])
def test_what_moves_a_state_by_more_than_a_thousand_deviations_is_not_used(deviations, used):
    state = start_at(0.0, np.zeros(3), 0.0, PRIOR)
    at = np.array([deviations * state.sd[0]])
    residual, H = linearise(state.x, np.array([0]), at)
    i, I = contribution(state.x, residual, H, np.array([[1e-6]]))  # noqa: E741
    x, P = assimilate_turned(state.x, state.P, i, I, 0.0, 0.0)
    assert np.isfinite(x).all() == np.isfinite(P).all() == used
    assert not used or x[0] == pytest.approx(at[0], rel=1e-4)
