"""A tiny ray caster: boxes and discs above a floor, as a depth camera on the ceiling would see them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

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


@cache
def _rays(camera: PinholeCamera, rotation: bytes) -> np.ndarray:
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    m = camera.normalise(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    R = np.frombuffer(rotation).reshape(3, 3)
    return (np.column_stack([m, np.ones(len(m))]) @ R.T).reshape(camera.height, camera.width, 3)


def _window(camera: FixedCamera, thing: Thing, solid: Solid) -> tuple[slice, slice]:
    """The part of the picture that a solid can be in, from the corners of a box around it."""
    signs = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    half = np.array([solid.half[0], solid.half[0] if solid.round else solid.half[1], solid.half[2]])
    corners = thing.pose.position + (solid.centre + signs * half) @ thing.pose.R_world_body.T
    k = camera.intrinsics
    if camera.to_camera(corners)[:, 2].min() < 0.05:
        return slice(0, k.height), slice(0, k.width)
    p = camera.project(corners)
    (left, top), (right, bottom) = p.min(axis=0).astype(int) - 1, p.max(axis=0).astype(int) + 2
    return slice(max(top, 0), max(bottom, 0)), slice(max(left, 0), max(right, 0))


def cast(
    camera: FixedCamera, things: tuple[Thing, ...] = (), stamp: float = 0.0, seed: int | None = None
) -> DepthFrame:
    """Render; with a seed also the noise of a sensor: 0.2 % of depth, steps of 3 mm z^2, 2 % of holes."""
    rays = _rays(camera.intrinsics, np.ascontiguousarray(camera.R_world_camera).tobytes())
    with np.errstate(divide="ignore"):
        z = np.where(rays[..., 2] < 0.0, -camera.t_world_camera[2] / rays[..., 2], np.inf)
    for thing in things:
        R = thing.pose.R_world_body
        origin = R.T @ (camera.t_world_camera - thing.pose.position)
        for solid in thing.solids:
            part = _window(camera, thing, solid)
            hits = _hits(solid, origin, rays[part].reshape(-1, 3) @ R)
            z[part] = np.minimum(z[part], hits.reshape(z[part].shape))
    if seed is not None:
        rng = np.random.default_rng(seed)
        z *= 1.0 + 0.002 * rng.standard_normal(z.shape, dtype=np.float32)
        step = 0.003 * z**2
        z = np.round(z / step) * step
        z[rng.random(z.shape, dtype=np.float32) < 0.02] = 0.0
    depth = np.where(np.isfinite(z), z * 1000.0, 0.0).round().clip(0, 65535).astype(np.uint16)
    return DepthFrame(stamp, depth)


def floor_threshold(camera: FixedCamera, margin: float = 0.06) -> np.ndarray:
    """The depth [mm] nearer than which a reading is foreground, for the empty floor."""
    empty = cast(camera).depth
    return (empty - np.minimum(empty, margin * 1000)).astype(np.uint16)
