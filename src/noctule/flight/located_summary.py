"""The figures of a flight along a path in space, as its judge finds them, for the flight's summary."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from noctule.control.paths import PathPlan
from noctule.flight.located_judge import Course, figures_of, stretches
from noctule.flight.located_track import NoTruthError, track_of_samples
from noctule.flight.samples import Samples
from noctule.geometry import Pose
from noctule.pilots.following import ON_PATH, FollowPhase

FIGURES = (
    "cross_track_max_m", "cross_track_mean_m", "cross_track_p95_m", "hover_rms_m", "heading_p95_deg",
    "recovery_s", "position_rms_m", "position_p95_m", "yaw_mean_deg", "yaw_sd_deg", "slips", "lost_s",
)  # fmt: skip


def located_figures(plan: PathPlan, samples: Samples, pushes: Sequence[float] = ()) -> dict[str, Any]:
    """Return FIGURES by name; None where nothing of the kind was flown, or nobody knows the truth.

    `pushes` [s, the flight's clock] are when somebody pushed the drone. Unlike an experiment, which knows
    when it stops, a flight stops where and for as long as its pilot says.
    """
    try:
        track = track_of_samples(samples)
    except NoTruthError:
        return dict.fromkeys(FIGURES)
    on_path = np.array([phase in ON_PATH for phase in samples.phases])
    if not on_path.any():
        return dict.fromkeys(FIGURES)
    stopped = np.array([phase == FollowPhase.STOP for phase in samples.phases])
    until = np.append(track.path_time, np.inf)  # the tick that went on, if there is one
    stops = tuple((float(until[begin]), float(until[end])) for begin, end in stretches(stopped))
    course = Course(plan.path, stops, tuple(pushes), float(track.path_time[on_path].max()))
    found = figures_of(track, course)
    return {name: found[name] for name in FIGURES}


def final_goal(samples: Samples) -> Pose | None:
    """Return where a located pilot wanted to be at the end; None where it never knew where it was."""
    known = next((known for known in reversed(samples.whereabouts) if known is not None), None)
    return None if known is None else Pose(known.wanted[:3].copy(), float(known.wanted[3]))
