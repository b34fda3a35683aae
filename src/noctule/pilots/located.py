"""The located pilot: it knows where it is by the camera in the room, and follows a path in space."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from noctule.control.limiter import limit_command
from noctule.estimation.filter_state import StateEstimate
from noctule.geometry import Array, wrap_angle
from noctule.messages import (
    Command,
    Decision,
    Doubt,
    Limits,
    Observation,
    Outcome,
    Whereabouts,
)
from noctule.pilots.doubt import Facts, Guard, judge
from noctule.pilots.doubt_reasons import not_found
from noctule.pilots.following import Conduct, FollowerReport
from noctule.pilots.located_settings import LocatedSettings
from noctule.pilots.path_follower import PathFollower
from noctule.pilots.senses import Senses

SEARCHING = "searching"


@dataclass(slots=True)
class LocatedPilot:
    """Joins senses, doubt and the follower into a deterministic state machine.

    Phases: `searching` (hovers until the fusion has begun and poses agree), then those of the follower. It
    ends REACHED at the end of everything, or LOST when it doubts for too long; then the loop lands it.
    """

    settings: LocatedSettings
    limits: Limits
    senses: Senses
    follower: PathFollower
    phase: str = SEARCHING
    guard: Guard = field(default_factory=Guard)
    report: FollowerReport | None = None
    _begun: float = math.nan  # [s], the first tick
    _last: float = math.nan  # [s], the last tick
    _sent: Command = field(default_factory=Command)
    _settled: bool = False  # enough poses agreed since the fusion began

    @property
    def doubt(self) -> Doubt:
        """How far it trusts its estimate."""
        return self.guard.doubt

    def step(self, observation: Observation) -> Decision:
        """Answer one observation."""
        now = observation.stamp
        if math.isnan(self._begun):
            self._begun = now
            if self.settings.begin_at_s is not None:
                self.follower.begin_at = now + self.settings.begin_at_s
        sent = self._sent if observation.sent is None else observation.sent
        dt = 0.0 if math.isnan(self._last) else max(0.0, now - self._last)
        self._last = now
        senses = self.senses
        senses.observe(observation, sent.as_array() + self.follower.push)
        if senses.turned:
            self._settled = False
            self.follower.forget()
        self._settled = self._settled or senses.poses >= self.settings.doubt.search_poses
        estimate = senses.estimate(now)
        if self.phase == SEARCHING and not self._settled:
            return self._search(observation, estimate, sent, dt)
        facts = senses.facts(now, estimate, self._settled)
        self.guard = judge(self.guard, facts, self.settings.doubt)
        if facts.jump > self.settings.doubt.jump_m:
            self.follower.forget()  # where it hovered was somewhere else
        wanted = np.zeros(4)
        if estimate is not None and self.doubt is not Doubt.LAND:
            wanted = self._follow(estimate, observation, sent)
        command = self._limited(wanted, sent, dt)
        whereabouts = None if estimate is None else self._whereabouts(estimate, facts)
        if self.doubt is Doubt.LAND:
            outcome, reason = Outcome.LOST, self.guard.reason
        elif self.follower.finished:
            outcome, reason = Outcome.REACHED, "the path is flown"
        else:
            return Decision(command, self.phase, whereabouts=whereabouts)
        return Decision(command, self.phase, outcome=outcome, reason=reason, whereabouts=whereabouts)

    def _search(
        self, observation: Observation, estimate: StateEstimate | None, sent: Command, dt: float
    ) -> Decision:
        """Hover until the drone is found, or give up with the reason."""
        now, limit = observation.stamp, self.settings.doubt.search_s
        facts = self.senses.facts(now, estimate, self._settled)
        outcome, reason = None, self.senses.why_unseen
        if now - self._begun > limit:
            outcome, reason = Outcome.LOST, not_found(limit, self.senses.why)
        whereabouts = None if estimate is None else self._whereabouts(estimate, facts)
        command = self._limited(np.zeros(4), sent, dt)
        return Decision(command, self.phase, outcome=outcome, reason=reason, whereabouts=whereabouts)

    def _follow(self, estimate: StateEstimate, observation: Observation, sent: Command) -> Array:
        hover = self.doubt is Doubt.HOVER
        conduct = Conduct(self.guard.pace, hover, self.guard.trust)
        command, self.report = self.follower.step(estimate, observation.stamp, sent, conduct)
        self.phase = self.report.phase.value
        return command.as_array()

    def _limited(self, wanted: Array, sent: Command, dt: float) -> Command:
        self._sent = Command.from_array(limit_command(wanted, sent.as_array(), self.limits, dt))
        return self._sent

    def _whereabouts(self, estimate: StateEstimate, facts: Facts) -> Whereabouts:
        report, senses = self.report, self.senses
        here = np.append(estimate.position, estimate.yaw)
        return Whereabouts(
            stamp=estimate.stamp,
            position=estimate.position.copy(),
            yaw=wrap_angle(estimate.yaw),
            velocity=np.append(estimate.v_world, estimate.yaw_rate),
            position_sd=facts.position_sd,
            yaw_sd=facts.yaw_sd,
            wanted=here if report is None else report.wanted,
            path_time=math.nan if report is None else report.path_time,
            s=math.nan if report is None else report.s,
            holding=report is not None and (report.holding or report.hovering or report.finished),
            doubt=self.doubt,
            doubt_reason=self.guard.reason,
            measured=senses.measured,
            unseen_reason=senses.why_unseen,
        )
