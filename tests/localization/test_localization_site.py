"""The folder of a calibrated camera: what is saved comes back, and what is wrong with it is one line."""

from __future__ import annotations

import errno
import os
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.camera import CEILING_CAMERA, FixedCamera, PinholeCamera
from noctule.errors import NoctuleError
from noctule.geometry import rot_x, rot_y, rot_z
from noctule.localization.calibration.lens import Lens
from noctule.localization.detection.band import SurfaceBand
from noctule.localization.detection.cubics import AreaCubics
from noctule.localization.detection.hu import HuPatterns
from noctule.localization.detector_file import Detectors, save_detectors
from noctule.localization.evidence import Grid
from noctule.localization.site import (
    SIMULATED,
    SiteCamera,
    load_background,
    load_camera,
    load_site,
    load_template,
    save_background,
    save_camera,
    save_template,
    straightened,
)
from noctule.localization.site_files import (
    SiteCameraError,
    SiteFileError,
    SiteFormatError,
    save_arrays,
    write_whole,
)
from noctule.localization.template import Template
from noctule.messages import DepthFrame
from noctule.vision.depth.background import Background

SMALL = FixedCamera(PinholeCamera.centred(16, 16, 20.0), np.eye(3), np.array([0.0, 0.0, 3.0]))
LEARN = "learn the empty room with `noctule calibrate background`"
CALIBRATE = "calibrate the camera with `noctule calibrate camera`"


def background() -> Background:
    rng = np.random.default_rng(1)
    return Background(
        rng.uniform(2000, 3000, (16, 16)).astype(np.float32),
        rng.uniform(1, 9, (16, 16)).astype(np.float32),
        rng.integers(0, 300, (16, 16), dtype=np.int32),
        rng.integers(0, 3000, (16, 16), dtype=np.uint16),
        300,
        4.0,
    )


def template() -> Template:
    rng = np.random.default_rng(2)
    probability, variance, height, weight = (
        rng.uniform(0.1, 0.9, (4, 10, 10)).astype(np.float32).astype(float)
    )
    arrays = {"probability": probability, "variance": variance, "height": height, "weight": weight}
    grid, frames = np.array([0.02, 0.01]), np.array([200.0])
    return Template.from_arrays({"grid": grid, "frames": frames, **arrays})


def same(a: object, b: object) -> bool:
    if is_dataclass(a):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return np.array_equal(a, b)


angle = st.floats(-3.0, 3.0)
metres = st.floats(-100.0, 100.0, allow_subnormal=False)


@given(a=angle, b=angle, c=angle, place=st.tuples(metres, metres, metres), k1=st.floats(-0.5, 0.5))
def test_a_camera_comes_back_to_the_last_bit(tmp_path_factory, a, b, c, place, k1):
    folder = tmp_path_factory.mktemp("site")
    fixed = FixedCamera(
        PinholeCamera(640, 480, 500.0 + a / 7, 501.1, 319.5 + b, 239.5), rot_z(a) @ rot_y(b) @ rot_x(c),
        np.array(place),
    )  # fmt: skip
    save_camera(folder, SiteCamera(fixed, Lens(k1, 0.1, -1e-4, 2e-17), np.array([0.001, -0.002, a / 100])))
    read = load_camera(folder)
    assert read.camera.intrinsics == fixed.intrinsics
    assert np.array_equal(read.camera.R_world_camera, fixed.R_world_camera)
    assert np.array_equal(read.camera.t_world_camera, fixed.t_world_camera)
    assert read.lens == Lens(k1, 0.1, -1e-4, 2e-17)
    assert np.array_equal(read.offset, [0.001, -0.002, a / 100])


def test_the_simulated_room_has_the_camera_of_table_2_without_lens_or_offset(tmp_path):
    assert SIMULATED.camera is CEILING_CAMERA
    save_camera(tmp_path, SIMULATED)
    read = load_camera(tmp_path)
    assert same(read.camera, CEILING_CAMERA)
    assert (read.lens, read.offset.tolist()) == (Lens(), [0.0, 0.0, 0.0])


def test_a_background_and_a_template_come_back_as_they_were(tmp_path):
    save_background(tmp_path, background(), SMALL)
    assert same(load_background(tmp_path, SMALL), background())
    save_template(tmp_path, template())
    assert same(load_template(tmp_path), template())
    assert load_template(tmp_path).grid == Grid(0.02, 10, 0.01)


