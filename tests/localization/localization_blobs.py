"""Blobs made by hand: what the camera would say of a flat thing of a given surface at a given place."""

from __future__ import annotations

import numpy as np

from noctule.camera import CEILING_CAMERA
from noctule.vision.depth.blob import Blob

DRONE_SURFACE = 0.12  # [m^2]


def blob_at(x_world, surface: float = DRONE_SURFACE, moments=None, label: int = 1) -> Blob:
    """Return the blob of a flat thing with `surface` [m^2] at `x_world` (3,) [m]."""
    x_world = np.asarray(x_world, dtype=np.float64)
    x_camera = CEILING_CAMERA.to_camera(x_world[None])[0]
    u, v = CEILING_CAMERA.project(x_world[None])[0]
    depth = float(x_camera[2])
    focal = CEILING_CAMERA.intrinsics.focal
    area = round(surface * focal[0] * focal[1] / depth**2)
    half = int(np.sqrt(area) / 2) + 1
    if moments is None:
        moments = np.zeros(7)
    return Blob(
        label,
        area,
        int(u) - half,
        int(v) - half,
        int(u) + half,
        int(v) + half,
        np.array([u, v]),
        np.asarray(moments, dtype=np.float64),
        x_camera,
        depth,
    )


def manual_flight_blobs(seed, frames=400, low=0.5, high=2.0, spread=0.03):
    """Return one blob per frame of a flight over all heights, with `spread` of noise on the surface."""
    rng = np.random.default_rng(seed)
    flown = []
    for _ in range(frames):
        x_world = np.array([0.0, -0.2, 0.0]) + rng.uniform([-0.4, -0.4, low], [0.4, 0.4, high])
        flown.append((blob_at(x_world, DRONE_SURFACE * (1.0 + spread * rng.standard_normal())),))
    return flown
