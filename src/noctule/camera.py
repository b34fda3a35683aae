"""The pinhole camera: pixels `p`, normalised image coordinates `m`, and how a camera sits on a body."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from noctule.geometry import R_BODY_CAMERA, Array, tilt


@dataclass(frozen=True, slots=True)
class PinholeCamera:
    """Intrinsics of a camera without distortion (undistort pictures where they are read)."""

    width: int  # [px]
    height: int  # [px]
    fx: float  # [px]
    fy: float  # [px]
    cx: float  # [px], principal point; the centre of the top left pixel is (0, 0)
    cy: float  # [px]

    @classmethod
    def centred(cls, width: int, height: int, focal: float) -> PinholeCamera:
        """Return a camera of `width` x `height` [px] with square pixels and a central principal point."""
        return cls(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0)

    @property
    def K(self) -> Array:
        """The (3, 3) calibration matrix."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def centre(self) -> Array:
        """The principal point, (2,) [px]."""
        return np.array([self.cx, self.cy])

    @property
    def focal(self) -> Array:
        """The focal lengths, (2,) [px]."""
        return np.array([self.fx, self.fy])

    def normalise(self, p: NDArray[np.floating]) -> Array:
        """Take pixels (n, 2) to normalised image coordinates (n, 2): K^-1 p."""
        return (np.asarray(p, dtype=np.float64) - self.centre) / self.focal

    def to_pixels(self, m: NDArray[np.floating]) -> Array:
        """Take normalised image coordinates (n, 2) to pixels (n, 2): K m."""
        return np.asarray(m, dtype=np.float64) * self.focal + self.centre

    def project(self, x_camera: Array) -> Array:
        """Project points (n, 3) [m] in camera coordinates (RDF) to pixels (n, 2); z must be positive."""
        return self.to_pixels(x_camera[:, :2] / x_camera[:, 2:3])


@dataclass(frozen=True, slots=True)
class CameraMount:
    """How a front camera sits on the body."""

    t_body_camera: Array = field(default_factory=lambda: np.array([0.09, 0.0, 0.0]))  # (3,) [m], FLU
    stabilised: bool = True  # True: the picture has neither the body's roll nor its pitch


def level_camera_rotation(roll: float, pitch: float) -> Array:
    """Return the (3, 3) rotation that takes coordinates of a tilted front camera to the levelled camera's.

    `roll` and `pitch` [rad] are the body's (see `geometry.tilt`); both cameras are RDF and share the heading.
    """
    return R_BODY_CAMERA.T @ tilt(roll, pitch) @ R_BODY_CAMERA


def derotate(m: Array, roll: float, pitch: float) -> Array:
    """Take normalised coordinates (n, 2) seen by a tilted front camera to those of the levelled camera."""
    if roll == 0.0 and pitch == 0.0:
        return np.asarray(m, dtype=np.float64)
    x = np.column_stack([m, np.ones(len(m))]) @ level_camera_rotation(roll, pitch).T
    return np.asarray(x[:, :2] / x[:, 2:3])


@dataclass(frozen=True, slots=True)
class FixedCamera:
    """A camera that stands still in the world: intrinsics, and where it is (for example on the ceiling)."""

    intrinsics: PinholeCamera
    R_world_camera: Array  # (3, 3), takes RDF camera coordinates to world coordinates
    t_world_camera: Array  # (3,) [m], the camera's centre in the world

    def to_world(self, p: NDArray[np.floating], z: NDArray[np.floating]) -> Array:
        """Take pixels (n, 2) with depths (n,) [m] along the optical axis to world points (n, 3) [m].

        Eq. (19) of Santos et al., inverted.
        """
        z = np.asarray(z, dtype=np.float64)[:, None]
        x_camera = np.hstack([self.intrinsics.normalise(p) * z, z])
        return np.asarray(x_camera @ self.R_world_camera.T + self.t_world_camera)

    def to_camera(self, x_world: Array) -> Array:
        """Take world points (n, 3) [m] to camera coordinates (n, 3) [m]."""
        return np.asarray((x_world - self.t_world_camera) @ self.R_world_camera)

    def project(self, x_world: Array) -> Array:
        """Project world points (n, 3) [m], which must lie before the camera, to pixels (n, 2): eq. (19)."""
        return self.intrinsics.project(self.to_camera(x_world))

    def inside(self, x_world: Array) -> Array:
        """Return how far (n,) [m] points (n, 3) are from the planes through the eye and the picture's edges.

        It is negative for points outside of the picture, and for those behind the camera.
        """
        k = self.intrinsics
        m = k.normalise(np.array([[-0.5, -0.5], [k.width - 0.5, k.height - 0.5]]))
        normals = np.array(
            [[1.0, 0.0, -m[0, 0]], [-1.0, 0.0, m[1, 0]], [0.0, 1.0, -m[0, 1]], [0.0, -1.0, m[1, 1]]]
        )
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return np.asarray((self.to_camera(x_world) @ normals.T).min(axis=1))


def _published_ceiling_camera() -> FixedCamera:
    # Printed rows take world to camera coordinates, in millimetres; they are orthonormal to 1e-6 only.
    printed = np.array(
        [
            [-0.014798, -0.960444, -0.278081],
            [-0.998049, -0.002685, 0.062384],
            [-0.060663, 0.278461, -0.958530],
        ]
    )
    u, _, vt = np.linalg.svd(printed)
    R_camera_world = u @ vt
    t_camera_world = np.array([179.759986, 31.442704, 3414.074341]) / 1000.0
    intrinsics = PinholeCamera(640, 480, 527.77365, 527.22889, 312.15707, 235.82853)
    return FixedCamera(intrinsics, R_camera_world.T, -R_camera_world.T @ t_camera_world)


CEILING_CAMERA = _published_ceiling_camera()
"""The depth camera of Santos et al., Table 2: at (0.241, -0.778, 3.321) m, tilted by 16.6 degrees."""
