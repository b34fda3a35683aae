"""What a way to measure the heading is."""

from __future__ import annotations

from typing import Protocol

from noctule.localization.heading.sighting import Sighting
from noctule.messages import HeadingMeasurement


class HeadingMethod(Protocol):
    """Measures the drone's heading on one blob of one frame."""

    @property
    def name(self) -> str:
        """Its name in settings and figures, and the source of its measurements."""
        ...

    @property
    def period(self) -> float:
        """What it cannot tell apart [rad]: headings that differ by multiples of this look the same."""
        ...

    def measure(self, sighting: Sighting, predicted: float) -> HeadingMeasurement | None:
        """Return the heading nearest to `predicted` [rad] that fits what is seen; None if nothing is told.

        The yaw is continuous with the prediction, not wrapped.
        """
        ...
