"""How well a path in space was followed, and how well the pilot knew where it was: judged by the truth.

All is counted over the path's time, from 0 to `Course.seconds`; positions are three-dimensional norms.
Cross-track leaves out stops, hovering the first 4 s of a stop, and both and the heading what is no following:
the 3 s after a push, and hovering in doubt.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from noctule.control.paths import SpacePath, nearest_anywhere
from noctule.flight.located_track import DOUBTS, FLY_ON, HOVER, LAND, SURE, Mask, Track
from noctule.geometry import Array, wrap_angles

Spans = tuple[tuple[float, float], ...]
"""From, to [s]."""

SETTLING = 4.0  # [s] of a stop that are not hovering yet
PUSHED = 3.0  # [s] after a push that belong to the recovery and to nothing else
UNSEEN = 0.25  # [s] without a measurement of the camera, after which the vehicle counts as lost
BACK = 0.08  # [m], as near to the path or the held point as a vehicle that has recovered is
SLIPPED = (0.5 * np.pi, 0.1)  # [rad], [s]: a heading off by more for longer is the other half turn


@dataclass(frozen=True, slots=True)
class Course:
    """What was to be flown."""

    path: SpacePath
    stops: Spans  # of the path's time
    pushes: tuple[float, ...]  # [s], the flight's clock
    seconds: float  # [s], of the path's time


def figures_of(track: Track, course: Course) -> dict[str, Any]:
    """Return the figures by name; None where there was nothing to count."""
    cross, held_off = cross_track(track, course), estimate_errors(track)
    away = np.linalg.norm(held_off[:, :3], axis=1)
    on = on_path(track, course)
    flying = on & ~pushed(track, course) & (track.doubt < HOVER)
    following, hovering = flying & ~stopped(track, course), flying & settled(track, course)
    turned = np.abs(wrap_angles(track.true[:, 3] - track.wanted[:, 3]))
    away_from_wanted = np.linalg.norm(track.true[:, :3] - track.wanted[:, :3], axis=1)
    recoveries = [recovery(track, np.where(track.holding, away_from_wanted, cross), p) for p in course.pushes]
    known = [seconds for seconds in recoveries if seconds is not None]
    yaw, fused = np.degrees(held_off[on, 3]), away[on]
    return {
        "cross_track_mean_m": _mean(cross[following]),
        "cross_track_p95_m": _p95(cross[following]),
        "cross_track_max_m": _most(cross[following]),
        "hover_rms_m": _rms(away_from_wanted[hovering]),
        "heading_p95_deg": _degrees(_p95(turned[flying])),
        "recovery_s": {"mean": _mean(np.array(known)), "max": _most(np.array(known))},
        "position_rms_m": _rms(fused),
        "position_p95_m": _p95(fused),
        "position_nees": _mean((fused / track.position_sd[on]) ** 2),
        "yaw_mean_deg": _mean(yaw),
        "yaw_sd_deg": float(yaw.std()) if yaw.size else None,
        "slips": slips(track, held_off[:, 3]),
        "lost_s": lost(track, course),
        "doubt_s": {str(name): in_doubt(track, course, k) for k, name in enumerate(DOUBTS) if k > SURE},
    }


def begun(track: Track, course: Course) -> Mask:
    """Return which ticks belong to the path's time, landing included; (n,)."""
    return np.asarray((track.path_time >= 0.0) & (track.path_time <= course.seconds))


def on_path(track: Track, course: Course) -> Mask:
    """Return which ticks are on the path: begun, not over, and not landing; (n,)."""
    return np.asarray(begun(track, course) & (track.doubt < LAND))


def stopped(track: Track, course: Course) -> Mask:
    """Return which ticks belong to a stop, from the order to stop to the order to go on; (n,)."""
    return within(track.path_time, course.stops)


def settled(track: Track, course: Course) -> Mask:
    """Return which ticks belong to a stop but to its first 4 s; (n,)."""
    return within(track.path_time, tuple((begin + SETTLING, end) for begin, end in course.stops))


