"""A flown flight of loc-1 to loc-3 judged: its figures from its recording, and those of many together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from noctule.campaign.measure import together
from noctule.experiments.loc_flight_outcome import OUTCOMES, outcome_of
from noctule.flight.located_judge import Course, figures_of
from noctule.flight.located_track import track_of
from noctule.flight.mission import Mission
from noctule.flight.reader import read_recording

Run = dict[str, Any]

OF_FLYING = (
    "outcome", "reason", "duration_s", "min_clearance_m", "max_command_step", "tick_ms", "realtime_factor",
    "recording", "report",
)  # fmt: skip
"""What is told of the summary that every flight has; the rest belongs to visual paths."""


def course_of(mission: Mission) -> Course:
    """Return what a mission with a path in space asks for, as the judge takes it."""
    plan = mission.space_plan()
    end = mission.located.end_after_s
    return Course(
        plan.path,
        tuple((stop.time or 0.0, (stop.time or 0.0) + stop.seconds) for stop in plan.timed),
        tuple(push.time_s for push in mission.vehicle.pushes),
        np.inf if end is None else end,
    )


def judged(run: Mapping[str, Any]) -> Run:
    """Return the summary of a flown flight with the judge's outcome and figures, read from its recording.

    Raises NoTruthError, and RecordingFileError where there is no recording.
    """
    recording = read_recording(Path(run["recording"]))
    mission = Mission.model_validate_json(recording.files["mission.json"])
    track, course = track_of(recording.ticks), course_of(mission)
    told: Run = {key: run[key] for key in OF_FLYING if key in run}
    fence = mission.fence.values(mission.room)
    told["outcome"] = outcome_of(track, course, fence, run["outcome"])
    return {"seed": mission.flight.seed, **told, **figures_of(track, course)}


def pooled(runs: Sequence[Run]) -> dict[str, Any]:
    """Return "summary", "least" and "most" over flights: the means, smallest and largest of their figures.

    `outcome` in the summary is the share of each outcome. A figure that some flight does not have is judged
    over those that do.
    """
    figures = together([{k: v for k, v in run.items() if k != "seed"} for run in runs])
    shares = {name: sum(run["outcome"] == name for run in runs) / len(runs) for name in OUTCOMES}
    return {**figures, "summary": {"outcome": shares, **figures["summary"]}}
