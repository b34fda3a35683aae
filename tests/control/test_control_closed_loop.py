"""The laws flown without vehicle dynamics: the pose integrates the command, x_dot = R_z(yaw) nu."""

import numpy as np
import pytest

from noctule.control.gains import AdaptiveGain, gain_vector
from noctule.control.servoing import (
    body_velocity,
    camera_twist,
    camera_twist_matrix,
    compensated_error,
    homography_error,
    upright_error,
)
from noctule.geometry import R_BODY_CAMERA, rot_z, wrap_angle

MOUNT = np.array([0.09, 0.0, 0.0])
B = camera_twist_matrix(MOUNT)
DT = 0.04
WALL = np.array([[2.5, 0.9, 0.6], [2.5, -0.8, 0.5], [2.5, 0.1, -0.7]])  # [m], world, all in one plane
ROOM = np.array([[1.8, 0.9, 0.6], [3.5, -1.2, 0.5], [2.4, 0.1, -0.7]])  # the plane through them is slanted
STARTS = [
    np.array([-0.8, 0.3, -0.2, 0.15]),
    np.array([-1.2, -0.4, 0.3, -0.25]),
    np.array([0.3, 0.2, 0.2, 0.3]),
    np.array([0.0, 0.0, 0.0, -0.4]),
]


def camera_pose(state):
    """R_world_camera and t_world_camera of (x, y, z, yaw)."""
    R = rot_z(state[3])
    return R @ R_BODY_CAMERA, state[:3] + R @ MOUNT


def relative(state):
    """R and t of X_cur = R X_ref + t; the reference pose is the origin."""
    (R_cur, t_cur), (R_ref, t_ref) = camera_pose(state), camera_pose(np.zeros(4))
    return R_cur.T @ R_ref, R_cur.T @ (t_ref - t_cur)


def reference_plane(points):
    """n/d of the plane through three world points, and the first of them, both in the reference camera."""
    R, t = camera_pose(np.zeros(4))
    X = (points - t) @ R
    return np.linalg.solve(X, np.ones(3)), X[0, :2] / X[0, 2]


def published(state, points):
    R, t = relative(state)
    n_over_d, m_ref = reference_plane(points)
    return homography_error(R + np.outer(t, n_over_d), m_ref)


def compensated(state, points):
    R, t = relative(state)
    n_over_d, m_ref = reference_plane(points)
    return compensated_error(R + np.outer(t, n_over_d), R, m_ref)


def upright(state, points):
    """The unknowns as an estimator reports them: t over the harmonic mean depth, and the yaw."""
    R, t = relative(state)
    R_ref, t_ref = camera_pose(np.zeros(4))
    depths = ((points - t_ref) @ R_ref)[:, 2]
    return upright_error(t * np.mean(1.0 / depths), float(np.arctan2(R[0, 2], R[2, 2])))


def fly(law, points, start, sign=1.0, seconds=40.0, gains=1.5, mount=MOUNT):
    state, track = start.copy(), [start.copy()]
    for _ in range(round(seconds / DT)):
        nu = body_velocity(sign * camera_twist(law(state, points), gains), mount)
        state = state + DT * np.array([*(rot_z(state[3]) @ nu[:3]), nu[3]])
        state[3] = wrap_angle(state[3])
        track.append(state)
        if np.linalg.norm(state[:3]) > 1.5 * np.linalg.norm(start) + 0.2:
            break
    return np.array(track)


def test_the_homography_of_these_tests_takes_reference_points_to_current_points():
    state = STARTS[0]
    R, t = relative(state)
    (R_ref, t_ref), (R_cur, t_cur) = camera_pose(np.zeros(4)), camera_pose(state)
    n_over_d, _ = reference_plane(ROOM)
    X_ref, X_cur = (ROOM - t_ref) @ R_ref, (ROOM - t_cur) @ R_cur
    mapped = (X_ref / X_ref[:, 2:]) @ (R + np.outer(t, n_over_d)).T
    np.testing.assert_allclose(mapped / mapped[:, 2:], X_cur / X_cur[:, 2:], atol=1e-12)


@pytest.mark.parametrize("points", [WALL, ROOM], ids=["planar", "virtual plane"])
@pytest.mark.parametrize("law", [published, compensated, upright])
@pytest.mark.parametrize("start", STARTS)
def test_plus_converges_to_the_reference_pose(law, points, start):
    track = fly(law, points, start)
    np.testing.assert_allclose(track[-1], np.zeros(4), atol=2e-3)


@pytest.mark.parametrize("law", [published, compensated, upright])
@pytest.mark.parametrize("start", STARTS)
def test_minus_as_printed_diverges(law, start):
    track = fly(law, ROOM, 0.05 * start, sign=-1.0, seconds=4.0)
    assert np.linalg.norm(track[-1]) > 1.5 * np.linalg.norm(track[0])


def test_the_papers_adaptive_gains_converge():
    gain = AdaptiveGain(at_zero=2.8, at_infinity=0.1, slope=5.0)
    state = STARTS[0].copy()
    for _ in range(2000):
        e = published(state, ROOM)
        nu = body_velocity(camera_twist(e, gain_vector(gain(e), 2.5, 0.5)), MOUNT)
        state = state + DT * np.array([*(rot_z(state[3]) @ nu[:3]), nu[3]])
    np.testing.assert_allclose(state, np.zeros(4), atol=2e-3)


def test_the_published_error_flies_aside_on_a_pure_turn_and_the_compensated_one_does_not():
    turned = np.array([0.0, 0.0, 0.0, 0.4])
    turn_in_place = [np.abs(fly(law, ROOM, turned)[:, 1]).max() for law in (published, compensated)]
    assert turn_in_place[0] > 0.1
    # What is left is the swing of a camera 9 cm ahead of the axis.
    assert turn_in_place[1] < 0.04


def test_the_camera_executes_its_twist_only_with_its_lever_arm():
    nu_c = camera_twist(upright(STARTS[1], ROOM), 1.0)
    np.testing.assert_allclose(B @ body_velocity(nu_c, MOUNT), nu_c, atol=1e-15)
    missed = B @ body_velocity(nu_c, np.zeros(3)) - nu_c
    # Without the arm the camera is dragged sideways by 0.09 m times the turn, and by nothing else.
    np.testing.assert_allclose(missed, [0.09 * nu_c[4], 0, 0, 0, 0, 0], atol=1e-15)
    assert abs(missed[0]) > 0.04


def test_with_the_lever_arm_the_camera_flies_straight_to_its_goal():
    def bend(mount):
        track = fly(compensated, WALL, STARTS[1], mount=mount)
        camera = np.array([camera_pose(state)[1] for state in track])
        camera = camera - camera_pose(np.zeros(4))[1]
        along = camera[0] / np.linalg.norm(camera[0])
        return np.linalg.norm(camera - np.outer(camera @ along, along), axis=1).max()

    assert bend(np.zeros(3)) > bend(MOUNT) + 0.005
