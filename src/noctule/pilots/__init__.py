"""What decides: deterministic state machines from observations to decisions."""

from noctule.pilots.factory import make_matcher, make_pilot
from noctule.pilots.settings import PilotSettings

__all__ = ["PilotSettings", "make_matcher", "make_pilot"]
