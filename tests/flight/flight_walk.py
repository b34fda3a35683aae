"""A walk through the simulated room, as a person with a camera would film it: pictures, and nothing else."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np

from noctule.camera import CameraMount, PinholeCamera
from noctule.flight.path_folder import Shot, save_path
from noctule.geometry import Pose
from noctule.simulation import SimulatedWorld
from noctule.simulation.spec import CameraSpec, RoomSpec, VehicleSpec
from noctule.vision.key_images import Frame

CAMERA = PinholeCamera.centred(856, 480, 510.0)
MOUNT = CameraMount(np.array([0.09, 0.0, 0.0]), stabilised=True)
RATE = 8.0  # [Hz]


def pose(x: float, y: float, yaw_deg: float) -> Pose:
    return Pose(np.array([x, y, 1.0]), float(np.radians(yaw_deg)))


def way() -> list[Pose]:
    """Three seconds: forward at 0.6 m/s, then a turn to the left while going on."""
    poses, x, y, yaw, dt = [], 0.0, 0.0, 0.0, 1.0 / RATE
    for i in range(round(3.0 * RATE) + 1):
        poses.append(Pose(np.array([x, y, 1.0]), yaw))
        speed = 0.6 * min(1.0, i * dt / 0.5, (3.0 - i * dt) / 0.5)
        x, y = x + speed * dt * np.cos(yaw), y + speed * dt * np.sin(yaw)
        yaw += np.radians(25.0) * dt if 1.0 <= i * dt < 2.5 else 0.0
    return poses


@cache
def photographs(seed: int, *poses: tuple[float, float, float]) -> tuple[np.ndarray, ...]:
    """Pictures from poses (x, y, heading in degrees), 1 m high, in the room of a seed."""
    return _pictures(seed, [pose(*p) for p in poses])


@cache
def walk() -> tuple[Frame, ...]:
    return tuple(Frame(i / RATE, picture) for i, picture in enumerate(_pictures(0, way())))


def _pictures(seed: int, poses: list[Pose]) -> tuple[np.ndarray, ...]:
    with SimulatedWorld(RoomSpec(seed=seed), VehicleSpec(), CameraSpec(), poses[0], seed) as world:
        return tuple(world.photograph(p, noisy=True).pixels for p in poses)


def video(file: Path, frames: tuple[Frame, ...] | None = None) -> Path:
    """Write frames as a video of motion JPEGs."""
    frames = walk() if frames is None else frames
    height, width = frames[0].pixels.shape[:2]
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"MJPG"), RATE, (width, height))
    for frame in frames:
        writer.write(cv2.cvtColor(frame.pixels, cv2.COLOR_RGB2BGR))
    writer.release()
    return file


def path_of(folder: Path, pictures: list[np.ndarray], camera: PinholeCamera = CAMERA) -> Path:
    """Write a path folder of pictures."""
    save_path(folder, [Shot(picture) for picture in pictures], camera, MOUNT)
    return folder
