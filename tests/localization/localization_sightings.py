"""Sightings to measure headings on: the simulated drone under the ceiling camera, and flat things by hand."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from noctule.camera import CEILING_CAMERA, FixedCamera
from noctule.geometry import Pose
from noctule.localization.detection.splinters import join_splinters, relabel
from noctule.localization.heading.sighting import Sighting
from noctule.messages import DepthFrame
from noctule.simulation.ceiling import CeilingSpec, DepthStage, ThingPose
from noctule.vision.depth.background import Background
from noctule.vision.depth.blobs import DEPTH_STEP, find_blobs
from noctule.vision.depth.learning import learn_background

MIN_AREA = 15  # [px]


@cache
def stage(hull: bool) -> tuple[DepthStage, Background]:
    """Return a room with a drone, and what it looks like empty."""
    room = DepthStage(CeilingSpec(hull=hull), 0)
    return room, learn_background(room.frame(i / 30.0, None).depth for i in range(30))


def largest(
    frame: DepthFrame, background: Background, camera: FixedCamera, depth_step: float | None = DEPTH_STEP
) -> Sighting:
    """Return the sighting of the largest thing in a frame."""
    labels, blobs = find_blobs(frame.depth, background, camera.intrinsics, MIN_AREA, depth_step)
    whole, parts = join_splinters(blobs, camera)
    blob = max(whole, key=lambda b: b.area)
    return Sighting(frame, relabel(labels, blobs, parts), blob, camera)


def drone_seen(
    x_world,
    yaw: float,
    roll: float = 0.0,
    pitch: float = 0.0,
    stamp: float = 100.0,
    things: Sequence[ThingPose] = (),
    hull: bool = True,
    depth_step: float | None = DEPTH_STEP,
) -> Sighting:
    """Return the sighting of the simulated drone; each stamp has its own noise."""
    room, background = stage(hull)
    pose = Pose(np.asarray(x_world, dtype=float), yaw, roll, pitch)
    return largest(room.frame(stamp, pose, things), background, CEILING_CAMERA, depth_step)


def flat(xy, camera: FixedCamera = CEILING_CAMERA, z: float = 1.0) -> Sighting:
    """Return a sighting whose pixels are those that world points (n, 2) at height z [m] fall on."""
    points = np.column_stack([xy, np.full(len(xy), z)])
    p = np.round(camera.project(points)).astype(int)
    shape = (camera.intrinsics.height, camera.intrinsics.width)
    nothing = np.full(shape, 9000, dtype=np.uint16)
    background = Background(
        nothing.astype(np.float32),
        np.ones(shape, dtype=np.float32),
        np.full(shape, 100, dtype=np.int32),
        nothing - 100,
        100,
        4.0,
    )
    # Each pixel gets the depth at which its own ray meets the plane, so that the points lie flat.
    ones = camera.to_world(p.astype(float), np.ones(len(p)))
    fall = (camera.t_world_camera[2] - z) / (camera.t_world_camera[2] - ones[:, 2])
    depth = nothing.copy()
    depth[p[:, 1], p[:, 0]] = np.round(1000.0 * fall)
    return largest(DepthFrame(1.5, depth), background, camera)
