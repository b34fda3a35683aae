"""Flights of the path follower on the simulator's dynamics, without pictures: a state estimate comes in.

The vehicles: "tilt" takes the identified model's inputs themselves (-1 to 1), as the paper's did;
"identified" is the same behind an onboard velocity loop, "first_order" a lag; both take velocities.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from noctule.estimation.delayed import DelayedFilter
from noctule.estimation.events import Input
from noctule.estimation.filter_state import Prior, StateEstimate, start_at
from noctule.estimation.measurements import NavdataNoise, of_pose, of_vehicle_state
from noctule.estimation.vehicle_model import VehicleModel
from noctule.geometry import rot_z, wrap_angle
from noctule.messages import FlightState, PoseMeasurement, VehicleState
from noctule.pilots.path_follower import FollowerSettings, PathFollower
from noctule.simulation.dynamics import STEP, STEPS_PER_SECOND, Motion, advance, make_model
from noctule.simulation.spec import LimitsSpec, VehicleSpec

LAG = 0.3
WIDE = LimitsSpec(forward=2.0, left=2.0, up=2.0, yaw_rate=3.0, acceleration=10.0, yaw_acceleration=20.0)
DT = 10  # steps of 1/300 s in a tick
UNIT = np.ones(4)
NO_COMMAND = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Tilted:
    """The identified model with its inputs as commands: nothing on board closes a loop."""

    gains: tuple
    drags: tuple

    def acceleration(self, velocity, command):
        return tuple(
            k * max(-1.0, min(1.0, u)) - d * v
            for k, d, u, v in zip(self.gains, self.drags, command, velocity, strict=True)
        )


def vehicle(kind):
    """Return the simulated vehicle, the model of it that a user would have, and its largest commands."""
    if kind == "tilt":
        known = VehicleModel.identified()
        return Tilted(tuple(known.input_gains), tuple(known.drags)), known, UNIT
    made = make_model(VehicleSpec(model=kind, lag=LAG))
    return made, VehicleModel.velocity_loop(LAG), np.array([2.0, 2.0, 2.0, 3.0])


def off_by(model, share, seed=0):
    """Return the model with each of k1 to k8 wrong by `share`, up or down as the seed draws."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], 8)
    return VehicleModel(
        model.input_gains * (1.0 + share * signs[:4]), model.drags * (1.0 + share * signs[4:]), model.delay
    )


@dataclass
class Perfect:
    """Knows the state as it is."""

    def sense(self, t, state, motion):
        pass

    def command(self, t, u):
        pass

    def estimate(self, t, state):
        return StateEstimate(t, state.copy(), np.eye(8))


class Fused:
    """The fusion's filter on what the sensors would say, late and noisy as in the experiments."""

    def __init__(self, seed, state, model, camera=(0.0025, 1.2)):
        self.rng = np.random.default_rng([seed, 77])
        self.filter = DelayedFilter(start_at(-0.01, state[:3], state[3], Prior(0.02, 0.02, 0.1, 0.1)), model)
        self.late: list = []
        self.camera_sd = np.array([*[camera[0]] * 3, np.radians(camera[1])])
        self.bias = self.rng.normal(0.0, 0.03, 3)
        self.drift, self.next_camera, self.next_report, self.count = 0.0, 0.0, 0.0, 0

    def sense(self, t, state, motion):
        rng = self.rng
        if t >= self.next_camera:
            self.next_camera += 1.0 / 30.0
            z = state[:4] + rng.normal(0.0, self.camera_sd)
            seen = PoseMeasurement(t, z[:3], wrap_angle(z[3]), np.diag(self.camera_sd**2), "depth")
            self._later(t + 0.04, of_pose(seen, self._number()))
        if t >= self.next_report:
            self.next_report = t + 1.0 / rng.uniform(28.0, 67.0)
            self.bias += rng.normal(0.0, 0.002, 3)
            self.drift += rng.normal(0.0, np.radians(0.05))
            v = rot_z(state[3]).T @ state[4:7] + self.bias + rng.normal(0.0, 0.06, 3)
            height = round((state[2] + rng.normal(0.0, 0.02)) / 0.01) * 0.01
            # Table 3: an error of 15 degrees in the mean that goes with the heading, up to 30.
            table = np.radians(14.6 - 10.0 * np.cos(state[3]))
            yaw = wrap_angle(state[3] + table + self.drift + rng.normal(0.0, np.radians(2.0)))
            said = VehicleState(t, FlightState.FLYING, yaw=yaw, v_body=v, height=height)
            if rng.random() > 0.03:
                self._later(
                    t + rng.uniform(0.042, 0.09), of_vehicle_state(said, NavdataNoise(), self._number())
                )
        for item in [item for item in self.late if item[0] <= t]:
            self.filter.insert(item[2])
            self.late.remove(item)

    def command(self, t, u):
        self.filter.insert(Input(t, u, sequence=self._number()))

    def estimate(self, t, state):
        return self.filter.estimate(t)

    def _number(self):
        self.count += 1
        return self.count

    def _later(self, at, event):
        self.late.append((at, self._number(), event))


