"""A heading of the blob at a place that is known: the drone's, where something else located it."""

from __future__ import annotations

import numpy as np

from noctule.camera import FixedCamera
from noctule.geometry import Array
from noctule.localization.detection.splinters import MIN_AREA, join_splinters, relabel
from noctule.localization.heading.method import HeadingMethod
from noctule.localization.heading.pose import blob_position
from noctule.localization.heading.sighting import Sighting
from noctule.messages import DepthFrame, HeadingMeasurement
from noctule.vision.depth import find_blobs
from noctule.vision.depth.background import Background

FARTHEST = 0.3  # [m], of a blob's middle from the place


def sighting_near(
    frame: DepthFrame, position: Array, background: Background, camera: FixedCamera
) -> Sighting | None:
    """Return the blob nearest to `position` (3,) [m], its splinters joined; None where there is no blob."""
    labels, blobs = find_blobs(frame.depth, background, camera.intrinsics, min_area=MIN_AREA)
    joined, parts = join_splinters(blobs, camera)
    if not joined:
        return None
    away = [float(np.linalg.norm(blob_position(blob, camera) - position)) for blob in joined]
    return Sighting(frame, relabel(labels, blobs, parts), joined[int(np.argmin(away))], camera)


def heading_near(
    method: HeadingMethod,
    frame: DepthFrame,
    position: Array,
    background: Background,
    camera: FixedCamera,
    predicted: float = 0.0,
) -> HeadingMeasurement | None:
    """Return what `method` measures on the blob nearest to `position` (3,) [m]; None without one.

    `predicted` [rad] chooses the turn of methods that do not know it.
    """
    sighting = sighting_near(frame, position, background, camera)
    if sighting is None or np.linalg.norm(blob_position(sighting.blob, camera) - position) > FARTHEST:
        return None
    return method.measure(sighting, predicted)
