"""Which of two headings half a turn apart is right: log-likelihood ratios summed over frames.

A single frame is wrong in one to three of a hundred. Frames seen from one side err together, so none counts
for much. The sum is bounded, so that a slip after an hour of certainty is noticed as fast as one after a
second. At the bound frames of the same agree to nothing new, and weighing them is a third of the work: then
every third is weighed, and all again from the first that disagrees.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

CERTAIN = 9.0  # that decides: three usual frames, one wrong in 8000 if they erred apart
MOST = 13.0  # more is not kept: from here to a slip noticed, -CERTAIN, it takes ten usual frames
_EVERY = 3  # frames, of which one is weighed at the bound
_PER_FRAME = 3.0  # one frame does not count for more; usual ones say twice that


class Facing(StrEnum):
    """What is known of the half turn."""

    UNDECIDED = "undecided"
    CERTAIN = "certain"


@dataclass(frozen=True, slots=True)
class HalfTurn:
    """The sum for the heading held, and whether it ever decided."""

    evidence: float = 0.0
    facing: Facing = Facing.UNDECIDED
    slipped: bool = False  # the last frame turned a heading around that had been certain
    unasked: int = 0  # frames since one was weighed

    @property
    def due(self) -> bool:
        """Whether the next frame is to be weighed."""
        return self.evidence < MOST or self.unasked >= _EVERY - 1

    def add(self, evidence: float | None) -> tuple[HalfTurn, bool]:
        """Add a frame's evidence for the heading held; return the sum, and whether to turn it by pi.

        None is the evidence of a frame that was not weighed.
        """
        if evidence is None:
            return HalfTurn(self.evidence, self.facing, unasked=self.unasked + 1), False
        bounded = min(max(evidence, -_PER_FRAME), _PER_FRAME)
        total = min(max(self.evidence + bounded, -MOST), MOST)
        if total <= -CERTAIN:
            return HalfTurn(-total, Facing.CERTAIN, self.facing is Facing.CERTAIN), True
        if total >= CERTAIN:
            return HalfTurn(total, Facing.CERTAIN), False
        return HalfTurn(total, self.facing), False
