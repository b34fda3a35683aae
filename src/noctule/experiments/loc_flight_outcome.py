"""How a flight below the ceiling camera ended: what a judge who knows the truth says of it."""

from __future__ import annotations

import numpy as np

from noctule.flight.fence import Fence
from noctule.flight.located_judge import Course, cross_track, estimate_errors, on_path
from noctule.flight.located_track import LAND, SURE, Mask, Track
from noctule.messages import Outcome

ASTRAY = (0.5, 1.0)  # [m], [s]: an estimate that is off by more for longer while it is held for sure
AWAY = 1.0  # [m] from the path
NAMES = {Outcome.REACHED: "completed", Outcome.LOST: "landed_lost", Outcome.COLLIDED: "contact"}
OUTCOMES = ("completed", "landed_lost", "fence", "contact", "diverged", "stuck", "aborted")


def outcome_of(track: Track, course: Course, fence: Fence, ended: str) -> str:
    """Return one of OUTCOMES: the first bad thing that happened, else how the flight `ended`.

    contact
        The hull touched something.
    fence
        The vehicle truly left the fence's box; while it lands only its walls count.
    diverged
        The estimate was off by more than 0.5 m for longer than 1 s while the pilot was sure of it, or the
        vehicle was more than 1 m from the path that it flew.
    completed, landed_lost
        The pilot's own end: the path's time is over, or it landed as it no longer knew where it was.
    stuck, aborted
        The time limit, or the supervisor, ended it.
    """
    first = {
        "contact": _first(track, track.touched),
        "diverged": min(_first(track, _far(track, course)), _first(track, _astray(track))),
        "fence": _first(track, _outside(track, fence)),
    }
    name = min(first, key=lambda key: first[key])
    if np.isfinite(first[name]):
        return name
    return NAMES.get(Outcome(ended), ended)


def _first(track: Track, mask: Mask) -> float:
    return float(track.stamps[mask][0]) if mask.any() else np.inf


def _outside(track: Track, fence: Fence) -> Mask:
    x = track.true[:, :3]
    beyond = (x < np.asarray(fence.low)) | (x > np.asarray(fence.high))
    return np.asarray(beyond[:, :2].any(axis=1) | (beyond[:, 2] & (track.doubt < LAND)))


def _far(track: Track, course: Course) -> Mask:
    return np.asarray(on_path(track, course) & (cross_track(track, course) > AWAY))


def _astray(track: Track) -> Mask:
    """Return which ticks come more than a second into a stretch of a wrong estimate held for sure; (n,)."""
    off = np.linalg.norm(estimate_errors(track)[:, :3], axis=1)
    wrong = (off > ASTRAY[0]) & (track.doubt == SURE)
    right = np.where(wrong, -np.inf, track.stamps)
    since = np.maximum.accumulate(right)  # the last tick that was right
    # Wrong from the first tick on: since that.
    since = np.where(np.isfinite(since), since, track.stamps[:1])
    return np.asarray(wrong & (track.stamps - since > ASTRAY[1]))
