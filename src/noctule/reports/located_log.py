"""What a report draws of a flight whose pilot knows where it is, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.control.paths import SpacePath
from noctule.flight.located_judge import PUSHED, SETTLING, distances, stretches, within
from noctule.geometry import Array, wrap_angles
from noctule.messages import Doubt
from noctule.pilots.following import ON_PATH, FollowPhase

Spans = list[tuple[float, float]]
"""From, to [s]."""

_NOT_FLOWN = (Doubt.HOVER, Doubt.LAND)


@dataclass(frozen=True, slots=True)
class Push:
    """Somebody pushes the drone."""

    time: float  # [s], as FlightLog.times
    seconds: float  # [s]
    acceleration: float  # [m/s^2], length of the vector


@dataclass(frozen=True, slots=True)
class LocatedLog:
    """A row for every tick of FlightLog.times, NaN or empty while the pilot did not know where it was."""

    times: Array  # (n,) [s], the ticks
    at: Array  # (n,) [s], when the estimate holds
    fused: Array  # (n, 4) where the pilot held itself to be: x, y, z [m], yaw [rad]
    velocity: Array  # (n, 4) of those
    position_sd: Array  # (n,) [m], root of the trace of the position's covariance
    yaw_sd: Array  # (n,) [rad]
    wanted: Array  # (n, 4) where it wanted to be
    path_time: Array  # (n,) [s] since the path was begun
    phases: tuple[str, ...]  # n, the follower's
    doubts: tuple[str, ...]  # n, empty while it did not know
    doubt_reasons: tuple[str, ...]  # n
    framed: NDArray[np.bool_]  # (n,) a new depth frame came
    seen: NDArray[np.bool_]  # (n,) the drone was measured in it
    unseen_reasons: tuple[str, ...]  # n
    measured_times: Array  # (k,) [s], the exposures
    measured: Array  # (k, 4) what was measured in them
    reported_yaw: Array  # (n,) [rad] what the vehicle says, from a zero of its own
    true: Array  # (n, 4) at the times `at`; all NaN without a referee
    pushes: tuple[Push, ...] = ()
    path: SpacePath | None = None  # what was to be flown
    walks: tuple[Array, ...] = ()  # (n, 2) [m] each, where people were; NaN while they were not there
    handed_over: float = float("nan")  # [s], to a pilot that flies by pictures; NaN: never

    @property
    def has_truth(self) -> bool:
        """Whether somebody knew where the drone really was."""
        return bool(np.isfinite(self.true).any())

    @property
    def flown(self) -> Array:
        """Where the drone was, (n, 4): truly where that is known, else as it was fused."""
        return self.true if self.has_truth else self.fused

    @property
    def begun(self) -> NDArray[np.bool_]:
        """The ticks from the path's beginning to its end, (n,)."""
        return np.array([phase in ON_PATH for phase in self.phases], dtype=bool)

    @property
    def on_path(self) -> NDArray[np.bool_]:
        """The ticks on the path and its stops, but none while it hovers in doubt or lands, (n,)."""
        flying = self.begun
        return np.asarray(flying & np.array([doubt not in _NOT_FLOWN for doubt in self.doubts], dtype=bool))

    @property
    def stopped(self) -> NDArray[np.bool_]:
        """The ticks at which it held a point of the path, (n,)."""
        return np.asarray(self.on_path & np.array([p == FollowPhase.STOP for p in self.phases], dtype=bool))

    @property
    def stops(self) -> Spans:
        """When it held a point of the path."""
        return spans(self.times, self.stopped)

    @property
    def disturbed(self) -> NDArray[np.bool_]:
        """The ticks within 3 s after a push, (n,)."""
        return within(self.times, tuple((push.time, push.time + PUSHED) for push in self.pushes))

    @property
    def hovering(self) -> NDArray[np.bool_]:
        """The ticks of stops that are judged: settled for 4 s, no push in the last 3 s, (n,)."""
        # A stop lasts to its last tick, that one included.
        settled = within(self.times, tuple((a + SETTLING, np.nextafter(b, np.inf)) for a, b in self.stops))
        return np.asarray(settled & self.stopped & ~self.disturbed)

    @property
    def following(self) -> NDArray[np.bool_]:
        """The ticks at which it moved along the path undisturbed, (n,)."""
        return np.asarray(self.on_path & ~self.stopped & ~self.disturbed)

    @property
    def off(self) -> Array:
        """Where it was less where it wanted to be, (n, 4)."""
        return _less(self.flown, self.wanted)

    @property
    def estimate_off(self) -> Array:
        """What the pilot held less what was true at that time, (n, 4)."""
        return _less(self.fused, self.true)

    @property
    def camera_off(self) -> Array:
        """What the camera measured less what the pilot held at the exposure, (k, 4)."""
        return _less(self.measured, between(self.at, self.fused, self.measured_times))

    def cross_track(self) -> Array:
        """Return the distance to the nearest point of the path, (n,) [m]; NaN before it is begun."""
        distance = np.full(len(self.times), np.nan)
        if self.path is not None:
            rows = self.on_path & np.isfinite(self.flown[:, 0])
            distance[rows] = distances(self.path, self.flown[rows, :3])
        return distance


def between(times: Array, rows: Array, at: Array) -> Array:
    """Return poses (n, 4) of ascending `times` (n,) at other times (k,); NaN outside and beside gaps."""
    known = np.isfinite(times) & np.isfinite(rows).all(axis=1)
    if not known.any():
        return np.full((len(at), 4), np.nan)
    columns = np.column_stack([rows[known, :3], np.unwrap(rows[known, 3])])
    return np.column_stack(
        [np.interp(at, times[known], column, left=np.nan, right=np.nan) for column in columns.T]
    )


def spans(times: Array, mask: NDArray[np.bool_]) -> Spans:
    """Return from when to when `mask` (n,) holds without a break."""
    return [(float(times[a]), float(times[b - 1])) for a, b in stretches(mask)]


def _less(a: Array, b: Array) -> Array:
    off = a - b
    off[:, 3] = wrap_angles(off[:, 3])
    return np.asarray(off)
