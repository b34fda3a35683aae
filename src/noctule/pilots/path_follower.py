"""Follows a path in space by what is known of the vehicle: to the start, along the path, stops, back.

Everything comes in with `step`: the estimate, the time, and what was really sent. It never reads a clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from noctule.control.cascade import CascadeSettings, cascade
from noctule.control.paths.heading import TurnReference, heading_at
from noctule.control.paths.plan import PathPlan
from noctule.control.paths.planning import straight
from noctule.control.paths.progress import Progress, Reference, advance, begin
from noctule.control.paths.speed import SpeedSettings
from noctule.control.paths.spot import Spot, hold, spot_ahead
from noctule.estimation.filter_state import StateEstimate
from noctule.estimation.vehicle_model import VehicleModel
from noctule.geometry import Array, wrap_angle
from noctule.messages import Command
from noctule.pilots.command_memory import CommandMemory
from noctule.pilots.following import (
    ON_PATH,
    SURE,
    Conduct,
    FollowerError,
    FollowerReport,
    FollowerSettings,
    FollowPhase,
)

__all__ = [
    "Conduct",
    "FollowPhase",
    "FollowerError",
    "FollowerReport",
    "FollowerSettings",
    "PathFollower",
    "warm_up",
]

_LONGEST_TICK = 0.2  # [s]; after a longer pause the wanted speed and heading go on from where they were
_BEFORE = (FollowPhase.TO_START, FollowPhase.SETTLE)


@dataclass(slots=True)
class PathFollower:
    """A deterministic state machine around `control.paths` and `control.cascade`.

    `model` counts its inputs in units of the command: m/s and rad/s of a velocity loop, or what
    `VehicleModelSettings.model` returns for a vehicle whose input 1 is `full_scale`. `limits` (4,) are the
    largest commands. The path is not begun before `begin_at` [s, of the ticks' stamps], where the follower
    goes to its start first, and left after `end_after` [s] of its own time. Raises DelayTooLongError and
    FollowerError.
    """

    plan: PathPlan
    model: VehicleModel
    limits: Array  # (4,) forward, left, up [m/s], yaw rate [rad/s]
    settings: FollowerSettings = field(default_factory=FollowerSettings)
    begin_at: float = -math.inf
    end_after: float = math.inf
    _phase: FollowPhase = FollowPhase.TO_START
    _leg: PathPlan | None = None
    _progress: Progress | None = None
    _spot: Spot | None = None  # where it hovers, in doubt or at an end that is no place on the path
    _begun: float = math.nan  # [s], the leg
    _path_begun: float = math.nan  # [s]
    _home: Array = field(default_factory=lambda: np.zeros(4))  # (4,) x, y, z, yaw
    _last: float = math.nan  # [s], stamp of the last tick
    _settled: float | None = None  # [s] since when the vehicle is at the start
    _gains: tuple[Array, Array, Array] = field(init=False)  # k1, k2, K
    _slow: Array = field(init=False)  # (4,) limits while it hovers in doubt
    _memory: CommandMemory = field(init=False)

    def __post_init__(self) -> None:
        """Refuse what cannot be flown."""
        self.settings.cascade.check_delay(self.model.delay)
        self._gains = self.settings.cascade.arrays()
        self.limits = np.asarray(self.limits, dtype=np.float64)
        if self.limits.shape != (4,) or not (self.limits > 0.0).all() or not np.isfinite(self.limits).all():
            raise FollowerError(f"follower: limits {self.limits.tolist()}; expected four numbers above 0")
        if not (self.model.input_gains > 0.0).all():
            raise FollowerError(
                f"follower: the vehicle's input gains are {self.model.input_gains.tolist()}; "
                "expected all above 0: identify the vehicle again"
            )
        slow = np.array([*(self.settings.hover_speed,) * 3, self.settings.hover_turn])
        self._slow = np.minimum(self.limits, slow)
        self._memory = CommandMemory(self.model, self.settings.cascade)

    @property
    def phase(self) -> FollowPhase:
        """What it is doing."""
        return self._phase

    @property
    def finished(self) -> bool:
        """Whether the path has been flown, and the way back where it was asked for."""
        return self._phase is FollowPhase.HOLD

    @property
    def push(self) -> Array:
        """What acts on the vehicle beside its commands, as a command (4,): trim, draught, a wrong model."""
        return self._memory.push

    def forget(self) -> None:
        """Drop what was learnt and held by an estimate that has turned out wrong."""
        self._memory.forget()
        self._spot = None

    def step(
        self, estimate: StateEstimate, stamp: float, sent: Command | None = None, conduct: Conduct = SURE
    ) -> tuple[Command, FollowerReport]:
        """Return the command of the tick at `stamp` [s], and what it was made of.

        `estimate` may be older than the tick: it is predicted to when the command takes effect. `sent` is
        what was really sent at the last tick, where a supervisor or the vehicle changed the command,
        `conduct` how sure to fly. Raises FollowerError, and changes nothing, for an estimate not finite.
        """
        now = np.ascontiguousarray(estimate.x[:8])
        if not all(map(math.isfinite, now.tolist())):
            raise FollowerError(
                f"follower: the estimate at {estimate.stamp:.2f} s is not finite; hover until it is again"
            )
        memory = self._memory
        memory.told(sent)
        until = max(stamp, estimate.stamp) + self.model.delay
        memory.learn(now, estimate.stamp, learning=not conduct.hover)
        x = memory.predict(now, estimate.stamp, until)
        dt = 0.0 if math.isnan(self._last) else min(max(0.0, stamp - self._last), _LONGEST_TICK)
        self._last = stamp
        wanted = self._wanted(x, stamp, until, dt, conduct)
        memory.asked(wanted.velocity, float(x[3]))
        target, limits = wanted.pose, self._slow if conduct.hover else self.limits
        if conduct.hover and conduct.trust < 1.0:
            target = _nearer(x, target, conduct.trust)
        u, free, v_r, _ = cascade(
            x, target, wanted.velocity, wanted.motion, wanted.acceleration, *self._gains,
            self.model.input_gains, self.model.drags, memory.push, limits,
        )  # fmt: skip
        if conduct.hover and conduct.trust <= 0.0:
            u = np.zeros(4)  # what is not known is not flown on: the vehicle holds its own velocity
        memory.remember(stamp, u)
        report = self._report(x, wanted.pose, v_r, u.tolist() != free.tolist(), until, conduct.hover)
        return Command.from_array(u), report

    def _wanted(self, x: Array, stamp: float, until: float, dt: float, conduct: Conduct) -> Reference:
        """Return what is wanted at this tick."""
        leg, progress = self._leg, self._progress
        if leg is None or progress is None or not conduct.hover:
            leg, progress = self._leg_of(x, stamp, until)
        ended = self._phase is FollowPhase.HOLD and not progress.arrived
        if not conduct.hover and not ended:
            self._spot = None
            self._progress, wanted = advance(leg, progress, x, until - self._begun, dt, conduct.pace)
            return wanted
        if self._spot is None:
            self._spot = spot_ahead(x, progress, leg)
        turn, wanted = hold(self._spot, progress.turn, dt, leg.turning)
        # From a stand: it must not dash off when it goes on.
        self._progress = replace(progress, turn=turn, allowed=0.0, speed=0.0)
        self._settled = None
        return wanted

    def _leg_of(self, x: Array, stamp: float, until: float) -> tuple[PathPlan, Progress]:
        """Return the leg to fly at this tick and the progress on it; begins the next one where one ends."""
        leg, progress, phase = self._leg, self._progress, self._phase
        if leg is None or progress is None:
            self._home = np.append(x[:3], wrap_angle(float(x[3])))
            turn = TurnReference(float(self._home[3]), float(x[7]))
            if not self.settings.go_to_start:
                return self._follow(turn, until)
            yaw = self._start_yaw()
            to_start = straight(x[:3], self.plan.path.position[0], yaw, self.settings.transfer)
            return self._begin(FollowPhase.TO_START, to_start, turn, until)
        if phase in _BEFORE:
            if self._is_settled(x, until) and stamp >= self.begin_at:
                return self._follow(progress.turn, until)
            self._phase = FollowPhase.SETTLE if progress.arrived else FollowPhase.TO_START
        elif phase is FollowPhase.RETURN and progress.arrived:
            self._phase = FollowPhase.HOLD
        elif phase in ON_PATH and (progress.arrived or until - self._path_begun >= self.end_after):
            if self.settings.return_home:
                home = straight(x[:3], self._home[:3], float(self._home[3]), self.settings.transfer)
                return self._begin(FollowPhase.RETURN, home, progress.turn, until)
            self._phase = FollowPhase.HOLD
        elif phase in ON_PATH:
            self._phase = FollowPhase.STOP if progress.holding else FollowPhase.FOLLOW
        return leg, progress

    def _follow(self, turn: TurnReference, until: float) -> tuple[PathPlan, Progress]:
        self._path_begun = until
        return self._begin(FollowPhase.FOLLOW, self.plan, turn, until)

    def _begin(
        self, phase: FollowPhase, leg: PathPlan, turn: TurnReference, until: float
    ) -> tuple[PathPlan, Progress]:
        self._phase, self._leg, self._begun = phase, leg, until
        self._progress = begin(leg, turn)
        return leg, self._progress

    def _start_yaw(self) -> float:
        """Return the heading [rad] with which the path begins; where it has none, the vehicle's."""
        found = heading_at(self.plan.heading, self.plan.path.start, 0.0)
        return float(self._home[3]) if found is None else found[0]

    def _is_settled(self, x: Array, until: float) -> bool:
        """Return whether the vehicle has been at the start long enough."""
        off = float(np.linalg.norm(x[:3] - self.plan.path.position[0]))
        turned = abs(wrap_angle(float(x[3]) - self._start_yaw()))
        if off > self.settings.arrive_m or turned > math.radians(self.settings.arrive_deg):
            self._settled = None
        elif self._settled is None:
            self._settled = until
        return self._settled is not None and until - self._settled >= self.settings.settle_s

    def _report(
        self, x: Array, pose: Array, v_r: Array, saturated: bool, until: float, hovering: bool
    ) -> FollowerReport:
        progress = self._progress
        assert progress is not None
        return FollowerReport(
            phase=self._phase,
            path_time=until - self._path_begun,
            s=progress.s,
            cross_track=math.dist(x[:3].tolist(), pose[:3].tolist()),
            yaw_error=wrap_angle(float(pose[3] - x[3])),
            speed=progress.speed,
            wanted=pose,
            predicted=x,
            velocity_ref=v_r,
            disturbance=self._memory.disturbance,
            saturated=saturated,
            holding=progress.holding,
            finished=self.finished,
            hovering=hovering,
        )


def _nearer(x: Array, pose: Array, share: float) -> Array:
    """Return a pose (4,) that is only so much of the way from `x` (8,) to `pose` (4,)."""
    away = pose - x[:4]
    away[3] = wrap_angle(float(away[3]))
    return np.asarray(x[:4] + share * away)


def warm_up() -> None:
    """Compile all that a tick runs, so that the first tick of a flight does not wait for it."""
    way = straight((0.0, 0.0, 1.0), (0.2, 0.0, 1.0), 0.0, SpeedSettings())
    settings = FollowerSettings(go_to_start=False, cascade=CascadeSettings(disturbance_rate=1.0))
    follower = PathFollower(way, VehicleModel.velocity_loop(0.3, delay=0.1), np.ones(4), settings)
    for tick in range(6):  # along it, and held at its end
        x = np.array([0.05 * tick, 0.0, 1.0, 0.0, 0.1, 0.0, 0.0, 0.0])
        follower.step(StateEstimate(0.03 * tick, x, np.eye(8)), 0.03 * tick)
