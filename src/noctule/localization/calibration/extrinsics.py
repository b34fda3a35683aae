"""Where a camera hangs: from pictures of a board that lies on the floor at a known place, and from depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from noctule.camera import FixedCamera, PinholeCamera
from noctule.errors import NoctuleError
from noctule.geometry import Array, rot_z
from noctule.localization.calibration.board import BoardView, without_strays
from noctule.localization.calibration.floor import Plane
from noctule.localization.calibration.lens import Lens
from noctule.localization.calibration.pose_fit import (
    Corners,
    WorldInCamera,
    is_possible,
    misfit,
    refine,
    rms,
    uncertainty,
)

_NO_LENS = Lens()
_LEAST_NOISE = 0.1  # [px], no corner is known better


class ViewSizeError(NoctuleError):
    """A picture of another size than the camera's."""


class NoPoseError(NoctuleError):
    """Corners that no pose of a camera explains."""


@dataclass(frozen=True, slots=True)
class BoardPlace:
    """Where a board lies: its origin, the lower left corner, and the heading of its x axis."""

    x: float = 0.0  # [m], world
    y: float = 0.0  # [m], world
    heading: float = 0.0  # [rad], counterclockwise from world x
    height: float = 0.0  # [m], of its face above the floor: its thickness

    def to_world(self, x_board: Array) -> Array:
        """Take points (n, 3) [m] on the board to the world."""
        return np.asarray(x_board @ rot_z(self.heading).T + np.array([self.x, self.y, self.height]))


@dataclass(frozen=True, slots=True)
class Extrinsics:
    """The pose found, and how well it is known."""

    camera: FixedCamera
    views: tuple[BoardView, ...]
    places: tuple[BoardPlace, ...]  # one for each view
    residuals: tuple[Array, ...]  # for each view (n, 2) [px], found minus predicted, lens taken out
    sd_angle: float  # [rad], of the rotation, its three axes together
    sd_position: Array  # (3,) [m], of the camera's place, world axes
    other_residual: float  # [px], of the second pose that a picture of a plane allows; inf when there is none

    @property
    def residual(self) -> float:
        """The rms length of all residuals [px]."""
        return float(np.sqrt((np.concatenate(self.residuals) ** 2).sum(axis=1).mean()))


def locate_camera(
    views: Sequence[BoardView],
    places: Sequence[BoardPlace],
    camera: PinholeCamera,
    lens: Lens = _NO_LENS,
    camera_sd: Array | None = None,
    floor: Plane | None = None,
) -> Extrinsics:
    """Find the pose of a camera that sees a board at known places; `extrinsics_faults` judges it.

    Least squares over all corners of all pictures, started from both poses that the largest view allows
    (IPPE).

    Parameters
    ----------
    views, places
        The board in each picture, and where it lay then.
    camera, lens
        The intrinsics.
    camera_sd
        Standard deviations (4,) [px] of fx, fy, cx, cy, which make the pose less certain.
    floor
        The plane z = 0 as the depth image shows it, in camera coordinates; taken into the fit with
        0.2 deg and 4 mm.

    Raises
    ------
    ViewSizeError
        When a picture is not of the camera's size.
    NoPoseError
        When no pose explains the corners.
    """
    for view in views:
        if view.size != (camera.width, camera.height):
            raise ViewSizeError(
                f"picture {view.name}: it is {view.size[0]}x{view.size[1]} px, the intrinsics are for "
                f"{camera.width}x{camera.height} px; take it with the camera as it was calibrated"
            )
    found = _fit(views, places, camera, lens, camera_sd, floor)
    kept = [without_strays(view, r) for view, r in zip(views, found.residuals, strict=True)]
    if all(len(a.p) == len(b.p) for a, b in zip(kept, views, strict=True)):
        return found
    return _fit(kept, places, camera, lens, camera_sd, floor)


def _fit(
    views: Sequence[BoardView],
    places: Sequence[BoardPlace],
    camera: PinholeCamera,
    lens: Lens,
    camera_sd: Array | None,
    floor: Plane | None,
) -> Extrinsics:
    straight = [lens.straighten(view.p, camera) for view in views]
    parts = [
        Corners(place.to_world(view.x_board), p)
        for view, place, p in zip(views, places, straight, strict=True)
    ]
    corners = Corners(np.concatenate([c.x for c in parts]), np.concatenate([c.p for c in parts]))
    largest = max(range(len(views)), key=lambda k: len(views[k].p))
    starts = _starts(views[largest], straight[largest], places[largest], camera)
    poses = [refine(pose, corners, camera, None, _LEAST_NOISE) for pose in starts]
    poses = [pose for pose in poses if is_possible(pose, corners)]
    if not poses:
        raise NoPoseError(
            f"picture {views[largest].name}: no pose of the camera explains its corners; are board and "
            "intrinsics those of this camera?"
        )
    poses.sort(key=lambda pose: rms(misfit(pose, corners, camera)))
    best = poses[0]
    others = [pose for pose in poses[1:] if not np.allclose(pose.R, best.R, atol=1e-3)]
    if floor is not None and others:  # depth knows which
        best = min(poses, key=lambda pose: Plane.through(pose.R, pose.t).angle_to(floor))
        others = []
    other_residual = rms(misfit(others[0], corners, camera)) if others else np.inf
    noise = max(rms(misfit(best, corners, camera)) / np.sqrt(2.0), _LEAST_NOISE)
    best = refine(best, corners, camera, floor, noise)
    sd_angle, sd_position = uncertainty(best, corners, camera, camera_sd, floor, noise)
    off = [misfit(best, part, camera) for part in parts]
    fixed = FixedCamera(camera, best.R.T, -best.R.T @ best.t)
    return Extrinsics(fixed, tuple(views), tuple(places), tuple(off), sd_angle, sd_position, other_residual)


def _starts(
    view: BoardView, straight: Array, place: BoardPlace, camera: PinholeCamera
) -> list[WorldInCamera]:
    _, rotations, translations, _ = cv2.solvePnPGeneric(
        view.x_board.reshape(-1, 1, 3), straight.reshape(-1, 1, 2), camera.K, None, flags=cv2.SOLVEPNP_IPPE
    )
    R_board_world = rot_z(place.heading).T
    origin = np.array([place.x, place.y, place.height])
    poses = []
    for r, t in zip(rotations, translations, strict=True):
        R = np.asarray(cv2.Rodrigues(r)[0], dtype=np.float64) @ R_board_world
        poses.append(WorldInCamera(R, np.asarray(t, dtype=np.float64).ravel() - R @ origin))
    return poses
