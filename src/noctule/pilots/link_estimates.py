"""The homographies between neighbouring key images, each estimated once.

Laps share their links, so a path of ten laps asks for no more estimates than one lap does.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from noctule.geometry import Array
from noctule.pilots.law import Optics
from noctule.pilots.visual_path import VisualPath
from noctule.vision.homography import HomographyEstimate, estimate_homography


@dataclass(slots=True)
class LinkEstimates:
    """Estimates between the levelled images of a path, kept by link and method."""

    path: VisualPath
    optics: Optics
    attitude_sd: float  # [rad], of both images together
    _levelled: dict[int, tuple[Array, Array]] = field(default_factory=dict)  # by the id of a link
    _found: dict[tuple[int, bool, str], HomographyEstimate] = field(default_factory=dict)

    def shared(self, index: int) -> tuple[Array, Array]:
        """Return what images `index` and `index` + 1 share, (n, 2) normalised each, roll and pitch out."""
        link = self.path.links[index]
        if id(link) not in self._levelled:
            here, ahead = self.path.images[index], self.path.images[index + 1]
            self._levelled[id(link)] = (
                self.optics.levelled(link.p_ref, here.roll, here.pitch),
                self.optics.levelled(link.p_next, ahead.roll, ahead.pitch),
            )
        return self._levelled[id(link)]

    def onward(self, index: int, method: str = "upright") -> HomographyEstimate:
        """Return what takes image `index` to image `index` + 1; raises NoHomographyError."""
        m_here, m_ahead = self.shared(index)
        return self._estimate(index, True, method, m_here, m_ahead)

    def back(self, index: int, method: str = "upright") -> HomographyEstimate:
        """Return what takes image `index` + 1 to image `index`; raises NoHomographyError.

        It is what a flight sees that is at image `index` and flies to the next one.
        """
        m_here, m_ahead = self.shared(index)
        return self._estimate(index, False, method, m_ahead, m_here)

    def _estimate(
        self, index: int, onward: bool, method: str, m_ref: Array, m_current: Array
    ) -> HomographyEstimate:
        key = (id(self.path.links[index]), onward, method)
        if key not in self._found:
            self._found[key] = estimate_homography(m_ref, m_current, method, self.attitude_sd)
        return self._found[key]
