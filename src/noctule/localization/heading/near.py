"""A heading of the blob at a place that is known: the drone's, where something else located it."""

from __future__ import annotations

import numpy as np

from noctule.camera import FixedCamera
from noctule.geometry import Array
from noctule.localization.detection.splinters import join_splinters, relabel
from noctule.localization.heading.method import HeadingMethod
from noctule.localization.heading.pose import blob_position
from noctule.localization.heading.sighting import Sighting
from noctule.localization.learning.bootstrap import MIN_AREA
from noctule.messages import DepthFrame, HeadingMeasurement
from noctule.vision.depth import find_blobs
from noctule.vision.depth.background import Background

FARTHEST = 0.3  # [m], of a blob's middle from the place


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
    labels, blobs = find_blobs(frame.depth, background, camera.intrinsics, min_area=MIN_AREA)
    joined, parts = join_splinters(blobs, camera)
    if not joined:
        return None
    away = [float(np.linalg.norm(blob_position(blob, camera) - position)) for blob in joined]
    nearest = int(np.argmin(away))
    if away[nearest] > FARTHEST:
        return None
    whole = relabel(labels, blobs, parts)
    return method.measure(Sighting(frame, whole, joined[nearest], camera), predicted)