OTHERS = [
    (replace(SMALL.intrinsics, fx=21.0), "fx 20 px, camera.toml says 21"),
    (replace(SMALL.intrinsics, cy=7.7), "cy 7.5 px, camera.toml says 7.7"),
    (replace(SMALL.intrinsics, width=32), "width 16 px, camera.toml says 32"),
]


@pytest.mark.parametrize(("intrinsics", "said"), OTHERS)
def test_the_background_of_another_camera_is_refused(tmp_path, intrinsics, said):
    save_background(tmp_path, background(), SMALL)
    with pytest.raises(SiteCameraError) as caught:
        load_background(tmp_path, replace(SMALL, intrinsics=intrinsics))
    assert str(caught.value) == (
        f"site file {tmp_path}/background.npz: it was made with a camera of {said}; {LEARN}, or put the "
        "camera back"
    )


def test_a_camera_that_was_calibrated_a_little_better_keeps_its_background(tmp_path):
    save_background(tmp_path, background(), SMALL)
    load_background(tmp_path, replace(SMALL, intrinsics=replace(SMALL.intrinsics, fx=20.09)))


def said(read, *arguments) -> str:
    with pytest.raises(NoctuleError) as caught:
        read(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_missing_file_says_which_command_makes_it(tmp_path):
    assert said(load_camera, tmp_path) == f"site file {tmp_path}/camera.toml: is missing; {CALIBRATE}"
    assert said(load_background, tmp_path, SMALL) == (
        f"site file {tmp_path}/background.npz: is missing; {LEARN}"
    )
    assert said(load_template, tmp_path) == (
        f"site file {tmp_path}/template.npz: is missing; learn the drone's top view with `noctule calibrate "
        "template`"
    )


def test_a_file_that_is_a_folder_cannot_be_read(tmp_path):
    (tmp_path / "camera.toml").mkdir()
    assert said(load_camera, tmp_path) == (
        f"site file {tmp_path}/camera.toml: cannot be read (Is a directory); {CALIBRATE}"
    )


CAMERA_MISTAKES = [
    ("fx = 527.77365", "fx = -3", "fx is -3, input should be greater than 0"),
    ("fx = 527", "fz = 527", "fx is missing"),
    ("width = 640", 'width = "wide"', "width is wide, input should be a valid integer"),
    ("format = 1", "format = 1\ncolour = 3", "unknown key colour"),
    ("offset = [0.0, 0.0, 0.0]", "offset = [0.0, 0.0]", "offset[2] is missing"),
    ("offset = [0.0, 0.0, 0.0]", "offset = [0.0, nan, 0.0]", "offset[1] is nan, input should be"),
    ("R_world_camera = [[-0.01", "R_world_camera = [[-0.51", "R_world_camera is no rotation, to 1e-6"),
    ("[camera]", "[camera", "this is not TOML"),
]


@pytest.mark.parametrize(("good", "bad", "what"), CAMERA_MISTAKES)
def test_every_mistake_in_camera_toml_is_one_line_that_names_the_key(tmp_path, good, bad, what):
    save_camera(tmp_path, SIMULATED)
    path = tmp_path / "camera.toml"
    text = path.read_text() + ("" if good in path.read_text() else "[camera]\n")
    assert good in text
    path.write_text(text.replace(good, bad, 1))
    line = said(load_camera, tmp_path)
    assert line.startswith(f"site file {path}: {what}")
    assert line.endswith(f"; {CALIBRATE}")


FAR_OFFSETS = [
    ([-9.9, 69.3, -0.000304], "-9.9, 69.3, -0.000304"),
    ([0.0, -1.3967813, 0.0], "0, -1.397, 0"),
    ([0.0, 0.0, 0.1501], "0, 0, 0.1501"),
]


@pytest.mark.parametrize(("offset", "found"), FAR_OFFSETS)
def test_an_offset_that_cannot_be_is_refused_except_by_who_measures_it_anew(tmp_path, offset, found):
    save_camera(tmp_path, replace(SIMULATED, offset=np.array(offset)))
    line = (
        f"site file {tmp_path}/camera.toml: offset is {found} m, expected 0.15 m or less along each axis; "
        "measure it again with `noctule calibrate offset`, or set it to [0.0, 0.0, 0.0]"
    )
    assert said(load_camera, tmp_path) == line
    assert said(load_site, tmp_path) == line
    assert load_camera(tmp_path, any_offset=True).offset.tolist() == offset
    # Let pass, it is the next file that is missing.
    assert "background.npz: is missing" in said(load_site, tmp_path, True)


@given(st.lists(st.floats(-0.15, 0.15), min_size=3, max_size=3))
def test_an_offset_that_can_be_comes_back_to_the_last_bit(tmp_path_factory, offset):
    folder = tmp_path_factory.mktemp("site")
    save_camera(folder, replace(SIMULATED, offset=np.array(offset)))
    assert load_camera(folder).offset.tolist() == offset


def test_another_format_is_named(tmp_path):
    save_camera(tmp_path, SIMULATED)
    path = tmp_path / "camera.toml"
    path.write_text(path.read_text().replace("format = 1", "format = 2"))
    with pytest.raises(SiteFormatError) as caught:
        load_camera(tmp_path)
    assert str(caught.value) == (
        f"site file {path}: found format 2, this version reads format 1; {CALIBRATE}"
    )
    path.write_text(path.read_text().replace("format = 2\n", ""))
    assert said(load_camera, tmp_path) == (
        f"site file {path}: found no format, this version reads format 1; {CALIBRATE}"
    )
    path.write_bytes(b"\xff\xfe")
    assert said(load_camera, tmp_path) == f"site file {path}: it is not UTF-8 text; {CALIBRATE}"


@given(st.data())
def test_a_background_cut_or_changed_anywhere_is_refused_or_the_same(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("site")
    save_background(folder, background(), SMALL)
    path = folder / "background.npz"
    whole = bytearray(path.read_bytes())
    at = data.draw(st.integers(0, len(whole) - 1))
    if data.draw(st.booleans()):
        whole = whole[:at]
    else:
        whole[at] ^= data.draw(st.integers(1, 255))
    path.write_bytes(whole)
    try:
        read = load_background(folder, SMALL)
    except (SiteFileError, SiteFormatError, SiteCameraError):
        return
    assert same(read, background())  # it was a byte that says nothing


def test_what_is_no_npz_file_is_named(tmp_path):
    path = tmp_path / "background.npz"
    for data in (b"", b"PK\x03\x04", b"not at all", np.arange(3).tobytes()):
        path.write_bytes(data)
        assert said(load_background, tmp_path, SMALL) == (
            f"site file {path}: it is damaged, or not the .npz file that Noctule wrote; {LEARN}"
        )


def test_arrays_of_objects_are_never_unpickled(tmp_path):
    path = tmp_path / "background.npz"
    np.savez(path, format=np.array(1), camera=np.array([Path("x")], dtype=object))
    assert "it is damaged, or not the .npz file that Noctule wrote" in said(load_background, tmp_path, SMALL)


NOTHING = "is 0, expected more than that where the room was seen"
ARRAY_MISTAKES = [
    ({"mean": np.zeros((4, 4), np.float32)}, "mean is 4x4 of float32, expected 16x16 of float32"),
    ({"nearest": np.zeros((16, 16))}, "nearest is 16x16 of float64, expected 16x16 of uint16"),
    ({"mean": np.full((16, 16), np.nan, np.float32)}, "mean holds values that are not finite"),
    ({"frames": np.array([300])}, "frames is 1 of int64, expected one value of int64"),
    ({"count": None}, "count is missing"),
    ({"count": np.zeros((16, 16), np.int32)}, f"count {NOTHING}"),
    ({"mean": np.zeros((16, 16), np.float32)}, f"mean {NOTHING}"),
    ({"deviation": np.zeros((16, 16), np.float32)}, f"deviation {NOTHING}"),
    ({"nearest": np.zeros((16, 16), np.uint16)}, f"nearest {NOTHING}"),
    ({"format": np.array(7)}, "found format 7, this version reads format 1"),
    ({"format": np.array("x")}, "found no format, this version reads format 1"),
]


@pytest.mark.parametrize(("changed", "what"), ARRAY_MISTAKES)
def test_every_wrong_array_is_one_line(tmp_path, changed, what):
    save_background(tmp_path, background(), SMALL)
    path = tmp_path / "background.npz"
    with np.load(path, allow_pickle=False) as file:
        arrays = {**{name: file[name] for name in file.files}, **changed}
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    assert said(load_background, tmp_path, SMALL) == f"site file {path}: {what}; {LEARN}"


def test_a_template_that_is_none_is_one_line(tmp_path):
    save_background(tmp_path, background(), SMALL)
    (tmp_path / "background.npz").rename(tmp_path / "template.npz")
    assert said(load_template, tmp_path) == (
        f"site file {tmp_path}/template.npz: not a template: grid, probability, variance, height, weight "
        "missing; learn the drone's top view with `noctule calibrate template`"
    )


EMPTY = {
    "probability": "its probability is not 0 to 1, with more than a half in some cells",
    "variance": "its variance is negative, or 0 in every cell",
    "weight": "its weight is negative, or 0 in every cell",
    "height": "its height is 0 in every cell of the drone",
}


WRONG = [(name, value) for name in EMPTY for value in (0.0, -1.0) if (name, value) != ("height", -1.0)]


@pytest.mark.parametrize(("name", "value"), WRONG)
def test_a_template_that_shows_no_drone_is_one_line(tmp_path, name, value):
    arrays = template().arrays()
    save_arrays(tmp_path / "template.npz", {**arrays, name: np.full_like(arrays[name], value)})
    assert said(load_template, tmp_path) == (
        f"site file {tmp_path}/template.npz: not a template: {EMPTY[name]}; learn the drone's top view with "
        "`noctule calibrate template`"
    )


def test_a_write_that_fails_leaves_the_file_as_it_was_and_nothing_beside_it(tmp_path, monkeypatch):
    save_camera(tmp_path, SIMULATED)
    before = (tmp_path / "camera.toml").read_bytes()

    def full(number: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(SiteFileError) as caught:
        save_camera(tmp_path, SiteCamera(SMALL))
    assert str(caught.value) == (
        f"site file {tmp_path}/camera.toml: cannot be written (No space left on device); free some space or "
        "choose another folder"
    )
    assert (tmp_path / "camera.toml").read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["camera.toml"]


def test_a_site_is_made_with_its_folder(tmp_path):
    write_whole(tmp_path / "sites" / "lab" / "camera.toml", b"x")
    assert (tmp_path / "sites" / "lab" / "camera.toml").read_bytes() == b"x"
    (tmp_path / "file").touch()
    assert "cannot be written (File exists)" in said(write_whole, tmp_path / "file" / "camera.toml", b"x")


def test_a_whole_site_is_loaded_at_once_and_the_first_file_that_is_missing_is_named(tmp_path):
    save_camera(tmp_path, SiteCamera(SMALL, Lens(0.1), np.array([0.0, 0.0, 0.03])))
    save_background(tmp_path, background(), SMALL)
    save_template(tmp_path, template())
    assert said(load_site, tmp_path) == (
        f"site file {tmp_path}/detector.toml: is missing; learn it with `noctule calibrate detector`"
    )
    cubics = AreaCubics(np.ones(4), np.zeros(4), 0.4, 1.9)
    hu = HuPatterns(np.ones((1, 7)), 1.0)
    save_detectors(tmp_path, Detectors(cubics, SurfaceBand(0.1, 0.2, 0.4, 1.9), hu), SMALL)
    site = load_site(tmp_path)
    assert site.camera.lens == Lens(0.1)
    assert site.detectors.band == SurfaceBand(0.1, 0.2, 0.4, 1.9)
    assert same(site.background, background())
    assert same(site.template, template())


def frame(depth: np.ndarray) -> DepthFrame:
    return DepthFrame(1.5, depth)


def test_frames_are_straightened_where_the_lens_bends():
    depth = np.arange(256, dtype=np.uint16).reshape(16, 16) + 1000
    seen = frame(depth)
    (same_frame,) = straightened([seen], SiteCamera(SMALL))
    assert same_frame is seen
    (straight,) = straightened([frame(depth)], SiteCamera(SMALL, Lens(-0.3)))
    assert straight.stamp == 1.5
    assert straight.depth.dtype == np.uint16
    assert not np.array_equal(straight.depth, depth)
    assert set(np.unique(straight.depth)) <= {0, *np.unique(depth)}  # readings, not means of them


@pytest.mark.parametrize(
    "depth", [np.ones((8, 16), np.uint16), np.ones((16, 16), np.float32), np.ones((16, 16, 3), np.uint16)]
)
def test_frames_of_no_such_camera_are_left_for_the_health_check_to_name(depth):
    seen = frame(depth)
    (left,) = straightened([seen], SiteCamera(SMALL, Lens(-0.3)))
    assert left is seen
