"""The avoidance of the law `noctule`: around every column on the side that is nearer.

Each column is a disc: its measured radius, half the vehicle and a margin. Seen from the vehicle a disc hides
an interval of headings; intervals that overlap are one. When the wanted direction of travel lies in an
interval, the vehicle flies along the interval's end, on a side that it keeps until the columns are passed.
A column out of the picture goes on being dead-reckoned, so the vehicle does not cut back into it.
The result is one task of two rows, forward and left speed, for the top of the hierarchy.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from noctule.control.activation import Activation
from noctule.estimation.column import (
    ColumnEstimate,
    ColumnPrior,
    begin_column,
    column_distance2,
    move_column,
    update_column,
)
from noctule.geometry import Array
from noctule.pilots.settings import DetourSettings

J_DETOUR: Array = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
"""The task's Jacobian: it demands the forward and the left speed."""

_FARTHEST, _WIDEST = 12.0, 0.75  # [m]
_MOST_DOUBT = 0.05  # [m] of room at the most for what dead reckoning may have lost
_FINAL = 0.6  # [m] to the last image: from here on the target's own clearance counts
_HITS = 3  # detections before a column is believed: a single false box must not move the vehicle


@dataclass(frozen=True, slots=True)
class Motion:
    """How the body moved: by `step` (2,) [m] in the heading frame of its beginning, and by `turn` [rad]."""

    step: Array
    turn: float
    dt: float  # [s]


