import numpy as np
import pytest

from noctule.estimation.odometry import Odometry
from noctule.geometry import rot_z, wrap_angle

DT = 1.0 / 30.0


def circle(odometry, ticks, speed=0.4, rate=0.5, report=True):
    for i in range(ticks):
        v, yaw = (np.array([speed, 0.0, 0.0]), 1.0 + rate * i * DT) if report else (None, None)
        odometry.step(i * DT, np.array([speed, 0.0, 0.0, rate]), v, yaw)


def test_counting_begins_at_zero_whatever_yaw_is_reported():
    pose = Odometry().step(5.0, np.zeros(4), np.zeros(3), 2.5)
    assert pose.yaw == 0.0
    assert not pose.position.any()


def test_a_reported_circle_is_closed():
    odometry = Odometry()
    turn = 2.0 * np.pi / 0.5
    # The lag model needs a moment to agree with the report, so count from an established speed.
    odometry._nu = np.array([0.4, 0.0, 0.0, 0.5])
    circle(odometry, round(turn / DT) + 1)
    assert np.linalg.norm(odometry.now.position) < 0.02
    assert odometry.now.yaw == pytest.approx(wrap_angle(0.5 * round(turn / DT) * DT), abs=1e-9)


def test_without_reports_the_commands_are_flown_through_the_lag():
    odometry = Odometry(lag=0.3)
    for i in range(91):
        odometry.step(i * DT, np.array([0.5, 0.0, 0.0, 0.0]), None, None)
    # A first-order lag is behind by speed * lag once it has settled.
    assert odometry.now.position[0] == pytest.approx(0.5 * 3.0 - 0.5 * 0.3, abs=0.01)


def test_a_noisy_report_costs_neither_delay_nor_the_noise():
    rng = np.random.default_rng(0)
    odometry, truth, errors = Odometry(lag=0.3), 0.0, []
    for i in range(300):
        command = 0.4 if i < 150 else -0.4
        truth += (1 - np.exp(-DT / 0.3)) * (command - truth)
        v = np.array([truth, 0.0, 0.0]) + rng.normal(0.0, 0.06, 3)
        pose = odometry.step(i * DT, np.array([command, 0.0, 0.0, 0.0]), v, 0.0)
        errors.append(pose.v_heading[0] - truth)
    assert np.std(errors) < 0.03
    # Right after the reversal, where a filter without the command would be late.
    assert abs(np.mean(errors[151:160])) < 0.03


def test_a_report_corrects_a_vehicle_that_does_not_obey():
    odometry = Odometry()
    for i in range(150):
        odometry.step(i * DT, np.array([0.5, 0.0, 0.0, 0.0]), np.zeros(3), 0.0)
    # The command says 0.5 m/s, the vehicle says it stands: a share of the command is left, not all of it.
    assert odometry.now.v_heading[0] < 0.25


def test_poses_of_the_last_second_are_interpolated():
    odometry = Odometry()
    circle(odometry, 40)
    a, b = odometry.at(1.0), odometry.at(1.0 + DT)
    middle = odometry.at(1.0 + DT / 2.0)
    assert middle.position == pytest.approx((a.position + b.position) / 2.0, abs=1e-6)
    assert middle.yaw == pytest.approx((a.yaw + b.yaw) / 2.0, abs=1e-9)


def test_outside_the_memory_the_nearest_pose_answers():
    odometry = Odometry(keep=0.5)
    circle(odometry, 60)
    assert odometry.at(99.0) is odometry.now
    assert odometry.at(-1.0).stamp == pytest.approx(odometry.now.stamp - 0.5, abs=DT)


def test_roll_and_pitch_are_kept_with_the_pose():
    odometry = Odometry()
    odometry.step(0.0, np.zeros(4), None, None, (0.02, -0.01))
    odometry.step(0.1, np.zeros(4), None, None, (0.04, -0.03))
    assert odometry.at(0.05).roll == pytest.approx(0.03)
    assert odometry.at(0.05).pitch == pytest.approx(-0.02)


def test_velocities_are_turned_by_the_heading_at_the_middle_of_the_step():
    odometry = Odometry()
    odometry._nu = np.array([1.0, 0.0, 0.0, 0.0])
    odometry.step(0.0, np.array([1.0, 0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), 0.0)
    pose = odometry.step(0.1, np.array([1.0, 0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), 0.2)
    assert pose.position == pytest.approx(rot_z(0.1) @ np.array([0.1, 0.0, 0.0]), abs=1e-9)
