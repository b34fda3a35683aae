"""The figures of a flight along a path in space, by the truth: how near to the path, how well it knew itself.

Cross-track leaves out stops, hovering the first 4 s of a stop, and both and the heading what is no following:
the 3 s after a push, and hovering in doubt. Positions are three-dimensional.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from noctule.control.paths import PathPlan, nearest_anywhere
from noctule.flight.samples import Samples
from noctule.geometry import Array, Pose
from noctule.messages import Doubt

FIGURES = (
    "cross_track_max_m", "cross_track_mean_m", "cross_track_p95_m", "hover_rms_m", "heading_p95_deg",
    "position_rms_m", "position_p95_m", "yaw_mean_deg", "yaw_sd_deg", "lost_s",
)  # fmt: skip
_ON_PATH = ("follow", "stop")  # phases of the follower
SETTLING = 4.0  # [s] of a stop that are not hovering yet
PUSHED = 3.0  # [s] after a push that belong to the recovery and to nothing else
UNSEEN = 0.25  # [s] without a measurement of the camera, after which the vehicle counts as lost
_SURE = (Doubt.SURE, Doubt.FLY_ON)
_NOT_FLOWN = (Doubt.HOVER, Doubt.LAND)


def located_figures(plan: PathPlan, samples: Samples, pushes: Sequence[float] = ()) -> dict[str, Any]:
    """Return FIGURES by name; None where nothing of the kind was flown, or nobody knows the truth.

    `pushes` [s, the flight's clock] are when somebody pushed the drone.
    """
    if len(samples.truths) != len(samples.whereabouts):
        return dict.fromkeys(FIGURES)
    rows = [
        (stamp, truth, known, phase)
        for stamp, truth, known, phase in zip(
            samples.times, samples.truths, samples.whereabouts, samples.phases, strict=True
        )
        if known is not None and phase in _ON_PATH
    ]
    if not rows:
        return dict.fromkeys(FIGURES)
    times = np.array([stamp for stamp, *_ in rows])
    true = np.array([[*truth.pose.position, truth.pose.yaw] for _, truth, _, _ in rows])
    wanted = np.array([known.wanted for _, _, known, _ in rows])
    held = np.array([[*known.position, known.yaw] for _, _, known, _ in rows])
    stopped = np.array([phase == "stop" for *_, phase in rows])
    flying = ~np.array([known.doubt in _NOT_FLOWN for _, _, known, _ in rows]) & ~_pushed(times, pushes)
    path = plan.path
    nearest = [path.at(nearest_anywhere(path, x)).position for x in np.ascontiguousarray(true[:, :3])]
    across = np.linalg.norm(true[:, :3] - np.array(nearest), axis=1)[~stopped & flying]
    standing = np.linalg.norm((true - wanted)[:, :3], axis=1)[_settled(times, stopped) & flying]
    turned = np.abs(np.degrees(_wrapped(true[:, 3] - wanted[:, 3])))[flying]
    away = np.linalg.norm((held - true)[:, :3], axis=1)
    yaw = np.degrees(_wrapped(held[:, 3] - true[:, 3]))
    return {
        "cross_track_max_m": _of(across, np.max),
        "cross_track_mean_m": _of(across, np.mean),
        "cross_track_p95_m": _of(across, _p95),
        "hover_rms_m": _of(standing, _rms),
        "heading_p95_deg": _of(turned, _p95),
        "position_rms_m": _of(away, _rms),
        "position_p95_m": _of(away, _p95),
        "yaw_mean_deg": _of(yaw, np.mean),
        "yaw_sd_deg": _of(yaw, np.std),
        "lost_s": _lost(samples),
    }


def final_goal(samples: Samples) -> Pose | None:
    """Return where a located pilot wanted to be at the end; None where it never knew where it was."""
    known = next((known for known in reversed(samples.whereabouts) if known is not None), None)
    return None if known is None else Pose(known.wanted[:3].copy(), float(known.wanted[3]))


def _settled(times: Array, stopped: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which ticks (n,) belong to a stop but to its first 4 s."""
    moved = np.maximum.accumulate(np.where(stopped, times[0], times))  # when it last did
    return np.asarray(stopped & (times - moved > SETTLING))


def _pushed(times: Array, pushes: Sequence[float]) -> NDArray[np.bool_]:
    """Return which ticks (n,) lie within 3 s after the beginning of a push."""
    after = np.zeros(times.shape, dtype=bool)
    for push in pushes:
        after |= (times >= push) & (times < push + PUSHED)
    return after


def _lost(samples: Samples) -> float:
    """Return for how long [s] it was unseen, or doubted more than flying on, once it knew where it was."""
    total, seen = 0.0, -np.inf
    before = None
    for stamp, known in zip(samples.times, samples.whereabouts, strict=True):
        if known is not None and known.measured is not None:
            seen = stamp
        begun = np.isfinite(seen)
        doubtful = known is None or known.doubt not in _SURE or stamp - seen > UNSEEN
        if begun and before is not None and doubtful:
            total += stamp - before
        before = stamp
    return float(total)


def _of(values: Array, figure: Any) -> float | None:
    return float(figure(values)) if values.size else None


def _p95(values: Array) -> float:
    return float(np.percentile(values, 95.0))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _wrapped(angles: Array) -> Array:
    return np.asarray(np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi)
