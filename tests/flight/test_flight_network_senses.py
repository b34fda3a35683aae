"""What nodes make of what their sensors say: calibrated, and turned the right way round, without a centre."""

from __future__ import annotations

import math

import numpy as np
import pytest

from noctule.estimation.contributions import from_bytes, half_turned, to_bytes
from noctule.estimation.filter_state import Prior, start_at
from noctule.estimation.measurements import Component
from noctule.estimation.network import Node
from noctule.estimation.sensors import HeadingCorrection, OnboardSensors, RoomSensor, Sensors
from noctule.flight.network.member import Member
from noctule.flight.network.senses import PATIENCE, Senses, Sight
from noctule.flight.network.wire import Kind
from noctule.geometry import wrap_angle
from noctule.messages import FlightState, HeadingMeasurement, PoseMeasurement, VehicleState

P = np.diag([0.004, 0.004, 0.004, 0.015]) ** 2
SPEED = 0.3


def report(stamp: float, yaw: float | None, speed: float = 0.0) -> VehicleState:
    v = np.array([speed, 0.0, 0.0])
    return VehicleState(stamp, FlightState.FLYING, yaw=yaw, v_body=v, height=1.0)


def sight(stamp: float, yaw: float, certain: bool = True, x: float = 0.0) -> Sight:
    return Sight(PoseMeasurement(stamp, np.array([x, 0.0, 1.0]), yaw, P, "registration"), certain)


def member(name: str = "depth") -> Member:
    return Member(name, start_at(0.0, np.array([0.0, 0.0, 1.0]), 0.0, Prior(position=2.0, yaw=2.0)))


class Flown:
    """A vehicle that flies along x with its nose ahead, below a camera; nodes in one process."""

    def __init__(self, *names: str, sensors: Sensors = Sensors()) -> None:
        self.members = {name: member(name) for name in names}
        self.senses = {name: Senses(name, sensors) for name in names}
        self.time = 0.0

    def share(self, name: str, sensed, now: float) -> None:
        for message in self.senses[name].take(sensed, self.members[name], now):
            for other, one in self.members.items():
                if other != name:
                    one.take(Kind.CONTRIBUTION, name, message, now)

    def fly(self, seconds: float, said: float | None, seen: float = math.pi, speed: float = SPEED) -> None:
        """Fly on; the vehicle says the heading `said`, the camera shows `seen` [rad]. Truth is 0."""
        for _ in range(int(30 * seconds)):
            self.time += 1.0 / 30.0
            t = self.time
            if "onboard" in self.members:
                self.share("onboard", report(t - 0.06, said, speed), t)
            self.share("depth", sight(t - 0.04, seen, True, speed * (t - 0.04)), t)

    def yaws(self) -> list[float]:
        return [one.node.estimate(self.time).yaw for one in self.members.values()]


def test_the_depth_node_knows_the_half_turn_by_what_the_vehicle_has_shared():
    flown = Flown("onboard", "depth", "fusion")
    flown.fly(0.5, said=0.3, seen=math.pi)
    assert np.abs(flown.yaws()).max() < 0.1
    assert flown.senses["onboard"].turns == 0


@pytest.mark.parametrize("said", [3.0, -2.6])
def test_a_half_turn_that_contradicts_the_way_it_flies_is_mended_at_all_nodes(said):
    flown = Flown("onboard", "depth", "fusion")
    flown.fly(0.3, said)
    assert np.abs(flown.yaws()).min() > 2.5
    flown.fly(2.7, said)
    assert np.abs(flown.yaws()).max() < 0.05
    assert flown.senses["onboard"].turns == 1
    known = [one.node.estimate(flown.time) for one in flown.members.values()]
    for one in known:
        assert np.abs(one.x - known[0].x).max() < 1e-9
        assert one.v_heading[0] == pytest.approx(SPEED, abs=0.03)
        assert abs(wrap_angle(one.x[8] + math.pi - said)) < 0.1  # what it says too much, once turned
        assert np.abs(one.x[9:]).max() < 3.0 * one.sd[9:].max()


def test_a_vehicle_that_hovers_says_nothing_of_its_half_turn():
    flown = Flown("onboard", "depth")
    flown.fly(3.0, said=3.0, speed=0.03)
    assert flown.senses["onboard"].turns == 0
    assert np.abs(flown.yaws()).min() > 2.9


def test_an_onboard_node_that_is_started_again_does_not_turn_the_others_back():
    flown = Flown("onboard", "depth", "fusion")
    flown.fly(3.0, said=3.0)
    again = member("onboard")
    again.node.rejoin(flown.members["fusion"].node)
    flown.members["onboard"], flown.senses["onboard"] = again, Senses("onboard")
    flown.fly(2.0, said=3.0)
    assert np.abs(flown.yaws()).max() < 0.05
    assert flown.senses["onboard"].turns == 0
    assert again.node.refusals["onboard: yaw gate"] == 0


