"""The figures of a flight, and of many."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from flight_fakes import FakeWorld, ScriptedPilot, no_match

from noctule.flight.loop import LoopSettings, fly
from noctule.flight.mission import Mission
from noctule.flight.reader import read_recording
from noctule.flight.recording import FlightRecorder
from noctule.flight.summary import (
    Samples,
    command_steps,
    errors_at_end,
    pool,
    reference_of,
    samples_of,
    summarise,
    summary_of,
)
from noctule.flight.supervisor import Bounds
from noctule.geometry import Pose
from noctule.messages import Command, Decision, Diagnostics, Outcome, Truth

KEYS = {
    "outcome", "reason", "duration_s", "position_error_m", "yaw_error_deg", "epsilon_px", "min_clearance_m",
    "max_command_step", "tick_ms", "realtime_factor", "cross_track_max_m", "cross_track_mean_m", "laps",
    "recording", "report",
}  # fmt: skip


def truth(x: float, yaw: float = 0.0, clearance: float = 1.0) -> Truth:
    return Truth(0.0, Pose(np.array([x, 0.0, 1.0]), yaw), np.zeros(3), clearance)


def test_the_first_command_counts_from_hover_and_linear_steps_by_their_length():
    linear, angular = command_steps(np.array([[0.3, 0.4, 0.0, -0.2], [0.3, 0.4, 0.1, 0.5]]))
    assert linear == pytest.approx(0.5)
    assert angular == pytest.approx(0.7)
    assert command_steps(np.empty((0, 4))) == (0.0, 0.0)


def test_errors_are_taken_in_space_and_the_short_way_round():
    goal = Pose(np.array([0.0, 0.3, 1.4]), np.radians(-179.0))
    distance, turn = errors_at_end(truth(0.0, np.radians(179.5)), goal)
    assert distance == pytest.approx(0.5)
    assert turn == pytest.approx(1.5)


def test_without_a_referee_or_a_known_goal_there_are_no_metres():
    assert errors_at_end(None, Pose(np.zeros(3), 0.0)) == (None, None)
    assert errors_at_end(truth(0.0), None) == (None, None)


def test_figures_are_those_of_the_samples():
    samples = Samples(
        times=[1.0, 1.1, 1.2],
        tick_ms=[1.0, 2.0, 9.0],
        epsilons=[30.0, 4.5, float("nan")],
        truths=[truth(0.0), truth(0.1, clearance=0.2), truth(0.3)],
        sent=[Command(0.1), Command(0.2), Command()],
    )
    summary = summarise(samples, Pose(np.array([0.3, 0.0, 1.1]), 0.1), "reached", "", 4.0)
    assert set(summary) == KEYS
    assert summary["duration_s"] == pytest.approx(0.2)
    assert summary["position_error_m"] == pytest.approx(0.1)
    assert summary["yaw_error_deg"] == pytest.approx(np.degrees(0.1))
    assert summary["epsilon_px"] == 4.5  # the last that was known
    assert summary["min_clearance_m"] == 0.2
    assert summary["max_command_step"] == {"linear": pytest.approx(0.2), "angular": 0.0}
    assert summary["tick_ms"]["median"] == 2.0
    json.dumps(summary, allow_nan=False)


def test_a_room_with_nothing_to_meet_has_no_clearance():
    samples = Samples(times=[0.0], truths=[truth(0.0, clearance=float("inf"))], sent=[Command()])
    assert summarise(samples, None, "reached", "", None)["min_clearance_m"] is None


def test_an_empty_flight_has_a_summary_too():
    summary = summarise(Samples(), None, "aborted", "Ctrl-C", None)
    assert set(summary) == KEYS
    json.dumps(summary, allow_nan=False)


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """Two flights that were recorded, with the summary that was noted at the end of each."""
    runs = []
    for seed in range(2):
        world = FakeWorld()
        world.referee.wall_x = 2.0 - seed
        pilot = ScriptedPilot(
            lambda i, o: Decision(
                Command(0.2),
                "flying",
                Diagnostics(epsilon_px=50.0 - i),
                outcome=Outcome.REACHED if i == 44 else None,
            )
        )
        path = tmp_path_factory.mktemp(f"flight{seed}") / "flight.mcap"
        start = Pose(np.array([0.0, 0.0, 1.0]), 0.0)
        with FlightRecorder(path) as recorder:
            recorder.note("truth", {"key_poses": "[[9, 9, 9, 0, 0, 0], [0.25, 0.0, 1.0, 0.0, 0.0, 0.0]]"})
            settings = LoopSettings(land_at_end=False)
            flown = fly(world.rig, pilot, no_match, settings, Bounds(), recorder, lambda e, t: None, start)
            goal = Pose(np.array([0.25, 0.0, 1.0]), 0.0)
            summary = summarise(flown.samples, goal, str(flown.outcome), flown.reason, flown.realtime_factor)
            recorder.note("summary", {name: json.dumps(value) for name, value in summary.items()})
        runs.append({"seed": seed, **summary, "recording": str(path)})
    return runs


def test_a_recording_alone_gives_the_summary_that_was_noted(flight):
    recording = read_recording(Path(flight[0]["recording"]))
    assert {"seed": 0, **summary_of(recording)} == flight[0]


def test_a_recording_without_its_summary_gives_the_same_figures_but_the_wall_clock(flight):
    recording = read_recording(Path(flight[1]["recording"]))
    bare = dataclasses.replace(recording, notes={"truth": recording.notes["truth"]})
    assert summary_of(bare) == {**summary_of(recording), "realtime_factor": None}


def test_a_recording_cut_short_is_aborted_with_what_is_known(flight):
    recording = read_recording(Path(flight[0]["recording"]))
    cut = dataclasses.replace(recording, notes={}, ticks=recording.ticks[:20], complete=False)
    summary = summary_of(cut)
    assert (summary["outcome"], summary["reason"]) == ("aborted", "the recording ends before the flight does")
    assert summary["duration_s"] == pytest.approx(19 / 30)
    assert summary["position_error_m"] is None
    assert set(summary) == KEYS
    assert samples_of(cut.ticks).times == [t.stamp for t in cut.ticks]


def test_many_flights_are_pooled_with_the_keys_and_nesting_of_one(flight):
    pooled = pool(flight)
    assert set(pooled) == KEYS - {"reason"}
    assert pooled["outcome"]["reached"] == 1.0
    assert set(pooled["outcome"]) == {"reached", "collided", "stuck", "lost", "aborted"}
    assert set(pooled["max_command_step"]) == {"linear", "angular"}
    assert set(pooled["tick_ms"]) == {"median", "p95"}


def test_the_pooled_times_of_ticks_are_those_of_all_ticks(flight):
    times = [t.tick_ms for run in flight for t in read_recording(Path(run["recording"])).flown]
    assert pool(flight)["tick_ms"]["p95"] == np.percentile(times, 95)
    assert pool(flight)["tick_ms"]["median"] == np.median(times)


def run(outcome: str = "reached", **known: object) -> dict[str, object]:
    empty = summarise(Samples(), None, outcome, "", None)
    return {**empty, **known}


def test_pooled_figures_are_rates_medians_and_extremes():
    runs = [
        run(duration_s=8.0, position_error_m=0.01, min_clearance_m=0.3, realtime_factor=3.0),
        run(duration_s=9.0, position_error_m=0.02, min_clearance_m=0.1, realtime_factor=5.0),
        run("lost", duration_s=20.0, max_command_step={"linear": 0.03, "angular": 0.06}),
        run("aborted", duration_s=None, min_clearance_m=None),
    ]
    pooled = pool(runs)
    assert pooled["outcome"] == {"reached": 0.5, "collided": 0.0, "stuck": 0.0, "lost": 0.25, "aborted": 0.25}
    assert pooled["duration_s"] == 9.0
    assert pooled["position_error_m"] == pytest.approx(0.015)
    assert pooled["min_clearance_m"] == 0.1
    assert pooled["max_command_step"] == {"linear": 0.03, "angular": 0.06}
    assert pooled["realtime_factor"] == 4.0


def test_pooled_cross_track_is_the_largest_of_all_and_the_median_of_the_means():
    def lap(most: float, mean: float, duration: float) -> dict[str, float]:
        return {"cross_track_max_m": most, "cross_track_mean_m": mean, "duration_s": duration}

    runs = [
        run(
            cross_track_max_m=0.3, cross_track_mean_m=0.01, laps=[lap(0.3, 0.01, 25.0), lap(0.1, 0.02, 26.0)]
        ),
        run(cross_track_max_m=0.1, cross_track_mean_m=0.02, laps=[lap(0.1, 0.02, 27.0)]),
        run(cross_track_max_m=0.2, cross_track_mean_m=0.06, laps=[lap(0.2, 0.06, 29.0)]),
        run("aborted"),
    ]
    pooled = pool(runs)
    assert (pooled["cross_track_max_m"], pooled["cross_track_mean_m"]) == (0.3, 0.02)
    # A lap that a flight did not get to does not count there.
    assert pooled["laps"] == [lap(0.3, 0.02, 27.0), lap(0.1, 0.02, 26.0)]
    assert pool([run()])["laps"] is None


def test_runs_of_a_version_that_knew_no_cross_track_can_still_be_pooled():
    old = {k: v for k, v in run().items() if k not in ("cross_track_max_m", "cross_track_mean_m", "laps")}
    pooled = pool([old])
    assert (pooled["cross_track_max_m"], pooled["cross_track_mean_m"], pooled["laps"]) == (None, None, None)


def on_the_way(*y: float, images: int = 9) -> Samples:
    samples = Samples(sent=[Command()])
    for i, off in enumerate(y):
        samples.times.append(float(i))
        samples.targets.append(min(i, images - 1))
        samples.truths.append(Truth(float(i), Pose(np.array([0.5 * i, off, 1.0]), 0.0), np.zeros(3), 1.0))
    return samples


def mission_with(**path: object) -> Mission:
    return Mission.model_validate({"path": {"poses": [[1, 0, 1, 0], [1, 1, 1, 90]], **path}})


def test_a_flight_is_judged_against_the_lines_through_the_true_poses():
    truths = [Pose(np.array([1.0, 0.0, 1.0]), 0.0), Pose(np.array([1.0, 1.0, 1.0]), 0.0)]
    reference = reference_of(mission_with(), truths)
    summary = summarise(on_the_way(0.1, -0.2, 0.3, images=2), None, "reached", "", None, reference)
    # The start and the first image are joined too; the last point lies on the second line, in the one lap.
    assert summary["cross_track_max_m"] == pytest.approx(0.2)
    assert summary["cross_track_mean_m"] == pytest.approx(0.1)
    assert [lap["duration_s"] for lap in summary["laps"]] == [2.0]


def test_a_flight_is_judged_against_the_missions_curve_where_it_has_one():
    truths = [Pose(np.array([1.0, 0.0, 1.0]), 0.0)] * 4
    reference = reference_of(mission_with(curve=[[3.0, 0.0]], laps=2), truths)
    summary = summarise(on_the_way(0.1, -0.2, 0.3), None, "reached", "", None, reference)
    assert summary["cross_track_max_m"] == pytest.approx(0.3)
    assert [lap["cross_track_max_m"] for lap in summary["laps"]] == pytest.approx([0.2, 0.3])


def test_without_the_truth_there_is_nothing_to_be_judged_against():
    assert reference_of(mission_with(curve=[[3.0, 0.0]]), ()) is None


def test_a_recording_with_its_mission_has_its_cross_track_even_when_it_was_cut_short(flight):
    recording = read_recording(Path(flight[0]["recording"]))
    files = {"mission.json": mission_with().model_dump_json().encode()}
    truth_only = {"truth": {"key_poses": "[[1, 0, 1, 0, 0, 0], [1, 1, 1, 0, 0, 0]]"}}
    cut = dataclasses.replace(recording, notes=truth_only, files=files, ticks=recording.ticks[:20])
    summary = summary_of(cut)
    assert 0.0 <= summary["cross_track_mean_m"] <= summary["cross_track_max_m"] < 0.2
    assert len(summary["laps"]) == 1
    assert summary_of(dataclasses.replace(cut, files={}))["cross_track_max_m"] is None


def test_without_recordings_the_pooled_ticks_are_cautious():
    runs = [run(tick_ms={"median": m, "p95": p}) for m, p in ((1.0, 3.0), (2.0, 9.0), (3.0, 4.0))]
    assert pool(runs)["tick_ms"] == {"median": 2.0, "p95": 9.0}


def test_no_flights_at_all_have_a_summary():
    assert pool([])["outcome"]["reached"] == 0.0
    assert pool([])["duration_s"] is None
