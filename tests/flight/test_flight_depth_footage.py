"""Folders of depth images: in order, in millimetres, with the colour that belongs to them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from noctule.flight.depth_footage import DepthFolderError, read_depth_folder


def depth(k: int) -> np.ndarray:
    return np.full((6, 8), 1000 + k, dtype=np.uint16)


def leave(folder: Path, names: list[str], kind: str = "depth") -> Path:
    """Leave one picture per name; its value tells which."""
    (folder / kind).mkdir(parents=True, exist_ok=True)
    for k, name in enumerate(names):
        shown = depth(k) if kind == "depth" else np.full((6, 8, 3), (10, 20, 30 + k), dtype=np.uint8)
        assert cv2.imwrite(str(folder / kind / name), shown)
    return folder


def seen(folder: Path, **options) -> list[tuple[float, int]]:
    return [(frame.stamp, int(frame.depth[0, 0])) for frame in read_depth_folder(folder, **options).frames()]


def test_names_with_a_decimal_point_are_seconds(tmp_path):
    leave(tmp_path, ["10.066667.png", "9.5.png", "10.033333.png"])
    assert seen(tmp_path) == [(9.5, 1001), (10.033333, 1002), (10.066667, 1000)]
    folder = read_depth_folder(tmp_path)
    assert (folder.count, next(folder.frames()).depth.dtype) == (3, np.uint16)


def test_long_whole_numbers_are_nanoseconds_and_short_ones_count_frames(tmp_path):
    leave(tmp_path / "a", ["1305031102160407000.png"])
    assert seen(tmp_path / "a") == [(pytest.approx(1305031102.160407), 1000)]
    leave(tmp_path / "b", ["000003.png", "000000.png", "frame-1.png"])
    assert seen(tmp_path / "b") == [(0.0, 1001), (1 / 30, 1002), (0.1, 1000)]


def test_a_listing_goes_before_names(tmp_path):
    leave(tmp_path, ["a.png", "b.png", "c.png"])
    (tmp_path / "depth.txt").write_text(
        "# depth maps\n# timestamp filename\n\n1.0 depth/c.png\n1.5 depth/a.png\n"
    )
    assert seen(tmp_path) == [(1.0, 1002), (1.5, 1000)]


def test_colour_goes_to_the_depth_that_was_taken_within_20_ms(tmp_path):
    leave(tmp_path, ["1.000.png", "1.033.png", "1.100.png"])
    leave(tmp_path, ["1.010.png", "1.040.png"], "rgb")
    colours = [frame.colour for frame in read_depth_folder(tmp_path).frames()]
    assert [None if c is None else c[0, 0].tolist() for c in colours] == [[30, 20, 10], [31, 20, 10], None]


@pytest.mark.parametrize("name", ["rgb", "colour", "color"])
def test_colour_may_have_either_name_and_a_listing(tmp_path, name):
    leave(tmp_path, ["1.0.png"])
    leave(tmp_path, ["x.png"], name)
    (tmp_path / f"{name}.txt").write_text(f"1.0 {name}/x.png\n")
    (frame,) = read_depth_folder(tmp_path).frames()
    assert frame.colour is not None


def test_counts_of_another_scale_become_millimetres(tmp_path):
    (tmp_path / "depth").mkdir()
    counts = np.array([[0, 5000, 12502, 65535]], dtype=np.uint16)
    cv2.imwrite(str(tmp_path / "depth" / "1.0.png"), counts)
    (frame,) = read_depth_folder(tmp_path, scale=5000.0).frames()
    assert frame.depth.tolist() == [[0, 1000, 2500, 13107]]
    assert frame.depth.dtype == np.uint16
    (frame,) = read_depth_folder(tmp_path, scale=100.0).frames()
    assert frame.depth.tolist() == [[0, 50000, 65535, 65535]]  # not around the corner


def test_pictures_that_are_no_depth_are_handed_on_for_the_health_check_to_name(tmp_path):
    leave(tmp_path, ["1.0.png"], "depth")
    cv2.imwrite(str(tmp_path / "depth" / "2.0.png"), np.zeros((6, 8), np.uint8))
    first, second = read_depth_folder(tmp_path, scale=5000.0).frames()
    assert (first.depth.dtype, second.depth.dtype) == (np.uint16, np.uint8)


def message(folder: Path, **options) -> str:
    with pytest.raises(DepthFolderError) as caught:
        list(read_depth_folder(folder, **options).frames())
    return str(caught.value)


def test_a_folder_without_depth_is_one_line(tmp_path):
    expected = "expected depth/*.png of 16 bits, or depth.txt with lines of stamp and file"
    assert message(tmp_path / "no") == f"folder {tmp_path}/no: there is no such folder; {expected}"
    assert message(tmp_path) == f"folder {tmp_path}: it holds no depth images; {expected}"
    assert message(tmp_path, scale=0.0) == (
        f"folder {tmp_path}: --scale is 0, expected 1 to 1000000 counts a metre"
    )


def test_names_that_are_no_stamps_are_one_line(tmp_path):
    leave(tmp_path, ["a.png"])
    assert message(tmp_path) == (
        f"picture {tmp_path}/depth/a.png: its name is no stamp; expected seconds as 12.345.png, or a number, "
        "or a listing depth.txt beside the folder"
    )


def test_two_pictures_of_one_moment_are_one_line(tmp_path):
    leave(tmp_path, ["1.0.png", "1.00.png"])
    assert "is stamped 1.000000 s, not after" in message(tmp_path)
    (tmp_path / "depth.txt").write_text("2.0 depth/1.0.png\n1.0 depth/1.00.png\n")
    assert message(tmp_path) == (
        f"{tmp_path}/depth.txt: 1.00.png is stamped 1.000000 s, not after 1.0.png (2.000000 s); put them in "
        "order"
    )


LINES = [
    ("x depth/1.0.png", "found 'x depth/1.0.png', expected a stamp in seconds and a file"),
    ("nan depth/1.0.png", "found 'nan depth/1.0.png', expected a stamp in seconds and a file"),
    ("1.0", "found '1.0', expected a stamp in seconds and a file"),
    ("1.0 no.png", "there is no file 'no.png'; restore it, or take the line out"),
]


@pytest.mark.parametrize(("line", "said"), LINES)
def test_every_mistake_in_a_listing_is_one_line_with_its_number(tmp_path, line, said):
    leave(tmp_path, ["1.0.png"])
    (tmp_path / "depth.txt").write_text(f"# stamp file\n{line}\n")
    assert message(tmp_path) == f"listing {tmp_path}/depth.txt, line 2: {said}"


def test_a_listing_that_is_no_text_is_one_line(tmp_path):
    (tmp_path / "depth.txt").write_bytes(b"\xff\xfe\x00")
    assert message(tmp_path) == f"listing {tmp_path}/depth.txt: it cannot be read; expected UTF-8 text"


def test_a_picture_that_was_cut_off_is_one_line_and_nothing_more(tmp_path, capfd):
    leave(tmp_path, ["1.0.png"])
    file = tmp_path / "depth" / "1.0.png"
    cv2.imwrite(str(file), np.random.default_rng(0).integers(0, 4000, (40, 40), dtype=np.uint16))
    file.write_bytes(file.read_bytes()[:1500])
    assert message(tmp_path) == f"picture {file}: it cannot be decoded; restore it, or remove it"
    assert capfd.readouterr().err == ""


def test_a_picture_that_cannot_be_decoded_is_one_line_when_its_turn_comes(tmp_path):
    leave(tmp_path, ["1.0.png", "2.0.png"])
    (tmp_path / "depth" / "2.0.png").write_bytes(b"")
    frames = read_depth_folder(tmp_path).frames()
    assert next(frames).stamp == 1.0
    with pytest.raises(DepthFolderError) as caught:
        next(frames)
    assert str(caught.value) == (
        f"picture {tmp_path}/depth/2.0.png: it cannot be decoded; restore it, or remove it"
    )
    folder = read_depth_folder(tmp_path)
    (tmp_path / "depth" / "1.0.png").unlink()
    with pytest.raises(DepthFolderError) as caught:
        next(folder.frames())
    assert str(caught.value) == (
        f"picture {tmp_path}/depth/1.0.png: cannot be read (No such file or directory); restore it, or take "
        "it out of the listing"
    )
