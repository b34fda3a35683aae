"""`noctule calibrate camera`: finds, draws, judges and keeps intrinsics, and where the camera hangs."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from noctule.cli.options import out_folder
from noctule.cli.show import as_json
from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.localization.calibration.board import Board, BoardView
    from noctule.localization.calibration.camera_files import CameraIntrinsics
    from noctule.localization.calibration.extrinsics import BoardPlace, Extrinsics
    from noctule.localization.calibration.extrinsics_judgement import PlaneCheck
    from noctule.localization.calibration.intrinsics import Intrinsics


class CalibrateOptionsError(NoctuleError):
    """Options of `noctule calibrate camera` that cannot be read or do not go together."""


class BoardPictureError(NoctuleError):
    """A picture to place the camera by that does not show the board."""


@dataclass(frozen=True, slots=True)
class Asked:
    """What is to be calibrated from, as the options say."""

    pictures: tuple[Path, ...]
    out: Path | None
    extrinsics: tuple[Path, ...]
    depth: tuple[Path, ...]
    at: tuple[str, ...]
    thickness: float
    print_board: Path | None


def calibrate(asked: Asked, board: tuple[str, float, float, str], json: bool) -> int:
    """Do what is asked, and tell it; 0, or a NoctuleError with one line for each fault."""
    work = _Work(_board(*board), [], {}, json)
    if asked.print_board is not None:
        from noctule.reports.board_sheet import write_board_sheet

        work.told["board"] = write_board_sheet(work.board, asked.print_board)
        work.say(f"board: {asked.print_board}, {_size(work.board)}; print it at 100 %")
    if asked.pictures or asked.extrinsics:
        if asked.out is None:
            raise CalibrateOptionsError("calibrate camera: --out is missing; expected the folder of the site")
        places = _places(asked)
        folder = out_folder(asked.out, "site")
        known = _intrinsics(work, asked.pictures, folder) if asked.pictures else _load(folder)
        if asked.extrinsics:
            _extrinsics(work, known, asked, places, folder)
    elif asked.print_board is None:
        raise CalibrateOptionsError(
            "calibrate camera: no picture is given; expected PICTURES of the board, or --extrinsics, or "
            "--print-board FILE"
        )
    print(as_json(work.told) if json else "\n".join(work.lines))
    return 0


@dataclass(frozen=True, slots=True)
class _Work:
    """What is calibrated with, and what is to be told about it."""

    board: Board
    lines: list[str]
    told: dict[str, Any]
    json: bool

    def say(self, *lines: str) -> None:
        """Add lines to what is told at the end."""
        self.lines.extend(lines)

    def refused(self, error: NoctuleError) -> NoctuleError:
        """Tell the figures of what is refused, and return the error."""
        if not self.json:
            print("\n".join(self.lines))
        return error


def _board(squares: str, square: float, marker: float, dictionary: str) -> Board:
    from noctule.localization.calibration.board import Board

    found = re.fullmatch(r"([0-9]{1,3})x([0-9]{1,3})", squares)
    if found is None:
        raise CalibrateOptionsError(f"--board is {squares!r}, expected its squares, as 7x5")
    return Board(int(found[1]), int(found[2]), square, marker, dictionary)


def _size(board: Board) -> str:
    return f"{board.columns}x{board.rows} squares, {board.size[0]:.2f} x {board.size[1]:.2f} m"


def _places(asked: Asked) -> list[BoardPlace]:
    """Return where the board lay in each picture; raises CalibrateOptionsError."""
    from noctule.localization.calibration.extrinsics import BoardPlace

    count, thickness = len(asked.extrinsics), asked.thickness
    for name, given in (("--at", asked.at), ("--depth", asked.depth)):
        if given and len(given) != count:
            raise CalibrateOptionsError(
                f"calibrate camera: {name} is given {len(given)} times, --extrinsics has {count} "
                "pictures; expected one for each"
            )
    if not 0.0 <= thickness <= 0.5:
        raise CalibrateOptionsError(f"--thickness is {thickness:g}, expected 0 to 0.5 m")
    number = r"\s*([-+]?[0-9]*\.?[0-9]+)\s*"
    places = []
    for text in asked.at or ("0,0,0",) * count:
        found = re.fullmatch(",".join([number] * 3), text)
        if found is None:
            raise CalibrateOptionsError(f"--at is {text!r}, expected x,y,heading [m, m, deg], as 0.5,-1,90")
        places.append(BoardPlace(float(found[1]), float(found[2]), math.radians(float(found[3])), thickness))
    return places


def _intrinsics(work: _Work, pictures: Sequence[Path], folder: Path) -> CameraIntrinsics:
    """Find, draw, judge and keep the intrinsics."""
    from noctule.localization.calibration.board import NoBoardError, find_board
    from noctule.localization.calibration.camera_files import (
        INTRINSICS,
        TEACH_CAMERA,
        CameraIntrinsics,
        save_intrinsics,
    )
    from noctule.localization.calibration.intrinsics import LARGEST_RESIDUAL, LeftOut, calibrate_intrinsics
    from noctule.localization.calibration.judgement import PoorIntrinsicsError, require_sound
    from noctule.localization.calibration.pictures import picture_files, read_greys
    from noctule.reports.calibration_figures import write_intrinsics_figure

    views, missing = [], []
    for name, grey in read_greys(picture_files(pictures)):
        try:
            views.append(find_board(work.board, grey, name))
        except NoBoardError as error:
            missing.append(LeftOut(name, str(error)))
    found = calibrate_intrinsics(views, missing)
    figure = write_intrinsics_figure(found, work.board, LARGEST_RESIDUAL, folder / "intrinsics.png")
    _tell_intrinsics(work, found, figure)
    try:
        require_sound(found)
    except PoorIntrinsicsError as error:
        raise work.refused(error) from None
    known = CameraIntrinsics(found.camera, found.lens, found.sd)
    save_intrinsics(folder, known)
    work.say(f"intrinsics: {folder / INTRINSICS}; for noctule teach: {folder / TEACH_CAMERA}")
    return known


def _tell_intrinsics(work: _Work, found: Intrinsics, figure: Path) -> None:
    camera, lens = found.camera, found.lens
    for one in found.used:
        tilt = math.degrees(one.tilt)
        work.say(
            f"picture {one.view.name}: {len(one.view.p)} corners, residual {one.residual:.2f} px, tilted "
            f"{tilt:.0f} deg"
        )
    work.say(*map(str, found.left_out))
    names = ("fx", "fy", "cx", "cy")
    work.say(
        f"residual: {found.residual:.2f} px rms over {len(found.used)} pictures",
        ", ".join(
            f"{name} {getattr(camera, name):.2f} ± {sd:.2f}" for name, sd in zip(names, found.sd, strict=True)
        )
        + f" px, {camera.width}x{camera.height} px",
        f"lens: moves pixels by up to {lens.largest_shift(camera):.1f} px",
        f"figure: {figure}",
    )
    work.told["intrinsics"] = {
        "width": camera.width,
        "height": camera.height,
        **{name: getattr(camera, name) for name in names},
        "sd_px": [float(sd) for sd in found.sd],
        "lens": [float(k) for k in lens.coefficients],
        "largest_shift_px": lens.largest_shift(camera),
        "residual_px": found.residual,
        "pictures": {one.view.name: one.residual for one in found.used},
        "left_out": {one.name: one.reason for one in found.left_out},
        "figure": figure,
    }


def _load(folder: Path) -> CameraIntrinsics:
    from noctule.localization.calibration.camera_files import load_intrinsics

    return load_intrinsics(folder)


def _extrinsics(
    work: _Work, known: CameraIntrinsics, asked: Asked, places: Sequence[BoardPlace], folder: Path
) -> None:
    """Find, compare with depth, draw, judge and keep where the camera hangs."""
    from noctule.localization.calibration.extrinsics import locate_camera
    from noctule.localization.calibration.extrinsics_judgement import (
        PoorExtrinsicsError,
        check_depth,
        require_sound_pose,
    )
    from noctule.localization.calibration.lens import straightener
    from noctule.localization.calibration.pictures import read_depth
    from noctule.localization.site import SiteCamera, save_camera
    from noctule.reports.calibration_figures import write_extrinsics_figure

    views = [_view(work.board, picture) for picture in asked.extrinsics]
    found = locate_camera(views, places, known.camera, known.lens, known.sd)
    straight = straightener(known.camera, known.lens)
    depths = [straight.depth(read_depth(file, known.camera)) for file in asked.depth]
    checks = check_depth(found, work.board, depths or [None] * len(views))
    floors = [check.fit for check in checks if check.what == "floor"]
    if floors:
        floor = max(floors, key=lambda fit: fit.count).plane
        found = locate_camera(views, places, known.camera, known.lens, known.sd, floor)
    figure = write_extrinsics_figure(found, work.board, folder / "extrinsics.png")
    _tell_extrinsics(work, found, checks, figure)
    try:
        require_sound_pose(found, checks)
    except PoorExtrinsicsError as error:
        raise work.refused(error) from None
    save_camera(folder, SiteCamera(found.camera, known.lens))
    work.say(f"camera: {folder / 'camera.toml'}")


def _view(board: Board, picture: Path) -> BoardView:
    from noctule.localization.calibration.board import NoBoardError, find_board
    from noctule.localization.calibration.pictures import read_grey

    try:
        return find_board(board, read_grey(picture), picture.name)
    except NoBoardError as error:
        raise BoardPictureError(f"picture {picture}: {error}") from None


def _tell_extrinsics(work: _Work, found: Extrinsics, checks: Sequence[PlaneCheck], figure: Path) -> None:
    place, sd = found.camera.t_world_camera, found.sd_position
    for view in found.views:
        work.say(f"picture {view.name}: {len(view.p)} corners on the floor")
    for check in checks:
        work.say(
            f"picture {check.name}: {check.what} by depth {1000 * check.farther:+.0f} mm and "
            f"{math.degrees(check.angle):.2f} deg off the corners'"
        )
    if not checks:
        work.say("depth: none to compare with")
    tilt = math.degrees(math.acos(min(1.0, -float(found.camera.R_world_camera[2, 2]))))
    work.say(
        f"residual: {found.residual:.2f} px rms",
        f"camera at ({place[0]:.3f}, {place[1]:.3f}, {place[2]:.3f}) m ± "
        f"({1000 * sd[0]:.0f}, {1000 * sd[1]:.0f}, {1000 * sd[2]:.0f}) mm, {tilt:.1f} ± "
        f"{math.degrees(found.sd_angle):.2f} deg off the vertical",
        f"figure: {figure}",
    )
    work.told["extrinsics"] = {
        "position_m": [float(x) for x in place],
        "R_world_camera": [[float(x) for x in row] for row in found.camera.R_world_camera],
        "sd_position_m": [float(x) for x in sd],
        "sd_angle_deg": math.degrees(found.sd_angle),
        "residual_px": found.residual,
        "depth": [
            {
                "picture": check.name,
                "plane": check.what,
                "farther_m": check.farther,
                "angle_deg": math.degrees(check.angle),
            }
            for check in checks
        ],
        "figure": figure,
    }
