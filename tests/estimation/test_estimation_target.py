import numpy as np
import pytest

from noctule.estimation.odometry import OdometryPose
from noctule.estimation.target import TargetPrior, begin_target, target_in_heading, update_target
from noctule.geometry import rot_z, wrap_angle

LEVER = np.array([0.09, 0.0, 0.0])
PRIOR = TargetPrior()
COV = np.diag([0.0005**2, 0.002**2, 0.002**2, 0.002**2])


def pose_at(stamp, position, yaw=0.0):
    return OdometryPose(stamp, np.asarray(position, dtype=float), yaw, np.zeros(3))


def measure(target, target_yaw, position, yaw, depth, rng=None):
    """Return t [mean depths] in the heading frame and the yaw difference, as an estimator would see them."""
    camera = position + rot_z(yaw) @ LEVER
    goal = np.asarray(target) + rot_z(target_yaw) @ LEVER
    noise = np.zeros(4) if rng is None else rng.multivariate_normal(np.zeros(4), COV)
    return rot_z(-yaw) @ (goal - camera) / depth + noise[1:], wrap_angle(yaw - target_yaw) + noise[0]


def fly(depth, bias=np.zeros(3), ticks=120, rng=None, prior=PRIOR, speed=0.4):
    """Approach a target 2 m ahead; the odometry counts `bias` [m/s] too much."""
    target, target_yaw = np.array([2.0, 0.3, -0.4]), 0.2
    true, counted, estimate = np.zeros(3), np.zeros(3), None
    for i in range(ticks):
        dt = 1.0 / 30.0
        v = speed * np.array([1.0, 0.25 * np.sin(i / 10.0), 0.0])
        true, counted = true + v * dt, counted + (v + bias) * dt
        t, yaw = measure(target, target_yaw, true, 0.0, depth, rng)
        pose = pose_at(i * dt, counted)
        if estimate is None:
            estimate = begin_target(t, yaw, COV, pose, LEVER, prior)
        else:
            estimate, _ = update_target(estimate, t, yaw, COV, pose, LEVER, prior)
    return estimate, pose, target - true, wrap_angle(target_yaw)


def test_the_first_measurement_is_reproduced_exactly():
    t, yaw = measure([1.5, 0.2, 0.1], -0.3, np.zeros(3), 0.4, 1.0 / PRIOR.inverse_depth)
    pose = pose_at(0.0, np.zeros(3), 0.4)
    way, turn = target_in_heading(begin_target(t, yaw, COV, pose, LEVER, PRIOR), pose, LEVER)
    assert way == pytest.approx(rot_z(-0.4) @ np.array([1.5, 0.2, 0.1]), abs=1e-12)
    assert turn == pytest.approx(-0.7)


@pytest.mark.parametrize("depth", [1.5, 3.0, 6.0])
def test_the_depth_is_learnt_from_motion_whatever_was_expected(depth):
    estimate, pose, way, _ = fly(depth)
    # The expectation was off by up to a factor of two; the unit may walk, so it is never known much better.
    assert estimate.depth == pytest.approx(depth, rel=0.15)
    assert target_in_heading(estimate, pose, LEVER)[0] == pytest.approx(way, abs=0.05)


def test_without_motion_the_depth_stays_unknown():
    estimate, *_ = fly(5.0, ticks=60, speed=0.0)
    assert np.sqrt(estimate.P[3, 3]) > 0.9 * PRIOR.inverse_depth_sd


def test_at_the_target_the_way_is_zero_whatever_the_depth():
    for depth in (1.0, 3.0, 9.0):
        t, yaw = measure([0.0, 0.0, 0.0], 0.0, np.zeros(3), 0.0, depth)
        pose = pose_at(0.0, np.zeros(3))
        way, turn = target_in_heading(begin_target(t, yaw, COV, pose, LEVER, PRIOR), pose, LEVER)
        assert np.linalg.norm(way) < 1e-12
        assert turn == 0.0


def test_a_sideways_bias_of_the_odometry_is_found():
    prior = TargetPrior(bias_sd=0.05)
    estimate, *_ = fly(3.0, bias=np.array([0.0, 0.04, 0.0]), ticks=150, prior=prior)
    assert estimate.velocity_bias[1] == pytest.approx(0.04, abs=0.012)


def test_noise_does_not_make_it_worse_than_a_single_measurement():
    rng = np.random.default_rng(1)
    estimate, pose, way, target_yaw = fly(3.0, rng=rng)
    assert np.linalg.norm(target_in_heading(estimate, pose, LEVER)[0] - way) < 0.05
    assert abs(wrap_angle(estimate.yaw - target_yaw)) < 0.003


def test_a_wild_measurement_is_refused_and_changes_nothing_but_the_prediction():
    estimate, pose, *_ = fly(3.0)
    later = pose_at(pose.stamp + 1 / 30, pose.position)
    after, accepted = update_target(estimate, np.array([2.0, -1.0, 0.5]), 0.8, COV, later, LEVER, PRIOR)
    assert not accepted
    assert after.position == pytest.approx(estimate.position, abs=1e-3)
    assert np.all(np.diag(after.P) >= np.diag(estimate.P) - 1e-12)


def test_covariances_stay_symmetric_and_positive():
    rng = np.random.default_rng(2)
    estimate, *_ = fly(2.0, rng=rng, ticks=300, speed=0.2)
    assert estimate.P == pytest.approx(estimate.P.T, abs=1e-12)
    assert np.linalg.eigvalsh(estimate.P).min() > 0.0


def test_fresh_points_loosen_the_depth_only():
    estimate, pose, *_ = fly(3.0)
    # The unit of t changes by 15 % because other points are in sight now; where the target is does not.
    t, yaw = measure([2.0, 0.3, -0.4], 0.2, pose.position, 0.0, 3.0 * 1.15)
    later = pose_at(pose.stamp + 1 / 30, pose.position)
    after, accepted = update_target(estimate, t, yaw, COV, later, LEVER, PRIOR, fresh=True)
    assert accepted
    assert np.linalg.norm(after.position - estimate.position) < 0.05
    assert after.depth > 1.05 * estimate.depth


def test_depth_and_bias_of_a_neighbour_are_taken_over():
    t, yaw = measure([1.0, 0.0, 0.0], 0.0, np.zeros(3), 0.0, 4.0)
    bias = (np.array([0.01, -0.02, 0.0]), 1e-4 * np.eye(3))
    estimate = begin_target(t, yaw, COV, pose_at(0.0, np.zeros(3)), LEVER, PRIOR, (0.25, 0.1), bias)
    assert estimate.depth == pytest.approx(4.0)
    assert np.sqrt(estimate.P[3, 3]) == pytest.approx(0.1)
    assert estimate.velocity_bias == pytest.approx(bias[0])
    assert estimate.position == pytest.approx([1.09, 0.0, 0.0])
