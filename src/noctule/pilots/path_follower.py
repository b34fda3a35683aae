"""Follows a path in space by what is known of the vehicle: to the start, along the path, stops, back.

Everything comes in with `step`: the estimate, the time, and what was really sent. It never reads a clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from pydantic import Field

from noctule.control.cascade import CascadeSettings, cascade, disturbance_after, predict_over_delay
from noctule.control.paths.heading import TurnReference, heading_at
from noctule.control.paths.plan import PathPlan, straight
from noctule.control.paths.progress import Progress, advance, begin
from noctule.control.paths.speed import SpeedSettings
from noctule.errors import NoctuleError
from noctule.estimation.filter_state import StateEstimate
from noctule.estimation.vehicle_model import VehicleModel
from noctule.geometry import Array, wrap_angle
from noctule.messages import Command
from noctule.settings import Settings

_LONGEST_TICK = 0.2  # [s]; after a longer pause the wanted speed and heading go on from where they were
_GAP = 0.3  # [s]; estimates farther apart say nothing of a disturbance
_MEMORY = 64  # commands remembered: 2 s at 30 Hz, and a delay may be 0.5 s


class FollowerError(NoctuleError):
    """A vehicle that the follower cannot fly."""


class FollowPhase(StrEnum):
    """What the follower is doing."""

    TO_START = "to start"
    FOLLOW = "follow"
    STOP = "stop"
    RETURN = "return"
    HOLD = "hold"  # at the end of everything


class FollowerSettings(Settings):
    """Gains, and what happens before and after the path."""

    cascade: CascadeSettings = CascadeSettings()
    transfer: SpeedSettings = SpeedSettings(cruise=0.3)  # on the way to the start and back
    go_to_start: bool = Field(True, description="fly to the path's first point first; false: be there")
    return_home: bool = Field(False, description="fly back to where it began")
    arrive_m: float = Field(0.05, gt=0.0, le=1.0, description="at the start within this [m]")
    arrive_deg: float = Field(5.0, gt=0.0, le=90.0, description="and within this heading [deg]")
    settle_s: float = Field(0.5, ge=0.0, le=60.0, description="for this long [s]")


@dataclass(frozen=True, slots=True)
class FollowerReport:
    """What the follower saw and thought at a tick; recorded and drawn, never flown on."""

    phase: FollowPhase
    path_time: float  # [s] since the path was begun; NaN before
    s: float  # [m] along the path, or along the way to it or back
    cross_track: float  # [m] from the nearest or the wanted point, as predicted
    yaw_error: float  # [rad], wanted minus predicted
    speed: float  # [m/s], v_d
    wanted: Array  # (4,) x, y, z [m], yaw [rad]
    predicted: Array  # (8,) the state at which the command takes effect
    velocity_ref: Array  # (4,) v_r [m/s, rad/s], world
    disturbance: Array  # (4,) forward, left, up [m/s^2], yaw [rad/s^2], as learnt
    saturated: bool
    holding: bool
    finished: bool


@dataclass(slots=True)
class PathFollower:
    """A deterministic state machine around `control.paths` and `control.cascade`.

    `model` counts its inputs in units of the command: m/s and rad/s of a velocity loop, or what
    `VehicleModelSettings.model` returns for a vehicle whose input 1 is `full_scale`. `limits` (4,) are the
    largest commands. Raises DelayTooLongError and FollowerError.
    """

    plan: PathPlan
    model: VehicleModel
    limits: Array  # (4,) forward, left, up [m/s], yaw rate [rad/s]
    settings: FollowerSettings = field(default_factory=FollowerSettings)
    _phase: FollowPhase = FollowPhase.TO_START
    _leg: PathPlan | None = None
    _progress: Progress | None = None
    _begun: float = math.nan  # [s], the leg
    _path_begun: float = math.nan  # [s]
    _home: Array = field(default_factory=lambda: np.zeros(4))  # (4,) x, y, z, yaw
    _last: float = math.nan  # [s], stamp of the last tick
    _settled: float | None = None  # [s] since when the vehicle is at the start
    _gains: tuple[Array, Array, Array] = field(init=False)  # k1, k2, K
    _bounds: Array = field(init=False)  # (4,) of the disturbance
    _disturbance: Array = field(default_factory=lambda: np.zeros(4))  # (4,) [m/s^2, rad/s^2], body
    _before: tuple[float, Array] | None = None  # the last estimate: stamp [s], state (8,)
    # The last commands; before the first, nothing was sent since ever.
    _stamps: Array = field(default_factory=lambda: np.full(_MEMORY, -np.inf))  # (n,) [s]
    _sent: Array = field(default_factory=lambda: np.zeros((_MEMORY, 4)))  # (n, 4)

    def __post_init__(self) -> None:
        """Refuse what cannot be flown."""
        self.settings.cascade.check_delay(self.model.delay)
        self._gains = self.settings.cascade.arrays()
        self._bounds = np.array(self.settings.cascade.most_disturbance)
        self.limits = np.asarray(self.limits, dtype=np.float64)
        if self.limits.shape != (4,) or not (self.limits > 0.0).all() or not np.isfinite(self.limits).all():
            raise FollowerError(f"follower: limits {self.limits.tolist()}; expected four numbers above 0")
        if not (self.model.input_gains > 0.0).all():
            raise FollowerError(
                f"follower: the vehicle's input gains are {self.model.input_gains.tolist()}; "
                "expected all above 0: identify the vehicle again"
            )

    @property
    def finished(self) -> bool:
        """Whether the path has been flown, and the way back where it was asked for."""
        return self._phase is FollowPhase.HOLD

    def step(
        self, estimate: StateEstimate, stamp: float, sent: Command | None = None
    ) -> tuple[Command, FollowerReport]:
        """Return the command of the tick at `stamp` [s], and what it was made of.

        `estimate` may be older than the tick: it is predicted to when the command takes effect. `sent` is
        what was really sent at the last tick, where a supervisor or the vehicle changed the command. Raises
        FollowerError, and changes nothing, for an estimate that is not finite.
        """
        now = np.ascontiguousarray(estimate.x[:8])
        if not np.isfinite(now).all():
            raise FollowerError(
                f"follower: the estimate at {estimate.stamp:.2f} s is not finite; hover until it is again"
            )
        if sent is not None:
            self._sent[-1] = sent.as_array()
        gains, drags, delay = self.model.input_gains, self.model.drags, self.model.delay
        until = max(stamp, estimate.stamp) + delay
        self._learn(now, estimate.stamp)
        push = self._disturbance / gains  # as a command
        x = predict_over_delay(
            now, estimate.stamp, until, self._stamps, self._sent, push, gains, drags, delay
        )
        dt = 0.0 if math.isnan(self._last) else min(max(0.0, stamp - self._last), _LONGEST_TICK)
        self._last = stamp
        leg, progress = self._leg_of(x, until)
        self._progress, wanted = advance(leg, progress, x, until - self._begun, dt)
        u, free, v_r, _ = cascade(
            x, wanted.pose, wanted.velocity, wanted.motion, wanted.acceleration,
            *self._gains, gains, drags, push, self.limits,
        )  # fmt: skip
        self._remember(stamp, u)
        return Command.from_array(u), self._report(x, wanted.pose, v_r, bool((u != free).any()), until)

    def _leg_of(self, x: Array, until: float) -> tuple[PathPlan, Progress]:
        """Return the leg to fly at this tick and the progress on it; begins the next one where one ends."""
        if self._leg is None or self._progress is None:
            self._home = np.append(x[:3], wrap_angle(float(x[3])))
            turn = TurnReference(float(self._home[3]), float(x[7]))
            if not self.settings.go_to_start:
                return self._follow(turn, until)
            yaw = self._start_yaw()
            to_start = straight(x[:3], self.plan.path.position[0], yaw, self.settings.transfer)
            return self._begin(FollowPhase.TO_START, to_start, turn, until)
        leg, progress = self._leg, self._progress
        if self._phase is FollowPhase.TO_START and self._is_settled(x, until):
            return self._follow(progress.turn, until)
        if progress.arrived and self._phase is FollowPhase.RETURN:
            self._phase = FollowPhase.HOLD
        elif progress.arrived and self._phase in (FollowPhase.FOLLOW, FollowPhase.STOP):
            if self.settings.return_home:
                home = straight(x[:3], self._home[:3], float(self._home[3]), self.settings.transfer)
                return self._begin(FollowPhase.RETURN, home, progress.turn, until)
            self._phase = FollowPhase.HOLD
        elif self._phase in (FollowPhase.FOLLOW, FollowPhase.STOP):
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

    def _learn(self, now: Array, stamp: float) -> None:
        """Compare the state with what was predicted of the last one."""
        settings, before = self.settings.cascade, self._before
        if before is not None and 0.0 < stamp - before[0] < _GAP and settings.disturbance_rate > 0.0:
            gains, drags, delay = self.model.input_gains, self.model.drags, self.model.delay
            push = self._disturbance / gains
            expected = predict_over_delay(
                before[1], before[0], stamp, self._stamps, self._sent, push, gains, drags, delay
            )
            self._disturbance = disturbance_after(
                self._disturbance, expected, now, settings.disturbance_rate, self._bounds
            )
        if before is None or stamp > before[0]:
            self._before = (stamp, now)

    def _remember(self, stamp: float, u: Array) -> None:
        self._stamps[:-1] = self._stamps[1:]
        self._sent[:-1] = self._sent[1:]
        self._stamps[-1], self._sent[-1] = stamp, u

    def _report(self, x: Array, pose: Array, v_r: Array, saturated: bool, until: float) -> FollowerReport:
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
            disturbance=self._disturbance,
            saturated=saturated,
            holding=progress.holding,
            finished=self.finished,
        )


def warm_up() -> None:
    """Compile all that a tick runs, so that the first tick of a flight does not wait for it."""
    way = straight((0.0, 0.0, 1.0), (1.0, 0.0, 1.0), 0.0, SpeedSettings())
    settings = FollowerSettings(go_to_start=False, cascade=CascadeSettings(disturbance_rate=1.0))
    follower = PathFollower(way, VehicleModel.velocity_loop(0.3, delay=0.1), np.ones(4), settings)
    x = np.array([0.0, 0.0, 1.0, 0.0, 0.1, 0.0, 0.0, 0.0])
    for tick in range(3):
        follower.step(StateEstimate(0.03 * tick, x, np.eye(8)), 0.03 * tick)
