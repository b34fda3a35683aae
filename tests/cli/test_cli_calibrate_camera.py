"""`noctule calibrate camera`: what a person types, and what comes of it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from noctule.camera import CEILING_CAMERA
from noctule.localization.calibration.board import Board
from noctule.localization.calibration.camera_files import load_intrinsics
from noctule.localization.site import load_camera

sys.path.append(str(Path(__file__).parents[1] / "localization"))
from localization_boards import CAMERA, CAREFUL, floor_depth, floor_picture, held, photograph

BOARD_OPTIONS = ("--square", "0.14", "--marker", "0.105")
LARGE = Board(square=0.14, marker=0.105)


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    """Pictures of a board held before the camera, and of one on the floor, with depth."""
    folder = tmp_path_factory.mktemp("taken")
    (folder / "pictures").mkdir()
    for k, pose in enumerate(CAREFUL):
        R, t = held(*pose[:4], 1.4 * pose[4], board=LARGE)
        cv2.imwrite(str(folder / f"pictures/{k:02}.png"), photograph(R, t, board=LARGE, seed=k))
    floor = floor_picture(CEILING_CAMERA, np.eye(3), [0.0, 0.0, 0.0], board=LARGE)
    cv2.imwrite(str(folder / "floor.png"), floor)
    cv2.imwrite(str(folder / "floor-depth.png"), floor_depth(CEILING_CAMERA, noise=0.012))
    return folder


@pytest.fixture
def calibrate(noctule, taken, tmp_path):
    """Run `noctule calibrate camera` beside the pictures."""
    for name in ("pictures", "floor.png", "floor-depth.png"):
        (tmp_path / name).symlink_to(taken / name)

    def call(*tokens):
        return noctule("calibrate", "camera", *tokens)

    return call


def test_pictures_become_a_site_with_its_figures(calibrate):
    said = calibrate(
        "pictures", *BOARD_OPTIONS, "--extrinsics", "floor.png", "--depth", "floor-depth.png", "--out", "site"
    )
    assert (said.code, said.err) == (0, "")
    lines = said.out.splitlines()
    assert lines[0].startswith("picture 00.png: ")
    assert lines[0].endswith(" deg")
    assert "residual: 0.0" in said.out
    assert "figure: site/intrinsics.png" in lines
    assert "intrinsics: site/intrinsics.toml; for noctule teach: site/teach-camera.toml" in lines
    assert lines[-1] == "camera: site/camera.toml"
    for name in ("intrinsics.png", "extrinsics.png"):
        assert cv2.imread(f"site/{name}") is not None
    known, site = load_intrinsics(Path("site")), load_camera(Path("site"))
    np.testing.assert_allclose(known.camera.focal, CAMERA.focal, rtol=0.002)
    assert site.camera.intrinsics == known.camera
    assert site.lens == known.lens
    np.testing.assert_allclose(site.camera.t_world_camera, CEILING_CAMERA.t_world_camera, atol=0.012)
    np.testing.assert_array_equal(site.offset, 0.0)


def test_the_camera_can_be_placed_later_and_told_to_programs(calibrate):
    first = calibrate("pictures", *BOARD_OPTIONS, "--out", "site", "--json").last_json["intrinsics"]
    assert (first["width"], first["height"]) == (640, 480)
    assert first["fx"] == pytest.approx(CAMERA.fx, rel=0.002)
    assert len(first["pictures"]) == len(CAREFUL)
    assert first["left_out"] == {}
    assert not Path("site/camera.toml").exists()
    said = calibrate(
        *BOARD_OPTIONS, "--extrinsics", "floor.png", "--depth", "floor-depth.png", "--at", "-1,0.5,90",
        "--out", "site", "--json",
    )  # fmt: skip
    assert (said.code, said.err) == (0, "")
    second = said.last_json["extrinsics"]
    # The world has moved with the board: a quarter turn, then the step.
    x, y, z = CEILING_CAMERA.t_world_camera
    assert second["position_m"] == pytest.approx([-1.0 - y, 0.5 + x, z], abs=0.012)
    assert [check["plane"] for check in second["depth"]] == ["board", "floor"]
    assert second["residual_px"] < 0.3
    assert second["figure"] == "site/extrinsics.png"


def test_a_poor_set_is_refused_and_its_figure_kept(calibrate, tmp_path):
    Path("frontal").mkdir()
    for k, pose in enumerate(CAREFUL):
        R, t = held(0, 0, *pose[2:4], 1.4 * pose[4], board=LARGE)
        cv2.imwrite(f"frontal/{k:02}.png", photograph(R, t, board=LARGE, seed=k))
    cv2.imwrite("frontal/empty.png", np.full((480, 640), 90, dtype=np.uint8))
    said = calibrate("frontal", *BOARD_OPTIONS, "--out", "site")
    assert said.code == 2
    lines = said.err.splitlines()
    assert lines[0].startswith("noctule: calibration: the ")
    assert any(
        "the boards were all seen at nearly the same angle; retake every other one" in s for s in lines
    )
    assert lines[-1] == (
        "picture empty.png: left out: no board is seen; is it sharp, lit, whole, and near enough?"
    )
    assert "figure: site/intrinsics.png" in said.out
    assert sorted(p.name for p in Path("site").iterdir()) == ["intrinsics.png"]
    told = calibrate("frontal", *BOARD_OPTIONS, "--out", "site", "--json")
    assert json.loads(told.out) == {"error": said.err.removeprefix("noctule: ").removesuffix("\n")}


def test_squares_of_another_size_than_said_are_refused(calibrate):
    calibrate("pictures", *BOARD_OPTIONS, "--out", "site")
    said = calibrate(
        "--square", "0.15", "--marker", "0.1125", "--extrinsics", "floor.png", "--depth", "floor-depth.png",
        "--out", "site",
    )  # fmt: skip
    assert said.code == 2
    assert "are the board's squares as large as you said? by depth they are 0.93" in said.err
    assert "figure: site/extrinsics.png" in said.out
    assert not Path("site/camera.toml").exists()


def test_a_board_to_print_needs_no_pictures(calibrate):
    said = calibrate("--print-board", "board.png", "--board", "5x4")
    assert (said.code, said.err) == (0, "")
    assert said.out == "board: board.png, 5x4 squares, 0.50 x 0.40 m; print it at 100 %\n"
    assert calibrate("--print-board", "board.pdf", "--json").last_json == {"board": "board.pdf"}
    assert Path("board.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("tokens", "line"),
    [
        (
            [],
            "calibrate camera: no picture is given; expected PICTURES of the board, or --extrinsics, or "
            "--print-board FILE",
        ),
        (["pictures"], "calibrate camera: --out is missing; expected the folder of the site"),
        (["--board", "7by5", "pictures"], "--board is '7by5', expected its squares, as 7x5"),
        (
            ["--board", "2x2", "pictures"],
            "board: it has 2x2 squares; expected 3 to 50 along each side, and at least 8 corners inside",
        ),
        (
            ["--extrinsics", "floor.png", "--at", "0,0", "--out", "site"],
            "--at is '0,0', expected x,y,heading [m, m, deg], as 0.5,-1,90",
        ),
        (
            ["--extrinsics", "floor.png", "--at", "0,0,0", "--at", "1,0,0", "--out", "site"],
            "calibrate camera: --at is given 2 times, --extrinsics has 1 pictures; expected one for each",
        ),
        (
            ["--extrinsics", "floor.png", "floor.png", "--depth", "floor-depth.png", "--out", "site"],
            "calibrate camera: --depth is given 1 times, --extrinsics has 2 pictures; expected one for each",
        ),
        (
            ["pictures", "--at", "0,0,0", "--out", "site"],
            "calibrate camera: --at is given 1 times, --extrinsics has 0 pictures; expected one for each",
        ),
        (
            ["--extrinsics", "floor.png", "--thickness", "3", "--out", "site"],
            "--thickness is 3, expected 0 to 0.5 m",
        ),
        (
            ["--extrinsics", "floor.png", "--out", "site"],
            "site file site/intrinsics.toml: is missing; find them with `noctule calibrate camera PICTURES`",
        ),
        (
            ["nowhere.png", "--out", "site"],
            "picture nowhere.png: cannot be read (No such file or directory); expected .png, .jpg, .jpeg, "
            ".bmp, .tif, .tiff",
        ),
        (
            ["--print-board", "board.svg"],
            "board board.svg: its name ends in '.svg'; expected .pdf or .png",
        ),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_mistake_is_one_line_and_exit_code_2(calibrate, tokens, line):
    said = calibrate(*tokens)
    assert said.err == f"noctule: {line}\n"
    assert said.out == ""
    assert said.code == 2


def test_a_floor_without_a_board_is_named(calibrate):
    calibrate("pictures", *BOARD_OPTIONS, "--out", "site")
    cv2.imwrite("bare.png", np.full((480, 640), 90, dtype=np.uint8))
    said = calibrate(*BOARD_OPTIONS, "--extrinsics", "bare.png", "--out", "site")
    assert said.err == (
        "noctule: picture bare.png: no board is seen; is it sharp, lit, whole, and near enough?\n"
    )
    assert said.code == 2


UNUSABLE = {
    "half": (np.s_[::2, ::2], 1, "wrong resolution: found 320x240 px, expected 640x480 px; "),
    "metres": (np.s_[:], 1000, "wrong unit: the usual depth is 3, expected 500 to 12000 [mm]; "),
    "zero": (np.s_[:], 60000, "all zero: no pixel has a depth; "),
}


@pytest.mark.parametrize("kind", UNUSABLE)
def test_a_depth_image_that_cannot_be_used_is_not_left_out_in_silence(calibrate, kind):
    calibrate("pictures", *BOARD_OPTIONS, "--out", "site")
    pixels, divisor, reason = UNUSABLE[kind]
    floor = cv2.imread("floor-depth.png", cv2.IMREAD_UNCHANGED)[pixels] // divisor
    cv2.imwrite("depth.png", floor)
    said = calibrate(*BOARD_OPTIONS, "--extrinsics", "floor.png", "--depth", "depth.png", "--out", "site")
    assert said.err.startswith(f"noctule: depth image depth.png: {reason}")
    assert (said.code, said.err.count("\n")) == (2, 1)
    assert not Path("site/camera.toml").exists()


def test_pictures_of_two_cameras_are_refused(calibrate):
    small = cv2.resize(cv2.imread("pictures/00.png"), None, fx=1.5, fy=1.5)
    cv2.imwrite("large.png", small)
    said = calibrate("pictures", "large.png", *BOARD_OPTIONS, "--out", "site")
    assert said.err == (
        "noctule: calibration: picture large.png is 960x720 px, most are 640x480 px; expected pictures of "
        "one camera at one size, not cropped\n"
    )


def test_help_says_what_every_option_is(calibrate):
    said = calibrate("--help")
    assert said.code == 0
    for option in ("--extrinsics", "--depth", "--at", "--thickness", "--square", "--print-board", "--json"):
        assert option in said.out
