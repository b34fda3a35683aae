"""A located flight that never was: the paper's ellipse with a stop, pushes and a person, hand-made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from noctule.control.paths import loc_1
from noctule.messages import Limits
from noctule.reports.flight_log import FlightLog, TruthLog
from noctule.reports.located_log import LocatedLog, Push, between

TICK = 1.0 / 30.0
STOP = (12.0, 24.0)  # [s]
PUSHES = (15.0, 20.0)  # [s]
BLIND = (30.0, 33.0)  # [s], the camera sees nothing
SPEED = 0.3  # [m/s]
BEGIN = 2.0  # [s]


def wrap(angle: np.ndarray) -> np.ndarray:
    return np.remainder(angle + np.pi, 2 * np.pi) - np.pi


def make_located(seconds: float = 40.0, truth: bool = True, seed: int = 0) -> LocatedLog:
    rng = np.random.default_rng(seed)
    t = TICK * np.arange(round(seconds / TICK))
    n = len(t)
    path = loc_1().path
    moving = (t >= BEGIN) & ~((t >= STOP[0]) & (t < STOP[1]))
    s = SPEED * TICK * np.cumsum(moving)
    points = [path.at(path.within(float(v))) for v in s]
    position = np.array([p.position for p in points])
    yaw = wrap(np.array([np.arctan2(p.tangent[1], p.tangent[0]) for p in points]))
    wanted = np.column_stack([position, yaw])

    def smooth(scale: float) -> np.ndarray:
        noise = rng.normal(size=n)
        for i in range(1, n):
            noise[i] = 0.95 * noise[i - 1] + 0.312 * noise[i]
        return scale * noise

    away = np.zeros(n)
    for push in PUSHES:
        since = np.clip(t - push, 0.0, None)
        away += 0.3 * since / 0.15 * np.exp(1.0 - since / 0.15) * (t >= push)
    true = wanted + np.column_stack(
        [smooth(0.004) + 0.6 * away, smooth(0.004) - 0.4 * away, smooth(0.003), smooth(0.01)]
    )
    true[:, 3] = wrap(true[:, 3])
    dark = (t >= BLIND[0]) & (t < BLIND[1])
    grown = np.where(dark, np.clip(t - BLIND[0], 0.0, None), 0.0)
    fused = true + np.column_stack(
        [smooth(0.003) + 0.02 * grown, smooth(0.003), smooth(0.003), smooth(0.012)]
    )
    fused[:, 3] = wrap(fused[:, 3])
    known = t >= 0.5
    fused[~known] = np.nan
    doubts = np.where(~known, "", "sure").astype(object)
    reasons = np.full(n, "", dtype=object)
    for level, begin, end in (("fly on", 0.3, 1.0), ("slow", 1.0, 2.0), ("hover", 2.0, 3.0)):
        inside = (t >= BLIND[0] + begin) & (t < BLIND[0] + end)
        doubts[inside] = level
        reasons[inside] = [
            f"the ceiling camera has not seen the drone for {v - BLIND[0]:.1f} s (too little of it is seen)"
            for v in t[inside]
        ]
    seen = known & ~dark & (rng.uniform(size=n) > 0.02)
    unseen = np.where(seen, "", np.where(known, "occluded: 12 % of the drone can be seen", ""))
    exposed = t[seen] - 0.04
    measured = between(t, true, np.clip(exposed, 0.0, None)) + rng.normal(size=(len(exposed), 4)) * (
        0.006,
        0.006,
        0.006,
        0.02,
    )
    measured[:, 3] = wrap(measured[:, 3])
    angle = 0.5 * t
    return LocatedLog(
        times=t,
        at=t,
        fused=fused,
        velocity=np.gradient(np.column_stack([fused[:, :3], np.unwrap(wanted[:, 3])]), TICK, axis=0),
        position_sd=np.where(known, 0.007 + 0.03 * grown, np.nan),
        yaw_sd=np.where(known, 0.014 + 0.01 * grown, np.nan),
        wanted=np.where(known[:, None], wanted, np.nan),
        path_time=np.where(t >= BEGIN, t - BEGIN, np.nan),
        phases=tuple(
            np.select([t < BEGIN, (t >= STOP[0]) & (t < STOP[1])], ["to start", "stop"], "follow").tolist()
        ),
        doubts=tuple(doubts.tolist()),
        doubt_reasons=tuple(reasons.tolist()),
        framed=np.ones(n, dtype=bool),
        seen=seen,
        unseen_reasons=tuple(unseen.tolist()),
        measured_times=exposed,
        measured=measured,
        reported_yaw=wrap(true[:, 3] + 0.4 + 0.01 * t),
        true=true if truth else np.full((n, 4), np.nan),
        pushes=tuple(Push(p, 0.2, 4.5) for p in PUSHES) if truth else (),
        path=path,
        walks=(np.column_stack([1.6 * np.cos(angle), 0.1 + 1.9 * np.sin(angle)]),) if truth else (),
    )


def make_located_log(seconds: float = 40.0, truth: bool = True) -> FlightLog:
    located = make_located(seconds, truth)
    t, n = located.times, len(located.times)
    v = np.gradient(located.true[:, :3], TICK, axis=0) if truth else np.empty((0, 3))
    asked = np.column_stack([0.3 * np.ones(n), 0.05 * np.sin(t), 0.05 * np.cos(t), 0.2 * np.sin(0.7 * t)])
    return FlightLog(
        times=t,
        asked=asked,
        sent=np.clip(asked, -0.29, 0.29),
        phases=("follow",) * n,
        target_index=np.zeros(n, dtype=np.int64),
        epsilon=np.full(n, np.nan),
        errors=np.full((n, 6), np.nan),
        tick_ms=np.random.default_rng(1).gamma(6.0, 0.3, n),
        truth=TruthLog(
            t,
            located.true[:, :3],
            located.true[:, 3],
            np.linalg.norm(v, axis=1),
            0.6 + 0.2 * np.sin(t),
            (),
            v,
        )
        if truth
        else None,
        limits=Limits(1.0, 1.0, 1.0, 1.5, 5.0, 10.0),
        located=located,
        summary={
            "outcome": "reached",
            "reason": "the path is flown",
            "duration_s": 39.97,
            "position_error_m": None,
            "min_clearance_m": 0.41 if truth else None,
            "max_command_step": {"linear": 0.03, "angular": 0.06},
            "tick_ms": {"median": 1.8, "p95": 2.9},
            **(_FIGURES if truth else {}),
        },
        about={"mission": "loc-1", "seed": "3", "noctule": "0.1.0"},
        notes=() if truth else ("No truth in this recording: error in metres not available.",),
    )


_FIGURES = {
    "cross_track_mean_m": 0.0047,
    "cross_track_p95_m": 0.0085,
    "hover_rms_m": 0.0064,
    "heading_p95_deg": 1.23,
    "recovery_s": {"mean": 0.52, "max": 0.61},
    "position_rms_m": 0.0078,
    "yaw_sd_deg": 0.71,
    "lost_s": 2.8,
}


def unlocated(log: FlightLog) -> FlightLog:
    return replace(log, located=None)
