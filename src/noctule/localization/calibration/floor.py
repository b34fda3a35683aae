"""Planes in depth images: the floor, and the board that lies on it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.camera import PinholeCamera
from noctule.geometry import Array

_ROUNDS = 8
_MOST = 40_000  # readings or so that are looked at; more know it no better
_FLAT = 0.06  # [m], readings that scatter more are no plane
_KEEP = 3.0  # standard deviations that a reading may lie off the plane


@dataclass(frozen=True, slots=True)
class Plane:
    """The plane normal . x = -distance in camera coordinates; the normal points to the camera's side."""

    normal: Array  # (3,), of length 1
    distance: float  # [m], of the camera from it

    @classmethod
    def through(cls, R_camera_plane: Array, t_camera_plane: Array) -> Plane:
        """Return the plane z = 0 of a frame whose pose before the camera is given."""
        normal = R_camera_plane[:, 2]
        return cls(normal, -float(normal @ t_camera_plane))

    def lowered(self, by: float) -> Plane:
        """Return the parallel plane that is farther from the camera by `by` [m]."""
        return Plane(self.normal, self.distance + by)

    def depth_at(self, m: Array) -> Array:
        """Return the depth (n,) [m] along the optical axis at normalised coordinates (n, 2)."""
        return np.asarray(-self.distance / (m @ self.normal[:2] + self.normal[2]))

    def angle_to(self, other: Plane) -> float:
        """Return the angle [rad] between two planes' normals."""
        cross = float(np.linalg.norm(np.cross(self.normal, other.normal)))
        return float(np.arctan2(cross, self.normal @ other.normal))


@dataclass(frozen=True, slots=True)
class PlaneFit:
    """A plane fitted to a depth image."""

    plane: Plane
    count: int  # readings that lie on it, of those looked at
    scatter: float  # [m], sd of these along the optical axis, at their mean depth


def inside_outline(outline: Array, camera: PinholeCamera) -> NDArray[np.bool_]:
    """Return which pixels (height, width) lie inside a convex polygon (n, 2) [px]."""
    mask = np.zeros((camera.height, camera.width), dtype=np.uint8)
    cv2.fillConvexPoly(mask, np.rint(outline).astype(np.int32), 1)
    return mask.astype(bool)


def near_plane(
    depth: NDArray[np.uint16], camera: PinholeCamera, plane: Plane, within: float
) -> NDArray[np.bool_]:
    """Return which pixels have a reading within `within` [m] of a plane, along the optical axis."""
    v, u = np.nonzero(depth)
    expected = plane.depth_at(camera.normalise(np.column_stack([u, v])))
    found = np.zeros(depth.shape, dtype=bool)
    found[v, u] = np.abs(depth[v, u] / 1000.0 - expected) <= within
    return found


def fit_plane(
    depth: NDArray[np.uint16], camera: PinholeCamera, where: NDArray[np.bool_], fewest: int = 200
) -> PlaneFit | None:
    """Fit a plane to the readings [mm] of the pixels `where`; None where fewer than `fewest` lie on one.

    Linear in the inverse depth, whose noise is the same at every depth for cameras that triangulate; readings
    off the plane are left out.
    """
    v, u = np.nonzero(where & (depth > 0))
    if len(u) < fewest:
        return None
    if len(u) > _MOST:
        v, u = v[:: len(u) // _MOST], u[:: len(u) // _MOST]
    z = depth[v, u] / 1000.0
    rays = np.column_stack([camera.normalise(np.column_stack([u, v])), np.ones(len(u))])
    inverse = 1.0 / z
    keep = np.ones(len(u), dtype=bool)
    slope: Array = np.zeros(3)
    for _ in range(_ROUNDS):
        slope = np.asarray(np.linalg.lstsq(rays[keep], inverse[keep], rcond=None)[0], dtype=np.float64)
        off = inverse - rays @ slope
        sd = 1.4826 * float(np.median(np.abs(off[keep])))
        kept = np.abs(off) <= _KEEP * max(sd, 1e-5)
        if kept.sum() < fewest:
            return None
        if (kept == keep).all():
            break
        keep = kept
    length = float(np.linalg.norm(slope))
    plane = Plane(-slope / length, 1.0 / length)
    depths = z[keep]
    scatter = float(np.std(depths - plane.depth_at(rays[keep, :2])))
    if not scatter <= _FLAT:
        return None
    return PlaneFit(plane, int(keep.sum()), scatter)
