"""What a detector is: it looks at the blobs of a frame, each by itself, and says which may be the drone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from noctule.camera import FixedCamera
from noctule.vision.depth.blob import Blob


class Detector(Protocol):
    """Proposes blobs as the drone; it remembers nothing, so it can start a track and find a lost one."""

    @property
    def name(self) -> str:
        """Its name in settings, files and figures."""
        ...

    def propose(self, blobs: Sequence[Blob], camera: FixedCamera) -> tuple[Blob, ...]:
        """Return the blobs that may be the drone, in the order given, their splinters joined to them."""
        ...


def blob_altitude(blob: Blob, camera: FixedCamera) -> float:
    """Return how high above the floor the mean of the blob's back-projected points is [m].

    It is the height of the surface that the camera sees: above the body's origin by a constant, which does
    not matter to a detector fitted on the same measure.
    """
    return float(camera.R_world_camera[2] @ blob.points + camera.t_world_camera[2])


def blob_surface(blob: Blob, camera: FixedCamera) -> float:
    """Return the size of the surface seen [m^2]: the area in the image times depth squared."""
    focal = camera.intrinsics.focal
    return float(blob.area * blob.depth**2 / (focal[0] * focal[1]))


def is_cut(blob: Blob, camera: FixedCamera) -> bool:
    """Return whether the blob touches the border of the image, so that part of it is not seen."""
    width, height = camera.intrinsics.width, camera.intrinsics.height
    return blob.left <= 0 or blob.top <= 0 or blob.right >= width or blob.bottom >= height
