"""What a manual flight shows of the drone: one row per frame in which it was seen whole and alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from noctule.camera import FixedCamera
from noctule.errors import NoctuleError
from noctule.geometry import Array
from noctule.localization.detection.detector import blob_altitude, blob_surface, is_cut
from noctule.localization.detection.splinters import join_splinters
from noctule.vision.depth.blob import Blob
from noctule.vision.depth.moments import hu_moments

MIN_SAMPLES = 100
MIN_CLIMB = 0.5  # [m], between the lowest and the highest of the samples
MIN_GROWTH = 1.1  # median area of the highest third over that of the lowest
_COMPANION = 0.25  # a second blob with more than this share of the first's surface is not a splinter
_CROWDED = 0.1  # share of the frames that may hold such a blob


class TooFewSamplesError(NoctuleError):
    """The manual flight shows the drone in too few frames."""


class AltitudeRangeError(NoctuleError):
    """The manual flight stayed at one height."""


class AreaTrendError(NoctuleError):
    """What was seen does not grow as it comes nearer to the camera, so it is not the drone."""


class NotAloneError(NoctuleError):
    """Something else than the drone was in the room during the manual flight."""


@dataclass(frozen=True, slots=True)
class FlightSamples:
    """The drone's blob in n frames of a manual flight."""

    altitude: Array  # (n,) [m], of the surface seen, from the blob's points
    area: Array  # (n,) [px]
    surface: Array  # (n,) [m^2], area times depth squared
    hu: Array  # (n, 7), Hu's invariants of its shape

    def __len__(self) -> int:
        return len(self.altitude)


def flight_samples(frames: Iterable[Sequence[Blob]], camera: FixedCamera) -> FlightSamples:
    """Collect the drone's blobs from the frames of a manual flight in an otherwise empty room.

    Each frame gives its blobs; with their splinters joined the largest one is the drone. Blobs cut by the
    image's border are left out.
    Raises NotAloneError, TooFewSamplesError, AltitudeRangeError or AreaTrendError.
    """
    chosen: list[Blob] = []
    seen = crowded = 0
    for blobs in frames:
        if not blobs:
            continue
        seen += 1
        whole, _ = join_splinters(blobs, camera)
        surfaces = [blob_surface(blob, camera) for blob in whole]
        largest = max(range(len(whole)), key=lambda i: surfaces[i])
        if sum(surface > _COMPANION * surfaces[largest] for surface in surfaces) > 1:
            crowded += 1
        elif not is_cut(whole[largest], camera):
            chosen.append(whole[largest])
    if crowded > _CROWDED * seen:
        raise NotAloneError(
            f"manual flight: {crowded} of {seen} frames show a second thing beside the drone, at most "
            f"{_CROWDED:.0%} may; empty the room, or take the background again, and repeat the flight"
        )
    samples = FlightSamples(
        np.array([blob_altitude(blob, camera) for blob in chosen]),
        np.array([float(blob.area) for blob in chosen]),
        np.array([blob_surface(blob, camera) for blob in chosen]),
        np.array([hu_moments(blob) for blob in chosen]).reshape(-1, 7),
    )
    check_samples(samples)
    return samples


def check_samples(samples: FlightSamples) -> None:
    """Refuse samples that no detector can be fitted on, with the reason."""
    if len(samples) < MIN_SAMPLES:
        raise TooFewSamplesError(
            f"manual flight: {len(samples)} frames show the drone whole, at least {MIN_SAMPLES} are needed; "
            "fly longer, inside the camera's view"
        )
    low, high = np.quantile(samples.altitude, [0.01, 0.99])
    if high - low < MIN_CLIMB:
        raise AltitudeRangeError(
            f"manual flight: altitudes from {low:.2f} to {high:.2f} m, a range of at least {MIN_CLIMB:g} m "
            "is needed; climb and descend over the heights that you want to fly at"
        )
    third = (high - low) / 3.0
    lowest = float(np.median(samples.area[samples.altitude <= low + third]))
    highest = float(np.median(samples.area[samples.altitude >= high - third]))
    if highest < MIN_GROWTH * lowest:
        raise AreaTrendError(
            f"manual flight: the area is {lowest:.0f} px at the lowest altitudes and {highest:.0f} px at the "
            f"highest, it should grow by {MIN_GROWTH - 1.0:.0%} or more; is it the drone that moves, and "
            "does the camera's calibration fit?"
        )
