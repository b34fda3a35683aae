"""What a report draws: a flight as plain arrays, whatever file it came from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from noctule.geometry import Array
from noctule.messages import ColumnBox, Limits
from noctule.reports.located_log import LocatedLog


@dataclass(frozen=True, slots=True)
class Solid:
    """A thing in the room, standing upright: its outline from above, where it begins and ends in height."""

    kind: str  # "column", "furniture", "person" or "wall"
    outline: Array  # (k, 2) [m], world x and y, closed from the last corner to the first
    bottom: float  # [m]
    top: float  # [m]
    name: str = ""
    rgb: tuple[float, float, float] | None = None  # its own colour, 0 to 1


@dataclass(frozen=True, slots=True)
class Hull:
    """The body that must not touch: an upright cylinder about the vehicle's centre."""

    radius: float = 0.2  # [m]
    height: float = 0.12  # [m]


@dataclass(frozen=True, slots=True)
class TruthLog:
    """Where the drone really was, where a simulator said so."""

    times: Array  # (m,) [s], as FlightLog.times
    position: Array  # (m, 3) [m], world ENU
    yaw: Array  # (m,) [rad]
    speed: Array  # (m,) [m/s]
    clearance: Array  # (m,) [m], hull surface to the nearest surface; negative inside
    contacts: tuple[str, ...] = ()  # names of all that was touched
    velocity: Array = field(default_factory=lambda: np.empty((0, 3)))  # (m, 3) [m/s], world; or empty


@dataclass(frozen=True, slots=True)
class Landing:
    """What came after the pilot's last tick, which is the first row."""

    times: Array  # (k,) [s], as FlightLog.times
    pose: Array  # (k, 4) x, y, z [m], yaw [rad]; without truth z is the vehicle's own height, the rest NaN
    true: bool  # whether that is where the drone really was
    said_landed: bool = False  # by the vehicle, at the end
    touching: tuple[str, ...] = ()  # what the hull touches at the end
    touched: tuple[str, ...] = ()  # what it touched after the pilot's last tick, but the floor


@dataclass(frozen=True, slots=True)
class Snapshot:
    """A picture of the flight and what the pilot saw in it."""

    time: float  # [s], as FlightLog.times
    pixels: NDArray[np.uint8]  # (height, width, 3) RGB
    phase: str
    target_index: int
    points_current: Array  # (n, 2) [px]
    points_ref: Array  # (n, 2) [px]
    columns: tuple[ColumnBox, ...] = ()


@dataclass(frozen=True, slots=True)
class FlightLog:
    """A flight on one time axis: seconds since its first tick. Rows that nothing is known of are NaN."""

    times: Array  # (n,) [s], the ticks
    asked: Array  # (n, 4) what the pilot asked: forward, left, up [m/s], yaw rate [rad/s]
    sent: Array  # (n, 4) what was sent
    phases: tuple[str, ...]  # n
    target_index: NDArray[np.int64]  # (n,)
    epsilon: Array  # (n,) mean distance of the points to their references [px]
    errors: Array  # (n, 6) servoing error (e_v, e_w), camera axes right, down, forward
    activations: dict[str, Array] = field(default_factory=dict)  # task -> (n,) h in [0, 1], top task first
    task_errors: dict[str, Array] = field(default_factory=dict)  # task -> (n,) norm of its error
    tick_ms: Array = field(default_factory=lambda: np.empty(0))  # (n,) or empty
    truth: TruthLog | None = None
    limits: Limits = field(default_factory=Limits)
    tick_s: float = 1.0 / 30.0  # [s], the nominal time between ticks
    key_poses: Array = field(default_factory=lambda: np.empty((0, 4)))  # (k, 4) x, y, z [m], yaw [rad]
    solids: tuple[Solid, ...] = ()
    room: Array | None = None  # (2, 3) [m], the lowest and the highest corner between the walls
    hull: Hull = field(default_factory=Hull)
    snapshots: tuple[Snapshot, ...] = ()
    safety_area: tuple[float, float, float, float] | None = None  # left, top, right, bottom [px]
    epsilon_limit: float | None = None  # [px], where an image counts as reached, if the law has one
    summary: dict[str, Any] = field(default_factory=dict)  # the contract's keys, see `summary.flight_rows`
    about: dict[str, str] = field(default_factory=dict)  # mission, law, seed, versions, ...
    mission_text: str = ""  # the mission file as it was flown
    notes: tuple[str, ...] = ()  # what is missing from the recording, and why
    located: LocatedLog | None = None  # of a pilot that knows where it is
    landing: Landing | None = None  # None where neither truth nor the vehicle tells of it
    clock_start: float | None = None  # [s], the first tick on the flight's clock; None of a real flight

    @property
    def span(self) -> tuple[float, float]:
        """First and last tick [s]."""
        return (float(self.times[0]), float(self.times[-1])) if len(self.times) else (0.0, 0.0)

    @property
    def by_pictures(self) -> bool:
        """Whether points of key images were tracked."""
        return bool(np.isfinite(self.epsilon).any())

    @property
    def switches(self) -> Array:
        """The times [s] at which the target image changed."""
        return np.asarray(self.times[1:][np.diff(self.target_index) != 0], dtype=np.float64)

    @property
    def command_steps(self) -> Array:
        """Change of the sent command from tick to tick, (n, 2): linear norm [m/s], yaw rate [rad/s].

        The first row is NaN: what was sent before the first tick is not known.
        """
        steps = np.full((len(self.times), 2), np.nan)
        if len(self.times) > 1:
            change = np.diff(self.sent, axis=0)
            steps[1:, 0] = np.linalg.norm(change[:, :3], axis=1)
            steps[1:, 1] = np.abs(change[:, 3])
        return steps

    def active(self, task: str) -> list[tuple[float, float]]:
        """Return the intervals [s] in which `task` has an activation above zero."""
        h = self.activations.get(task)
        if h is None or not len(h):
            return []
        on = np.zeros(len(h) + 2, dtype=bool)
        on[1:-1] = np.nan_to_num(h) > 1e-6
        starts, ends = np.flatnonzero(on[1:] & ~on[:-1]).tolist(), np.flatnonzero(~on[1:] & on[:-1]).tolist()
        last = len(self.times) - 1
        return [
            (float(self.times[a]), float(self.times[min(b, last)])) for a, b in zip(starts, ends, strict=True)
        ]
