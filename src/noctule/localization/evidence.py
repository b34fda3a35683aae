"""What a depth frame says about the cells of a body: drone, free or unknown, seen from a supposed pose.

Every pixel near the supposed pose is taken to the body's axes. A reading that is foreground and near the
body's height is *drone*, at the place of its own point; a ray that passes that height and ends well below it
is *free*, at the place where it crosses. Everything else (occluded, invalid, outside the picture) is unknown:
no evidence. Taking drone readings at their own points, not where their rays cross the plane, keeps sides seen
obliquely in place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.geometry import Array, Pose
from noctule.vision.homography.compiled import compiled

Map = NDArray[np.float32]

BAND = 0.13  # [m], a reading this near to the body's height may be drone; from localization.md
BELOW = 0.5  # [m], foreground between the band and this far below is neither drone nor free
_THICK = 0.08  # [m], from the plane up to the highest that is drone
# readings along a cell's sides at least; nearer drones are read in strides
_PER_CELL_U, _PER_CELL_V = 2.0, 1.0


@dataclass(frozen=True, slots=True)
class Grid:
    """Square cells in the body's axes, centred on its origin: index [i, j] is x [forward], y [left]."""

    cell: float  # [m]
    n: int  # cells along a side
    plane: float  # [m], height over the body's origin at which rays count as free

    @property
    def half(self) -> float:
        """Half the side, [m]."""
        return 0.5 * self.n * self.cell

    def grown(self, margin: float) -> Grid:
        """Return the grid with `margin` [m] more on every side."""
        return Grid(self.cell, self.n + 2 * math.ceil(margin / self.cell), self.plane)


@dataclass(frozen=True, slots=True)
class Evidence:
    """A frame's readings, counted in a grid laid out in the axes of a supposed pose."""

    pose: Pose  # supposed
    R_world_body: Array  # (3, 3), its rotation
    distance: float  # [m], of that from the camera, along its axis
    grid: Grid
    drone: Map  # (n, n), area [cells] of the drone readings in a cell: about 1 where all of it is drone
    free: Map  # (n, n), the same of readings that see past the cell
    height: Map  # (n, n) [m], height over the supposed origin, summed over the drone readings' areas


def gather(
    depth: NDArray[np.uint16], nearest: NDArray[np.uint16], camera: FixedCamera, pose: Pose, grid: Grid
) -> Evidence:
    """Gather the readings of a depth image (h, w) [mm] in the cells around a supposed pose.

    `nearest` (h, w) [mm] is the background's: a reading below it is foreground.
    """
    R_world_body = pose.R_world_body
    R_body_camera = R_world_body.T @ camera.R_world_camera
    t_body_camera = R_world_body.T @ (camera.t_world_camera - pose.position)
    k = camera.intrinsics
    n = grid.n
    drone, free, height = (np.zeros((n, n), dtype=np.float32) for _ in range(3))
    left, top, right, bottom = _window(
        R_body_camera, t_body_camera, grid.half, grid.plane, (k.fx, k.fy, k.cx, k.cy), k.width, k.height
    )
    distance = -float(R_body_camera[:, 2] @ t_body_camera)
    if left < right and top < bottom and distance > 0.0:
        strides = (
            max(1, int(grid.cell * k.fx / (_PER_CELL_U * distance))),
            max(1, int(grid.cell * k.fy / (_PER_CELL_V * distance))),
        )
        _count(
            depth, nearest, (k.fx, k.fy, k.cx, k.cy), R_body_camera, t_body_camera,
            (left, top, right, bottom), strides, grid.cell, grid.plane, BAND, BELOW, drone, free, height,
        )  # fmt: skip
    return Evidence(pose, R_world_body, distance, grid, drone, free, height)


@compiled
def _window(
    R: Array,
    t: Array,
    half: float,
    plane: float,
    intrinsics: tuple[float, float, float, float],
    width: int,
    height: int,
) -> tuple[int, int, int, int]:
    """Return the part of the picture that shows a grid: left, top, right, bottom [px], clipped to it.

    R, t take camera coordinates to the body's.
    """
    fx, fy, cx, cy = intrinsics
    left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
    for x in (-half, half):
        for y in (-half, half):
            for z in (plane, plane + _THICK):
                dx, dy, dz = x - t[0], y - t[1], z - t[2]
                depth = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz
                if depth < 0.05:
                    return 0, 0, 0, 0
                u = fx * (R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz) / depth + cx
                v = fy * (R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz) / depth + cy
                left, top = min(left, u), min(top, v)
                right, bottom = max(right, u), max(bottom, v)
    return (
        int(min(max(left, 0.0), width)),
        int(min(max(top, 0.0), height)),
        int(min(max(right + 2.0, 0.0), width)),
        int(min(max(bottom + 2.0, 0.0), height)),
    )


@compiled
def _count(
    depth: NDArray[np.uint16],
    nearest: NDArray[np.uint16],
    intrinsics: tuple[float, float, float, float],
    R: Array,
    t: Array,
    window: tuple[int, int, int, int],
    strides: tuple[int, int],
    cell: float,
    plane: float,
    band: float,
    below: float,
    drone: Map,
    free: Map,
    height: Map,
) -> None:
    """Add the readings of a window to the maps; R, t take camera coordinates to the body's."""
    fx, fy, cx, cy = intrinsics
    n = drone.shape[0]
    inverse = 1.0 / cell
    middle = 0.5 * n
    # a reading stands for its pixel's shadow on the level plane
    scale = strides[0] * strides[1] / (cell * cell * fx * fy)
    left, top, right, bottom = window
    tx, ty, tz = t
    rx_x, ry_x, rz_x = R[0, 0], R[1, 0], R[2, 0]
    per_fx = 1.0 / fx
    for v in range(top, bottom, strides[1]):
        y_m = (v - cy) / fy
        ax = R[0, 1] * y_m + R[0, 2]
        ay = R[1, 1] * y_m + R[1, 2]
        az = R[2, 1] * y_m + R[2, 2]
        for u in range(left, right, strides[0]):
            reading = depth[v, u]
            if reading == 0:
                continue
            x_m = (u - cx) * per_fx
            rz = az + rz_x * x_m
            d = reading * 0.001
            over = tz + d * rz - plane
            if over > band:
                continue  # something nearer hides the cell
            near = reading < nearest[v, u]
            seen = near and over > -band
            if near and not seen and over > -below:
                continue  # a thing that reaches up to the body: a slice of it looks like anything
            along = 1.0 / rz
            if not seen:
                d = (plane - tz) * along
                # Near the floor a body may be too close to the background to be told from it.
                if over > -band and d * 1000.0 >= nearest[v, u]:
                    continue
            area = -d * d * scale * along
            x_cell = (tx + d * (ax + rx_x * x_m)) * inverse + middle
            y_cell = (ty + d * (ay + ry_x * x_m)) * inverse + middle
            if not (0.0 <= x_cell < n and 0.0 <= y_cell < n):
                continue
            i, j = int(x_cell), int(y_cell)
            if seen:
                drone[i, j] += area
                height[i, j] += area * (over + plane)
            else:
                free[i, j] += area
