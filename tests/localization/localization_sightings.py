"""The largest blob of a ray-cast frame: a plain stand-in for the compiled pass over the frame."""

from __future__ import annotations

import cv2
import numpy as np
from localization_rays import DRONE, Thing, cast, floor_threshold

from noctule.camera import CEILING_CAMERA, FixedCamera
from noctule.geometry import Pose
from noctule.localization.heading.sighting import Sighting
from noctule.messages import DepthFrame
from noctule.vision.depth.blob import Blob


_FLOORS: dict[int, tuple[FixedCamera, np.ndarray]] = {}


def floor_of(camera: FixedCamera) -> np.ndarray:
    """Return `floor_threshold` of a camera, cast once."""
    if id(camera) not in _FLOORS:
        _FLOORS[id(camera)] = (camera, floor_threshold(camera))
    return _FLOORS[id(camera)][1]


def largest_blob(frame: DepthFrame, camera: FixedCamera = CEILING_CAMERA) -> Sighting:
    """Return the largest connected piece of foreground over an empty floor."""
    near = ((frame.depth > 0) & (frame.depth < floor_of(camera))).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(near, connectivity=8)
    label = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    x, y, w, h, area = (int(n) for n in stats[label])
    v, u = np.nonzero(labels == label)
    z = frame.depth[v, u] * 1e-3
    a, b = u - u.mean(), v - v.mean()
    orders = [(2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)]
    moments = np.array([(a**i * b**j).sum() for i, j in orders])
    m = camera.intrinsics.normalise(np.column_stack([u, v]))
    points = np.column_stack([m * z[:, None], z]).mean(axis=0)
    centroid = np.array([u.mean(), v.mean()])
    blob = Blob(label, area, x, y, x + w, y + h, centroid, moments, points, float(z.mean()))
    return Sighting(frame, labels, blob, camera)


def drone_seen(x_world, yaw: float, roll=0.0, pitch=0.0, seed=None, things=()) -> Sighting:
    """Return the sighting of the ray-cast drone."""
    drone = Thing(Pose(np.asarray(x_world, dtype=float), yaw, roll, pitch), DRONE)
    return largest_blob(cast(CEILING_CAMERA, (drone, *things), seed=seed))


def flat(xy, camera: FixedCamera = CEILING_CAMERA, z: float = 1.0) -> Sighting:
    """Return a sighting whose pixels are those that world points (n, 2) at height z [m] fall on."""
    points = np.column_stack([xy, np.full(len(xy), z)])
    p = np.round(camera.project(points)).astype(int)
    depth = np.zeros((camera.intrinsics.height, camera.intrinsics.width), dtype=np.uint16)
    floor = floor_of(camera)
    # Each pixel gets the depth at which its own ray meets the plane, so that the points lie flat.
    ones = camera.to_world(p.astype(float), np.ones(len(p)))
    fall = (camera.t_world_camera[2] - z) / (camera.t_world_camera[2] - ones[:, 2])
    depth[p[:, 1], p[:, 0]] = np.round(1000.0 * fall)
    depth = np.where(depth > 0, depth, floor + 60).astype(np.uint16)
    return largest_blob(DepthFrame(1.5, depth), camera)
