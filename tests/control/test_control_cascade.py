"""The cascade against its equations, the model it inverts, and the vehicle it predicts."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from noctule.control.cascade import (
    CascadeSettings,
    DelayTooLongError,
    cascade,
    compensator,
    kinematic_law,
    moved,
    predict_over_delay,
    saturated,
)
from noctule.estimation.vehicle_model import TABLE_1, transition

GAINS, DRAGS = np.array(TABLE_1[0::2]), np.array(TABLE_1[1::2])
K1, K2, K = CascadeSettings().arrays()
NOTHING, WIDE = np.zeros(4), np.full(4, 1e9)
four = arrays(float, 4, elements=st.floats(-1.0, 1.0))
eight = arrays(float, 8, elements=st.floats(-2.0, 2.0))


def acceleration(x, u):
    """Eqs. (3) to (5): the world's acceleration under u, (4,)."""
    c, s = math.cos(x[3]), math.sin(x[3])
    R = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return R @ (GAINS * u - DRAGS * (R.T @ x[4:]))


def test_the_defaults_are_the_gains_of_the_second_prototype():
    np.testing.assert_array_equal(K1, (1.5, 1.5, 1.0, 2.0))
    np.testing.assert_array_equal(K2, (2.5, 2.5, 2.5, 2.0))
    np.testing.assert_array_equal(K, (8.0, 8.0, 7.0, 8.0))


@given(eight, four, four)
def test_the_kinematic_law_is_equation_48(x, pose, velocity):
    v_r, _, error = kinematic_law(x, pose, velocity, NOTHING, NOTHING, K1, K2)
    turned = math.remainder(pose[3] - x[3], math.tau)
    e = np.append(pose[:3] - x[:3], turned)
    np.testing.assert_allclose(error, e, atol=1e-12)
    np.testing.assert_allclose(v_r, velocity + K1 * np.tanh(K2 * e), atol=1e-12)
    assert (np.abs(v_r - velocity) <= K1).all()  # the tanh bounds what an error may ask for


@given(eight, four, four, four)
def test_its_derivative_is_that_of_its_velocity(x, pose, motion, acceleration_d):
    h, velocity = 1e-6, np.array([0.1, -0.2, 0.05, 0.3])

    def v_r(t):
        then = x.copy()
        then[:4] += t * x[4:]
        moving = kinematic_law(
            then, pose + t * motion, velocity + t * acceleration_d, motion, NOTHING, K1, K2
        )
        return moving[0]

    _, rate, error = kinematic_law(x, pose, velocity, motion, acceleration_d, K1, K2)
    if abs(abs(error[3]) - math.pi) > 1e-3:
        np.testing.assert_allclose(rate, (v_r(h) - v_r(-h)) / (2 * h), atol=1e-6)


@given(eight, four, four)
def test_the_compensator_makes_the_velocity_error_fall_as_equation_56(x, v_r, rate):
    u = compensator(x, v_r, rate, K, GAINS, DRAGS)
    gamma_dot = rate - acceleration(x, u)
    np.testing.assert_allclose(gamma_dot, -K * (v_r - x[4:]), atol=1e-9)


@given(eight)
def test_at_rest_on_the_point_nothing_is_to_be_done(x):
    x[4:] = 0.0
    u, free, v_r, _ = cascade(x, x[:4], NOTHING, NOTHING, NOTHING, K1, K2, K, GAINS, DRAGS, NOTHING, WIDE)
    np.testing.assert_allclose(u, 0.0, atol=1e-9)
    np.testing.assert_allclose(v_r, 0.0, atol=1e-9)
    np.testing.assert_array_equal(u, free)


@given(arrays(float, 4, elements=st.floats(-5.0, 5.0)))
def test_saturation_keeps_the_level_direction_and_cuts_the_rest(u):
    limits = np.array([1.0, 0.5, 0.8, 1.2])
    cut = saturated(u, limits)
    assert (np.abs(cut) <= limits * (1 + 1e-12)).all()
    assert cut[0] * u[1] == pytest.approx(cut[1] * u[0], abs=1e-9)
    assert cut[0] * u[0] >= 0.0
    np.testing.assert_array_equal(cut[2:], np.clip(u[2:], -limits[2:], limits[2:]))
    np.testing.assert_allclose(saturated(cut, limits), cut, rtol=1e-12)
    if (np.abs(u) <= limits).all():
        np.testing.assert_array_equal(cut, u)


