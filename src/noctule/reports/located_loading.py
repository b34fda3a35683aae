"""From a recording to a `LocatedLog`: what the pilot held, what the camera saw, and the mission around it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from noctule.flight.reader import Tick
from noctule.geometry import Array
from noctule.messages import Decision
from noctule.pilots.handover import WARM_UP
from noctule.reports.located_log import LocatedLog, between
from noctule.reports.located_scene import LocatedScene

_NOTHING = np.full(4, np.nan)


def located_log(flown: Sequence[Tick], start: float, scene: LocatedScene) -> LocatedLog | None:
    """Return what `flown` ticks hold of where the pilot was; None of a pilot that is not located.

    `start` [s] is the stamp at which the report's time begins.
    """
    where = [None if t.decision is None else t.decision.whereabouts for t in flown]
    if all(w is None for w in where) and scene.path is None:
        return None
    times = np.array([t.stamp - start for t in flown])
    phases = tuple("" if t.decision is None else t.decision.phase for t in flown)
    handed_over = _handed_over(times, phases)
    # From then on another pilot flies, and this one wants nothing any more.
    wanting = [None if t >= handed_over else w for t, w in zip(times, where, strict=True)]
    at = np.array([np.nan if w is None else w.stamp - start for w in where])
    seen = [w.measured for w in where if w is not None and w.measured is not None]
    return LocatedLog(
        times=times,
        at=at,
        fused=np.array([_NOTHING if w is None else np.append(w.position, w.yaw) for w in where]),
        velocity=np.array([_NOTHING if w is None else w.velocity for w in where]),
        position_sd=np.array([np.nan if w is None else w.position_sd for w in where]),
        yaw_sd=np.array([np.nan if w is None else w.yaw_sd for w in where]),
        wanted=np.array([_NOTHING if w is None else w.wanted for w in wanting]),
        path_time=np.array([np.nan if w is None else w.path_time for w in where]),
        phases=phases,
        doubts=tuple("" if w is None else str(w.doubt) for w in where),
        doubt_reasons=tuple("" if w is None else w.doubt_reason for w in where),
        framed=np.array([t.depth_stamp is not None for t in flown]),
        seen=np.array([w is not None and w.measured is not None for w in where]),
        unseen_reasons=tuple(_why(t.decision) for t in flown),
        measured_times=np.array([m.stamp - start for m in seen]),
        measured=np.array([np.append(m.position, m.yaw) for m in seen]).reshape(-1, 4),
        reported_yaw=np.array([_reported_yaw(t) for t in flown]),
        true=between(times, _true(flown), at),
        pushes=scene.pushes(start),
        path=scene.path,
        walks=scene.walks(times + start),
        handed_over=handed_over,
    )


def _handed_over(times: Array, phases: Sequence[str]) -> float:
    """Return when another pilot took over [s]; NaN when none did."""
    waiting = [k for k, phase in enumerate(phases) if phase == WARM_UP]
    taken = waiting[-1] + 1 if waiting else len(phases)
    return float(times[taken]) if taken < len(phases) and phases[taken] else float("nan")


def _why(decision: Decision | None) -> str:
    if decision is None or (decision.whereabouts is None and decision.outcome is not None):
        return ""
    # Before it knows where it is a pilot says with the decision itself why the drone is not seen.
    return decision.reason if decision.whereabouts is None else decision.whereabouts.unseen_reason


def _reported_yaw(tick: Tick) -> float:
    state = tick.told.state
    return float(state.yaw) if state.HasField("yaw") else float("nan")


def _true(flown: Sequence[Tick]) -> Array:
    return np.array(
        [_NOTHING if t.truth is None else np.append(t.truth.pose.position, t.truth.pose.yaw) for t in flown]
    )