@dataclass
class Flown:
    """What happened, a row for every tick."""

    t: np.ndarray  # (n,) [s] since the path was begun
    state: np.ndarray  # (n, 8), the truth
    wanted: np.ndarray  # (n, 4)
    estimate: np.ndarray  # (n, 8)
    reports: list
    commands: np.ndarray  # (n, 4)
    pushes: tuple = ()
    follower: PathFollower | None = field(default=None, repr=False)

    def on_path(self, path):
        """Return the true distance from the path, the nearest point looked for everywhere, (n,) [m]."""
        i = (((path.position[None] - self.state[:, None, :3]) ** 2).sum(axis=2)).argmin(axis=1)
        gap, along = self.state[:, :3] - path.position[i], path.tangent[i]
        return np.linalg.norm(gap - (gap * along).sum(axis=1, keepdims=True) * along, axis=1)

    def calm(self, after=3.0):
        """Return which rows are not within `after` [s] of a push, (n,)."""
        return ~np.any([(self.t >= p) & (self.t < p + after) for p in self.pushes], axis=0) | (
            not self.pushes
        )

    def cross_track(self, plan, stops):
        """Return mean and 95th percentile [m] outside of stops and 3 s after pushes."""
        rows = self.calm() & ~np.any([(self.t >= a) & (self.t < b) for a, b in stops], axis=0)
        d = self.on_path(plan.path)[rows]
        return float(d.mean()), float(np.quantile(d, 0.95))

    def hover_rms(self, stops):
        """Return the rms distance [m] from the held point, without a stop's first 4 s and pushes."""
        rows = self.calm() & np.any([(self.t >= a + 4.0) & (self.t < b) for a, b in stops], axis=0)
        d = np.linalg.norm(self.state[rows, :3] - self.wanted[rows, :3], axis=1)
        return float(np.sqrt((d**2).mean()))

    def recoveries(self, path, limit=0.08):
        """Return for each push the last time within 3 s [s] at which it was farther off than `limit` [m]."""
        held = np.array([r.holding for r in self.reports])
        off = np.where(
            held, np.linalg.norm(self.state[:, :3] - self.wanted[:, :3], axis=1), self.on_path(path)
        )
        found = []
        for p in self.pushes:
            rows = np.flatnonzero((self.t >= p) & (self.t < p + 3.0) & (off > limit))
            found.append(float(self.t[rows[-1]] - p) if rows.size else 0.0)
        return found


def fly(
    plan,
    kind="tilt",
    seconds=20.0,
    model=None,
    delay=0.02,
    known_delay=None,
    gust=0.6,
    pushes=(),
    seed=0,
    fused=False,
    start=None,
    settings=None,
):
    """Fly the plan, from its first point where no other `start` (x, y, z, yaw) is given."""
    truth_model, known, limits = vehicle(kind)
    known = known if model is None else model
    known = VehicleModel(known.input_gains, known.drags, delay if known_delay is None else known_delay)
    if settings is None:
        settings = FollowerSettings(go_to_start=start is not None)
    follower = PathFollower(plan, known, limits, settings)
    rng = np.random.default_rng([seed, 3])
    if start is None:
        at = plan.path.start
        heading = 0.0 if not hasattr(plan.heading, "yaw") else plan.heading.yaw
        if type(plan.heading).__name__ == "AlongPath":
            heading = float(np.arctan2(at.tangent[1], at.tangent[0]))
        start = (*at.position, heading)
    m = Motion(*(float(v) for v in start))
    spec = VehicleSpec(limits=WIDE)
    eye = Fused(seed, state_of(m), known) if fused else Perfect()
    on_way: list = []
    command = NO_COMMAND
    directions = [push_direction(rng) for _ in pushes]
    rows: list = []
    for step in range(round(seconds * STEPS_PER_SECOND)):
        t = step * STEP
        eye.sense(t, state_of(m), m)
        if step % DT == 0:
            estimate = eye.estimate(t, state_of(m))
            nu, report = follower.step(estimate, t)
            u = nu.as_array()
            eye.command(t, u)
            on_way.append((t + delay, tuple(float(v) for v in u)))
            rows.append(
                (report.path_time - known.delay, state_of(m), report.wanted, estimate.x[:8], report, u)
            )
        while on_way and on_way[0][0] <= t + 1e-9:
            command = on_way.pop(0)[1]
        blow = gust * rng.standard_normal(3)
        path_time = rows[-1][0] + (step % DT) * STEP
        for p, (direction, turn) in zip(pushes, directions, strict=True):
            if p <= path_time < p + 0.2:
                blow = blow + direction
                m.yaw_rate += STEP * turn
        advance(m, truth_model, spec, command, tuple(float(v) for v in blow))
        if abs(m.x) + abs(m.y) + abs(m.z) > 50.0:
            break
    t, state, wanted, estimates, reports, commands = zip(*rows, strict=True)
    return Flown(
        np.array(t), np.array(state), np.array(wanted), np.array(estimates), list(reports),
        np.array(commands), tuple(pushes), follower,
    )  # fmt: skip


def state_of(m):
    return np.array([m.x, m.y, m.z, m.yaw, m.vx, m.vy, m.vz, m.yaw_rate])


def push_direction(rng):
    """Return an acceleration (3,) [m/s^2] of the experiments' pushes, and one of the yaw [rad/s^2]."""
    d = rng.normal(size=3) * np.array([1.0, 1.0, 0.3])
    return 4.5 * d / np.linalg.norm(d), float(rng.choice([-3.0, 3.0]))