@given(eight, four, st.floats(0.0, 1.0))
def test_the_prediction_moves_as_the_fusion_does(x, u, dt):
    expected, _ = transition(x, dt, u, GAINS, DRAGS)
    np.testing.assert_allclose(moved(x, dt, u, GAINS, DRAGS), expected, atol=1e-9)
    without = np.array([1e-9, 1e-5, 1e-3, 0.0])  # where the closed form would cancel
    expected, _ = transition(x, dt, u, GAINS, without)
    np.testing.assert_allclose(moved(x, dt, u, GAINS, without), expected, atol=1e-8)


def test_without_turning_a_second_is_as_good_as_many_short_steps():
    x, u = np.array([0, 0, 1, 0.7, 0.4, -0.2, 0.1, 0.0]), np.array([0.1, -0.2, 0.3, 0.0])
    many = x
    for _ in range(100):
        many = moved(many, 0.01, u, GAINS, DRAGS)
    np.testing.assert_allclose(moved(x, 1.0, u, GAINS, DRAGS), many, atol=1e-12)


def test_the_commands_on_their_way_are_applied_when_they_take_effect():
    x = np.array([0, 0, 1, 0.2, 0.1, 0, 0, 0.0])
    stamps, commands = np.array([0.0, 0.1, 0.2, 0.3]), np.random.default_rng(0).uniform(-1, 1, (4, 4))
    got = predict_over_delay(x, 0.32, 0.55, stamps, commands, NOTHING, GAINS, DRAGS, 0.25)
    # From 0.32 on the command of 0.0 is in force (since 0.25), that of 0.1 from 0.35 on, of 0.2 from 0.45.
    want = moved(x, 0.03, commands[0], GAINS, DRAGS)
    want = moved(want, 0.1, commands[1], GAINS, DRAGS)
    want = moved(want, 0.1, commands[2], GAINS, DRAGS)
    np.testing.assert_allclose(got, want, atol=1e-12)


def test_before_the_first_command_nothing_is_in_force():
    x = np.array([0, 0, 1, 0.2, 0.1, 0, 0, 0.0])
    none = np.empty((0, 4))
    got = predict_over_delay(x, 0.0, 0.2, np.empty(0), none, NOTHING, GAINS, DRAGS, 0.2)
    np.testing.assert_allclose(got, moved(x, 0.2, NOTHING, GAINS, DRAGS), atol=1e-12)
    one = np.ones((1, 4))
    got = predict_over_delay(x, 0.0, 0.2, np.array([-0.1]), one, NOTHING, GAINS, DRAGS, 0.2)
    want = moved(moved(x, 0.1, NOTHING, GAINS, DRAGS), 0.1, one[0], GAINS, DRAGS)
    np.testing.assert_allclose(got, want, atol=1e-12)
    same = predict_over_delay(x, 0.5, 0.5, np.array([-0.1]), one, NOTHING, GAINS, DRAGS, 0.2)
    np.testing.assert_array_equal(same, x)


def test_a_push_acts_all_the_time_as_a_command_would():
    x, push = np.array([0, 0, 1, 0.2, 0.1, 0, 0, 0.0]), np.array([0.1, 0.2, -0.1, 0.0])
    stamps, commands = np.array([0.0]), np.full((1, 4), 0.3)
    got = predict_over_delay(x, 0.0, 0.2, stamps, commands, push, GAINS, DRAGS, 0.0)
    np.testing.assert_allclose(got, moved(x, 0.2, commands[0] + push, GAINS, DRAGS), atol=1e-12)
    free = cascade(x, x[:4], NOTHING, NOTHING, NOTHING, K1, K2, K, GAINS, DRAGS, NOTHING, WIDE)[0]
    taken_out = cascade(x, x[:4], NOTHING, NOTHING, NOTHING, K1, K2, K, GAINS, DRAGS, push, WIDE)[0]
    np.testing.assert_allclose(taken_out, free - push, atol=1e-12)


def test_a_delay_beyond_what_was_shown_stable_is_refused():
    CascadeSettings().check_delay(0.3)
    with pytest.raises(DelayTooLongError) as caught:
        CascadeSettings().check_delay(0.42)
    assert str(caught.value) == (
        "vehicle: its commands take effect after 0.42 s, the cascade was shown to be stable up to 0.30 s; "
        "mend the link, or lower K and raise longest_delay_s after trying it in simulation"
    )
    CascadeSettings(longest_delay_s=0.5).check_delay(0.42)
