"""What is learnt of a disturbance: a constant, and what goes with the speed that is wanted."""

import math

import numpy as np

from noctule.control.cascade import disturbance_after, nothing_learnt, on_body_axes
from noctule.geometry import rot_z

DRAGS = np.full(4, 1 / 0.3)  # of a velocity loop
SLOPE_SD = 0.3 * DRAGS
DT = 1 / 30
NOTHING = np.zeros(4)
BOUNDS = np.column_stack([np.ones(4), DRAGS])


def learning(constant, slope, wanted, seconds=10.0, slope_sd=SLOPE_SD, learnt=None, noise=None):
    """Return what is learnt, and how far the velocity was from the predicted one at every tick, (n, 4).

    The vehicle flies as it is wanted on body axes, `wanted(t)`, with its nose at 2 rad, and the model as it
    is says so but for `constant` (4,) and `slope` (4,) times what is wanted.
    """
    learnt, covariance = nothing_learnt(slope_sd) if learnt is None else learnt
    yaw, offs = 2.0, []
    for tick in range(round(seconds / DT)):
        v = wanted(tick * DT)
        expected = np.append([0, 0, 1, yaw], on_world_axes(v, yaw))
        missing = (constant + slope * v - learnt[:, 0] - learnt[:, 1] * v) * DT
        if noise is not None:
            missing = missing + noise(tick)
        found = np.append(expected[:4], expected[4:] + on_world_axes(missing, yaw))
        learnt, covariance = disturbance_after(
            learnt, covariance, expected, found, v, DT, 2.0, slope_sd, BOUNDS
        )
        offs.append(missing)
    return learnt, covariance, np.array(offs)


def on_world_axes(body, yaw):
    return np.append(rot_z(yaw) @ body[:3], body[3])


def around(t):
    """Speeds that turn: forward, left, up, yaw."""
    return np.array([0.3 * math.cos(0.6 * t), 0.3 * math.sin(0.6 * t), 0.1 * math.sin(t), 0.5 * math.cos(t)])


def still(t):
    return np.zeros(4)


CONSTANT, SLOPE = np.array([0.3, -0.2, 0.1, 0.25]), np.array([2.0, -1.5, 0.8, -1.0])


def test_world_rates_are_turned_to_body_axes_and_the_yaw_rate_stays():
    turned = on_body_axes(np.array([0.0, 2.0, 0.3, 0.4]), np.pi / 2)
    np.testing.assert_allclose(turned, [2.0, 0.0, 0.3, 0.4], atol=1e-12)
    body = np.array([0.3, -0.1, 0.2, 0.7])
    np.testing.assert_allclose(on_body_axes(on_world_axes(body, -2.5), -2.5), body, atol=1e-12)


def test_a_constant_disturbance_is_learnt_on_body_axes_while_nothing_is_wanted():
    learnt, covariance, _ = learning(CONSTANT, SLOPE, still)
    np.testing.assert_allclose(learnt[:, 0], CONSTANT, atol=1e-3)
    # A hovering vehicle says nothing of what goes with the speed.
    np.testing.assert_array_equal(learnt[:, 1], np.zeros(4))
    np.testing.assert_allclose(covariance[:, 1, 1], SLOPE_SD**2)


def test_what_goes_with_the_wanted_speed_is_told_from_a_constant():
    learnt, covariance, _ = learning(CONSTANT, SLOPE, around, 40.0)
    np.testing.assert_allclose(learnt[:, 0], CONSTANT, atol=0.04)
    np.testing.assert_allclose(learnt[:, 1], SLOPE, atol=0.2)
    assert (covariance[:, 1, 1] < SLOPE_SD**2).all()
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()


def test_a_constant_alone_trails_behind_a_speed_that_turns():
    offs = [learning(NOTHING, 0.6 * DRAGS, around, 40.0, sd)[2][-300:] for sd in (NOTHING, SLOPE_SD)]
    trailing, following = (np.sqrt((off[:, :2] ** 2).mean()) for off in offs)
    assert following < 0.15 * trailing


def test_the_constant_alone_is_learnt_with_the_rate_that_is_asked_for():
    learnt, covariance, _ = learning(CONSTANT, NOTHING, still, 20.0, NOTHING)
    learnt = learnt.copy()
    learnt[:, 0] -= 0.1
    after = learning(CONSTANT, NOTHING, still, DT, NOTHING, (learnt, covariance))[0]
    np.testing.assert_allclose(after[:, 0] - learnt[:, 0], 0.1 * 2.0 * DT, rtol=0.05)


def test_a_push_hardly_changes_what_goes_with_the_speed():
    known = learning(CONSTANT, SLOPE, around, 40.0)
    pushed = learning(
        CONSTANT, SLOPE, around, 2.0, learnt=known[:2], noise=lambda k: 4.5 * DT * np.ones(4) * (k < 6)
    )
    # Taken at its word, a push against the speed would say as much as the bounds allow.
    assert np.abs(pushed[0][:, 1] - known[0][:, 1]).max() < 0.5


def test_a_large_disturbance_is_bounded():
    learnt, _, _ = learning(np.full(4, 9.0), 9.0 * DRAGS, around, 1.0)
    assert (np.abs(learnt) <= BOUNDS).all()
    assert (learnt[:, 0] == 1.0).any()
    assert (learnt[:, 1] == DRAGS).any()
