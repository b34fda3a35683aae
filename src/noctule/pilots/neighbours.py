"""Which of several answers for the next key image agrees with the image before it.

With few points in one part of the picture the `upright` estimate has two minima that the points cannot tell
apart, a few degrees from each other. The heading tells: that of the current picture against image k + 1 is
its heading against image k less the turn between the two, and that turn is known well from all the points
that they share.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from noctule.geometry import wrap_angle
from noctule.pilots.link_estimates import LinkEstimates
from noctule.vision.homography import HomographyEstimate, NoHomographyError

_SAME = float(
    np.radians(1.2)
)  # both headings are good to some tenths of a degree, the minima lie farther apart
_LEAST_POINTS = 40  # fewer shared points do not tell the turn between two images well enough
_PATIENCE = 60  # ticks of disagreement after which the link is not believed any more


@dataclass(slots=True)
class Neighbours:
    """What the turns between neighbouring key images say of the next one."""

    links: LinkEstimates
    _refused: dict[int, int] = field(default_factory=dict)  # index -> ticks in a row

    def turn(self, index: int) -> float | None:
        """Return the yaw [rad] of image `index` + 1 against image `index`, None where it is not certain."""
        if len(self.links.shared(index)[0]) < _LEAST_POINTS:
            return None
        try:
            found = self.links.onward(index)
        except NoHomographyError:
            return None
        return None if found.alternatives else found.yaw

    def choose(
        self,
        index: int,
        estimate: HomographyEstimate,
        yaw_before: float,
        begin_again: Callable[[], HomographyEstimate | None],
    ) -> HomographyEstimate | None:
        """Return the answer for image `index` that agrees with the image before, None when none does.

        Parameters
        ----------
        index
            The image, 1 or more.
        estimate
            Its estimate, with the other answers that explain the points as well.
        yaw_before
            The current picture's yaw [rad] against image `index` - 1.
        begin_again
            Estimates without a start, for when the start itself sits in the wrong minimum.
        """
        turn = self.turn(index - 1)
        if turn is None or self._refused.get(index, 0) > _PATIENCE:
            return estimate

        def off(answer: HomographyEstimate) -> float:
            return abs(wrap_angle(answer.yaw - (yaw_before - turn)))

        best = min([estimate, *estimate.alternatives], key=off)
        if off(best) > _SAME:
            cold = begin_again()
            if cold is not None:
                best = min([best, cold, *cold.alternatives], key=off)
        if off(best) > _SAME:
            self._refused[index] = self._refused.get(index, 0) + 1
            return None
        self._refused[index] = 0
        return best if best is estimate else replace(best, alternatives=())
