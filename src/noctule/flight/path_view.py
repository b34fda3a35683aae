"""Whether a depth camera that stands in the room can see the drone along a path, told before it takes off."""

from __future__ import annotations

import numpy as np

from noctule.camera import FixedCamera
from noctule.control.paths import PathPlan
from noctule.errors import NoctuleError
from noctule.geometry import Array
from noctule.localization.site import Site

_INSIDE = 0.10  # [m] from the picture's edge: more than half of the drone is seen, though it strays
_ABOVE = 0.10  # [m] from the body's origin to its highest part
_BODY = 0.20  # [m] about its origin that must be free
_AROUND = 8  # points on the rim of the body


class UnseenPathError(NoctuleError):
    """A path where the depth camera cannot see the drone, or where something stands."""


def unseen(camera: FixedCamera, nearest: float, farthest: float, position: Array) -> tuple[int, str] | None:
    """Return the first of the positions (n, 3) [m] where a drone is not seen, and why; None if it is at all.

    `nearest` and `farthest` [m], along the optical axis, bound what has a depth.
    """
    depth = camera.to_camera(position)[:, 2]
    near, far = depth - _ABOVE < nearest, depth > farthest
    inside = camera.inside(position)
    bad = near | far | (inside < _INSIDE)
    if not bad.any():
        return None
    k = int(bad.argmax())
    if near[k]:
        return k, (
            f"{max(0.0, depth[k]):.2f} m below the ceiling camera, which measures from {nearest:g} m on; "
            "fly lower there, or hang it higher"
        )
    if far[k]:
        return k, (
            f"{depth[k]:.2f} m from the ceiling camera, which measures up to {farthest:g} m; "
            "fly higher there, or hang it lower"
        )
    edge = f"nearer than {_INSIDE:.2f} m to the edge" if inside[k] >= 0.0 else f"{-inside[k]:.2f} m outside"
    return k, (
        f"{edge} of the ceiling camera's picture; fly lower or nearer to its middle there, or move the camera"
    )


def require_free(site: Site, plan: PathPlan, name: str) -> None:
    """Refuse a path that leads into, or behind, something that stood there when the room was learned empty.

    Raises UnseenPathError.
    """
    path = plan.path
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    rim = _BODY * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(_AROUND)])
    body = path.position[:, None, :] + np.vstack([rim, np.zeros(3)])
    taken = behind(site, body.reshape(-1, 3)).reshape(len(path.position), -1).any(axis=1)
    if taken.any():
        raise UnseenPathError(
            f"{name}: space_path: something stood at {path.place(float(path.s[int(taken.argmax())]))}, or "
            f"between it and the camera, when the empty room was learned; expected {_BODY:g} m free around "
            "it: fly elsewhere, or clear the place and learn the background again"
        )


def behind(site: Site, points: Array) -> np.ndarray:
    """Return which of the points (n, 3) [m] the camera cannot see in the empty room; unknown ones it can."""
    camera, mean = site.camera.camera, site.background.mean
    depth = camera.to_camera(points)[:, 2]
    hidden = np.zeros(len(points), dtype=bool)
    before = np.nonzero(depth > 0.0)[0]
    p = np.rint(camera.project(points[before])).astype(np.int64)
    inside = ((p >= 0) & (p < [mean.shape[1], mean.shape[0]])).all(axis=1)
    before, p = before[inside], p[inside]
    room = mean[p[:, 1], p[:, 0]] / 1000.0  # [m]
    hidden[before] = (room > 0.0) & (depth[before] > room)
    return hidden
