"""Where the drone is, from one blob of one frame."""

from __future__ import annotations

import numpy as np

from noctule.camera import FixedCamera
from noctule.geometry import Array
from noctule.messages import HeadingMeasurement, PoseMeasurement
from noctule.vision.depth.blob import Blob

POSITION_SD = np.array([0.012, 0.012, 0.003])  # [m], of one frame, bare and alone (hull: 0.007, 0.007, 0.003)
POSITION_SD.setflags(write=False)
_NO_OFFSET = np.zeros(3)
_NO_OFFSET.setflags(write=False)


def blob_position(blob: Blob, camera: FixedCamera) -> Array:
    """Return the mean of the blob's back-projected points (3,) [m] in the world.

    Not the point at the centroid pixel, as eq. (19) of Santos et al. is used: its depth may be that of a
    hole or a rotor, 10 mm worse.
    """
    return np.asarray(camera.R_world_camera @ blob.points + camera.t_world_camera)


def blob_pose(
    blob: Blob,
    camera: FixedCamera,
    heading: HeadingMeasurement,
    offset: Array = _NO_OFFSET,
    position_sd: Array = POSITION_SD,
) -> PoseMeasurement:
    """Return the pose of a drone seen as `blob` with `heading`.

    `offset` (3,) [m] is what the calibration found between the body's origin and the middle of the surface
    seen (world axes); `position_sd` (3,) [m].
    """
    variances = np.append(position_sd**2, heading.variance)
    position = blob_position(blob, camera) + offset
    return PoseMeasurement(heading.stamp, position, heading.yaw, np.diag(variances), heading.source)
