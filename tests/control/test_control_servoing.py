import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from noctule.control.servoing import (
    body_velocity,
    camera_twist,
    camera_twist_matrix,
    compensated_error,
    homography_error,
    interaction_at_zero,
    mean_distance,
    upright_error,
)
from noctule.geometry import R_BODY_CAMERA, rot_y, rot_z, skew

MOUNT = np.array([0.09, 0.02, -0.03])
TWISTS = arrays(np.float64, 4, elements=st.floats(-2.0, 2.0))
TRIPLES = arrays(np.float64, 3, elements=st.floats(-0.3, 0.3))


def exponential(nu_c, dt):
    """The motion of points in the camera when the camera moves with the twist nu_c for dt: R and t."""
    S = np.zeros((4, 4))
    S[:3, :3], S[:3, 3] = -skew(nu_c[3:]) * dt, -nu_c[:3] * dt
    T, term = np.eye(4), np.eye(4)
    for k in range(1, 12):
        term = term @ S / k
        T = T + term
    return T[:3, :3], T[:3, 3]


@given(TRIPLES, st.tuples(st.floats(-0.6, 0.6), st.floats(-0.4, 0.4)))
def test_the_interaction_matrix_at_zero_is_the_derivative_of_the_error(slope, m):
    n_over_d, m_ref = np.array([slope[0], slope[1], 0.5 + abs(slope[2])]), np.array(m)
    step, numeric = 1e-6, np.empty((6, 6))
    for i, nu_c in enumerate(np.eye(6)):
        ends = []
        for dt in (step, -step):
            R, t = exponential(nu_c, dt)
            ends.append(homography_error(R + np.outer(t, n_over_d), m_ref))
        numeric[:, i] = (ends[0] - ends[1]) / (2 * step)
    np.testing.assert_allclose(interaction_at_zero(m_ref, n_over_d), numeric, atol=1e-8)


@given(TRIPLES, st.tuples(st.floats(-0.6, 0.6), st.floats(-0.4, 0.4)))
def test_every_eigenvalue_of_the_interaction_matrix_is_negative(slope, m):
    n_over_d = np.array([slope[0], slope[1], 0.5 + abs(slope[2])])
    assert np.linalg.eigvals(interaction_at_zero(np.array(m), n_over_d)).real.max() < 0.0


@given(TRIPLES, st.floats(-1.0, 1.0))
def test_the_upright_error_is_the_compensated_error_of_its_homography(t, yaw):
    R = rot_y(yaw)
    H = R + np.outer(t, [0.0, 0.0, 1.0])
    np.testing.assert_allclose(
        compensated_error(H, R, np.array([0.2, -0.1])), upright_error(t, yaw), atol=1e-14
    )


def test_a_turn_alone_is_sideways_motion_in_the_published_error_only():
    R = rot_y(0.2)
    assert abs(homography_error(R, np.zeros(2))[0]) == pytest.approx(np.sin(0.2))
    np.testing.assert_array_equal(compensated_error(R, R, np.zeros(2))[:3], np.zeros(3))


def test_translation_alone_is_a_turn_in_the_published_error_only():
    H = np.eye(3) + np.outer([0.2, 0.0, 0.0], [0.0, 0.0, 1.0])
    assert homography_error(H, np.zeros(2))[4] == pytest.approx(0.2)
    np.testing.assert_array_equal(compensated_error(H, np.eye(3), np.zeros(2))[3:], np.zeros(3))


def test_the_error_takes_the_point_with_or_without_its_one():
    H = np.arange(9.0).reshape(3, 3)
    np.testing.assert_array_equal(
        homography_error(H, np.array([0.3, 0.1])), homography_error(H, np.array([0.3, 0.1, 1.0]))
    )


def test_a_camera_that_turned_left_is_asked_to_turn_right():
    nu_c = camera_twist(upright_error(np.zeros(3), yaw=0.3), 1.0)
    assert body_velocity(nu_c, np.zeros(3))[3] == pytest.approx(-2.0 * np.sin(0.3))


def test_a_camera_that_is_behind_its_target_is_asked_to_fly_forward():
    # The scene seems farther than in the reference: X_cur = X_ref + t with t_z > 0.
    nu = body_velocity(camera_twist(upright_error(np.array([0.0, 0.0, 0.4]), 0.0), 0.5), MOUNT)
    np.testing.assert_allclose(nu, [0.2, 0.0, 0.0, 0.0])


def test_one_gain_for_each_axis_scales_each_axis():
    np.testing.assert_array_equal(camera_twist(np.ones(6), np.arange(6.0)), np.arange(6.0))


@pytest.mark.parametrize(
    ("nu", "twist"),
    [
        ([1, 0, 0, 0], [0, 0, 1, 0, 0, 0]),  # forward is z
        ([0, 1, 0, 0], [-1, 0, 0, 0, 0, 0]),  # left is -x
        ([0, 0, 1, 0], [0, -1, 0, 0, 0, 0]),  # up is -y
        ([0, 0, 0, 1], [-0.09, 0, 0, 0, -1, 0]),  # counterclockwise is about -y, and the camera swings left
    ],
)
def test_each_body_velocity_is_the_right_camera_twist(nu, twist):
    B = camera_twist_matrix(np.array([0.09, 0.0, 0.0]))
    np.testing.assert_allclose(B @ np.array(nu, dtype=float), twist, atol=1e-15)


@given(TWISTS)
def test_the_camera_twist_matrix_is_the_derivative_of_the_cameras_pose(nu):
    def camera(dt):
        """R_start_camera and t after dt of constant body velocity from a level start."""
        R = rot_z(nu[3] * dt)
        half = rot_z(0.5 * nu[3] * dt)  # midpoint rule
        return R @ R_BODY_CAMERA, half @ nu[:3] * dt + R @ MOUNT

    step = 1e-5
    (R1, t1), (R0, t0) = camera(step), camera(-step)
    v = R_BODY_CAMERA.T @ (t1 - t0) / (2 * step)
    W = R_BODY_CAMERA.T @ (R1 - R0) / (2 * step)
    np.testing.assert_allclose(camera_twist_matrix(MOUNT) @ nu, [*v, W[2, 1], W[0, 2], W[1, 0]], atol=1e-8)


@given(TWISTS)
def test_the_body_velocity_undoes_the_camera_twist(nu):
    np.testing.assert_allclose(body_velocity(camera_twist_matrix(MOUNT) @ nu, MOUNT), nu, atol=1e-15)


@given(arrays(np.float64, 6, elements=st.floats(-2.0, 2.0)))
def test_roll_and_pitch_rates_leave_no_trace_in_the_body_velocity(nu_c):
    level = nu_c * np.array([1, 1, 1, 0, 1, 0])
    np.testing.assert_array_equal(body_velocity(nu_c, MOUNT), body_velocity(level, MOUNT))


def test_the_lever_arm_changes_the_lateral_velocity_of_a_turn():
    turn = np.array([0.0, 0.0, 0.0, 0.0, -1.0, 0.0])
    with_arm, without = body_velocity(turn, np.array([0.09, 0, 0])), body_velocity(turn, np.zeros(3))
    np.testing.assert_allclose(with_arm - without, [0.0, -0.09, 0.0, 0.0])


def test_epsilon_is_a_mean_distance_not_a_mean_square():
    assert mean_distance(np.array([[3.0, 4.0], [0.0, 0.0]]), np.zeros((2, 2))) == 2.5


def test_epsilon_of_no_points_is_not_a_number():
    assert np.isnan(mean_distance(np.empty((0, 2)), np.empty((0, 2))))