STILL = Motion(np.zeros(2), 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class TrackedColumn:
    """A column, how often it was seen, and the side on which it is being passed."""

    estimate: ColumnEstimate
    hits: int = 1
    side: int = 0  # +1: pass with the column on the right (go left), -1: the other way, 0: not chosen


@dataclass(frozen=True, slots=True)
class Blocked:
    """An interval of headings that columns hide."""

    low: float  # [rad], right end
    high: float  # [rad], left end
    members: tuple[int, ...]


@dataclass(slots=True)
class Detour:
    """Tracks columns and answers with the avoidance task."""

    settings: DetourSettings
    body_radius: float  # [m]
    camera_ahead: float  # [m]
    lag: float  # [s], the vehicle answers this late
    columns: tuple[TrackedColumn, ...] = ()
    activation: Activation = field(init=False)

    def __post_init__(self) -> None:
        """Start without columns."""
        self.activation = Activation(self.settings.fade_s)

    @property
    def prior(self) -> ColumnPrior:
        """What is expected of a column that was not seen before."""
        return ColumnPrior(radius=self.settings.assumed_width / 2.0)

    def move(self, step: Array, turn: float, dt: float) -> None:
        """Dead-reckon every column over `dt` [s]: the body moved by `step` (2,) [m] and turned by `turn`."""
        moved = self._moved(Motion(step, turn, dt))
        self.columns = tuple(c for c in moved if not self._forgotten(c))

    def _moved(self, motion: Motion) -> list[TrackedColumn]:
        """Return the columns after a motion of the body."""
        c, s = np.cos(motion.turn), np.sin(motion.turn)
        step = motion.step + self.camera_ahead * np.array([c - 1.0, s])
        return [
            replace(column, estimate=move_column(column.estimate, step, motion.turn, motion.dt, self.prior))
            for column in self.columns
        ]

    def _forgotten(self, column: TrackedColumn) -> bool:
        e = column.estimate
        behind = -self._centre(e)[0] > self.body_radius + self.settings.margin
        patience = self.settings.forget_s if column.hits >= _HITS else 0.2
        # What never looms is no column: two that overlapped in the picture, or something far behind.
        absurd = e.distance > _FARTHEST or e.radius > _WIDEST
        return bool(behind or absurd or e.unseen > patience)

    def _centre(self, estimate: ColumnEstimate) -> Array:
        """Return the axis of a column, (2,) [m]: forward and left of the body's centre."""
        return np.asarray(estimate.centre + np.array([self.camera_ahead, 0.0]))

    def see(self, edges: list[tuple[float | None, float | None]]) -> None:
        """Take the bearings [rad, left positive] of the edges seen; None where an edge is out of view."""
        columns = list(self.columns)
        free = set(range(len(columns)))
        for left, right in edges:
            near = [(column_distance2(columns[i].estimate, (left, right), self.prior), i) for i in free]
            best = min(near, default=(np.inf, -1))
            if best[0] < 16.0:
                i = best[1]
                free.discard(i)
                estimate = update_column(columns[i].estimate, (left, right), self.prior)
                columns[i] = replace(columns[i], estimate=estimate, hits=columns[i].hits + 1)
            elif left is not None and right is not None:
                columns.append(TrackedColumn(begin_column(left, right, self.prior)))
        self.columns = tuple(columns)

    def steer(
        self, wanted: Array, v: Array, goal: Array | None, dt: float, since: Motion = STILL
    ) -> tuple[Array, float]:
        """Return the task's demand (2,) [m/s] and its activation.

        Parameters
        ----------
        wanted
            Velocity that the tasks below want, (2,) [m/s]: forward, left.
        v
            Velocity now, (2,) [m/s].
        goal
            Where the flight ends, (2,) [m], when that is near; None while it goes on beyond.
        dt
            Tick [s].
        since
            Motion since the picture in which the columns were last seen: pictures come late.
        """
        speed = float(np.linalg.norm(wanted))
        heading = float(np.arctan2(wanted[1], wanted[0]))
        discs = self._discs(v, goal, since)
        on = False
        demand = wanted.copy()
        for blocked in merge_blocked(discs):
            if speed < 1e-6 or not blocked.low < heading < blocked.high:
                continue
            side = self._side(blocked, heading)
            end = blocked.high if side > 0 else blocked.low
            on = True
            along = np.array([np.cos(end), np.sin(end)])
            # A sharp turn is flown slowly, so that the vehicle does not drift on into the column.
            swerve = float(np.linalg.norm(v - (v @ along) * along))
            demand = max(0.35, 1.0 - 2.0 * swerve / speed) * speed * along
            break
        push = np.zeros(2)
        for centre, radius, _ in discs:
            d = float(np.linalg.norm(centre))
            if d < radius:
                push -= 1.5 * (radius - d) * centre / max(d, 1e-6)
        if push.any():
            on = True
            demand = demand + push
        self.activation = self.activation.step(on, dt)
        return demand, self.activation.h

    def _discs(self, v: Array, goal: Array | None, since: Motion) -> list[tuple[Array, float, int]]:
        """Return (centre (2,), radius, index) of the columns that matter now."""
        discs = []
        for i, (seen, column) in enumerate(zip(self.columns, self._moved(since), strict=True)):
            if column.hits < _HITS:
                continue
            e = column.estimate
            here = self._centre(e)
            centre = here - self.lag * v  # where it will be once the vehicle answers
            radius = e.radius + self.body_radius + self.settings.margin
            doubt = float(np.sqrt(e.P[1, 1]))
            if seen.estimate.unseen > 0.0:
                # Out of sight it may have come nearer than dead reckoning says.
                radius += min(doubt * e.distance, _MOST_DOUBT)
            # Distances are uncertain before the column has loomed: act on its near end.
            near = e.distance * float(np.exp(-min(doubt, 0.7))) + self.camera_ahead - radius
            if near > self.settings.reach:
                continue
            if goal is not None:
                if float(np.linalg.norm(goal)) < near:
                    continue
                if float(np.linalg.norm(goal)) < _FINAL:
                    # A target inside the disc: keep what the target itself keeps, but never touch.
                    reach = float(np.linalg.norm(goal - here))
                    radius = max(min(radius, reach - 0.02), e.radius + self.body_radius + 0.05)
            discs.append((centre, radius, i))
        return discs

    def _side(self, blocked: Blocked, heading: float) -> int:
        """Return the side already chosen for this group of columns, else choose the nearer and keep it."""
        chosen = [self.columns[i].side for i in blocked.members if self.columns[i].side]
        side = chosen[0] if chosen else (1 if blocked.high - heading <= heading - blocked.low else -1)
        columns = list(self.columns)
        for i in blocked.members:
            columns[i] = replace(columns[i], side=side)
        self.columns = tuple(columns)
        return side


def merge_blocked(discs: list[tuple[Array, float, int]]) -> list[Blocked]:
    """Return the intervals of headings hidden by discs (centre (2,), radius [m], index), overlaps merged.

    An interval that reaches beyond +-pi comes on the other side as well, so headings in (-pi, pi] need no
    wrapping.
    """
    intervals = []
    for centre, radius, i in discs:
        d = float(np.linalg.norm(centre))
        bearing = float(np.arctan2(centre[1], centre[0]))
        half = float(np.arcsin(radius / d)) if d > radius else np.pi / 2
        for turn in (-2.0 * np.pi, 0.0, 2.0 * np.pi):
            low, high = bearing - half + turn, bearing + half + turn
            if high > -np.pi and low < np.pi:
                intervals.append(Blocked(low, high, (i,)))
    intervals.sort(key=lambda b: b.low)
    merged: list[Blocked] = []
    for b in intervals:
        if merged and b.low <= merged[-1].high:
            last = merged[-1]
            merged[-1] = Blocked(last.low, max(last.high, b.high), last.members + b.members)
        else:
            merged.append(b)
    return merged
