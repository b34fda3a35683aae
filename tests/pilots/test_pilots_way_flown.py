"""The last check of the half turn: the way the camera sees it fly against the way that it says."""

import numpy as np
import pytest

from noctule.pilots.way_flown import WayFlown

DT = 1.0 / 30.0


def first_contradiction(velocity, told, yaw, seconds=3.0):
    """Return when the heading is contradicted [s] of a drone that flies with `velocity` and says `told`."""
    rng, way = np.random.default_rng(0), WayFlown()
    for k in range(round(seconds / DT)):
        t = k * DT
        way.told(t, None if told is None else np.append(told, 0.0) + rng.normal(0.0, 0.06, 3), yaw)
        if way.contradicted(t, np.append(velocity, 0.0) * t + rng.normal(0.0, 0.0025, 3)):
            return t
    return None


@pytest.mark.parametrize("off", [0.0, 0.5, -1.0])
def test_a_heading_that_is_about_right_is_never_contradicted(off):
    assert first_contradiction((0.3, 0.0), (0.3, 0.0), off) is None


@pytest.mark.parametrize("off", [np.pi, np.pi - 0.5, np.pi + 0.5])
def test_the_wrong_half_turn_is_within_a_second(off):
    found = first_contradiction((0.3, 0.0), (0.3, 0.0), off)
    assert found is not None
    assert found < 1.0


def test_a_drone_that_hovers_or_says_nothing_tells_nothing():
    assert first_contradiction((0.03, 0.0), (0.03, 0.0), np.pi) is None
    assert first_contradiction((0.3, 0.0), None, np.pi) is None


def test_after_it_was_told_it_begins_anew():
    way = WayFlown()
    for k in range(40):
        way.told(k * DT, np.array([0.4, 0.0, 0.0]), np.pi)
        if way.contradicted(k * DT, np.array([0.4 * k * DT, 0.0, 1.0])):
            break
    way.forget()
    assert not way.contradicted(41 * DT, np.array([0.4 * 41 * DT, 0.0, 1.0]))
