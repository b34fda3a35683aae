"""The board: what it may be, how it is drawn, and where its corners are found."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from localization_boards import BOARD, CAMERA, CAREFUL, held, photograph

from noctule.camera import PinholeCamera
from noctule.localization.calibration.board import (
    Board,
    BoardError,
    BoardView,
    NoBoardError,
    find_board,
    without_strays,
)
from noctule.localization.calibration.pictures import (
    PictureFileError,
    picture_files,
    read_depth,
    read_grey,
    read_greys,
)


def truth(view, R, t, camera=CAMERA):
    """Where the corners that were found really are, (n, 2) [px]."""
    return camera.project(view.x_board @ R.T + t)


def refusal(picture, board=BOARD):
    """Why a picture is refused."""
    with pytest.raises(NoBoardError) as told:
        find_board(board, picture, "a.png")
    return str(told.value)


@pytest.mark.parametrize("pose", CAREFUL[:6])
def test_corners_are_found_to_a_tenth_of_a_pixel_and_without_bias(pose):
    R, t = held(*pose)
    view = find_board(BOARD, photograph(R, t), "a.png")
    off = view.p - truth(view, R, t)
    assert len(view.p) >= 20
    assert np.median(np.hypot(*off.T)) < 0.1
    assert np.sqrt((off**2).mean()) < 0.15
    assert np.abs(off.mean(axis=0)).max() < 0.06
    assert (view.name, view.size) == ("a.png", (640, 480))


def test_the_frame_of_the_board_is_right_handed_and_its_origin_the_lower_left_corner():
    R, t = held(0, 0, 0, (320, 240), 1.0)
    view = find_board(BOARD, photograph(R, t), "a.png")
    first = int(np.argmin(view.x_board[:, 0] + view.x_board[:, 1]))
    np.testing.assert_allclose(view.x_board[first], [0.1, 0.1, 0.0], atol=1e-6)
    assert view.p[first, 0] < 320  # left
    assert view.p[first, 1] > 240  # below
    np.testing.assert_allclose(BOARD.outline[2], [0.7, 0.5, 0.0], atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_a_board_far_away_is_still_seen():
    # Squares of 16 px: a marker's cell is two pixels wide.
    R, t = held(10, 5, 20, (330, 250), 3.3)
    view = find_board(BOARD, photograph(R, t), "a.png")
    off = view.p - truth(view, R, t)
    assert len(view.p) == 24
    assert np.sqrt((off**2).mean()) < 0.2


def test_part_of_a_board_is_enough():
    R, t = held(20, 0, 0, (560, 240), 0.9)
    view = find_board(BOARD, photograph(R, t), "a.png")
    assert 8 <= len(view.p) < 24
    assert np.abs(view.p - truth(view, R, t)).max() < 0.5


@pytest.mark.parametrize(("blur", "width"), [(0.5, 1.9), (1.0, 2.9), (1.5, 3.9), (2.0, 4.8)])
def test_the_width_of_edges_grows_with_the_blur(blur, width):
    view = find_board(BOARD, photograph(*held(20, 15, 5, (320, 240), 0.9), blur=blur), "a.png")
    assert view.edge_width == pytest.approx(width, abs=0.3)


@pytest.mark.parametrize("along", ["x", "y"])
def test_a_picture_blurred_along_one_axis_is_as_wide_as_its_worse_edges(along):
    kernel = np.zeros((7, 7))
    kernel[3, :] = 1.0 / 7.0
    kernel = kernel if along == "x" else kernel.T
    view = find_board(BOARD, photograph(*held(20, 0, 0, (320, 240), 0.9), blur=kernel), "a.png")
    assert view.edge_width == pytest.approx(7.0, abs=0.8)


def test_the_width_of_edges_does_not_depend_on_the_light():
    picture = photograph(*held(20, 15, 5, (320, 240), 0.9))
    dim = (0.4 * picture + 20).astype(np.uint8)
    bright, dark = (find_board(BOARD, p, "a.png").edge_width for p in (picture, dim))
    assert dark == pytest.approx(bright, rel=0.1)


def test_without_a_board_it_says_so():
    empty = np.full((480, 640), 120, dtype=np.uint8)
    assert refusal(empty) == "no board is seen; is it sharp, lit, whole, and near enough?"


def test_a_board_of_another_family_of_markers_is_named():
    other = Board(dictionary="6x6_50")
    picture = photograph(*held(20, 15, 5, (320, 240), 0.9), board=other)
    assert refusal(picture) == (
        "its markers are of the dictionary 6x6_50, the board's are of 4x4_50; is it another board?"
    )


def test_a_board_of_another_shape_is_named():
    other = Board(5, 7)
    picture = photograph(*held(20, 15, 5, (320, 240), 1.1), board=other)
    said = refusal(picture)
    assert said.endswith("; is it another board?")
    assert "they do not lie as on a board of 7x5 squares" in said


def test_too_little_of_a_board_is_counted():
    picture = photograph(*held(0, 0, 0, (320, 240), 0.9))
    picture[:, 250:] = 120
    assert refusal(picture) == "only 4 corners of the board are seen, expected 8; show more of it"


def test_corners_in_one_row_are_refused(monkeypatch):
    wide = Board(12, 3, 0.06, 0.045)
    row = np.column_stack([np.arange(11.0) * 20, np.full(11, 50.0)]).astype(np.float32).reshape(-1, 1, 2)

    class OneRow:
        def detectBoard(self, picture):  # as OpenCV spells it
            return row, np.arange(11, dtype=np.int32), (), np.arange(12)

    monkeypatch.setattr("noctule.localization.calibration.board._detector", lambda charuco: OneRow())
    picture = np.zeros((480, 640), dtype=np.uint8)
    assert refusal(picture, wide) == "the 11 corners seen are all in one row; show more of the board"


@pytest.mark.parametrize(
    ("given", "line"),
    [
        (
            {"dictionary": "aruco"},
            "board: dictionary 'aruco' is unknown; expected one of 4x4_50, 4x4_250, 5x5_50, 5x5_250, 6x6_50, "
            "6x6_250",
        ),
        (
            {"columns": 2},
            "board: it has 2x5 squares; expected 3 to 50 along each side, and at least 8 corners inside",
        ),
        (
            {"columns": 3, "rows": 4},
            "board: it has 3x4 squares; expected 3 to 50 along each side, and at least 8 corners inside",
        ),
        ({"square": 100.0}, "board: its squares are 100 m; expected 0.005 to 1 m"),
        (
            {"marker": 0.1},
            "board: its markers are 0.1 m in squares of 0.1 m; expected 0.03 to 0.095 m, a white rim "
            "around each",
        ),
        (
            {"columns": 15, "rows": 10},
            "board: 15x10 squares hold 75 markers, the dictionary 4x4_50 has 50; take a larger one",
        ),
    ],
)
def test_a_board_that_cannot_be_is_refused(given, line):
    with pytest.raises(BoardError) as told:
        Board(**given)
    assert str(told.value) == line


@given(st.integers(4, 12), st.integers(4, 12))
@settings(max_examples=8, deadline=None)
def test_any_board_drawn_is_found_whole(columns, rows):
    board = Board(columns, rows, dictionary="4x4_250")
    drawn = cv2.copyMakeBorder(board.draw(60), 30, 30, 30, 30, cv2.BORDER_CONSTANT, value=255)
    view = find_board(board, drawn, "a.png")
    assert len(view.p) == (columns - 1) * (rows - 1)
    expected = np.column_stack([view.x_board[:, 0], board.size[1] - view.x_board[:, 1]]) * 600 + 29.5
    np.testing.assert_allclose(view.p, expected, atol=0.3)


def strays(lengths):
    view = BoardView("a", (640, 480), np.zeros((len(lengths), 2)), np.zeros((len(lengths), 3)), 2.0)
    kept = without_strays(view, np.column_stack([lengths, np.zeros(len(lengths))]))
    return len(view.p) - len(kept.p)


def test_a_corner_far_off_is_dropped_and_many_are_the_pictures_fault():
    assert strays([0.05] * 23 + [1.0]) == 1
    assert strays([0.05] * 23 + [0.3]) == 0  # near enough
    assert strays([0.3] * 23 + [1.4]) == 0  # no worse than its kind
    assert strays([0.05] * 15 + [1.0] * 4) == 0  # more than a tenth
    assert strays([0.05] * 7 + [1.0]) == 0  # eight are the fewest


def test_pictures_are_read_from_folders_in_the_order_of_their_names(tmp_path):
    for name in ("b.png", "a.jpg", "c.PNG"):
        cv2.imwrite(str(tmp_path / name), np.full((20, 30, 3), 100, dtype=np.uint8))
    (tmp_path / "notes.txt").write_text("no picture")
    cv2.imwrite(str(tmp_path / "d.png"), np.full((20, 30, 4), 100, dtype=np.uint8))
    read = list(read_greys(picture_files([tmp_path])))
    assert [name for name, _ in read] == ["a.jpg", "b.png", "c.PNG", "d.png"]
    assert {picture.shape for _, picture in read} == {(20, 30)}
    assert {picture.dtype for _, picture in read} == {np.dtype(np.uint8)}


def test_what_is_no_picture_is_named(tmp_path):
    def said(read, path):
        with pytest.raises(PictureFileError) as told:
            read(path)
        return str(told.value).replace(str(tmp_path), "here")

    kinds = ".png, .jpg, .jpeg, .bmp, .tif, .tiff"
    assert (
        said(lambda p: picture_files([p]), tmp_path) == f"folder here: it holds no picture; expected {kinds}"
    )
    assert said(read_grey, tmp_path / "a.png") == (
        f"picture here/a.png: cannot be read (No such file or directory); expected {kinds}"
    )
    for name, data in (("b.png", b"not a picture"), ("empty.png", b"")):
        (tmp_path / name).write_bytes(data)
        assert said(read_grey, tmp_path / name) == (
            f"picture here/{name}: this is no picture that can be read; expected {kinds}"
        )
    cv2.imwrite(str(tmp_path / "depth.png"), np.full((20, 30), 3000, dtype=np.uint16))
    assert said(read_grey, tmp_path / "depth.png") == (
        "picture here/depth.png: it has 16 bits a channel, as a depth image; expected a colour or grey "
        "picture of 8 bits"
    )
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((20, 30), 100, dtype=np.uint8))
    small = PinholeCamera.centred(30, 20, 20.0)
    assert said(lambda file: read_depth(file, small), tmp_path / "grey.png") == (
        "depth image here/grey.png: a pixel has 1 x 8 bits, expected one channel of 16 bits; save the depth "
        "itself, in millimetres, not a picture of it"
    )
    np.testing.assert_array_equal(read_depth(tmp_path / "depth.png", small), 3000)


@pytest.mark.parametrize(
    ("depth", "reason"),
    [
        (np.full((10, 15), 3000), "wrong resolution: found 15x10 px, expected 30x20 px; "),
        (np.full((20, 30), 3), "wrong unit: the usual depth is 3, expected 500 to 12000 [mm]; "),
        (np.zeros((20, 30)), "all zero: no pixel has a depth; "),
    ],
)
def test_a_depth_image_that_cannot_be_used_is_named(tmp_path, depth, reason):
    cv2.imwrite(str(tmp_path / "a.png"), depth.astype(np.uint16))
    with pytest.raises(PictureFileError) as told:
        read_depth(tmp_path / "a.png", PinholeCamera.centred(30, 20, 20.0))
    assert str(told.value).startswith(f"depth image {tmp_path}/a.png: {reason}")


def test_a_picture_that_was_cut_off_is_one_line_and_nothing_more(tmp_path, capfd):
    cv2.imwrite(str(tmp_path / "a.png"), np.random.default_rng(0).integers(0, 255, (40, 40), dtype=np.uint8))
    whole = (tmp_path / "a.png").read_bytes()
    (tmp_path / "a.png").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(PictureFileError, match="this is no picture that can be read"):
        read_grey(tmp_path / "a.png")
    assert capfd.readouterr().err == ""
