import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from noctule.control.limiter import LimiterError, limit_command, limit_speed
from noctule.messages import Limits

LIMITS = Limits()
ANY = arrays(np.float64, 4, elements=st.floats(-1e4, 1e4))
INSIDE = ANY.map(lambda nu: np.clip(nu, -LIMITS.speeds, LIMITS.speeds))
DT = st.one_of(st.just(0.0), st.floats(1e-12, 1e-6), st.floats(1e-3, 2.0))


@given(ANY)
def test_speeds_are_within_their_limits_to_the_last_bit(nu):
    assert (np.abs(limit_speed(nu, LIMITS)) <= LIMITS.speeds).all()


@given(ANY)
def test_the_direction_of_flight_is_kept(nu):
    linear, limited = nu[:3], limit_speed(nu, LIMITS)[:3]
    assert np.linalg.norm(np.cross(linear, limited)) <= 1e-9 * np.linalg.norm(linear)
    assert linear @ limited >= 0.0


@given(INSIDE)
def test_a_velocity_within_the_limits_is_left_alone(nu):
    np.testing.assert_array_equal(limit_speed(nu, LIMITS), nu)


def test_one_fast_axis_slows_the_others_but_not_the_turn():
    np.testing.assert_allclose(limit_speed(np.array([1.2, 0.2, -0.1, 0.7]), LIMITS), [0.6, 0.1, -0.05, 0.7])


def test_a_fast_turn_does_not_slow_the_flight():
    np.testing.assert_allclose(limit_speed(np.array([0.5, 0.2, 0.0, -3.0]), LIMITS), [0.5, 0.2, 0.0, -0.8])


def test_an_axis_without_speed_is_dropped_and_the_others_go_on():
    level = Limits(up=0.0)
    np.testing.assert_array_equal(limit_speed(np.array([0.5, 0.2, 0.3, 0.0]), level), [0.5, 0.2, 0.0, 0.0])


@given(ANY, INSIDE, DT)
def test_a_command_is_always_within_all_limits(wanted, previous, dt):
    nu = limit_command(wanted, previous, LIMITS, dt)
    assert (np.abs(nu) <= LIMITS.speeds).all()
    assert np.linalg.norm(nu[:3] - previous[:3]) <= LIMITS.acceleration * dt
    assert abs(nu[3] - previous[3]) <= LIMITS.yaw_acceleration * dt


@given(ANY, ANY, DT)
def test_the_change_is_bounded_even_from_outside_the_speed_limits(wanted, previous, dt):
    nu = limit_command(wanted, previous, LIMITS, dt)
    assert np.linalg.norm(nu[:3] - previous[:3]) <= LIMITS.acceleration * dt
    assert abs(nu[3] - previous[3]) <= LIMITS.yaw_acceleration * dt


@given(ANY, INSIDE, DT)
def test_limiting_twice_is_limiting_once(wanted, previous, dt):
    once = limit_command(wanted, previous, LIMITS, dt)
    np.testing.assert_array_equal(limit_command(once, previous, LIMITS, dt), once)


def test_limiting_twice_is_limiting_once_from_rest_in_any_direction():
    for wanted in np.random.default_rng(2).normal(size=(300, 4)):
        once = limit_command(wanted, np.zeros(4), LIMITS, 1.0 / 30.0)
        np.testing.assert_array_equal(limit_command(once, np.zeros(4), LIMITS, 1.0 / 30.0), once)


@given(ANY, INSIDE, st.floats(0.01, 0.1))
def test_a_step_stays_within_the_limit_when_the_tick_is_rounded_a_little_short(wanted, previous, dt):
    nu = limit_command(wanted, previous, LIMITS, dt)
    short = dt * (1.0 - 0.9e-9)
    assert np.linalg.norm(nu[:3] - previous[:3]) <= LIMITS.acceleration * short
    assert abs(nu[3] - previous[3]) <= LIMITS.yaw_acceleration * short


def test_a_step_of_exactly_the_limit_is_cut_to_a_hair_under_it():
    nu = limit_command(np.array([0.1, 0.0, 0.0, -0.2]), np.zeros(4), LIMITS, 0.1)
    assert 0.1 * (1.0 - 3e-9) <= nu[0] <= 0.1 * (1.0 - 1e-9)
    assert 0.2 * (1.0 - 3e-9) <= -nu[3] <= 0.2 * (1.0 - 1e-9)


@given(INSIDE)
def test_a_feasible_command_is_passed_as_it_is(previous):
    step = 0.5 * np.array([0.01, -0.005, 0.002, 0.03])
    wanted = np.clip(previous + step, -LIMITS.speeds, LIMITS.speeds)
    np.testing.assert_array_equal(limit_command(wanted, previous, LIMITS, 0.04), wanted)


def test_the_full_acceleration_is_used():
    nu = limit_command(np.array([0.6, 0.6, 0.0, 0.8]), np.zeros(4), LIMITS, 0.1)
    assert np.linalg.norm(nu[:3]) == pytest.approx(0.1, rel=1e-8)
    assert nu[3] == pytest.approx(0.2, rel=1e-8)


def test_no_time_means_no_change():
    previous = np.array([0.1, 0.2, 0.3, 0.4])
    np.testing.assert_array_equal(limit_command(np.zeros(4), previous, LIMITS, 0.0), previous)


def test_a_constant_wish_is_reached_and_kept():
    wanted, nu = np.array([0.5, -0.3, 0.2, 0.6]), np.zeros(4)
    for _ in range(40):
        nu = limit_command(wanted, nu, LIMITS, 1.0 / 30.0)
    np.testing.assert_array_equal(nu, wanted)


def test_the_arguments_are_left_alone():
    wanted, previous = np.array([5.0, 5.0, 5.0, 5.0]), np.zeros(4)
    limit_command(wanted, previous, LIMITS, 0.1)
    assert (wanted == 5.0).all()
    assert (previous == 0.0).all()


@pytest.mark.parametrize(
    ("wanted", "previous", "dt", "message"),
    [
        (
            np.array([0.0, np.nan, 0.0, 0.0]),
            np.zeros(4),
            0.1,
            "wanted command: [0.0, nan, 0.0, 0.0], expected 4 finite numbers; hover instead",
        ),
        (
            np.zeros(4),
            np.zeros(3),
            0.1,
            "previous command: [0.0, 0.0, 0.0], expected 4 finite numbers; hover instead",
        ),
        (
            np.zeros(4),
            np.zeros(4),
            -0.1,
            "time step is -0.1 s, expected 0 or more; are the stamps in order?",
        ),
    ],
)
def test_what_cannot_be_bounded_is_refused(wanted, previous, dt, message):
    with pytest.raises(LimiterError) as caught:
        limit_command(wanted, previous, LIMITS, dt)
    assert str(caught.value) == message
