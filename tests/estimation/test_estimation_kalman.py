"""The compiled Kalman filter against the textbook in plain numpy, and what it must never do."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.estimation.chi_square import chi_square_cdf, chi_square_quantile, nees, nees_band
from noctule.estimation.filter_state import FilterError, StateEstimate, start_at
from noctule.estimation.kalman_filter import correct, predict
from noctule.estimation.matrices import cholesky, inverse_spd, times
from noctule.estimation.measurements import (
    Component,
    Measurement,
    NavdataNoise,
    linearise,
    of_heading,
    of_pose,
    of_vehicle_state,
)
from noctule.estimation.vehicle_model import ProcessNoise, VehicleModel, process_covariance, transition
from noctule.geometry import rot_z
from noctule.messages import FlightState, HeadingMeasurement, PoseMeasurement, VehicleState

MODEL, DENSITIES = VehicleModel.identified(), ProcessNoise().densities
ALL = np.arange(8)


def random_spd(rng, n, spread=3.0):
    A = rng.normal(size=(n, n))
    return A @ A.T + np.diag(10.0 ** rng.uniform(-spread, 0.0, n))


def random_state(rng, n=11):
    return rng.normal(size=n), random_spd(rng, n)


def textbook_correct(x, P, residual, H, R):
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    IKH = np.eye(x.size) - K @ H
    return x + K @ residual, IKH @ P @ IKH.T + K @ R @ K.T


@pytest.mark.parametrize("n", [8, 9, 10, 11])
def test_a_prediction_is_f_and_f_p_f_plus_q(n):
    rng = np.random.default_rng(n)
    x, P = random_state(rng, n)
    u = rng.uniform(-1, 1, 4)
    x1, P1 = predict(x, P, 0.03, u, MODEL.input_gains, MODEL.drags, DENSITIES)
    expected, F = transition(x, 0.03, u, MODEL.input_gains, MODEL.drags)
    Q = process_covariance(0.5 * (x[3] + expected[3]), 0.03, MODEL.drags, DENSITIES, n)
    assert np.array_equal(x1, expected)
    assert np.allclose(P1, F @ P @ F.T + Q, rtol=1e-12, atol=1e-12)
    assert np.array_equal(P1, P1.T)


@settings(deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 8))
def test_a_sequential_correction_is_the_textbook_s_at_once(seed, m):
    rng = np.random.default_rng(seed)
    x, P = random_state(rng)
    H, R, residual = rng.normal(size=(m, 11)), random_spd(rng, m), rng.normal(size=m)
    x1, P1 = correct(x, P, residual, H, R)
    x2, P2 = textbook_correct(x, P, residual, H, R)
    assert np.allclose(x1, x2, rtol=1e-8, atol=1e-8)
    assert np.allclose(P1, P2, rtol=1e-8, atol=1e-8)


def test_a_correction_changes_nothing_that_it_was_given():
    rng = np.random.default_rng(0)
    x, P = random_state(rng)
    before = x.copy(), P.copy()
    correct(x, P, np.ones(2), rng.normal(size=(2, 11)), np.eye(2))
    predict(x, P, 0.1, np.zeros(4), MODEL.input_gains, MODEL.drags, DENSITIES)
    assert np.array_equal(x, before[0])
    assert np.array_equal(P, before[1])


def test_measurements_a_million_times_surer_than_the_state_leave_it_positive_definite():
    state = start_at(0.0, np.zeros(3), 0.0)
    x, P = state.x, state.P * 1e6
    for k in range(300):
        x, P = predict(x, P, 0.01, np.zeros(4), MODEL.input_gains, MODEL.drags, DENSITIES)
        residual, H = linearise(x, ALL, np.zeros(8))
        x, P = correct(x, P, residual, H, np.eye(8) * 1e-10)
        assert np.array_equal(P, P.T)
        assert np.linalg.eigvalsh(P)[0] > 0.0, k


def test_a_covariance_that_is_none_is_told_by_nan():
    x, P = random_state(np.random.default_rng(0))
    x1, P1 = correct(x, P, np.ones(2), np.eye(11)[:2].copy(), np.array([[1.0, 2.0], [2.0, 1.0]]))
    assert np.isnan(x1).all()
    assert np.isnan(P1).all()


@settings(deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 11))
def test_small_matrices_are_inverted_and_multiplied_as_numpy_does(seed, n):
    rng = np.random.default_rng(seed)
    A, v = random_spd(rng, n), rng.normal(size=n)
    assert np.allclose(cholesky(A), np.linalg.cholesky(A), atol=1e-10)
    assert np.allclose(inverse_spd(A) @ A, np.eye(n), atol=1e-7)
    assert np.allclose(times(A, v), A @ v)


def test_the_inverse_of_an_indefinite_matrix_is_nan():
    assert np.isnan(inverse_spd(np.diag([1.0, -1.0]))).all()


@pytest.mark.parametrize("n", [8, 9, 10, 11])
def test_the_jacobian_of_every_measurement_is_that_of_finite_differences(n):
    x = np.random.default_rng(n).normal(size=n)
    z = np.zeros(8)
    residual, H = linearise(x, ALL, z)
    for j in range(n):
        d = 1e-6 * (np.arange(n) == j)
        up, down = linearise(x + d, ALL, z)[0], linearise(x - d, ALL, z)[0]
        assert np.allclose(H[:, j], (down - up) / 2e-6, atol=1e-8)
    assert residual.shape == (8,)


def test_onboard_velocities_are_those_of_the_heading_frame_with_their_biases():
    x = np.array([0, 0, 0, 0.7, 0.5, -0.3, 0.1, 0, 0.2, 0.02, -0.03])
    residual, _ = linearise(x, np.array([4, 5, 6]), np.zeros(3))
    expected = rot_z(0.7).T @ x[4:7] + [0.02, -0.03, 0.0]
    assert np.allclose(-residual, expected)


def test_an_innovation_of_yaw_takes_the_short_way_round():
    x = np.zeros(11)
    x[3], x[8] = 7 * np.pi - 0.1, 0.3  # three turns and a half
    residual, _ = linearise(x, np.array([3, 7]), np.array([-np.pi + 0.1, -np.pi + 0.1]))
    assert residual == pytest.approx([0.2, -0.1])


def test_the_yaw_counts_turns_and_is_told_wrapped():
    x = np.zeros(11)
    x[3] = 7.0
    estimate = StateEstimate(0.0, x, np.eye(11))
    assert estimate.yaw == pytest.approx(7.0 - 2 * np.pi)
    assert estimate.pose.yaw == estimate.yaw


def test_an_estimate_is_told_in_the_frames_that_others_use():
    x = np.array([1.0, 2.0, 3.0, np.pi / 2, 0.5, 0.2, 0.1, 0.4])
    estimate = StateEstimate(0.0, x, np.eye(8))
    assert estimate.pose.position.tolist() == [1.0, 2.0, 3.0]
    assert np.allclose(estimate.v_heading, [0.2, -0.5, 0.1])
    assert estimate.v_world.tolist() == [0.5, 0.2, 0.1]
    assert estimate.yaw_rate == 0.4


def test_a_pose_becomes_four_numbers_with_its_covariance():
    R = np.diag([1.0, 2.0, 3.0, 4.0]) * 1e-4
    made = of_pose(PoseMeasurement(3.0, np.array([1.0, 2.0, 3.0]), 0.5, R, "registration"), 7)
    assert made.components.tolist() == [Component.X, Component.Y, Component.Z, Component.YAW]
    assert made.z.tolist() == [1.0, 2.0, 3.0, 0.5]
    assert np.array_equal(made.R, R)
    assert (made.stamp, made.source, made.sequence) == (3.0, "registration", 7)


def test_markers_give_the_yaw_alone():
    made = of_heading(HeadingMeasurement(1.0, 0.3, 0.01, "markers"))
    assert made.components.tolist() == [Component.YAW]
    assert made.R.tolist() == [[0.01]]


def test_what_the_vehicle_reports_is_used_and_what_it_does_not_is_not():
    noise = NavdataNoise(velocity_sd=0.1, climb_sd=0.4, height_sd=0.2, heading_sd=0.3)
    full = VehicleState(1.0, FlightState.FLYING, 0.01, 0.02, 0.5, np.array([0.1, 0.2, 0.3]), 1.2)
    made = of_vehicle_state(full, noise)
    assert made is not None
    C = Component
    assert made.components.tolist() == [C.FORWARD, C.LEFT, C.UP, C.Z, C.HEADING]
    assert made.z.tolist() == [0.1, 0.2, 0.3, 1.2, 0.5]
    assert np.sqrt(np.diag(made.R)) == pytest.approx([0.1, 0.1, 0.4, 0.2, 0.3])
    height = of_vehicle_state(VehicleState(1.0, FlightState.FLYING, height=1.0), noise)
    assert height is not None
    assert height.components.tolist() == [C.Z]
    assert of_vehicle_state(VehicleState(1.0, FlightState.FLYING), noise) is None


def test_parts_of_a_measurement_keep_their_covariance():
    R = np.arange(9.0).reshape(3, 3)
    whole = Measurement(0.0, np.array([0, 1, 3]), np.array([1.0, 2.0, 3.0]), R, "depth", 5)
    part = whole.part(np.array([True, False, True]))
    assert part.components.tolist() == [0, 3]
    assert part.R.tolist() == [[0.0, 2.0], [6.0, 8.0]]
    assert part.sequence == 5


def test_a_pose_with_a_covariance_of_three_is_refused():
    with pytest.raises(FilterError) as told:
        of_pose(PoseMeasurement(1.0, np.zeros(3), 0.0, np.eye(3), "depth"))
    assert str(told.value) == (
        "measurement of 'depth': (4,) numbers with a covariance (3, 3); expected (4,) and (4, 4)"
    )


@pytest.mark.parametrize("variance", [0.0, -1.0, np.nan])
def test_a_heading_without_a_variance_is_refused(variance):
    with pytest.raises(FilterError) as told:
        of_heading(HeadingMeasurement(1.0, 0.5, variance, "markers"))
    assert str(told.value) == (
        f"measurement of 'markers' at 1 s: [0.5] with variances [{variance}]; "
        "expected finite numbers and a positive definite covariance"
    )


@pytest.mark.parametrize(
    ("probability", "freedom", "value"),
    [
        (0.95, 1, 3.841459),
        (0.999, 3, 16.26624),
        (0.5, 2, 1.386294),
        (0.025, 11, 3.815748),
        (0.975, 40, 59.34171),
    ],
)
def test_the_quantiles_of_chi_square_are_those_of_the_tables(probability, freedom, value):
    assert chi_square_quantile(probability, freedom) == pytest.approx(value, rel=1e-6)
    assert chi_square_cdf(value, freedom) == pytest.approx(probability, rel=1e-6)


def test_quantiles_of_many_degrees_go_on_where_the_exact_ones_end():
    exact, near = chi_square_quantile(0.975, 200), chi_square_quantile(0.975, 201)
    assert exact < near < exact + 2.0
    low, high = nees_band(100, 11)
    assert (low, high) == pytest.approx((0.9182, 1.0853), abs=1e-3)


@settings(deadline=None)
@given(st.integers(0, 1000))
def test_the_nees_is_the_error_in_deviations_and_its_yaw_wraps(seed):
    rng = np.random.default_rng(seed)
    L = np.linalg.cholesky(random_spd(rng, 11))
    e, x = rng.normal(size=11), rng.normal(size=11)
    truth = x - L @ e
    truth[3] += 2 * np.pi
    small = abs((L @ e)[3]) < np.pi
    assert not small or nees(StateEstimate(0.0, x, L @ L.T), truth) == pytest.approx(e @ e, rel=1e-6)
