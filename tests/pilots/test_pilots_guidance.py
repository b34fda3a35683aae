import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.control.limiter import limit_command
from noctule.messages import Limits
from noctule.pilots.guidance import Segment, cruise_velocity, stop_velocity, unit, yaw_rate
from noctule.pilots.settings import ProgressGains

GAINS, LIMITS, LAG = ProgressGains(), Limits(), 0.3
AHEAD = np.array([1.0, 0.0, 0.0])
place = st.tuples(*3 * [st.floats(-3.0, 3.0)]).map(np.array)
velocity = st.tuples(*3 * [st.floats(-0.6, 0.6)]).map(np.array)
angle = st.floats(-np.pi, np.pi)


def direction_of(azimuth, elevation):
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


direction = st.builds(direction_of, angle, st.floats(-1.5, 1.5))


def segment(to_target, turn=0.0, direction=AHEAD, following=None, v=(0.0, 0.0, 0.0)):
    return Segment(np.array(to_target, dtype=float), turn, direction, following, np.array(v))


def test_a_segment_splits_the_way_along_and_across():
    s = segment([2.0, 0.5, -0.25])
    assert s.along == 2.0
    assert s.across == pytest.approx([0.0, 0.5, -0.25])
    assert segment([-0.1, 0.0, 0.0]).along == pytest.approx(-0.1)


def test_what_is_too_short_has_no_direction():
    assert unit(np.array([0.0, 3.0, 4.0])) == pytest.approx([0.0, 0.6, 0.8])
    assert not unit(np.full(3, 1e-12)).any()


@given(angle)
def test_the_yaw_rate_is_bounded_and_turns_the_shorter_way(turn):
    rate = yaw_rate(turn, GAINS, LIMITS)
    assert abs(rate) <= LIMITS.yaw_rate
    assert rate * turn >= 0.0
    if abs(GAINS.yaw * turn) < LIMITS.yaw_rate:
        assert rate == pytest.approx(GAINS.yaw * turn)


@given(place, angle, direction, st.none() | direction)
def test_cruising_is_never_faster_than_the_cruise_speed(to_target, turn, along, following):
    v = cruise_velocity(segment(to_target, turn, along, following), GAINS)
    assert np.linalg.norm(v) <= GAINS.cruise * (1.0 + 1e-9)


@given(place, angle, direction, velocity)
def test_stopping_is_never_faster_than_cruising_or_than_can_be_braked(to_target, turn, along, v):
    s = segment(to_target, turn, along, None, v)
    wanted = stop_velocity(s, GAINS, LIMITS, LAG)
    assert np.linalg.norm(wanted) <= GAINS.cruise * (1.0 + 1e-9)
    assert np.linalg.norm(wanted) <= np.sqrt(LIMITS.acceleration * np.linalg.norm(to_target)) + 1e-9


@given(place, direction)
def test_the_correction_across_never_exceeds_the_slant(to_target, along):
    # Without a next segment the velocity splits exactly into along and across.
    v = cruise_velocity(segment(to_target, 0.0, along), GAINS)
    across = v - (v @ along) * along
    assert np.linalg.norm(across) <= 0.8 * GAINS.cruise * (1.0 + 1e-9)
    assert v @ along >= 0.6 * GAINS.cruise * (1.0 - 1e-9)  # it always goes on along the path


def test_near_the_path_the_correction_is_proportional():
    v = cruise_velocity(segment([2.0, 0.1, -0.05]), GAINS)
    assert v[1:] == pytest.approx([0.1 * GAINS.cross, -0.05 * GAINS.cross])


@pytest.mark.parametrize("stop", [False, True])
def test_the_farther_off_the_heading_the_slower(stop):
    def speed(turn):
        s = segment([2.0, 0.0, 0.0], turn)
        v = stop_velocity(s, GAINS, LIMITS, LAG) if stop else cruise_velocity(s, GAINS)
        return float(np.linalg.norm(v))

    speeds = [speed(turn) for turn in (0.0, 0.25, -0.5, 1.0)]
    assert speeds == sorted(speeds, reverse=True)
    assert speed(0.5) == pytest.approx(0.5 * GAINS.cruise)
    assert speed(-0.5) == pytest.approx(speed(0.5))


def test_the_next_direction_counts_only_near_the_image():
    left = np.array([0.0, 1.0, 0.0])
    far = cruise_velocity(segment([1.0, 0.0, 0.0], following=left), GAINS, blend=0.25)
    assert far == pytest.approx([GAINS.cruise, 0.0, 0.0])
    at = cruise_velocity(segment([0.0, 0.0, 0.0], following=left), GAINS, blend=0.25)
    assert at == pytest.approx(GAINS.cruise * np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0))


def test_the_velocity_turns_into_the_next_segment_without_a_jump():
    left = np.array([0.0, 1.0, 0.0])
    places = ([x, 0.0, 0.0] for x in np.arange(1.0, -0.01, -0.01))
    path = [cruise_velocity(segment(place, following=left), GAINS) for place in places]
    assert np.abs(np.diff(path, axis=0)).max() < 0.03


def test_stopping_is_proportional_to_where_the_vehicle_will_be():
    still = stop_velocity(segment([0.1, 0.02, 0.0]), GAINS, LIMITS, LAG)
    assert still == pytest.approx(GAINS.position * np.array([0.1, 0.02, 0.0]))
    # Going at 0.3 m/s it will be 0.09 m farther when it answers.
    moving = stop_velocity(segment([0.1, 0.02, 0.0], v=(0.3, 0.0, 0.0)), GAINS, LIMITS, LAG)
    assert moving == pytest.approx(GAINS.position * np.array([0.01, 0.02, 0.0]))


def test_at_the_target_nothing_is_wanted():
    assert not stop_velocity(segment([0.0, 0.0, 0.0]), GAINS, LIMITS, LAG).any()


def test_far_from_the_last_image_the_line_through_the_images_is_kept():
    v = stop_velocity(segment([3.0, 0.2, 0.0]), GAINS, LIMITS, LAG)
    # Straight at the target would be 0.067 of forward; the line is joined much sooner.
    assert v[1] / v[0] > 0.5
    assert v[1] == pytest.approx(0.2 * GAINS.cross)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.05, 3.0), st.floats(-0.45, 0.45))
def test_a_lagging_vehicle_stops_without_overshoot(distance, speed):
    dt, x, v, command = 1.0 / 30.0, 0.0, min(speed, np.sqrt(distance) / 2.0), np.zeros(4)
    command[0] = v
    farthest = 0.0
    for _ in range(600):
        s = segment([distance - x, 0.0, 0.0], v=(v, 0.0, 0.0))
        wanted = np.append(stop_velocity(s, GAINS, LIMITS, LAG), 0.0)
        command = limit_command(wanted, command, LIMITS, dt)
        for _ in range(10):
            v += (command[0] - v) / LAG * dt / 10.0
            x += v * dt / 10.0
        farthest = max(farthest, x)
    assert farthest <= distance + 0.03
    assert x == pytest.approx(distance, abs=1e-3)