def pushed(track: Track, course: Course) -> Mask:
    """Return which ticks lie within 3 s after the beginning of a push; (n,)."""
    return within(track.stamps, tuple((push, push + PUSHED) for push in course.pushes))


def cross_track(track: Track, course: Course) -> Array:
    """Return how far the vehicle truly was from the nearest point of the whole path, (n,) [m]."""
    return distances(course.path, track.true[:, :3])


def distances(path: SpacePath, positions: Array) -> Array:
    """Return how far each of `positions` (n, 3) [m] is from the nearest point of the whole path, (n,) [m]."""
    nearest = [path.at(nearest_anywhere(path, x)).position for x in np.ascontiguousarray(positions)]
    return np.asarray(np.linalg.norm(positions - np.array(nearest).reshape(-1, 3), axis=1))


def estimate_errors(track: Track) -> Array:
    """Return what the pilot held less what was true at that very time, (n, 4) [m, rad]; NaN before."""
    yaw = np.unwrap(track.true[:, 3])
    true = [np.interp(track.held_at, track.stamps, column) for column in (*track.true[:, :3].T, yaw)]
    off = track.held - np.column_stack(true)
    off[:, 3] = wrap_angles(off[:, 3])
    return np.asarray(off)


def recovery(track: Track, off: Array, push: float) -> float | None:
    """Return the last time [s] after a push, within 3 s, at which `off` (n,) [m] was above 8 cm.

    Time counts from the push's beginning; 0 when it never was, None for a push that no tick followed, and 3
    where it had not come back by then, or when the flight ended. `off` is the distance from the held point in
    a stop, else that from the path.
    """
    after = (track.stamps >= push) & (track.stamps < push + PUSHED) & (track.path_time >= 0.0)
    if not after.any():
        return None
    far = off[after] > BACK
    if far[-1]:
        return PUSHED
    above = track.stamps[after][far]
    return float(above[-1] - push) if above.size else 0.0


def slips(track: Track, yaw_off: Array) -> int:
    """Return how often the held heading was the other half turn: off by over 90 deg for over 0.1 s."""
    return sum(length > SLIPPED[1] for length in runs(track.stamps, np.abs(yaw_off) > SLIPPED[0]))


def lost(track: Track, course: Course) -> float:
    """Return for how long [s] the vehicle was lost.

    That is while the camera had not measured it for 0.25 s, or the pilot's doubt was beyond flying on by
    the sensors that remain. Landing counts too.
    """
    seen = np.maximum.accumulate(np.where(track.measured, track.stamps, -np.inf))
    missed = (track.stamps - seen > UNSEEN) | (track.doubt > FLY_ON)
    return _seconds(track, begun(track, course) & missed)


def in_doubt(track: Track, course: Course, doubt: int) -> float:
    """Return for how long [s] of the path the pilot was in this doubt."""
    return _seconds(track, begun(track, course) & (track.doubt == doubt))


def runs(stamps: Array, mask: Mask) -> list[float]:
    """Return how long [s] each stretch lasts in which `mask` (n,) holds, from its first to its last tick."""
    return [float(stamps[end - 1] - stamps[begin]) for begin, end in stretches(mask)]


def stretches(mask: Mask) -> list[tuple[int, int]]:
    """Return the stretches in which `mask` (n,) holds: the first tick, and that behind the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def within(times: Array, spans: Spans) -> Mask:
    """Return which times (n,) [s] lie in one of the spans, their beginnings included; (n,)."""
    inside = np.zeros(times.shape, dtype=bool)
    for begin, end in spans:
        inside |= (times >= begin) & (times < end)
    return inside


def _seconds(track: Track, mask: Mask) -> float:
    # Each tick stands for the time since the one before.
    steps = np.diff(track.stamps, prepend=track.stamps[:1])
    return float(steps[mask].sum())


def _mean(values: Array) -> float | None:
    return float(values.mean()) if values.size else None


def _rms(values: Array) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def _p95(values: Array) -> float | None:
    return float(np.percentile(values, 95.0)) if values.size else None


def _most(values: Array) -> float | None:
    return float(values.max()) if values.size else None


def _degrees(value: float | None) -> float | None:
    return None if value is None else float(np.degrees(value))
