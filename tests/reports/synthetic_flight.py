"""A flight that never was: a smooth curve past a column, with everything that a report can draw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from noctule.messages import ColumnBox, Limits
from noctule.reports.flight_log import FlightLog, Snapshot, Solid, TruthLog

TICK = 1.0 / 30.0


def box_outline(x: float, y: float, width: float, depth: float) -> np.ndarray:
    return np.array([[x, y], [x + width, y], [x + width, y + depth], [x, y + depth]])


def make_log(ticks: int = 300, truth: bool = True, snapshots: int = 6, seed: int = 0) -> FlightLog:
    rng = np.random.default_rng(seed)
    t = TICK * np.arange(ticks)
    end = max(t[-1], TICK)
    u = t / end
    x, y = 3.5 * (3 * u**2 - 2 * u**3), 0.5 * np.exp(-(((u - 0.4) / 0.12) ** 2)) + 0.3 * u**3
    z = 1.0 - 0.3 * u**2
    v = np.gradient(np.column_stack([x, y, z]), axis=0) / TICK
    asked = np.column_stack([v, 0.4 * np.sin(4 * u)])
    sent = np.clip(asked, -np.array([0.6, 0.6, 0.5, 0.8]), np.array([0.6, 0.6, 0.5, 0.8]))
    target = np.minimum((4 * u).astype(np.int64), 3)
    to_go = 1.0 - (4 * u - target)
    h = np.clip(np.minimum(12 * (u - 0.2), 12 * (0.55 - u)), 0, 1)
    height, width = 120, 214
    pictures = tuple(
        Snapshot(
            time=float(t[i]),
            pixels=rng.integers(60, 190, (height, width, 3), dtype=np.uint8),
            phase="following_path",
            target_index=int(target[i]),
            points_current=(p := rng.uniform((20, 20), (width - 20, height - 20), (25, 2))),
            points_ref=p + rng.normal(0, 4, (25, 2)),
            columns=(ColumnBox(90, 5, 104, 115, np.array([90, 60]), np.array([104, 60])),),
        )
        for i in np.linspace(0, ticks - 1, snapshots).astype(int)
    )
    solids = (
        Solid("column", box_outline(1.4, -0.05, 0.05, 0.1), 0.0, 2.5, "column 0"),
        Solid("furniture", box_outline(2.0, 1.1, 1.2, 0.5), 0.0, 0.8, "table"),
        Solid("furniture", box_outline(4.2, -1.8, 0.4, 1.2), 0.0, 1.9, "shelf"),
    )
    clearance = np.abs(np.hypot(x - 1.425, y) - 0.2 - 0.03)
    return FlightLog(
        times=t,
        asked=asked,
        sent=sent,
        phases=("following_path",) * ticks,
        target_index=target,
        epsilon=60 * to_go + rng.uniform(0, 1, ticks),
        errors=np.column_stack([0.3 * to_go, 0.1 * to_go, to_go, 0 * u, 0.2 * np.sin(5 * u), 0 * u]),
        activations={"avoidance": h, "visibility": np.roll(h, ticks // 4) * 0.8},
        task_errors={"avoidance": 0.2 * h, "visibility": 30 * u, "servoing": to_go},
        tick_ms=rng.gamma(6.0, 0.4, ticks),
        truth=TruthLog(t, np.column_stack([x, y, z]), 0.2 * u, np.linalg.norm(v, axis=1), clearance)
        if truth
        else None,
        limits=Limits(),
        tick_s=TICK,
        key_poses=np.array(
            [[1.5, 0.05, 1.0, 0.0], [2.0, 0.1, 0.95, 0.1], [3.0, 0.2, 0.8, 0.2], [3.5, 0.3, 0.7, 0.3]]
        ),
        solids=solids,
        room=np.array([[-1.0, -2.0, 0.0], [5.0, 2.0, 2.6]]),
        snapshots=pictures,
        safety_area=(12.0, 10.0, 202.0, 110.0),
        epsilon_limit=6.0,
        summary={
            "outcome": "reached",
            "duration_s": 21.37,
            "position_error_m": 0.0123,
            "yaw_error_deg": 0.217,
            "epsilon_px": 1.84,
            "min_clearance_m": 0.146,
            "max_command_step": {"linear": 0.0331, "angular": 0.0642},
            "tick_ms": {"median": 2.31, "p95": 4.87},
            "realtime_factor": 3.74,
            "recording": "out/flight.mcap",
        },
        about={"mission": "two-columns", "law": "noctule", "seed": "7", "noctule": "0.1.0"},
        mission_text='[mission]\nname = "two-columns"\n',
    )


def without_truth(log: FlightLog) -> FlightLog:
    gone = ("position_error_m", "yaw_error_deg", "min_clearance_m")
    return replace(
        log,
        truth=None,
        summary={k: v for k, v in log.summary.items() if k not in gone},
        notes=("no truth in this recording: error in metres not available",),
    )