def test_without_a_vehicle_the_view_from_above_is_believed_alone_after_a_while():
    flown = Flown("depth")
    flown.fly(PATIENCE - 0.1, said=None, seen=0.7)
    known = flown.members["depth"].node.estimate(flown.time)
    assert known.sd[0] < 0.01
    assert known.sd[3] > 1.0
    flown.fly(0.3, said=None, seen=0.7)
    assert flown.yaws()[0] == pytest.approx(0.7, abs=0.01)


def test_a_half_turn_that_is_not_certain_is_not_shared():
    one, senses = member(), Senses("depth")
    (first,) = senses.take(sight(0.1, 0.4, certain=False), one, 0.14)
    (late,) = senses.take(sight(0.2 + PATIENCE, 0.4, certain=False), one, 0.24 + PATIENCE)
    for message in (first, late):
        assert from_bytes(message).I[Component.YAW, Component.YAW] == 0.0
    (certain,) = senses.take(sight(0.3 + PATIENCE, 0.4), one, 0.34 + PATIENCE)
    assert from_bytes(certain).I[Component.YAW, Component.YAW] > 0.0


def test_what_the_site_was_calibrated_to_is_taken_off_before_it_is_shared():
    sensors = Sensors(
        onboard=OnboardSensors(heading=HeadingCorrection(constant=0.4), height_bias=0.2),
        depth=RoomSensor(position_bias=(0.1, 0.0, 0.2), delay=0.03),
        markers=RoomSensor(heading=HeadingCorrection(constant=0.05), heading_sd=0.2),
    )
    one = member()
    senses = Senses("depth", sensors)
    (said,) = senses.take(report(0.1, 1.4), one, 0.15)
    part = from_bytes(said)
    assert part.i[Component.YAW] / part.I[Component.YAW, Component.YAW] == pytest.approx(1.0)
    assert part.i[Component.Z] / part.I[Component.Z, Component.Z] == pytest.approx(0.8)
    (seen,) = senses.take(sight(0.2, 1.0), one, 0.24)
    part = from_bytes(seen)
    assert part.stamp == pytest.approx(0.17)
    assert part.i[0] / part.I[0, 0] == pytest.approx(-0.1)
    (marked,) = senses.take(HeadingMeasurement(0.25, 1.05, 1e-4, "markers"), one, 0.3)
    part = from_bytes(marked)
    assert (part.source, part.I[3, 3]) == ("markers", pytest.approx(25.0))
    assert part.i[3] / part.I[3, 3] == pytest.approx(1.0)


def test_what_one_camera_says_of_pose_and_markers_are_contributions_of_two_sources():
    one, senses = member(), Senses("ceiling")
    parts = [
        from_bytes(senses.take(sensed, one, 0.2)[0])
        for sensed in (sight(0.1, 0.2), HeadingMeasurement(0.1, 0.2, 1e-4, "markers"))
    ]
    assert [part.source for part in parts] == ["ceiling", "markers"]
    assert parts[0].sequence != parts[1].sequence


def test_a_vehicle_that_reports_nothing_says_so():
    one = member("onboard")
    assert Senses("onboard").take(VehicleState(0.1, FlightState.LANDED), one, 0.1) == []
    assert one.reason == "the vehicle reports nothing"


def test_a_half_turn_moves_nothing_but_the_yaw_and_reaches_all_that_counted_other_turns():
    moving = start_at(1.0, np.array([1.0, 2.0, 1.2]), 0.4, Prior(0.01, 0.02, 0.05, 0.05))
    moving.x[4:7] = 0.2, -0.1, 0.05
    parts = half_turned(moving, "onboard", 7)
    assert [part.sequence for part in parts] == [7, 8, 9]
    turned = start_at(1.0, moving.position, 0.4 + 4.0 * math.pi, Prior(0.01, 0.02, 0.05, 0.05))
    turned.x[4:7] = moving.x[4:7]
    for start in (moving, turned):
        node = Node("fusion", start)
        for part in parts:
            assert node.receive(from_bytes(to_bytes(part)))
        known = node.estimate(1.0)
        assert abs(wrap_angle(known.yaw - 0.4 - math.pi)) < 0.01
        assert known.sd[3] == pytest.approx(0.1, rel=0.01)
        np.testing.assert_allclose(np.delete(known.x, 3), np.delete(start.x, 3), atol=1e-9)
        np.testing.assert_allclose(known.sd[9:], np.hypot(0.05, start.sd[9:]))
        np.testing.assert_allclose(known.sd[:3], start.sd[:3])


@pytest.mark.parametrize("size", [8, 9])
def test_a_state_without_velocity_biases_is_turned_too(size):
    (part,) = half_turned(start_at(1.0, np.zeros(3), 0.4, size=size), "onboard", 0)
    assert part.i.size == size
