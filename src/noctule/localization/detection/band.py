"""Detection by a band: the surface seen, in square metres, is the drone's at every depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from noctule.camera import FixedCamera
from noctule.localization.detection.detector import blob_altitude, blob_surface
from noctule.localization.detection.samples import FlightSamples, check_samples
from noctule.localization.detection.splinters import join_splinters
from noctule.vision.depth.blob import Blob


@dataclass(frozen=True, slots=True)
class SurfaceBand:
    """Accepts a blob whose surface and altitude were both seen in the manual flight.

    The area times depth squared is nearly constant, also over the width of the picture, where a tilted
    camera sees the same altitude at many depths; so the band is narrower than the cubics.
    """

    name: ClassVar[str] = "band"
    smallest: float  # [m^2]
    largest: float  # [m^2]
    lowest: float  # [m]
    highest: float  # [m]

    def propose(self, blobs: Sequence[Blob], camera: FixedCamera) -> tuple[Blob, ...]:
        """Return the blobs inside the band."""
        return tuple(
            blob
            for blob in join_splinters(blobs, camera)[0]
            if self.smallest < blob_surface(blob, camera) < self.largest
            and self.lowest <= blob_altitude(blob, camera) <= self.highest
        )


def fit_band(samples: FlightSamples, share: float = 0.98, margin: float = 0.05) -> SurfaceBand:
    """Fit the band: quantiles that hold `share` of the samples, widened by `margin` of the surface.

    Raises as `check_samples`.
    """
    check_samples(samples)
    ends = [0.5 - 0.5 * share, 0.5 + 0.5 * share]
    smallest, largest = (float(q) for q in np.quantile(samples.surface, ends))
    lowest, highest = (float(q) for q in np.quantile(samples.altitude, [0.005, 0.995]))
    return SurfaceBand((1.0 - margin) * smallest, (1.0 + margin) * largest, lowest, highest)
