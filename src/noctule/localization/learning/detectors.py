"""Learning the detectors from a manual flight."""

from __future__ import annotations

from collections.abc import Iterable

from noctule.camera import FixedCamera
from noctule.localization.detection.band import fit_band
from noctule.localization.detection.cubics import fit_cubics
from noctule.localization.detection.hu import fit_hu
from noctule.localization.detection.samples import FlightSamples, flight_samples
from noctule.localization.detection.splinters import MIN_AREA
from noctule.localization.detector_file import Detectors
from noctule.messages import DepthFrame
from noctule.vision.depth.background import Background
from noctule.vision.depth.blobs import find_blobs


def fit_detectors(
    frames: Iterable[DepthFrame], background: Background, camera: FixedCamera
) -> tuple[Detectors, FlightSamples]:
    """Fit all detectors on the frames of a manual flight in an otherwise empty room.

    Returns what Fig. 11 is drawn from too. Whoever uses them should look for blobs of `MIN_AREA` as well.
    Raises as `flight_samples`.
    """
    blobs = (find_blobs(f.depth, background, camera.intrinsics, min_area=MIN_AREA)[1] for f in frames)
    samples = flight_samples(blobs, camera)
    return Detectors(fit_cubics(samples), fit_band(samples), fit_hu(samples)), samples
