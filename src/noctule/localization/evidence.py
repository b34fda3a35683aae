"""What a depth frame says about the cells of a body: drone, free or unknown, seen from a supposed pose.

Every pixel near the supposed pose is taken to the body's axes. A reading that is foreground and near the
body's height is *drone*, at the place of its own point; a ray that passes that height and ends well below it
is *free*, at the place where it crosses. Everything else (occluded, invalid, outside the picture) is unknown:
no evidence. Taking drone readings at their own points, not where their rays cross the plane, keeps sides seen
obliquely in place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.geometry import Array, Pose
from noctule.localization.gathering import FULL, Map, count_readings, rotation

__all__ = ["FULL", "Evidence", "Grid", "Map", "gather"]


@dataclass(frozen=True, slots=True)
class Grid:
    """Square cells in the body's axes, centred on its origin: index [i, j] is x [forward], y [left]."""

    cell: float  # [m]
    n: int  # cells along a side
    plane: float  # [m], height over the body's origin at which rays count as free


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
    share: Map  # (n, n), how far the cell is drone, 0 to 1
    trust: Map  # (n, n), how far that counts, 0 (unknown) to 1


def gather(
    depth: NDArray[np.uint16], nearest: NDArray[np.uint16], camera: FixedCamera, pose: Pose, grid: Grid
) -> Evidence:
    """Gather the readings of a depth image (h, w) [mm] in the cells around a supposed pose.

    `nearest` (h, w) [mm] is the background's: a reading below it is foreground.
    """
    k = camera.intrinsics
    R_world_body = rotation(pose.yaw, pose.roll, pose.pitch)
    maps = np.zeros((5, grid.n, grid.n), dtype=np.float32)
    distance = count_readings(
        depth, nearest, (k.fx, k.fy, k.cx, k.cy), camera.R_world_camera, camera.t_world_camera,
        R_world_body, pose.position, grid.cell, grid.plane, maps,
    )  # fmt: skip
    drone, free, height, share, trust = maps
    return Evidence(pose, R_world_body, distance, grid, drone, free, height, share, trust)
