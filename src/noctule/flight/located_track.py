"""A flight below the ceiling camera as its judge takes it: what was true, held and wanted, tick by tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.errors import NoctuleError
from noctule.flight.reader import Tick
from noctule.flight.samples import Samples
from noctule.geometry import Array, Pose
from noctule.messages import Doubt, Truth, Whereabouts

Mask = NDArray[np.bool_]

DOUBTS = tuple(Doubt)
SURE, FLY_ON, HOVER, LAND = (
    DOUBTS.index(doubt) for doubt in (Doubt.SURE, Doubt.FLY_ON, Doubt.HOVER, Doubt.LAND)
)
_NOTHING = np.full(4, np.nan)


class NoTruthError(NoctuleError):
    """A flight that nobody can judge."""


@dataclass(frozen=True, slots=True)
class Track:
    """A flight, a row for every tick; NaN where nothing was held yet."""

    stamps: Array  # (n,) [s], the flight's clock
    true: Array  # (n, 4) x, y, z [m], yaw [rad]
    held_at: Array  # (n,) [s], when `held` holds
    held: Array  # (n, 4), where the pilot held itself to be
    position_sd: Array  # (n,) [m]
    wanted: Array  # (n, 4)
    path_time: Array  # (n,) [s] since the path was begun
    holding: Mask  # (n,)
    doubt: NDArray[np.int_]  # (n,) index into DOUBTS
    measured: Mask  # (n,), the camera measured the vehicle in this tick's frame
    touched: Mask  # (n,)


def track_of(ticks: Sequence[Tick]) -> Track:
    """Return the track of recorded ticks, those of the braking and landing at the end included.

    After the pilot's end the vehicle counts as landing: it may touch the floor, and nothing else.

    Raises
    ------
    NoTruthError
        When a tick holds no truth.
    """
    truths = [tick.truth for tick in ticks if tick.truth is not None]
    if not ticks or len(truths) < len(ticks):
        raise NoTruthError("flight: its recording holds no truth, expected one of a simulated flight")
    where = [None if tick.decision is None else tick.decision.whereabouts for tick in ticks]
    landing = [tick.decision is None for tick in ticks]
    return _made([tick.stamp for tick in ticks], truths, where, landing)


def track_of_samples(samples: Samples) -> Track:
    """Return the track of a flight that has just been flown, while the pilot was asked.

    Raises
    ------
    NoTruthError
        When there is no truth of every tick.
    """
    if len(samples.truths) != len(samples.times) or not samples.times:
        raise NoTruthError("flight: nobody knows the truth of it, expected a simulated flight")
    return _made(samples.times, samples.truths, samples.whereabouts, [False] * len(samples.times))


def _made(
    stamps: Sequence[float],
    truths: Sequence[Truth],
    where: Sequence[Whereabouts | None],
    landing: Sequence[bool],
) -> Track:
    doubt = np.array([SURE if w is None else DOUBTS.index(w.doubt) for w in where])
    doubt[np.array(landing)] = LAND
    return Track(
        stamps=np.array(stamps),
        true=np.array([_row(truth.pose) for truth in truths]),
        held_at=np.array([np.nan if w is None else w.stamp for w in where]),
        held=np.array([_NOTHING if w is None else np.append(w.position, w.yaw) for w in where]),
        position_sd=np.array([np.nan if w is None else w.position_sd for w in where]),
        wanted=np.array([_NOTHING if w is None else w.wanted for w in where]),
        path_time=np.array([np.nan if w is None else w.path_time for w in where]),
        holding=np.array([w is not None and w.holding for w in where]),
        doubt=doubt,
        measured=np.array([w is not None and w.measured is not None for w in where]),
        touched=np.array(
            [
                bool(set(truth.contacts) - ({"floor"} if k >= LAND else set()))
                for truth, k in zip(truths, doubt, strict=True)
            ]
        ),
    )


def _row(pose: Pose) -> Array:
    return np.append(pose.position, pose.yaw)
