"""A blob with the frame that it was found in, and its points in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.geometry import Array
from noctule.messages import DepthFrame
from noctule.vision.depth.blob import Blob

SLAB = 0.13  # [m], points further above or below the median of the blob are not of the drone


@dataclass(frozen=True, slots=True)
class Sighting:
    """What a heading is measured on."""

    frame: DepthFrame
    labels: NDArray[np.integer]  # (height, width), which blob a pixel belongs to
    blob: Blob
    camera: FixedCamera


def blob_pixels(sighting: Sighting) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Return rows (n,), columns (n,) and depths (n,) [m] of the blob's pixels within its slab of depth."""
    blob = sighting.blob
    rows, columns = np.nonzero(sighting.labels[blob.top : blob.bottom, blob.left : blob.right] == blob.label)
    rows, columns = rows + blob.top, columns + blob.left
    depth = sighting.frame.depth[rows, columns] * 1e-3
    kept = (depth > 0.0) & (np.abs(depth - np.median(depth)) < SLAB)
    return rows[kept], columns[kept], depth[kept]


def world_points(sighting: Sighting) -> tuple[Array, Array]:
    """Return the blob's points (n, 3) [m] in the world, and how much surface each stands for (n,) [m^2].

    Without that weight the near side of a thing seen from the side would count more than the far one.
    """
    rows, columns, depth = blob_pixels(sighting)
    points = sighting.camera.to_world(np.column_stack([columns, rows]).astype(np.float64), depth)
    focal = sighting.camera.intrinsics.focal
    return points, depth**2 / (focal[0] * focal[1])
