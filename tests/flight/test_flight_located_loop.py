"""The loop below a depth camera, on a fake world: no picture, no matcher, and the pilot says where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flight_fakes import FakeWorld, ScriptedPilot, forward, no_match, whereabouts

from noctule.flight.fence import Fence
from noctule.flight.flown import Flown
from noctule.flight.loop import LoopSettings, fly
from noctule.flight.reader import read_recording
from noctule.flight.recording import FlightRecorder
from noctule.flight.rig import Rig
from noctule.flight.supervisor import Bounds
from noctule.geometry import Pose
from noctule.messages import Command, Decision, FlightState, Limits, Outcome

DT = 1.0 / 30.0
START = Pose(np.array([0.0, 0.0, 1.0]), 0.0)


def fly_located(world, pilot, recorder=None, rig=None, bounds=None, matcher=None, **settings) -> Flown:
    chosen = LoopSettings(**{"time_limit_s": 5.0, "land_at_end": False, **settings})
    bounds = bounds or Bounds()
    return fly(rig or world.located_rig, pilot, matcher, chosen, bounds, recorder, lambda e, t: None, START)


def test_a_tick_needs_neither_picture_nor_matcher_and_tells_each_depth_frame_once():
    world = FakeWorld()
    pilot = forward()
    flown = fly_located(world, pilot, time_limit_s=1.0)
    assert flown.outcome == Outcome.STUCK
    told = [o for o in pilot.told if o.depth is not None]
    assert all(o.picture is None and o.matches == () for o in pilot.told)
    assert len({o.depth.stamp for o in told}) == len(told) >= 29
    assert all(o.stamp - o.depth.stamp == pytest.approx(DT) for o in told)


def test_the_pilot_is_told_what_was_really_sent_at_the_last_tick():
    world = FakeWorld()
    pilot = forward(5.0)
    flown = fly_located(world, pilot, time_limit_s=1.0)
    assert pilot.told[0].sent is None
    assert [o.sent for o in pilot.told[1:]] == flown.samples.sent[: len(pilot.told) - 1]
    assert pilot.told[-1].sent.forward == pytest.approx(0.6)  # the limit, not what was asked


def test_the_fence_is_held_by_where_the_pilot_is_not_by_what_the_vehicle_adds_up():
    def answer(i, observation):
        # The vehicle reports no velocity of its own: dead reckoning would see only the commands.
        where = whereabouts(observation.stamp, world.vehicle.position + np.array([0.5, 0.0, 0.0]), sd=0.01)
        return Decision(Command(0.5), "follow", whereabouts=where)

    world = FakeWorld()
    fence = Fence((-5.0, -5.0, 0.2), (1.5, 5.0, 2.0))
    bounds = Bounds(limits=Limits(), fence=fence)
    fly_located(world, ScriptedPilot(answer), bounds=bounds, time_limit_s=8.0)
    # It stops at the fence less three deviations, by its own word 0.5 m ahead of where it is.
    assert world.vehicle.position[0] == pytest.approx(1.5 - 0.03 - 0.5, abs=0.01)


def test_dead_reckoning_goes_on_where_the_pilot_falls_silent():
    def answer(i, observation):
        known = whereabouts(observation.stamp, np.array([1.0, 0.0, 1.0])) if i < 5 else None
        return Decision(Command(0.5), "follow", whereabouts=known)

    world = FakeWorld()
    bounds = Bounds(fence=Fence((-5.0, -5.0, 0.2), (2.0, 5.0, 2.0)))
    fly_located(world, ScriptedPilot(answer), bounds=bounds, time_limit_s=8.0)
    flown = 1.0 + world.vehicle.position[0]
    assert 1.8 < flown < 2.05


def test_a_depth_camera_that_dies_leaves_the_pilot_its_time_then_lands():
    world = FakeWorld()
    world.ceiling.dead_after = 1.0
    pilot = forward(0.0)
    flown = fly_located(world, pilot, time_limit_s=60.0)
    assert flown.outcome == Outcome.ABORTED
    assert flown.reason == (
        "the supervisor ended the flight: no picture, depth frame, report or command came for too long"
    )
    assert flown.end == pytest.approx(1.0 + 12.0 + 3.0, abs=0.1)
    assert world.vehicle.flight_state == FlightState.LANDED


def test_a_flight_that_is_lost_lands_where_it_is_told_to_and_hovers_elsewhere():
    for land, after in ((True, FlightState.LANDED), (False, FlightState.FLYING)):
        world = FakeWorld()
        pilot = ScriptedPilot(lambda i, o: Decision(Command(), "search", outcome=Outcome.LOST, reason="dark"))
        flown = fly_located(world, pilot, land_when_lost=land)
        assert (flown.outcome, flown.reason) == (Outcome.LOST, "dark")
        assert world.vehicle.flight_state == after


def test_with_both_cameras_the_one_that_is_flown_by_counts():
    def answer(i, observation):
        known = whereabouts(observation.stamp, np.array([0.0, 0.0, 1.0])) if i < 90 else None
        return Decision(Command(), "located" if i < 90 else "visual", whereabouts=known)

    world = FakeWorld()
    world.camera.dead_after = 1.0
    rig = replace(world.rig, ceiling=world.ceiling)
    assert isinstance(rig, Rig)
    flown = fly_located(world, ScriptedPilot(answer), rig=rig, matcher=no_match, time_limit_s=20.0)
    # Pictures end at 1 s; nobody misses them until the pilot flies by them, from 3 s on.
    assert flown.outcome == Outcome.ABORTED
    assert flown.end == pytest.approx(1.0 + 0.5 + 3.0, abs=0.1)


def test_the_recording_holds_where_the_pilot_was(tmp_path):
    def answer(i, observation):
        return Decision(Command(0.1), "follow", whereabouts=whereabouts(observation.stamp, np.ones(3) * i))

    world = FakeWorld()
    with FlightRecorder(tmp_path / "flight.mcap") as recorder:
        flown = fly_located(world, ScriptedPilot(answer), recorder, time_limit_s=0.3)
    ticks = read_recording(tmp_path / "flight.mcap").flown
    kept = [tick.decision.whereabouts.position[0] for tick in ticks]
    assert kept == [known.position[0] for known in flown.samples.whereabouts] == list(range(len(ticks)))
