"""Figures of a calibration, and the board to print."""

from __future__ import annotations

import re
import struct
from dataclasses import replace

import cv2
import numpy as np
import pytest

from noctule.camera import CEILING_CAMERA, FixedCamera, PinholeCamera
from noctule.geometry import rot_x, rot_y
from noctule.localization.calibration.board import Board, BoardView, find_board
from noctule.localization.calibration.extrinsics import BoardPlace, Extrinsics
from noctule.localization.calibration.intrinsics import Intrinsics, LeftOut, UsedPicture
from noctule.localization.calibration.lens import Lens
from noctule.reports.board_sheet import BoardSheetError, write_board_sheet
from noctule.reports.calibration_figures import (
    extrinsics_figure,
    intrinsics_figure,
    write_extrinsics_figure,
    write_intrinsics_figure,
)

BOARD = Board()
CAMERA = PinholeCamera.centred(640, 480, 528.0)
GRID = np.array([[x, y, 0.0] for y in range(1, 5) for x in range(1, 7)]) * 0.1


def view(name, R, t, camera=CAMERA):
    return BoardView(name, (640, 480), camera.project(GRID @ R.T + t), GRID, 2.0)


@pytest.fixture
def found():
    used = []
    for k in range(5):
        R = rot_x(0.2 * k) @ rot_y(0.3 - 0.1 * k) @ np.diag([1.0, -1.0, -1.0])
        t = np.array([0.1 * k - 0.5, 0.2, 1.2])
        residuals = np.random.default_rng(k).normal(0.0, 0.05 + 0.02 * k, (24, 2))
        used.append(UsedPicture(view(f"{k}.png", R, t), residuals, R, t))
    return Intrinsics(CAMERA, Lens(), np.full(4, 0.3), tuple(used), (LeftOut("bad.png", "blurred"),))


@pytest.fixture
def placed():
    fixed = FixedCamera(CAMERA, CEILING_CAMERA.R_world_camera, CEILING_CAMERA.t_world_camera)
    places = (BoardPlace(), BoardPlace(-0.5, 0.3, 1.0))
    views = tuple(
        BoardView(f"{k}.png", (640, 480), fixed.project(place.to_world(GRID)), GRID, 2.0)
        for k, place in enumerate(places)
    )
    residuals = (np.full((24, 2), 0.1), np.full((24, 2), -0.2))
    return Extrinsics(fixed, views, places, residuals, 0.001, np.full(3, 0.002), np.inf)


def titles(figure):
    return [axis.get_title(loc="left") or axis.get_title() for axis in figure.axes]


def test_the_residuals_of_every_picture_are_drawn_and_ordered(found):
    figure = intrinsics_figure(found, BOARD, 0.5)
    picture, bars, *_ = figure.axes
    assert [label.get_text() for label in bars.get_yticklabels()] == [f"{k}.png" for k in range(5)]
    widths = [bar.get_width() for bar in bars.patches]
    assert widths == sorted(widths)
    assert widths[-1] == pytest.approx(found.used[4].residual)
    assert "5 pictures" in " ".join(titles(figure))
    assert "Each picture, 1 left out" in titles(figure)
    assert "times enlarged" in picture.get_xlabel()


