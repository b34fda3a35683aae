"""What the ticks alone say of a flight, for recordings that end before their summary."""

from __future__ import annotations

from typing import Any

import numpy as np

from noctule.geometry import Array, wrap_angle
from noctule.messages import Decision, Outcome
from noctule.reports.flight_log import FlightLog


def tally(log: FlightLog, last: Decision) -> dict[str, Any]:
    """Return the summary's figures as far as the ticks give them; `last` is the pilot's last answer.

    The errors at the end are given for flights that reached the last image; on the way they mean nothing.
    """
    touched = log.truth is not None and bool(log.truth.contacts)
    outcome = str(Outcome.COLLIDED) if touched else "" if last.outcome is None else str(last.outcome)
    steps = log.command_steps
    summary: dict[str, Any] = {
        "outcome": outcome or None,
        "reason": last.reason,
        "duration_s": log.span[1] - log.span[0],
        "epsilon_px": _or_none(_last(log.epsilon)),
        "max_command_step": {"linear": _or_none(_most(steps[:, 0])), "angular": _or_none(_most(steps[:, 1]))},
    }
    ticks = log.tick_ms[np.isfinite(log.tick_ms)]
    if len(ticks):
        summary["tick_ms"] = {"median": float(np.median(ticks)), "p95": float(np.percentile(ticks, 95))}
    if log.truth is not None:
        clearance = log.truth.clearance[np.isfinite(log.truth.clearance)]
        summary["min_clearance_m"] = float(clearance.min()) if len(clearance) else None
        if outcome == Outcome.REACHED and len(log.key_poses):
            goal = log.key_poses[-1]
            summary["position_error_m"] = float(np.linalg.norm(log.truth.position[-1] - goal[:3]))
            turn = wrap_angle(float(log.truth.yaw[-1]) - float(goal[3]))
            summary["yaw_error_deg"] = abs(float(np.degrees(turn)))
    return summary


def _last(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known[-1]) if len(known) else float("nan")


def _most(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else float("nan")


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None
