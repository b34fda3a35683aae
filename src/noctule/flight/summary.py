"""The figures of a flight, named as the command line promises them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from noctule.control.paths import PathPlan
from noctule.errors import NoctuleError
from noctule.flight.codec import decode_pose
from noctule.flight.cross_track import Reference, cross_track, level_curve, polyline
from noctule.flight.located_summary import FIGURES, final_goal, located_figures
from noctule.flight.mission import Mission
from noctule.flight.reader import Recording, read_recording
from noctule.flight.samples import Samples, samples_of
from noctule.geometry import Array, Pose, wrap_angle
from noctule.messages import Outcome, Truth

OUTCOMES = tuple(str(o) for o in Outcome)


def command_steps(sent: Array) -> tuple[float, float]:
    """Return the largest change from one sent command (n, 4) to the next: linear [m/s], angular [rad/s].

    A flight begins in hover, so the first command counts from zero.
    """
    if not len(sent):
        return 0.0, 0.0
    change = np.diff(np.vstack([np.zeros((1, 4)), sent]), axis=0)
    return float(np.linalg.norm(change[:, :3], axis=1).max()), float(np.abs(change[:, 3]).max())


def errors_at_end(final: Truth | None, goal: Pose | None) -> tuple[float | None, float | None]:
    """Return the distance [m] and the absolute heading error [deg] of where it is to where it should be."""
    if final is None or goal is None:
        return None, None
    distance = float(np.linalg.norm(final.pose.position - goal.position))
    return distance, abs(float(np.degrees(wrap_angle(final.pose.yaw - goal.yaw))))


def finite_or_none(value: float) -> float | None:
    """Return a figure as JSON can hold it."""
    return float(value) if np.isfinite(value) else None


def summarise(
    samples: Samples,
    goal: Pose | None,
    outcome: str,
    reason: str,
    realtime_factor: float | None,
    reference: Reference | None = None,
    plan: PathPlan | None = None,
    pushes: Sequence[float] = (),
) -> dict[str, Any]:
    """Return the figures of a flight; `goal` is where the last key image was really taken.

    `reference` is the curve that the body was to follow, None where nobody knows it. A path in space has a
    `plan` instead, perhaps `pushes` [s, the flight's clock], and where there is no `goal` the flight's is
    where the pilot wanted to be at its end.
    Time runs from the pilot's first tick to its last; the pose at the end is the true one at that last tick.
    """
    if plan is not None and goal is None:
        goal = final_goal(samples)
    epsilons = [e for e in samples.epsilons if np.isfinite(e)]
    clearances = [t.clearance for t in samples.truths]
    distance, turn = errors_at_end(samples.truths[-1] if samples.truths else None, goal)
    linear, angular = command_steps(np.array([c.as_array() for c in samples.sent]).reshape(-1, 4))
    times = samples.tick_ms
    positions = np.array([t.pose.position for t in samples.truths]).reshape(-1, 3)
    return {
        "outcome": outcome,
        "reason": reason,
        "duration_s": samples.times[-1] - samples.times[0] if samples.times else 0.0,
        "position_error_m": distance,
        "yaw_error_deg": turn,
        "epsilon_px": epsilons[-1] if epsilons else None,
        "min_clearance_m": finite_or_none(min(clearances)) if clearances else None,
        "max_command_step": {"linear": linear, "angular": angular},
        "tick_ms": {
            "median": float(np.median(times)) if times else None,
            "p95": float(np.percentile(times, 95)) if times else None,
        },
        "realtime_factor": realtime_factor,
        **cross_track(reference, samples.times, positions, samples.targets),
        **({} if plan is None else located_figures(plan, samples, pushes)),
        "recording": None,
        "report": None,
    }


def reference_of(mission: Mission, truth: Sequence[Pose]) -> Reference | None:
    """Return what a flight is judged against; `truth` holds the true pose of each image of its route.

    The mission's curve, or straight lines from the start through those poses; None where nobody knows them.
    """
    if not truth or mission.path is None or mission.space_path is not None:
        return None
    start, images = mission.start.nominal, len(truth) // mission.path.laps
    if mission.path.curve is not None:
        return Reference(level_curve(start, mission.path.curve), images)
    return Reference(polyline([start.position, *(pose.position for pose in truth)]), images)


def truth_of(recording: Recording) -> tuple[Pose, ...]:
    """Return where the images of the route were really taken; empty where the recording does not say."""
    poses = json.loads(recording.notes.get("truth", {}).get("key_poses", "[]"))
    return tuple(decode_pose(json.dumps(pose)) for pose in poses)


def _worked_out(recording: Recording) -> dict[str, Any]:
    truth = truth_of(recording)
    try:
        mission = Mission.model_validate_json(recording.files.get("mission.json", b""))
        plan = None if mission.space_path is None else mission.space_plan()
        reference = reference_of(mission, truth)
        pushes = [push.time_s for push in mission.vehicle.pushes]
    except (ValidationError, NoctuleError):  # of another version: all the other figures can still be told
        reference, plan, pushes = None, None, []
    goal = truth[-1] if truth else None
    return summarise(
        samples_of(recording.ticks), goal, *_outcome_of(recording), None, reference, plan, pushes
    )


def summary_of(recording: Recording) -> dict[str, Any]:
    """Return the figures of a recording: those noted at its end, or worked out where it was cut short.

    A flight whose end is missing has the outcome of its last tick, and "aborted" where that has none.
    """
    noted = recording.notes.get("summary")
    if noted is not None:
        summary = {name: json.loads(value) for name, value in noted.items()}
    else:
        summary = _worked_out(recording)
    return {**summary, "recording": str(recording.path)}


def _outcome_of(recording: Recording) -> tuple[str, str]:
    for tick in recording.flown:
        if tick.truth is not None and (tick.truth.contacts or tick.truth.clearance <= 0.0):
            return str(Outcome.COLLIDED), "touched " + (", ".join(tick.truth.contacts) or "something")
        if tick.decision is not None and tick.decision.outcome is not None:
            return str(tick.decision.outcome), tick.decision.reason
    return str(Outcome.ABORTED), "the recording ends before the flight does"


def pool(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return one summary over many runs, with the keys and nesting of a run.

    `outcome` becomes the rate of each outcome. `min_clearance_m` is the least and `max_command_step` the
    largest of all; `tick_ms` is over all ticks where the recordings are there to be read, else the median of
    the medians and the largest 95th percentile. `cross_track_max_m` is the largest of all and
    `cross_track_mean_m` the median of the flights' means, for every lap too; so is `recovery_s`. Everything
    else is the median of what is known, None where nothing is.
    """
    steps = {axis: _of([r["max_command_step"][axis] for r in runs], max) for axis in ("linear", "angular")}
    summary: dict[str, Any] = {
        "outcome": {o: sum(r["outcome"] == o for r in runs) / max(len(runs), 1) for o in OUTCOMES}
    }
    for name in ("duration_s", "position_error_m", "yaw_error_deg", "epsilon_px"):
        summary[name] = _of([r[name] for r in runs], np.median)
    summary["min_clearance_m"] = _of([r["min_clearance_m"] for r in runs], min)
    summary["max_command_step"] = steps
    summary["tick_ms"] = _pooled_ticks(runs)
    summary["realtime_factor"] = _of([r["realtime_factor"] for r in runs], np.median)
    summary |= _pooled_cross_track(runs)
    each = [r["laps"] for r in runs if r.get("laps")]
    most = max((len(laps) for laps in each), default=0)
    by_lap = [[laps[k] for laps in each if k < len(laps)] for k in range(most)]
    summary["laps"] = [
        {**_pooled_cross_track(laps), "duration_s": _of([lap["duration_s"] for lap in laps], np.median)}
        for laps in by_lap
    ] or None
    for name in FIGURES:
        if name not in summary and any(name in r for r in runs):
            figures = [r.get(name) for r in runs]
            summary[name] = _pooled_recovery(figures) if name == "recovery_s" else _of(figures, np.median)
    return {**summary, "recording": None, "report": None}


def _pooled_cross_track(figures: Sequence[dict[str, Any]]) -> dict[str, float | None]:
    # Campaigns flown by an earlier version have none.
    return {
        "cross_track_max_m": _of([f.get("cross_track_max_m") for f in figures], max),
        "cross_track_mean_m": _of([f.get("cross_track_mean_m") for f in figures], np.median),
    }


def _pooled_recovery(figures: Sequence[dict[str, float | None] | None]) -> dict[str, float | None]:
    known = [f for f in figures if f is not None]
    return {"mean": _of([f["mean"] for f in known], np.median), "max": _of([f["max"] for f in known], max)}


def _of(values: list[float | None], figure: Any) -> float | None:
    known = [v for v in values if v is not None]
    return float(figure(known)) if known else None


def _pooled_ticks(runs: Sequence[dict[str, Any]]) -> dict[str, float | None]:
    paths = [Path(r["recording"]) for r in runs if r.get("recording")]
    if paths and len(paths) == len(runs) and all(p.exists() for p in paths):
        times = np.concatenate([[t.tick_ms for t in read_recording(p).flown] for p in paths])
        if len(times):
            return {"median": float(np.median(times)), "p95": float(np.percentile(times, 95))}
    return {
        "median": _of([r["tick_ms"]["median"] for r in runs], np.median),
        "p95": _of([r["tick_ms"]["p95"] for r in runs], max),
    }