def test_parts_of_the_picture_without_a_corner_are_shaded(found):
    figure = intrinsics_figure(found, BOARD, 0.5)
    bare = [patch for patch in figure.axes[0].patches if patch.get_alpha() == pytest.approx(0.12)]
    p = np.concatenate([one.view.p for one in found.used])
    parts = {(int((v + 0.5) // 80), int((u + 0.5) // 80)) for u, v in p}
    assert len(bare) == 48 - len(parts)


def test_arrows_are_never_longer_than_they_can_be_read(found):
    for scale in (0.01, 1.0, 300.0):
        used = tuple(replace(one, residuals=one.residuals * scale) for one in found.used)
        axis = intrinsics_figure(replace(found, used=used), BOARD, 0.5).axes[0]
        times = int(re.search(r"(\d+) times", axis.get_xlabel())[1])
        lengths = np.concatenate([np.hypot(*one.residuals.T) for one in used])
        assert times * np.percentile(lengths, 95) <= 22.0 or times == 1


def test_the_camera_hangs_where_it_is_drawn(placed):
    figure = extrinsics_figure(placed, BOARD)
    above = figure.axes[1]
    (words,) = [text for text in above.texts if "camera" in text.get_text()]
    assert words.get_text() == f"camera, {placed.camera.t_world_camera[2]:.3f} m up"
    assert words.xy == pytest.approx(tuple(placed.camera.t_world_camera[:2]))
    assert len(above.patches) >= 3  # the floor and two boards


def test_a_camera_that_sees_the_horizon_has_no_floor_drawn(placed):
    level = FixedCamera(
        CAMERA, np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([-2.0, 0.0, 1.0])
    )
    drawn = extrinsics_figure(replace(placed, camera=level), BOARD)
    assert len(drawn.axes[1].patches) < len(extrinsics_figure(placed, BOARD).axes[1].patches)


def test_figures_are_the_same_bytes_every_time(found, placed, tmp_path):
    for write, args in (
        (write_intrinsics_figure, (found, BOARD, 0.5)),
        (write_extrinsics_figure, (placed, BOARD)),
    ):
        first, second = (write(*args, tmp_path / name).read_bytes() for name in ("a.png", "b.png"))
        assert first == second
        assert cv2.imread(str(tmp_path / "a.png")).shape[1] == 1350


def test_the_png_sheet_is_the_board_at_its_true_size(tmp_path):
    board = Board(5, 4, 0.06, 0.045)
    file = write_board_sheet(board, tmp_path / "board.png")
    picture = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    data = file.read_bytes()
    at = data.index(b"pHYs") + 4
    per_metre, _, unit = struct.unpack(">IIB", data[at : at + 9])
    assert unit == 1
    found = find_board(board, picture, "board.png")
    assert len(found.p) == 12
    for axis in (0, 1):
        slope = np.polyfit(found.x_board[:, axis], found.p[:, axis], 1)[0]
        assert abs(slope) == pytest.approx(per_metre, rel=0.001)
    assert np.polyfit(found.x_board[:, 1], found.p[:, 1], 1)[0] < 0  # y up the page


@pytest.mark.parametrize(
    "board", [Board(), Board(8, 6, 0.03, 0.02, "5x5_50"), Board(6, 5, 0.05, 0.04, "6x6_250")]
)
def test_any_sheet_shows_the_board_that_is_looked_for(board, tmp_path):
    picture = cv2.imread(str(write_board_sheet(board, tmp_path / "board.png")), cv2.IMREAD_GRAYSCALE)
    small = cv2.resize(
        picture, (1000, round(1000 * picture.shape[0] / picture.shape[1])), interpolation=cv2.INTER_AREA
    )
    assert len(find_board(board, small, "a").p) == (board.columns - 1) * (board.rows - 1)


def test_the_pdf_sheet_has_the_size_of_the_board_and_its_margin(tmp_path):
    data = write_board_sheet(BOARD, tmp_path / "board.pdf").read_bytes()
    box = [float(x) for x in re.search(rb"MediaBox \[([^\]]*)\]", data)[1].split()]
    assert box[2:] == pytest.approx([0.78 / 0.0254 * 72, 0.58 / 0.0254 * 72], abs=0.01)
    assert write_board_sheet(BOARD, tmp_path / "again.pdf").read_bytes() == data


def test_a_sheet_of_another_kind_is_refused(tmp_path):
    with pytest.raises(BoardSheetError) as told:
        write_board_sheet(BOARD, tmp_path / "board")
    assert str(told.value) == f"board {tmp_path}/board: its name ends in nothing; expected .pdf or .png"
