"""Flights of the located pilot on the simulator's dynamics, without pictures.

A locator that is told the truth says what the registration would, 40 ms late and as noisy; the vehicle
reports as `simulation.navdata` has it, and its velocity loop holds the velocity that it measures.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from pilots_space_flight import push_direction

from noctule.estimation.identification import VehicleModelSettings
from noctule.estimation.sensors import Sensors
from noctule.geometry import rot_z, wrap_angle
from noctule.localization.located import Located, LocatorState
from noctule.messages import (
    Command,
    DepthFrame,
    FlightState,
    Limits,
    Observation,
    PoseMeasurement,
    VehicleState,
)
from noctule.pilots.located_factory import make_located_pilot
from noctule.pilots.located_settings import LocatedSettings
from noctule.simulation.dynamics import STEP, STEPS_PER_SECOND, Motion, advance, make_model
from noctule.simulation.navdata import Navdata, NavdataSpec
from noctule.simulation.spec import LimitsSpec, VehicleSpec

LIMITS = LimitsSpec(forward=1.0, left=1.0, up=1.0, yaw_rate=1.5, acceleration=5.0, yaw_acceleration=10.0)
DT = 10  # steps in a tick
CAMERA_LATE = 0.04  # [s]
LAG = 0.3
EMPTY = np.zeros((1, 1), dtype=np.uint16)
POSE_SD = np.array([0.0022, 0.0022, 0.0022, np.radians(0.6)])


def loop_model(lag=LAG, delay=0.02):
    """Return what identification would find of a vehicle with a velocity loop."""
    return VehicleModelSettings(k=(1.0 / lag,) * 8, delay_s=delay)


def off_by(model, share, seed):
    """Return the model with each of k1 to k8 wrong by `share`, up or down as the seed draws."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], 8)
    return model.model_copy(update={"k": tuple((np.array(model.k) * (1.0 + share * signs)).tolist())})


class Eye:
    """A locator: says what the camera would say of the truth at a frame's exposure."""

    def __init__(self, seed, hidden=(), why="occluded: 0 % of the drone can be seen"):
        self.rng = np.random.default_rng([seed, 11])
        self.truth = {}
        self.hidden, self.why = hidden, why
        self.turned = ()  # spans in which the half turn seen is the wrong one

    def step(self, frame, prediction=None):
        noise = self.rng.normal(0.0, POSE_SD)
        if any(a <= frame.stamp < b for a, b in self.hidden):
            return Located(frame.stamp, LocatorState.LOST, None, self.why)
        z = self.truth[frame.stamp] + noise
        cov = np.diag(POSE_SD**2)
        pose = PoseMeasurement(frame.stamp, z[:3], wrap_angle(float(z[3])), cov, "registration")
        return Located(frame.stamp, LocatorState.TRACKING, pose, "", True)


@dataclass
class Rows:
    """What happened, a row for every tick."""

    t: np.ndarray  # (n,) [s], the flight's clock
    state: np.ndarray  # (n, 8), the truth
    commands: np.ndarray  # (n, 4), sent
    decisions: list
    reports: list
    pilot: object = field(repr=False)
    pushes: tuple = ()

    @property
    def path_time(self):
        return np.array(
            [np.nan if d.whereabouts is None else d.whereabouts.path_time for d in self.decisions]
        )

    @property
    def wanted(self):
        return np.array(
            [np.full(4, np.nan) if d.whereabouts is None else d.whereabouts.wanted for d in self.decisions]
        )

    @property
    def doubts(self):
        return [None if d.whereabouts is None else d.whereabouts.doubt for d in self.decisions]

    @property
    def phases(self):
        return [d.phase for d in self.decisions]

    def calm(self, after=3.0):
        return ~np.any([(self.t >= p) & (self.t < p + after) for p in self.pushes], axis=0) | (
            not self.pushes
        )

    def off_path(self, path):
        i = (((path.position[None] - self.state[:, None, :3]) ** 2).sum(axis=2)).argmin(axis=1)
        gap, along = self.state[:, :3] - path.position[i], path.tangent[i]
        return np.linalg.norm(gap - (gap * along).sum(axis=1, keepdims=True) * along, axis=1)

    def off_wanted(self):
        return np.linalg.norm(self.state[:, :3] - self.wanted[:, :3], axis=1)

    def figures(self, plan, stops):
        """Return cross-track mean and p95, hover rms [m], recoveries [s]."""
        s = self.path_time
        stopped = np.any([(s >= a) & (s < b) for a, b in stops], axis=0)
        rows = (s >= 0.0) & self.calm() & ~stopped
        d = self.off_path(plan.path)[rows]
        still = (s >= 0.0) & self.calm() & np.any([(s >= a + 4.0) & (s < b) for a, b in stops], axis=0)
        hover = np.sqrt((self.off_wanted()[still] ** 2).mean()) if still.any() else np.nan
        return float(d.mean()), float(np.quantile(d, 0.95)), float(hover), self.recoveries(plan, stopped)

    def recoveries(self, plan, stopped, limit=0.08):
        off = np.where(stopped, self.off_wanted(), self.off_path(plan.path))
        found = []
        for p in self.pushes:
            rows = np.flatnonzero((self.t >= p) & (self.t < p + 3.0) & (off > limit))
            found.append(float(self.t[rows[-1]] - p) if rows.size else 0.0)
        return found

    def position_rms(self):
        rows = np.array([d.whereabouts is not None for d in self.decisions])
        x = np.array([d.whereabouts.position for d in self.decisions if d.whereabouts is not None])
        return float(np.sqrt(((x - self.state[rows, :3]) ** 2).sum(axis=1).mean()))


