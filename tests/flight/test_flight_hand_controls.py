"""Keys become a velocity that decays, and nothing is touched whatever is pressed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.flight.hand_controls import DEAD_MAN, SPEEDS, Bumper, Sticks
from noctule.flight.key_script import STICKS
from noctule.geometry import Pose
from noctule.messages import Command, Limits, Truth
from noctule.simulation import SimulatedWorld
from noctule.simulation.spec import CameraSpec, RoomSpec, VehicleSpec

DT = 1.0 / 30.0


@pytest.mark.parametrize(("key", "axis", "sign"), [(k, a, s) for k, (a, s) in STICKS.items()])
def test_a_key_moves_its_axis_only_and_without_it_the_vehicle_hovers(key, axis, sign):
    sticks = Sticks(Limits())
    sticks.press(key, 0.0)
    expected = np.zeros(4)
    expected[axis] = sign * SPEEDS[axis]
    np.testing.assert_array_equal(sticks.wanted(0.0), expected)
    np.testing.assert_array_equal(sticks.wanted(DEAD_MAN), np.zeros(4))


def test_a_key_that_repeats_holds_its_speed():
    sticks = Sticks(Limits())
    speeds = []
    for tick in range(60):
        sticks.press("w", tick * DT)
        speeds.append(sticks.wanted((tick + 1) * DT)[0])
    assert min(speeds) > 0.9 * SPEEDS[0]


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_the_longer_the_key_is_let_go_the_slower(first, second):
    sticks = Sticks(Limits())
    sticks.press("q", 0.0)
    early, late = sorted((first, second))
    assert sticks.wanted(late)[3] <= sticks.wanted(early)[3]


def test_the_opposite_key_takes_over_and_hover_lets_go_of_all():
    sticks = Sticks(Limits())
    sticks.press("w", 0.0)
    sticks.press("a", 0.0)
    sticks.press("s", 0.1)
    assert sticks.wanted(0.1)[0] == -SPEEDS[0]
    sticks.release()
    np.testing.assert_array_equal(sticks.wanted(0.1), np.zeros(4))


def test_no_key_goes_beyond_the_limits():
    sticks = Sticks(Limits(forward=0.1, yaw_rate=0.2))
    sticks.press("w", 0.0)
    sticks.press("e", 0.0)
    assert sticks.wanted(0.0).tolist() == [0.1, 0.0, 0.0, -0.2]


def test_something_in_the_way_stops_the_flight_but_not_the_turn():
    bumper = Bumper(lambda pose: ("wall_front",) if pose.position[0] > 1.0 else (), 0.3, Limits(), DT)
    still = Truth(0.0, Pose(np.array([0.99, 0.0, 1.0]), 0.0), np.zeros(3), 1.0)
    wanted = np.array([0.4, 0.0, 0.0, 0.05])
    nu, names = bumper.command(wanted, Command(), still)
    assert names == ("wall_front",)
    np.testing.assert_allclose(nu, [0.0, 0.0, 0.0, 0.05])
    nu, names = bumper.command(-wanted, Command(), still)
    assert names == ()
    assert nu[0] < 0.0


@pytest.mark.parametrize("key", ["w", "s", "a", "d", "r", "f"])
def test_whichever_way_one_flies_nothing_is_touched_and_one_gets_close(key):
    """In the simulated room, with its furniture, for half a minute at full speed."""
    limits, vehicle = Limits(), VehicleSpec()
    start = Pose(np.array([0.0, 0.0, 1.0]), 0.4)
    with SimulatedWorld(RoomSpec(seed=2), vehicle, CameraSpec(), start, 2) as world, world.vehicle:
        bumper = Bumper(lambda pose: world.clearance(pose)[1], vehicle.lag, limits, DT)
        sticks, previous, stopped = Sticks(limits), Command(), []
        for tick in range(900):
            world.clock.sleep_until(tick * DT)
            truth = world.referee.truth()
            assert truth.contacts == ()
            sticks.press(key, tick * DT)
            nu, names = bumper.command(sticks.wanted(tick * DT), previous, truth)
            previous = world.vehicle.send(Command.from_array(nu), 1.0)
            stopped += names
        assert stopped
        axis, sign = STICKS[key]
        step = np.zeros(3)
        step[axis] = 0.1 * sign
        c, s = np.cos(0.4), np.sin(0.4)
        ahead = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ step
        assert world.clearance(Pose(truth.pose.position + ahead, 0.4))[1] == (stopped[-1],)
