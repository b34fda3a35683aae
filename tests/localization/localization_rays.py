"""A tiny ray caster: boxes and discs above a floor, as a depth camera on the ceiling would see them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noctule.camera import CEILING_CAMERA, FixedCamera, PinholeCamera
from noctule.geometry import Pose
from noctule.messages import DepthFrame


def small_camera(scale: float = 0.5) -> FixedCamera:
    """The camera of Table 2 with fewer pixels, so that tests are quick."""
    k = CEILING_CAMERA.intrinsics
    small = PinholeCamera(
        int(k.width * scale),
        int(k.height * scale),
        k.fx * scale,
        k.fy * scale,
        (k.cx + 0.5) * scale - 0.5,
        (k.cy + 0.5) * scale - 0.5,
    )
    return FixedCamera(small, CEILING_CAMERA.R_world_camera, CEILING_CAMERA.t_world_camera)


@dataclass(frozen=True)
class Solid:
    """A box (half sizes) or an upright disc (radius, half height) at a place in the body's frame."""

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    round: bool = False


@dataclass(frozen=True)
class Thing:
    """Solids that move together."""

    pose: Pose
    solids: tuple[Solid, ...]


_ROTORS = [(0.127, 0.127), (0.127, -0.127), (-0.127, 0.127), (-0.127, -0.127)]
DRONE = (
    Solid((0.03, 0.0, 0.02), (0.2, 0.05, 0.03)),
    Solid((0.0, 0.0, 0.02), (0.02, 0.13, 0.015)),
    *(Solid((x, y, 0.03), (0.1, 0.1, 0.01), round=True) for x, y in _ROTORS),
)
TRAY = (Solid((0.0, 0.0, 0.0), (0.25, 0.2, 0.02)),)
BOX = (Solid((0.0, 0.0, 0.0), (0.3, 0.2, 0.25)),)
PERSON = (
    Solid((0.0, 0.0, 0.7), (0.15, 0.25, 0.7)),
    Solid((0.0, 0.0, 1.6), (0.1, 0.1, 0.12), round=True),
)


def _hits(solid: Solid, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
    o, half = origin - solid.centre, np.array(solid.half)
    with np.errstate(divide="ignore", invalid="ignore"):
        if solid.round:
            top = (half[2] - o[2]) / rays[:, 2]
            at = o[:2] + top[:, None] * rays[:, :2]
            return np.where((at**2).sum(axis=1) < half[0] ** 2, top, np.inf)
        a, b = (-half - o) / rays, (half - o) / rays
    near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    return np.where((near < far) & (near > 0.0), near, np.inf)


def cast(
    camera: FixedCamera, things: tuple[Thing, ...] = (), stamp: float = 0.0, seed: int | None = None
) -> DepthFrame:
    """Render; with a seed also the noise of a sensor: 0.2 % of depth, steps of 3 mm z^2, 2 % of holes."""
    k = camera.intrinsics
    v, u = np.mgrid[0 : k.height, 0 : k.width]
    m = k.normalise(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    rays = np.column_stack([m, np.ones(len(m))]) @ camera.R_world_camera.T
    z = -camera.t_world_camera[2] / rays[:, 2]
    z = np.where(rays[:, 2] < 0.0, z, np.inf)
    for thing in things:
        R = thing.pose.R_world_body
        centre = camera.project(thing.pose.position[None])[0]
        reach = 1.4 * k.fx / max(camera.to_camera(thing.pose.position[None])[0, 2], 0.3)
        near = np.flatnonzero(
            (np.abs(u.ravel() - centre[0]) < reach) & (np.abs(v.ravel() - centre[1]) < reach)
        )
        origin = R.T @ (camera.t_world_camera - thing.pose.position)
        for solid in thing.solids:
            z[near] = np.minimum(z[near], _hits(solid, origin, rays[near] @ R))
    if seed is not None:
        rng = np.random.default_rng(seed)
        z = z * (1.0 + 0.002 * rng.standard_normal(len(z)))
        step = 0.003 * z**2
        z = np.round(z / step) * step
        z[rng.random(len(z)) < 0.02] = 0.0
    depth = np.where(np.isfinite(z), z * 1000.0, 0.0).round().clip(0, 65535).astype(np.uint16)
    return DepthFrame(stamp, depth.reshape(k.height, k.width))


def floor_threshold(camera: FixedCamera, margin: float = 0.06) -> np.ndarray:
    """The depth [mm] nearer than which a reading is foreground, for the empty floor."""
    empty = cast(camera).depth
    return (empty - np.minimum(empty, margin * 1000)).astype(np.uint16)
