"""The loop, flown on a fake world."""

from __future__ import annotations

import gc
import os
import signal
import threading

import numpy as np
import pytest
from flight_fakes import FakeWorld, ScriptedPilot, forward, no_match

from noctule.devices.protocols import DeviceError
from noctule.flight.fence import Fence
from noctule.flight.flown import Aborted, Flown
from noctule.flight.interrupt import interruptible
from noctule.flight.loop import LoopSettings, fly
from noctule.flight.orders import Orders
from noctule.flight.reader import read_recording
from noctule.flight.recording import FlightRecorder, RecordingError
from noctule.flight.rig import take_off
from noctule.flight.supervisor import Bounds
from noctule.geometry import Pose
from noctule.messages import (
    Command,
    Decision,
    FlightState,
    MatchRequest,
    MatchResult,
    Observation,
    Outcome,
    Picture,
)

DT = 1.0 / 30.0
START = Pose(np.array([0.0, 0.0, 1.0]), 0.0)


def fly_fake(world, pilot, recorder=None, matcher=no_match, bounds=None, orders=None, **settings) -> Flown:
    chosen = LoopSettings(**{"time_limit_s": 5.0, "land_at_end": False, **settings})
    return fly(
        world.rig, pilot, matcher, chosen, bounds or Bounds(), recorder, lambda e, text: None, START, orders
    )


def ends_after(ticks: int, outcome: Outcome, reason: str = "") -> ScriptedPilot:
    return ScriptedPilot(
        lambda i, o: Decision(Command(0.3), "flying", outcome=outcome if i == ticks else None, reason=reason)
    )


@pytest.mark.parametrize("outcome", [Outcome.REACHED, Outcome.LOST, Outcome.STUCK])
def test_the_pilot_may_end_the_flight_and_its_reason_is_kept(outcome):
    flown = fly_fake(FakeWorld(), ends_after(30, outcome, "because"))
    assert (flown.outcome, flown.reason, flown.error) == (outcome, "because", None)
    assert flown.end - flown.begin == pytest.approx(1.0)


def test_the_time_limit_makes_stuck():
    flown = fly_fake(FakeWorld(), forward(0.05), time_limit_s=2.0)
    assert (flown.outcome, flown.reason) == (Outcome.STUCK, "the time limit of 2 s has passed")
    assert flown.end - flown.begin == pytest.approx(2.0)


def test_the_referees_truth_makes_collided_and_names_what_was_touched():
    world = FakeWorld()
    world.referee.wall_x = 0.3
    flown = fly_fake(world, forward(0.3))
    assert (flown.outcome, flown.reason) == (Outcome.COLLIDED, "touched column_0")
    assert flown.samples.truths[-1].clearance <= 0.0


def test_without_a_referee_nothing_is_judged_by_truth():
    world = FakeWorld()
    world.referee.wall_x = 0.3
    object.__setattr__(world.rig, "referee", None)
    flown = fly_fake(world, forward(0.3), time_limit_s=2.0)
    assert flown.outcome == Outcome.STUCK
    assert flown.samples.truths == []


def test_a_tick_tells_the_pilot_the_newest_picture_once_under_its_own_stamp():
    world, pilot = FakeWorld(), forward()
    fly_fake(world, pilot, time_limit_s=1.0, rate_hz=60.0)
    seen = [o.picture.stamp for o in pilot.told if o.picture is not None]
    assert len(seen) == pytest.approx(len(pilot.told) / 2, abs=2)
    assert seen == sorted(set(seen))


def test_every_command_sent_is_within_one_step_of_the_last_to_the_end():
    world = FakeWorld()
    rng = np.random.default_rng(2)
    pilot = ScriptedPilot(lambda i, o: Decision(Command(*rng.uniform(-2, 2, 4)), "wild"))
    flown = fly_fake(world, pilot, time_limit_s=3.0)
    sent = np.array([c.as_array() for c in [Command(), *world.vehicle.sent]])
    assert (np.linalg.norm(np.diff(sent, axis=0)[:, :3], axis=1) <= 1.0 * DT).all()
    assert world.vehicle.sent[-1] == Command()
    assert flown.samples.sent == world.vehicle.sent