def fly(
    plan,
    kind="identified",
    seconds=30.0,
    model=None,
    delay=0.02,
    known_delay=None,
    gust=0.6,
    pushes=(),
    seed=0,
    start=None,
    settings=None,
    hidden=(),
    silent=(),
    no_frames=(),
    why="occluded: 0 % of the drone can be seen",
    sensors=None,
    limits=LIMITS,
    bias=0.03,
    pilot_of=None,
    on_tick=None,
):
    """Fly the plan; `pushes` [s] are times of the flight's clock, spans are (from, to) likewise."""
    spec = VehicleSpec(model=kind, lag=LAG, limits=limits)
    truth_model = make_model(spec)
    told = delay if known_delay is None else known_delay
    model = loop_model() if model is None else model
    model = model.model_copy(update={"delay_s": told})
    settings = LocatedSettings() if settings is None else settings
    sensors = Sensors() if sensors is None else sensors
    eye = Eye(seed, hidden, why)
    allowed = Limits(**limits.model_dump())
    pilot = make_located_pilot(settings, plan, eye, sensors, model, allowed)
    if pilot_of is not None:
        pilot = pilot_of(pilot)
    rng = np.random.default_rng([seed, 3])
    if start is None:
        start = (*plan.path.start.position, 0.0)
    m = Motion(*(float(v) for v in start))
    nav = Navdata(NavdataSpec(velocity_bias=bias), np.random.SeedSequence([seed, 5]), STEPS_PER_SECOND)
    directions = [push_direction(rng) for _ in pushes]
    on_way, frames, rows, sent = [], [], [], None
    command = (0.0, 0.0, 0.0, 0.0)
    report = truth_report(m, 0.0)
    for step in range(round(seconds * STEPS_PER_SECOND)):
        t = step * STEP
        fresh = nav.step(step, lambda t=t: truth_report(m, t))
        if fresh is not None and not any(a <= t < b for a, b in silent):
            report = fresh
        if step % DT == 3 and not any(a <= t < b for a, b in no_frames):
            eye.truth = {stamp: x for stamp, x in eye.truth.items() if stamp > t - 0.5}
            eye.truth[t] = np.array([m.x, m.y, m.z, m.yaw])
            frames.append((t + CAMERA_LATE, DepthFrame(t, EMPTY)))
        if step % DT == 0:
            depth = None
            while frames and frames[0][0] <= t + 1e-9:
                depth = frames.pop(0)[1]
            observation = Observation(t, report, depth=depth, sent=sent)
            if on_tick is not None:
                observation = on_tick(observation)
            decision = pilot.step(observation)
            sent = decision.command
            on_way.append((t + delay, tuple(sent.as_array().tolist())))
            x = np.array([m.x, m.y, m.z, m.yaw, m.vx, m.vy, m.vz, m.yaw_rate])
            rows.append((t, x, sent.as_array(), decision, getattr(pilot, "report", None)))
            if decision.outcome is not None and pilot_of is None:
                break
        while on_way and on_way[0][0] <= t + 1e-9:
            command = on_way.pop(0)[1]
        blow = gust * rng.standard_normal(3)
        for p, (direction, turn) in zip(pushes, directions, strict=True):
            if p <= t < p + 0.2:
                blow = blow + direction
                m.yaw_rate += STEP * turn
        # The loop on board holds the velocity that it measures.
        held = tuple((np.array(command) - [*nav.velocity_bias, 0.0]).tolist())
        advance(m, truth_model, spec, held, tuple(float(v) for v in blow))
        if abs(m.x) + abs(m.y) + abs(m.z) > 50.0:
            break
    t, state, commands, decisions, reports = zip(*rows, strict=True)
    return Rows(
        np.array(t), np.array(state), np.array(commands), list(decisions), list(reports), pilot, tuple(pushes)
    )


def truth_report(m, t):
    v = rot_z(m.yaw).T @ np.array([m.vx, m.vy, m.vz])
    return VehicleState(t, FlightState.FLYING, 0.0, 0.0, wrap_angle(m.yaw), v, m.z)


NO_COMMAND = Command()
