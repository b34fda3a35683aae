"""Figures of a flight that was not flown."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def pretended_summary(outcome: str, recording: Path) -> dict[str, Any]:
    """Return figures in the form of the contract."""
    return {
        "outcome": outcome,
        "reason": "" if outcome == "reached" else "the time limit of 5 s has passed",
        "duration_s": 12.5,
        "position_error_m": 0.0125,
        "yaw_error_deg": 0.25,
        "epsilon_px": 1.5,
        "min_clearance_m": float("inf"),
        "max_command_step": {"linear": 0.03, "angular": 0.06},
        "tick_ms": {"median": 2.0, "p95": 4.0},
        "realtime_factor": 3.5,
        "recording": str(recording),
        "report": None,
    }
