"""What a flight came to."""

from __future__ import annotations

from dataclasses import dataclass, field

from noctule.errors import NoctuleError
from noctule.flight.samples import Samples
from noctule.messages import Outcome


class Aborted(NoctuleError):  # noqa: N818  (an end that was asked for, not a fault)
    """The flight was ended from outside; the recording can be read."""


@dataclass(slots=True)
class Flown:
    """What a flight came to; filled while it lasts."""

    outcome: Outcome | None = None
    reason: str = ""
    error: BaseException | None = None  # to be raised when all is closed
    begin: float = 0.0  # [s], the pilot's first tick
    end: float = 0.0  # [s], the outcome
    wall: float = 0.0  # [s] of wall time between the two
    samples: Samples = field(default_factory=Samples)
    phase: str = ""

    @property
    def realtime_factor(self) -> float | None:
        """Seconds of flight per second of wall time."""
        return (self.end - self.begin) / self.wall if self.wall > 0.0 else None

    def finish(self, outcome: Outcome, reason: str, error: BaseException | None = None) -> None:
        """Set the outcome; the first one stands."""
        if self.outcome is None:
            self.outcome, self.reason, self.error = outcome, reason, error
