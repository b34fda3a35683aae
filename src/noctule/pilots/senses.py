"""All that a located pilot senses, joined: the camera in the room, the vehicle's reports, what was sent."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from noctule.estimation.filter_state import StateEstimate
from noctule.geometry import Array
from noctule.localization.fusion import Fusion
from noctule.localization.located import Located
from noctule.localization.tracker import Prediction
from noctule.messages import DepthFrame, Observation, PoseMeasurement
from noctule.pilots.doubt import Facts
from noctule.pilots.way_flown import WayFlown

_NO_FRAME = "no picture of it comes"
_NOT_BELIEVED = "what it saw was too far from where the drone must be"


class Locating(Protocol):
    """The part of a locator that is needed here."""

    def step(self, frame: DepthFrame, prediction: Prediction | None = None) -> Located:
        """Look at a frame."""
        ...


@dataclass(slots=True)
class Senses:
    """Hands observations to locator and fusion in the order in which they count; deterministic, no clock."""

    locator: Locating
    fusion: Fusion
    measured: PoseMeasurement | None = None  # what this tick's depth frame said
    why_unseen: str = ""  # why this tick's depth frame said nothing
    poses: int = 0  # that the fusion took in a row since it began
    turned: bool = False  # at this tick the half turn was found wrong
    _jump: float = 0.0  # [m], at this tick
    _frame: float = -math.inf  # [s], the newest depth frame
    _seen: float = -math.inf  # [s], exposure of the last pose that was taken
    _reported: float = -math.inf  # [s], the last report
    _why: str = field(default="nothing was looked at yet")  # since when nothing was taken
    _last: float = math.nan  # [s], the last tick
    _turns: int = 0
    _way: WayFlown = field(default_factory=WayFlown)

    def observe(self, observation: Observation, acted: Array) -> None:
        """Take in a tick; `acted` (4,) is the command that acts since the last one, with any push."""
        now, state, depth = observation.stamp, observation.state, observation.depth
        self.measured, self.why_unseen, self._jump, self.turned = None, "", 0.0, False
        if not math.isnan(self._last):
            self.fusion.command(self._last, acted)
        self._last = now
        if state.stamp > self._reported:
            self._reported = state.stamp
            self.fusion.report(state, now)
            held = self.fusion.prediction(state.stamp)
            if held is not None:
                self._way.told(state.stamp, state.v_body, held.pose.yaw)
        if depth is not None and depth.stamp > self._frame:
            self._frame = depth.stamp
            self._look(self.locator.step(depth, self.fusion.prediction(depth.stamp)), now)
        if self.fusion.turns != self._turns:
            self._turns, self.turned, self.poses = self.fusion.turns, True, 0
            self._way.forget()

    def estimate(self, now: float) -> StateEstimate | None:
        """Return what is known at `now` [s]; None before the fusion has begun."""
        return self.fusion.estimate(now) if self.fusion.begun else None

    def facts(self, now: float, estimate: StateEstimate | None, settled: bool) -> Facts:
        """Return how good the estimate is; `settled` is whether it has been since it began anew."""
        why = self._why
        if now - self._frame > 0.5:
            why = _NO_FRAME
        if estimate is None:
            sd = turn = math.inf
        else:
            sd = math.sqrt(float(np.trace(estimate.P[:3, :3])))
            turn = math.sqrt(float(estimate.P[3, 3]))
        return Facts(
            stamp=now,
            unseen=max(0.0, now - self._seen),
            silent=max(0.0, now - self._reported),
            position_sd=sd,
            yaw_sd=turn,
            why_unseen=why,
            jump=self._jump,
            turned=not settled,
        )

    @property
    def why(self) -> str:
        """Why the drone is not seen, in the locator's words."""
        return self._why

    def _look(self, located: Located, now: float) -> None:
        pose = located.measurement
        self.measured, self.why_unseen = pose, located.reason
        if pose is None:
            self._why, self.poses = located.reason, 0
            return
        if self.fusion.begun and self._way.contradicted(pose.stamp, pose.position):
            self.fusion.turn_around()
        before, refused = self.fusion.prediction(pose.stamp), self._refused()
        self.fusion.pose(pose, located.heading_certain, now)
        after = self.fusion.prediction(pose.stamp)
        if after is None or self._refused() > refused:
            self._why = _NOT_BELIEVED if after is not None else "the vehicle has not reported its heading"
            self.poses = 0
            return
        self._why, self._seen, self.poses = "", pose.stamp, self.poses + 1
        if before is not None:
            self._jump = float(np.linalg.norm(after.pose.position - before.pose.position))

    def _refused(self) -> int:
        """Return how often a position was refused; the vehicle has no say in it."""
        return sum(
            count for reason, count in self.fusion.refusals.items() if reason.endswith("position gate")
        )
