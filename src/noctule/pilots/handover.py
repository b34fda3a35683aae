"""From the located pilot to the visual one, in the air and without a jump.

The located pilot flies to where the visual path begins and holds that point. Then the visual pilot is shown
the same observations; once it recognises its first key image it takes over, its commands blended in.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from noctule.control.limiter import limit_command
from noctule.messages import Command, Decision, Doubt, Limits, Observation, Outcome, Pilot
from noctule.pilots.located import LocatedPilot
from noctule.pilots.located_settings import HandoverSettings

WARM_UP = "hand over"
_FLYING = "flying"  # the visual pilot's phase once it is recognising


@dataclass(slots=True)
class HandoverPilot:
    """A deterministic state machine of two pilots; the located one goes on telling where the drone is."""

    located: LocatedPilot
    visual: Pilot
    limits: Limits
    settings: HandoverSettings = field(default_factory=HandoverSettings)
    _waited: float = math.nan  # [s] since the located flight ended, but for hovering in doubt
    _agrees_since: float = math.nan  # [s], when the visual pilot began to recognise
    _taken: float = math.nan  # [s], when the visual pilot took over
    _last: float = math.nan  # [s], the last tick
    _sent: Command = field(default_factory=Command)

    def step(self, observation: Observation) -> Decision:
        """Answer one observation."""
        now = observation.stamp
        sent = self._sent if observation.sent is None else observation.sent
        dt = 0.0 if math.isnan(self._last) else max(0.0, now - self._last)
        self._last = now
        located = self.located.step(observation)
        if math.isnan(self._waited):
            if located.outcome is not Outcome.REACHED:
                self._sent = located.command
                return located
            self._waited = 0.0
        elif self.located.doubt is not Doubt.HOVER:
            # A drone in doubt is perhaps not where the path begins; its own limits end that.
            self._waited += dt
        visual = self.visual.step(observation)
        if math.isnan(self._taken):
            decision = self._warm_up(now, located, visual)
        else:
            decision = replace(visual, whereabouts=located.whereabouts)
        share = self._share(now)
        a, b = located.command.as_array(), visual.command.as_array()
        command = limit_command(a + share * (b - a), sent.as_array(), self.limits, dt)
        self._sent = Command.from_array(command)
        return replace(decision, command=self._sent)

    def _warm_up(self, now: float, located: Decision, visual: Decision) -> Decision:
        """Hold the point until the visual pilot recognises where it is, or give up with the reason."""
        decision = replace(visual, phase=WARM_UP, outcome=None, reason="", whereabouts=located.whereabouts)
        if located.outcome is Outcome.LOST:
            return replace(decision, outcome=Outcome.LOST, reason=located.reason)
        recognised = visual.phase == _FLYING and self.located.doubt is not Doubt.HOVER
        if not recognised:
            self._agrees_since = math.nan
        elif math.isnan(self._agrees_since):
            self._agrees_since = now
        if now - self._agrees_since >= self.settings.agree_s:
            self._taken = now
            return replace(decision, phase=visual.phase, outcome=visual.outcome, reason=visual.reason)
        if visual.outcome is not None or self._waited > self.settings.warm_up_s:
            why = f": {visual.reason}" if visual.reason else ""
            return replace(
                decision,
                outcome=Outcome.LOST,
                reason="the visual pilot does not recognise the first key image from here, after "
                f"{self._waited:.1f} s{why}; end the path in space where the visual path begins",
            )
        return decision

    def _share(self, now: float) -> float:
        """Return the share of the visual pilot's command, 0 to 1."""
        if math.isnan(self._taken):
            return 0.0
        blend = self.settings.blend_s
        return 1.0 if blend <= 0.0 else min(1.0, (now - self._taken) / blend)
