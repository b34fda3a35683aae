"""Least squares for the pose of a camera, from corners in the world and the floor as depth shows it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from noctule.camera import PinholeCamera
from noctule.geometry import Array, skew
from noctule.localization.calibration.floor import Plane

_ROUNDS = 30
_STILL = 1e-12  # a step shorter than this is the end
TILT_SD, HEIGHT_SD = (
    float(np.radians(0.2)),
    0.004,
)  # of a floor by depth, [rad] and [m]: its errors are no noise


@dataclass(frozen=True, slots=True)
class WorldInCamera:
    """A pose: takes world coordinates to camera coordinates."""

    R: Array  # (3, 3), world to camera
    t: Array  # (3,) [m]


@dataclass(frozen=True, slots=True)
class Corners:
    """Corners in the world, and where they were found."""

    x: Array  # (n, 3) [m], world
    p: Array  # (n, 2) [px], lens taken out


def is_possible(pose: WorldInCamera, corners: Corners) -> bool:
    """Tell whether all corners lie before the camera, and the camera above the floor."""
    x = corners.x @ pose.R.T + pose.t
    above = float((-pose.R.T @ pose.t)[2]) > float(corners.x[:, 2].max())
    return bool(np.isfinite(x).all() and (x[:, 2] > 0.0).all() and above)


def misfit(pose: WorldInCamera, corners: Corners, camera: PinholeCamera) -> Array:
    """Return the residuals (n, 2) [px], found minus predicted."""
    return np.asarray(corners.p - camera.project(corners.x @ pose.R.T + pose.t))


def rms(off: Array) -> float:
    """Return the rms length of residuals (n, 2)."""
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def _jacobian(pose: WorldInCamera, corners: Corners, camera: PinholeCamera) -> Array:
    """Return d p / d (rotation from the left, translation), (2 n, 6)."""
    x = corners.x @ pose.R.T
    z = (x + pose.t)[:, 2]
    m = (x + pose.t)[:, :2] / z[:, None]
    J = np.zeros((len(x), 2, 3))
    J[:, 0, 0], J[:, 0, 2] = camera.fx / z, -camera.fx * m[:, 0] / z
    J[:, 1, 1], J[:, 1, 2] = camera.fy / z, -camera.fy * m[:, 1] / z
    turn = -np.array([skew(point) for point in x])
    return np.concatenate([J @ turn, J], axis=2).reshape(-1, 6)


def _floor_rows(pose: WorldInCamera, floor: Plane) -> tuple[Array, Array]:
    """Return residuals (4,) and Jacobian (4, 6) of the floor against depth, over their deviations."""
    up = pose.R[:, 2]
    off = np.concatenate([(floor.normal - up) / TILT_SD, [(floor.distance + up @ pose.t) / HEIGHT_SD]])
    J = np.zeros((4, 6))
    J[:3, :3] = -skew(up) / TILT_SD
    J[3, :3] = -(np.cross(up, pose.t)) / HEIGHT_SD
    J[3, 3:] = -up / HEIGHT_SD
    return off, J


def system(
    pose: WorldInCamera, corners: Corners, camera: PinholeCamera, floor: Plane | None, noise: float
) -> tuple[Array, Array]:
    """Return the residuals and the Jacobian of what they are compared with, over their deviations."""
    off, J = misfit(pose, corners, camera).ravel() / noise, _jacobian(pose, corners, camera) / noise
    if floor is None:
        return off, J
    more, rows = _floor_rows(pose, floor)
    return np.concatenate([off, more]), np.concatenate([J, rows])


def refine(
    pose: WorldInCamera, corners: Corners, camera: PinholeCamera, floor: Plane | None, noise: float
) -> WorldInCamera:
    """Return the pose of least squares near `pose` (Levenberg and Marquardt)."""
    off, J = system(pose, corners, camera, floor, noise)
    damping = 1e-6
    for _ in range(_ROUNDS):
        A = J.T @ J
        step = np.linalg.solve(A + damping * np.diag(np.diag(A)), J.T @ off)
        tried = WorldInCamera(np.asarray(cv2.Rodrigues(step[:3])[0]) @ pose.R, pose.t + step[3:])
        new, new_J = system(tried, corners, camera, floor, noise)
        if new @ new <= off @ off:
            pose, off, J, damping = tried, new, new_J, damping / 10.0
            if float(np.linalg.norm(step)) < _STILL:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return pose


def uncertainty(
    pose: WorldInCamera,
    corners: Corners,
    camera: PinholeCamera,
    camera_sd: Array | None,
    floor: Plane | None,
    noise: float,
) -> tuple[float, Array]:
    """Return the deviation of the rotation [rad] and of the camera's place (3,) [m]."""
    _, J = system(pose, corners, camera, floor, noise)
    covariance: Array = np.asarray(np.linalg.inv(J.T @ J), dtype=np.float64)
    if camera_sd is not None:
        x = corners.x @ pose.R.T + pose.t
        m, one, none = x[:, :2] / x[:, 2:], np.ones(len(x)), np.zeros(len(x))
        by_camera = np.stack(
            [np.column_stack([m[:, 0], none, one, none]), np.column_stack([none, m[:, 1], none, one])], axis=1
        ).reshape(-1, 4)
        gain = covariance @ J[: len(by_camera)].T @ (by_camera / noise) * camera_sd
        covariance = covariance + gain @ gain.T
    # The camera's centre is -R' t; the translation turns with the rotation.
    to_centre = -pose.R.T @ np.hstack([skew(pose.t), np.eye(3)])
    place = to_centre @ covariance @ to_centre.T
    return float(np.sqrt(np.trace(covariance[:3, :3]))), np.sqrt(np.diag(place))
