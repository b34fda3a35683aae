"""What a lens does to a picture, and how to take it out again.

`PinholeCamera` has no distortion: pictures and depth images are undistorted where they are read.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.camera import PinholeCamera
from noctule.geometry import Array
from noctule.messages import DepthFrame


@dataclass(frozen=True, slots=True)
class Lens:
    """Radial and tangential distortion, in OpenCV's model."""

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    @property
    def coefficients(self) -> Array:
        """The coefficients k1, k2, p1, p2, (4,)."""
        return np.array([self.k1, self.k2, self.p1, self.p2])

    def straighten(self, p: Array, camera: PinholeCamera) -> Array:
        """Take pixels (n, 2) as the lens shows them to those of the pinhole."""
        if not self.coefficients.any():
            return p
        found = cv2.undistortPoints(p.reshape(-1, 1, 2), camera.K, self.coefficients, P=camera.K)
        return np.asarray(found, dtype=np.float64).reshape(-1, 2)

    def largest_shift(self, camera: PinholeCamera) -> float:
        """Return how far [px] the lens moves a pixel, at most, over the border of the picture."""
        u, v = np.linspace(0.0, camera.width - 1.0, 33), np.linspace(0.0, camera.height - 1.0, 33)
        rows = [np.column_stack([u, np.full(33, w)]) for w in (v[0], v[-1])]
        columns = [np.column_stack([np.full(33, w), v]) for w in (u[0], u[-1])]
        border = np.concatenate(rows + columns)
        return float(np.hypot(*(self._bend(border, camera) - border).T).max())

    def _bend(self, p: Array, camera: PinholeCamera) -> Array:
        x = np.column_stack([camera.normalise(p), np.ones(len(p))])
        zero = np.zeros(3)
        bent, _ = cv2.projectPoints(x.reshape(-1, 1, 3), zero, zero, camera.K, self.coefficients)
        return np.asarray(bent, dtype=np.float64).reshape(-1, 2)


@dataclass(frozen=True, slots=True)
class Straightener:
    """Takes the distortion out of the pictures of one camera. Make it with `straightener`; it is reusable."""

    map_x: NDArray[np.float32]  # (height, width) [px], where each pixel of the result is read
    map_y: NDArray[np.float32]  # (height, width) [px]

    def picture(self, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return a colour or grey picture without distortion, black where the lens saw nothing."""
        return np.asarray(cv2.remap(pixels, self.map_x, self.map_y, cv2.INTER_LINEAR), dtype=np.uint8)

    def depth(self, depth: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Return a depth image without distortion, 0 where the lens saw nothing.

        Of the nearest reading: a mean of two readings at an edge is a place where nothing is.
        """
        return np.asarray(cv2.remap(depth, self.map_x, self.map_y, cv2.INTER_NEAREST), dtype=np.uint16)

    def frame(self, frame: DepthFrame) -> DepthFrame:
        """Return a frame with depth and colour without distortion."""
        colour = None if frame.colour is None else self.picture(frame.colour)
        return replace(frame, depth=self.depth(frame.depth), colour=colour)


def straightener(camera: PinholeCamera, lens: Lens) -> Straightener:
    """Return what takes the distortion of `lens` out; the result's intrinsics are those of `camera`."""
    map_x, map_y = cv2.initUndistortRectifyMap(
        camera.K, lens.coefficients, np.eye(3), camera.K, (camera.width, camera.height), cv2.CV_32FC1
    )
    return Straightener(np.asarray(map_x, dtype=np.float32), np.asarray(map_y, dtype=np.float32))
