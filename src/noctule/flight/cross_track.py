"""How far a flight strayed from the curve that it was to follow; only the judge knows that curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from noctule.geometry import Array, Pose, rot_z


class Piece(Protocol):
    """A piece of a curve in space."""

    def distance(self, points: Array) -> Array:
        """Return the distances (n,) [m] of points (n, 3) [m] from the piece."""


@dataclass(frozen=True, slots=True)
class Line:
    """A straight piece."""

    begin: Array  # (3,) [m]
    end: Array  # (3,) [m]

    def distance(self, points: Array) -> Array:
        """Return the distances (n,) [m] of points (n, 3) [m] from the piece."""
        along = self.end - self.begin
        length = max(float(along @ along), 1e-18)  # both ends may be one point
        share = np.clip((points - self.begin) @ along / length, 0.0, 1.0)
        return np.asarray(np.linalg.norm(points - self.begin - share[:, None] * along, axis=1))


@dataclass(frozen=True, slots=True)
class Arc:
    """A level piece of a circle, at most a whole one."""

    centre: Array  # (3,) [m]
    begin: Array  # (2,) [m], from the centre to the first point; its length is the radius
    sweep: float  # [rad], positive counterclockwise

    def distance(self, points: Array) -> Array:
        """Return the distances (n,) [m] of points (n, 3) [m] from the piece."""
        radius = float(np.linalg.norm(self.begin))
        offset = points - self.centre
        planar = np.linalg.norm(offset[:, :2], axis=1)
        middle = rot_z(0.5 * self.sweep)[:2, :2] @ self.begin / radius
        # Within half the sweep of the middle, said without angles.
        beside = offset[:, :2] @ middle >= planar * np.cos(0.5 * abs(self.sweep)) - 1e-12
        ends = [self.begin, rot_z(self.sweep)[:2, :2] @ self.begin]
        to_ends = np.min([np.linalg.norm(offset[:, :2] - end, axis=1) for end in ends], axis=0)
        return np.asarray(np.hypot(np.where(beside, np.abs(planar - radius), to_ends), offset[:, 2]))


@dataclass(frozen=True, slots=True)
class Reference:
    """What a flight is judged against."""

    pieces: tuple[Piece, ...]
    images_per_lap: int

    def distance(self, points: Array) -> Array:
        """Return the distance (n,) [m] of each point (n, 3) [m] from the curve, in space."""
        return np.asarray(np.min([piece.distance(points) for piece in self.pieces], axis=0))


def level_curve(start: Pose, curve: Sequence[tuple[float, float]]) -> tuple[Piece, ...]:
    """Return the pieces of a level curve that begins at `start`, along its heading.

    `curve` holds length [m] and curvature [1/m] (positive to the left, 0 straight) of each.
    """
    pieces: list[Piece] = []
    at, forward = np.asarray(start.position, dtype=np.float64), rot_z(start.yaw)[:, 0]
    for length, curvature in curve:
        if curvature == 0.0:
            end = at + length * forward
            pieces.append(Line(at, end))
        else:
            centre = at + rot_z(0.5 * np.pi) @ forward / curvature
            turn = rot_z(length * curvature)
            pieces.append(Arc(centre, (at - centre)[:2], length * curvature))
            end, forward = centre + turn @ (at - centre), turn @ forward
        at = end
    return tuple(pieces)


def polyline(points: Sequence[Array]) -> tuple[Piece, ...]:
    """Return the straight pieces between points (3,) [m], each once, however often they are flown."""
    pairs = {(tuple(a), tuple(b)) for a, b in pairwise(points)}
    return tuple(Line(np.array(a), np.array(b)) for a, b in sorted(pairs))


def cross_track(
    reference: Reference | None, times: Sequence[float], positions: Array, targets: Sequence[int]
) -> dict[str, Any]:
    """Return the cross-track figures of a flight and of each of its laps.

    Parameters
    ----------
    reference
        None: nobody knows the curve, and every figure is None.
    times
        [s] of the pilot's ticks. Every one counts, those on which a column is being avoided as well.
    positions
        (n, 3) [m], where the body really was at those ticks.
    targets
        Index of the image that was flown to, at those ticks; a lap ends when it passes the lap's last image.
    """
    if reference is None or not len(positions):
        return {**_figures(None), "laps": None}
    away = reference.distance(positions)
    # The index never falls in a flight that goes on; where an image is looked for again it is still its lap.
    lap = np.maximum.accumulate(np.asarray(targets, dtype=np.int64)) // reference.images_per_lap
    begins = [int(np.argmax(lap == number)) for number in np.unique(lap)]
    ends = [*begins[1:], len(lap)]
    each = []
    for begin, end in zip(begins, ends, strict=True):
        until = times[min(end, len(lap) - 1)]
        each.append({**_figures(away[begin:end]), "duration_s": float(until - times[begin])})
    return {**_figures(away), "laps": each}


def _figures(away: Array | None) -> dict[str, float | None]:
    if away is None:
        return {"cross_track_max_m": None, "cross_track_mean_m": None}
    return {"cross_track_max_m": float(away.max()), "cross_track_mean_m": float(away.mean())}
