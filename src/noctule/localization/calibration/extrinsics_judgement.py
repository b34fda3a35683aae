"""Whether a camera's pose is good enough, and whether its depth agrees with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.camera import PinholeCamera
from noctule.errors import NoctuleError
from noctule.geometry import Array
from noctule.localization.calibration.board import Board
from noctule.localization.calibration.extrinsics import Extrinsics
from noctule.localization.calibration.floor import Plane, PlaneFit, fit_plane, inside_outline, near_plane

LARGEST_RESIDUAL = 1.0  # [px] rms
LARGEST_ANGLE_SD = math.radians(0.3)
LARGEST_POSITION_SD = 0.015  # [m]
_SECOND = 2.0  # the other pose of a plane must fit worse by this factor
_NEAR_FLOOR = 0.06  # [m], readings this near to the floor expected are taken for it
_SHRINK = 0.9  # of the board's outline, away from the paper's edge
_FEWEST_OF_FLOOR = 5000  # readings

BOARD_ANGLE, FLOOR_ANGLE = math.radians(3.0), math.radians(1.5)
DISTANCE_SHARE, DISTANCE_LEAST = 0.015, 0.02  # of the distance, and [m]


class PoorExtrinsicsError(NoctuleError):
    """A pose that is not good enough; one line for each fault."""


class DepthSizeError(NoctuleError):
    """A depth image of another size than the picture."""


@dataclass(frozen=True, slots=True)
class PlaneCheck:
    """A plane by depth against the same plane by the board's corners."""

    what: str  # "board" or "floor"
    name: str  # of the picture
    fit: PlaneFit
    distance: float  # [m], from the camera along the optical axis, by the corners
    farther: float  # [m], how much farther depth says it is
    angle: float  # [rad], between both planes


def check_depth(
    found: Extrinsics, board: Board, depths: Sequence[NDArray[np.uint16] | None]
) -> list[PlaneCheck]:
    """Compare the board's plane, and the floor's, with what the depth images [mm] show.

    `depths` holds one for each picture, registered to it and without distortion, or None. A plane that depth
    does not show (too few readings) is not in the list.

    Raises
    ------
    DepthSizeError
        When a depth image is not of the picture's size.
    """
    camera = found.camera.intrinsics
    checks = []
    for view, place, depth in zip(found.views, found.places, depths, strict=True):
        if depth is None:
            continue
        if depth.shape != (camera.height, camera.width):
            raise DepthSizeError(
                f"depth image of {view.name}: it is {depth.shape[1]}x{depth.shape[0]} px, the picture "
                f"{camera.width}x{camera.height} px; expected depth registered to the picture"
            )
        middle = board.outline.mean(axis=0)
        inner = place.to_world(middle + _SHRINK * (board.outline - middle))
        on_board = inside_outline(found.camera.project(inner), camera)
        at = camera.normalise(found.camera.project(place.to_world(middle[None])))
        floor = floor_plane(found)
        if (fit := fit_plane(depth, camera, on_board)) is None:
            continue
        checks.append(_compare("board", view.name, floor.lowered(-place.height), fit, at))
        expected = fit.plane.lowered(place.height)
        whole = fit_floor(depth, camera, expected)
        if whole is not None:
            checks.append(_compare("floor", view.name, floor, whole, at))
    return checks


def floor_plane(found: Extrinsics) -> Plane:
    """Return the plane z = 0 in camera coordinates."""
    R, t = found.camera.R_world_camera, found.camera.t_world_camera
    return Plane.through(R.T, -R.T @ t)


def fit_floor(depth: NDArray[np.uint16], camera: PinholeCamera, expected: Plane) -> PlaneFit | None:
    """Fit the floor to the readings near where it is expected; None where depth hardly shows it."""
    near = near_plane(depth, camera, expected, _NEAR_FLOOR)
    first = fit_plane(depth, camera, near, _FEWEST_OF_FLOOR)
    if first is None:
        return None
    # A little board knows its tilt badly: look again around the floor found.
    again = near_plane(depth, camera, first.plane, _NEAR_FLOOR)
    return fit_plane(depth, camera, again, _FEWEST_OF_FLOOR)


def _compare(what: str, name: str, plane: Plane, fit: PlaneFit, at: Array) -> PlaneCheck:
    distance = float(plane.depth_at(at)[0])
    return PlaneCheck(
        what, name, fit, distance, float(fit.plane.depth_at(at)[0]) - distance, plane.angle_to(fit.plane)
    )


def require_sound_pose(found: Extrinsics, checks: Sequence[PlaneCheck] = ()) -> Extrinsics:
    """Return the pose; raises PoorExtrinsicsError unless it is good enough and depth agrees with it."""
    faults = extrinsics_faults(found, checks)
    if faults:
        raise PoorExtrinsicsError("\n".join(faults))
    return found


def extrinsics_faults(found: Extrinsics, checks: Sequence[PlaneCheck] = ()) -> list[str]:
    """Return one line for each thing not good enough: what, how much, what was expected, what to do."""
    faults = []
    if found.residual > LARGEST_RESIDUAL:
        worst = max(range(len(found.views)), key=lambda k: float((found.residuals[k] ** 2).mean()))
        faults.append(
            f"extrinsics: the residual is {found.residual:.2f} px rms, expected {LARGEST_RESIDUAL:g} px or "
            f"less, worst in {found.views[worst].name}; is the board flat, and where you said that it lies?"
        )
    if found.other_residual < _SECOND * found.residual:
        faults.append(
            f"extrinsics: two poses fit the corners ({found.residual:.2f} and {found.other_residual:.2f} "
            "px); give the depth image with --depth, lay the board nearer, or use a larger one"
        )
    sd = float(np.linalg.norm(found.sd_position))
    if sd > LARGEST_POSITION_SD or found.sd_angle > LARGEST_ANGLE_SD:
        faults.append(
            f"extrinsics: the pose is known to {1000 * sd:.0f} mm and {math.degrees(found.sd_angle):.2f} deg "
            f"only (sd), expected {1000 * LARGEST_POSITION_SD:.0f} mm and "
            f"{math.degrees(LARGEST_ANGLE_SD):.2f} deg or less; lay the board at more places, or use a "
            "larger one"
        )
    return faults + [line for check in checks for line in _disagreement(check)]


def _disagreement(check: PlaneCheck) -> list[str]:
    lines = []
    limit = max(DISTANCE_SHARE * check.distance, DISTANCE_LEAST)
    if abs(check.farther) > limit:
        share = 1.0 + check.farther / check.distance
        lines.append(
            f"picture {check.name}: the {check.what} is {check.distance:.3f} m away by the board's corners, "
            f"{check.distance + check.farther:.3f} m by depth, expected to agree within {1000 * limit:.0f} "
            f"mm; are the board's squares as large as you said? by depth they are {share:.3f} times that"
        )
    allowed = BOARD_ANGLE if check.what == "board" else FLOOR_ANGLE
    if check.angle > allowed:
        lines.append(
            f"picture {check.name}: the {check.what} by depth is tilted by {math.degrees(check.angle):.1f} "
            f"deg against the board's corners, expected {math.degrees(allowed):g} deg or less; does the "
            "board lie flat on the floor, and is the depth image registered to the picture?"
        )
    return lines
