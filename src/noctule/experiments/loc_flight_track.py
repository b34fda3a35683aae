"""A recorded flight as what the judge takes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from noctule.errors import NoctuleError
from noctule.experiments.loc_flight_judge import DOUBTS, LAND, SURE, Track
from noctule.flight.reader import Tick
from noctule.geometry import Array, Pose
from noctule.messages import Whereabouts

_NOTHING = np.full(4, np.nan)


class NoTruthError(NoctuleError):
    """A flight that nobody can judge."""


def track_of(ticks: Sequence[Tick]) -> Track:
    """Return the track of recorded ticks, those of the braking and landing at the end included.

    After the pilot's end the vehicle counts as landing: it may touch the floor, and nothing else.

    Raises
    ------
    NoTruthError
        When a tick holds no truth.
    """
    if not ticks or any(tick.truth is None for tick in ticks):
        raise NoTruthError("flight: its recording holds no truth, expected one of a simulated flight")
    rows = [tick.truth for tick in ticks if tick.truth is not None]
    where = [None if tick.decision is None else tick.decision.whereabouts for tick in ticks]
    landing = np.array([tick.decision is None for tick in ticks])
    doubt = np.array([SURE if w is None else DOUBTS.index(w.doubt) for w in where])
    doubt[landing] = LAND
    return Track(
        stamps=np.array([tick.stamp for tick in ticks]),
        true=np.array([_row(row.pose) for row in rows]),
        held_at=np.array([np.nan if w is None else w.stamp for w in where]),
        held=np.array([_NOTHING if w is None else np.append(w.position, w.yaw) for w in where]),
        position_sd=np.array([np.nan if w is None else w.position_sd for w in where]),
        wanted=np.array([_NOTHING if w is None else w.wanted for w in where]),
        path_time=np.array([np.nan if w is None else w.path_time for w in where]),
        holding=np.array([w is not None and w.holding for w in where]),
        doubt=doubt,
        measured=np.array([_measured(w) for w in where]),
        touched=np.array(
            [
                bool(set(row.contacts) - ({"floor"} if k >= LAND else set()))
                for row, k in zip(rows, doubt, strict=True)
            ]
        ),
    )


def _row(pose: Pose) -> Array:
    return np.append(pose.position, pose.yaw)


def _measured(where: Whereabouts | None) -> bool:
    return where is not None and where.measured is not None