def test_the_end_is_a_hover_and_with_landing_the_ground():
    world = FakeWorld()
    fly_fake(world, ends_after(30, Outcome.REACHED))
    assert (world.vehicle.flight_state, world.vehicle.command) == (FlightState.FLYING, Command())
    world = FakeWorld()
    fly_fake(world, ends_after(30, Outcome.REACHED), land_at_end=True)
    assert world.vehicle.flight_state == FlightState.LANDED
    assert world.vehicle.calls == ["land"]


def test_a_match_arrives_in_the_observation_its_delay_later_and_of_the_picture_of_the_request():
    def answer(i: int, observation: Observation) -> Decision:
        requests = (MatchRequest(4),) if i == 10 else ()
        return Decision(Command(), "matching", requests=requests)

    def matcher(picture: Picture, index: int) -> MatchResult:
        point = np.full((1, 2), float(picture.pixels[0, 0, 0]))
        return MatchResult(picture.stamp, index, point, point)

    pilot = ScriptedPilot(answer)
    fly_fake(FakeWorld(), pilot, matcher=matcher, time_limit_s=1.0, match_delay_s=0.15)
    ((i, arrived),) = [(i, o) for i, o in enumerate(pilot.told) if o.matches]
    asked = pilot.told[10]
    assert asked.picture is not None
    assert arrived.stamp - asked.stamp == pytest.approx(5 * DT)  # the first tick at or after 0.15 s
    assert arrived.matches[0].stamp == asked.picture.stamp
    assert i == 15


def test_the_same_flight_twice_tells_the_pilot_the_same():
    def answer(i: int, observation: Observation) -> Decision:
        return Decision(
            Command(0.2, 0.01 * (i % 7)), "flying", requests=(MatchRequest(i),) if i % 4 == 0 else ()
        )

    told = []
    for _ in range(2):
        pilot = ScriptedPilot(answer)
        fly_fake(FakeWorld(), pilot, time_limit_s=1.5)
        told.append(repr(pilot.told))
    assert told[0] == told[1]


def test_a_camera_that_dies_brings_it_to_hover_then_to_the_ground():
    world, pilot = FakeWorld(), forward()
    world.camera.dead_after = 1.0
    flown = fly_fake(world, pilot, time_limit_s=20.0)
    assert flown.outcome == Outcome.ABORTED
    assert flown.reason == (
        "the supervisor ended the flight: no picture, depth frame, report or command came for too long"
    )
    assert world.vehicle.flight_state == FlightState.LANDED
    assert flown.end == pytest.approx(1.0 + 0.5 + 3.0, abs=0.1)
    slow = [c.forward for c in world.vehicle.sent[-60:]]
    assert max(slow) == 0.0


def test_a_vehicle_that_stops_reporting_is_brought_to_hover():
    world = FakeWorld()
    world.vehicle.frozen_since = 0.5
    fly_fake(world, forward(), time_limit_s=2.0)
    assert world.vehicle.command == Command()


def test_a_low_battery_lands():
    world = FakeWorld()
    world.vehicle.battery = 0.05
    flown = fly_fake(world, forward())
    assert flown.reason == "the supervisor ended the flight: the battery is low"
    assert world.vehicle.flight_state == FlightState.LANDED


def test_the_fence_holds_by_reports_alone():
    world = FakeWorld()
    object.__setattr__(world.rig, "referee", None)
    fence = Fence((-1.0, -1.0, 0.2), (0.8, 1.0, 2.0), 0.005, 0.02)
    fly_fake(world, forward(0.5), bounds=Bounds(fence=fence), time_limit_s=8.0)
    assert 0.6 < world.vehicle.position[0] < 0.8


