"""A cloud of points in space and what a camera sees of it: views without pictures."""

import numpy as np

from noctule.camera import CameraMount, PinholeCamera
from noctule.control.servoing import mean_distance
from noctule.estimation.odometry import OdometryPose
from noctule.geometry import R_BODY_CAMERA, rot_z, tilt
from noctule.pilots.law import Optics, Scene, View
from noctule.vision.homography import estimate_homography

CAMERA = PinholeCamera.centred(856, 480, 510.0)
MOUNT = CameraMount()
OPTICS = Optics(CAMERA, MOUNT)
DT = 1.0 / 30.0


def cloud(n=60, seed=0, near=2.5, far=5.0):
    """Points (n, 3) [m] ahead of the origin, in the world, of depths far apart."""
    rng = np.random.default_rng([seed, 0xC10D])
    x = rng.uniform(near, far, n)
    return np.column_stack([x, x * rng.uniform(-0.6, 0.6, n), 1.0 + x * rng.uniform(-0.35, 0.35, n)])


def pixels(points, position, yaw, roll=0.0, pitch=0.0):
    """Return (n, 2) [px] of points seen from a body's place."""
    R = rot_z(yaw) @ tilt(roll, pitch)
    body = (points - np.asarray(position)) @ R
    return CAMERA.project((body - MOUNT.t_body_camera) @ R_BODY_CAMERA)


def inside(p):
    return ((p >= 0.0) & (p <= [CAMERA.width - 1.0, CAMERA.height - 1.0])).all(axis=1)


def view_of(index, points, target, here, pose, method="generic", noise=0.1, seed=0):
    """The view of a key image taken at `target` (position, yaw) from `here`; `noise` [px] in both."""
    rng = np.random.default_rng([seed, index])
    p_ref, p = pixels(points, *target), pixels(points, *here)
    both = inside(p_ref) & inside(p)
    p_ref = p_ref[both] + rng.normal(0.0, noise, (both.sum(), 2))
    p = p[both] + rng.normal(0.0, noise, (both.sum(), 2))
    estimate = estimate_homography(CAMERA.normalise(p_ref), CAMERA.normalise(p), method)
    return View(index, pose, estimate, p_ref, p, mean_distance(p, p_ref))


def scene_at(stamp, views, previous, columns=(), dt=DT):
    pose = OdometryPose(stamp, np.zeros(3), 0.0, np.zeros(3))
    return Scene(stamp, dt, pose, np.asarray(previous, dtype=float), views, columns, pose)


def pose_at(stamp):
    return OdometryPose(stamp, np.zeros(3), 0.0, np.zeros(3))
