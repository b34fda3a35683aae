"""A small room seen straight from above: a level floor, and boxes over it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from noctule.camera import FixedCamera, PinholeCamera
from noctule.flight.depth_scene import Scene
from noctule.localization.detection.band import SurfaceBand
from noctule.localization.detection.cubics import AreaCubics
from noctule.localization.detection.hu import HuPatterns
from noctule.localization.detector_file import Detectors, save_detectors
from noctule.localization.site import SiteCamera, save_background, save_camera, save_template
from noctule.localization.template import build_template
from noctule.vision.depth import learn_background

CAMERA = FixedCamera(
    PinholeCamera.centred(160, 120, 140.0),
    np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    np.array([0.0, 0.0, 3.0]),
)

DETECTORS = Detectors(
    AreaCubics(np.array([9000.0, 0, 0, 0]), np.array([100.0, 0, 0, 0]), 0.2, 2.2),
    SurfaceBand(0.02, 0.3, 0.2, 2.2),
    HuPatterns(np.ones((1, 7)), 1.0),
)

Box = tuple[float, float, float, float, float]
"""x, y and top z [m] of a box in the world, and its length and width."""


def depth(boxes: list[Box], noise: int) -> np.ndarray:
    """Return the depth image (120, 160) [mm]; `noise` draws the sensor's."""
    image = np.full((120, 160), 3000.0)
    for x, y, z, length, width in sorted(boxes, key=lambda box: box[2]):
        corners = np.array([[x - length / 2, y - width / 2, z], [x + length / 2, y + width / 2, z]])
        (u0, v0), (u1, v1) = np.sort(CAMERA.project(corners), axis=0)
        rows = slice(max(round(v0), 0), max(round(v1), 0))
        image[rows, max(round(u0), 0) : max(round(u1), 0)] = 1000.0 * (3.0 - z)
    image += np.random.default_rng(noise).normal(0.0, 4.0, image.shape)
    return np.rint(image).astype(np.uint16)


def leave(folder: Path, images: list[np.ndarray]) -> Path:
    """Leave a folder of depth images, 30 a second."""
    (folder / "depth").mkdir(parents=True)
    for k, image in enumerate(images):
        cv2.imwrite(str(folder / "depth" / f"{k:06d}.png"), image)
    return folder


def leave_site(folder: Path) -> Path:
    """Leave a site with nothing but its camera."""
    save_camera(folder, SiteCamera(CAMERA))
    return folder


def leave_empty_room(folder: Path, frames: int = 20) -> Path:
    """Leave what the camera sees of the empty room."""
    return leave(folder, [depth([], k) for k in range(frames)])


def flight(frames: int = 150, more: tuple[Box, ...] = ()) -> list[np.ndarray]:
    """Return a flight by hand of a drone of 0.5 x 0.4 m, up and down and round."""
    images = []
    for k in range(frames):
        t = 2.0 * np.pi * k / frames
        drone = (0.2 * np.cos(3 * t), 0.3 * np.sin(2 * t), 1.1 - 0.7 * np.cos(5 * t), 0.5, 0.4)
        images.append(depth([drone, *more], 1000 + k))
    return images


def leave_simulated_site(folder: Path) -> Path:
    """Leave a site of the simulated room; its template is made of true poses, which is quick."""
    camera = Scene("none").spec.camera
    background = learn_background([f.depth for f in Scene("none", seconds=0.7).frames()])
    scene = Scene("manual", seconds=30.0)
    poses = {stamp: pose for stamp, pose in scene.poses() if pose is not None}
    samples = [
        (frame, poses[frame.stamp]) for frame in scene.frames(lambda stamp: round(30 * stamp) % 10 == 0)
    ]
    save_camera(folder, SiteCamera(camera))
    save_background(folder, background, camera)
    save_detectors(folder, DETECTORS, camera)
    save_template(folder, build_template(samples, background.nearest, camera))
    return folder