def test_a_vehicle_in_emergency_is_sent_nothing_more():
    world = FakeWorld()

    def answer(i: int, observation: Observation) -> Decision:
        if i == 20:
            world.vehicle.emergency()
        return Decision(Command(0.2), "flying")

    flown = fly_fake(world, ScriptedPilot(answer))
    assert flown.outcome == Outcome.ABORTED
    assert len(world.vehicle.sent) <= 21


def test_ctrl_c_hovers_lands_and_leaves_a_readable_recording(tmp_path):
    world = FakeWorld()

    def answer(i: int, observation: Observation) -> Decision:
        if i == 40:
            os.kill(os.getpid(), signal.SIGINT)
        return Decision(Command(0.3), "flying")

    before = signal.getsignal(signal.SIGINT)
    with FlightRecorder(tmp_path / "a.mcap") as recorder:
        flown = fly_fake(world, ScriptedPilot(answer), recorder)
    assert flown.outcome == Outcome.ABORTED
    assert isinstance(flown.error, Aborted)
    assert str(flown.error) == (
        "flight: ended by Ctrl-C after 1.3 s, hovered and landed; the recording until then can be read"
    )
    assert world.vehicle.flight_state == FlightState.LANDED
    assert signal.getsignal(signal.SIGINT) == before
    recording = read_recording(tmp_path / "a.mcap")
    assert recording.complete
    assert len(recording.flown) == 41
    assert recording.ticks[-1].supervisor == "landed"


def test_a_second_ctrl_c_does_not_wait_but_still_lands():
    world = FakeWorld()

    def answer(i: int, observation: Observation) -> Decision:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        return Decision(Command(0.3), "flying")

    with pytest.raises(KeyboardInterrupt):
        fly_fake(world, ScriptedPilot(answer))
    assert world.vehicle.calls == ["land"]


class FullDisk(FlightRecorder):
    """A recorder whose disk is full after a number of ticks."""

    def __init__(self, ticks: int) -> None:
        self.left = ticks

    def tick(self, *args, **kwargs) -> None:
        self.left -= 1
        if self.left < 0:
            raise RecordingError("recording x: No space left on device")


@pytest.mark.parametrize("ticks", [0, 30])
def test_a_full_disk_ends_the_flight_in_hover_and_on_the_ground(ticks):
    world = FakeWorld()
    flown = fly_fake(world, forward(), FullDisk(ticks))
    assert flown.outcome == Outcome.ABORTED
    assert isinstance(flown.error, RecordingError)
    assert world.vehicle.flight_state == FlightState.LANDED


def test_a_pilot_with_a_fault_is_landed_and_its_error_handed_on():
    world = FakeWorld()

    def answer(i: int, observation: Observation) -> Decision:
        if i == 30:
            raise ZeroDivisionError("a fault of the pilot")
        return Decision(Command(0.3), "flying")

    flown = fly_fake(world, ScriptedPilot(answer))
    assert isinstance(flown.error, ZeroDivisionError)
    assert flown.reason == "ZeroDivisionError: a fault of the pilot"
    assert world.vehicle.flight_state == FlightState.LANDED
    steps = np.diff([c.forward for c in world.vehicle.sent])
    assert np.abs(steps).max() <= DT


def test_a_link_that_breaks_ends_the_flight_with_its_own_first_error():
    world = FakeWorld()
    send = world.vehicle.send

    def broken(command: Command, valid_for: float) -> Command:
        if len(world.vehicle.sent) >= 20:
            raise DeviceError("fake vehicle: no answer")
        return send(command, valid_for)

    world.vehicle.send = broken
    flown = fly_fake(world, forward())
    assert flown.outcome == Outcome.ABORTED
    assert str(flown.error) == "fake vehicle: no answer"
    assert flown.reason == "DeviceError: fake vehicle: no answer"


def test_in_a_thread_of_its_own_the_flight_leaves_signals_alone():
    before, seen = signal.getsignal(signal.SIGINT), []

    def run() -> None:
        with interruptible() as asked:
            seen.append((asked.is_set(), signal.getsignal(signal.SIGINT)))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert seen == [(False, before)]


def test_what_was_there_before_the_flight_is_collected_again_after_it():
    fly_fake(FakeWorld(), forward(), time_limit_s=0.2)
    assert gc.get_freeze_count() == 0


def ordering(orders: Orders, at: dict[int, str]) -> ScriptedPilot:
    """A pilot that flies ahead while a person gives orders at the given ticks."""

    def answer(i: int, observation: Observation) -> Decision:
        if i in at:
            what, _, back = at[i].partition(" ")
            event = getattr(orders, what)
            event.clear() if back else event.set()
        return Decision(Command(0.3), "flying")

    return ScriptedPilot(answer)


def test_an_emergency_order_cuts_the_motors_in_the_same_tick():
    world, orders = FakeWorld(), Orders()
    flown = fly_fake(world, ordering(orders, {30: "emergency"}), orders=orders)
    assert world.vehicle.calls == ["emergency"]
    assert (flown.outcome, len(world.vehicle.sent)) == (Outcome.ABORTED, 30)


def test_an_order_to_land_brakes_first_and_says_why_the_flight_ended():
    world, orders = FakeWorld(), Orders()
    flown = fly_fake(world, ordering(orders, {30: "land"}), orders=orders)
    assert flown.reason == "the supervisor ended the flight: landing was asked for"
    assert world.vehicle.sent[30].forward == pytest.approx(0.3 - DT)
    assert world.vehicle.flight_state == FlightState.LANDED


def test_an_order_to_hover_holds_until_it_is_taken_back():
    world, orders = FakeWorld(), Orders()
    flown = fly_fake(
        world, ordering(orders, {30: "hover", 60: "hover back"}), orders=orders, time_limit_s=4.0
    )
    speeds = [c.forward for c in world.vehicle.sent]
    assert speeds[29] == 0.3
    assert speeds[45] == speeds[59] == 0.0
    assert speeds[90] == 0.3
    assert flown.outcome == Outcome.STUCK


def test_a_recording_holds_the_pilots_ticks_and_the_braking_after_them(tmp_path):
    world, pilot = FakeWorld(), ends_after(20, Outcome.REACHED)
    with FlightRecorder(tmp_path / "a.mcap", lossless=True) as recorder:
        flown = fly_fake(world, pilot, recorder)
    recording = read_recording(tmp_path / "a.mcap")
    assert repr([t.observation() for t in recording.flown]) == repr(pilot.told)
    assert len(recording.ticks) > len(recording.flown) == 21
    assert [t.sent for t in recording.ticks] == flown.samples.sent
    assert [t.tick_ms for t in recording.flown] == flown.samples.tick_ms


def test_take_off_arms_climbs_and_waits_for_flight():
    world = FakeWorld()
    world.vehicle.flight_state = FlightState.LANDED
    take_off(world.rig, 1.0)
    assert world.vehicle.calls == ["arm", "takeoff"]
    assert world.vehicle.flight_state == FlightState.FLYING


def test_a_vehicle_that_hovers_already_does_not_take_off():
    world = FakeWorld()
    take_off(world.rig, 1.0)
    assert world.vehicle.calls == []


def test_a_take_off_that_never_ends_is_given_up_with_what_was_found():
    world = FakeWorld()
    world.vehicle.flight_state = FlightState.LANDED
    world.vehicle.takeoff_s = np.inf
    with pytest.raises(DeviceError) as caught:
        take_off(world.rig, 1.0)
    assert str(caught.value) == (
        "take-off: the vehicle still says 'taking_off' after 20 s, expected 'flying'; "
        "is it armed, level and charged?"
    )
    assert world.vehicle.calls[-1] == "land"
