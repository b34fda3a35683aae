"""A path that cannot be repeated is refused before take-off, by name and figure."""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from flight_walk import CAMERA, path_of, photographs

from noctule.camera import PinholeCamera
from noctule.flight.mission import load_mission
from noctule.flight.mission_flight import fly_mission
from noctule.flight.path_check import (
    Fault,
    PathCheckError,
    check_folder,
    check_path,
    link_fault,
    measure_path,
    require_seen,
    require_sound,
)
from noctule.flight.path_folder import PathCameraError, load_path
from noctule.vision.links import LinkQuality

GOOD = ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (1.0, 0.0, 0.0), (1.4, 0.1, 15.0))
LINK = LinkQuality(120, 18, 30.0, 0.9, 0.3, 0.2, 0.1, True)


def lines(folder, mission=None) -> list[str]:
    return [str(fault) for fault in check_folder(folder, mission)]


@pytest.fixture
def folder(tmp_path):
    return path_of(tmp_path / "walk", list(photographs(0, *GOOD)))


def test_a_good_path_has_no_fault_and_may_be_flown(folder):
    assert lines(folder, load_mission("two-columns")) == []
    path = load_path(folder)
    require_sound(path, "path")
    turn = [round(float(np.degrees(link.yaw))) for link in measure_path(path)]
    assert turn == [0, 0, 15]


def test_an_image_of_another_room_is_named_with_both_neighbours(tmp_path):
    pictures = list(photographs(0, *GOOD))
    (pictures[1],) = photographs(5, (2.0, 1.0, 100.0))
    found = lines(path_of(tmp_path / "walk", pictures))
    assert found == [
        f"images {a} and {b}: they share 0 points, at least 16 are needed to fly from one to the other; "
        "take a picture between them, in the same room"
        for a, b in (("000.png", "001.png"), ("001.png", "002.png"))
    ]


def test_an_image_from_the_same_place_of_a_room_of_the_same_walls_is_refused_too(tmp_path):
    # The rooms share their shell, so corners really agree: the few that do are not enough.
    pictures = list(photographs(0, *GOOD))
    (pictures[1],) = photographs(5, GOOD[1])
    found = check_folder(path_of(tmp_path / "walk", pictures))
    assert [fault.images for fault in found] == [("000.png", "001.png"), ("001.png", "002.png")]
    for fault in found:
        assert re.match(r"they share \d+ points, at least 16|no geometry, \d+ of \d+ features", fault.what)


def test_a_gap_is_told_by_how_far_the_camera_moved(tmp_path):
    pictures = photographs(0, (-0.6, 0.0, 0.0), (3.2, 0.0, 0.0), (3.6, 0.0, 0.0))
    (line,) = lines(path_of(tmp_path / "walk", list(pictures)))
    assert re.fullmatch(
        r"images 000\.png and 001\.png: gap, the camera moves (0\.[89]|1\.0)\d mean depths between them, "
        r"at most 0\.7 can be flown; take a picture between them",
        line,
    )


def test_a_gap_is_told_by_how_far_the_camera_turned(tmp_path):
    pictures = photographs(0, (0.0, 0.0, 0.0), (0.0, 0.0, 50.0))
    (line,) = lines(path_of(tmp_path / "walk", list(pictures)))
    assert line == (
        "images 000.png and 001.png: gap, the camera turns 50 deg between them, at most 40 can be flown; "
        "take a picture between them"
    )


def test_one_corrupted_picture_is_named_by_its_hash(folder):
    picture = folder / "002.png"
    data = bytearray(picture.read_bytes())
    before = load_path(folder)
    data[len(data) // 2] ^= 0x40
    picture.write_bytes(bytes(data))
    (line,) = lines(folder)
    assert re.fullmatch(
        rf"path {re.escape(str(folder))}: image 002\.png was changed after the path was taught: its sha256 "
        r"is [0-9a-f]{12}\.\.\., path\.toml says [0-9a-f]{12}\.\.\.; restore it or teach the path again",
        line,
    )
    assert len(before.images) == 4


def test_every_picture_that_is_wrong_has_a_line(folder):
    (folder / "000.png").unlink()
    (folder / "003.png").write_bytes(b"no picture")
    first, second = lines(folder)
    assert first == (
        f"path {folder}: image 000.png cannot be read (No such file or directory); restore it or teach "
        "the path again"
    )
    assert "image 003.png was changed" in second


def test_a_picture_of_another_camera_in_the_path_is_named(folder):
    text = (folder / "path.toml").read_text()
    head, *entries = text.split("[[images]]")
    entries[2] = entries[2].replace("510.0, 510.0", "400.0, 400.0")
    (folder / "path.toml").write_text("[[images]]".join([head, *entries]))
    expected = (
        f"path {folder}: image 002.png was taken by a camera with fx 400 px, the path's has 510; one "
        "path needs one camera: teach it again"
    )
    assert lines(folder) == [expected]
    with pytest.raises(PathCameraError) as caught:
        load_path(folder)
    assert str(caught.value) == expected


def test_a_path_of_another_camera_than_the_missions_is_refused(tmp_path):
    camera = PinholeCamera.centred(856, 480, 400.0)
    folder = path_of(tmp_path / "walk", list(photographs(0, *GOOD)), camera)
    assert lines(folder, load_mission("two-columns")) == [
        f"path {folder}: it was taken by a camera with fx 400 px, the mission's has 510; fly it with the "
        "camera that took it or teach the path again"
    ]


def test_a_picture_that_is_cut_off_is_one_line_though_its_hash_was_mended(folder, capfd):
    picture, text = (folder / "001.png").read_bytes(), (folder / "path.toml").read_text()
    cut = picture[: len(picture) // 2]
    (folder / "001.png").write_bytes(cut)
    old, new = (hashlib.sha256(data).hexdigest() for data in (picture, cut))
    (folder / "path.toml").write_text(text.replace(old, new))
    assert lines(folder) == [
        f"path {folder}: image 001.png is no picture that can be decoded; teach the path again"
    ]
    assert capfd.readouterr().err == ""


def test_what_is_seen_at_the_start_must_show_in_one_of_the_images(folder):
    path = load_path(folder)
    (seen,) = photographs(0, (0.9, 0.1, 5.0))
    require_seen(path, seen, "path walk")
    for pixels, told in (
        (np.zeros_like(seen), "000.png where 0 of 0 features that look alike agree on one scene"),
        (photographs(5, *GOOD)[0], r"00\d.png where \d+ of \d+ features that look alike agree on one scene"),
    ):
        with pytest.raises(PathCheckError) as caught:
            require_seen(path, pixels, "path walk")
        assert re.fullmatch(
            r"path walk: none of its 4 images shows what the camera sees at the start, nearest is "
            rf"{told}, at least 50% must; is it from this room\? start nearer to it or teach the path again",
            str(caught.value),
        )


def test_a_path_of_another_room_is_refused_before_anything_is_flown_or_recorded(folder, tmp_path):
    mission = load_mission("two-columns")
    path = mission.path.model_copy(update={"folder": folder, "poses": None})
    mission = mission.model_copy(update={"path": path})
    with pytest.raises(PathCheckError, match="none of its 4 images shows what the camera sees at the start"):
        fly_mission(mission, 5, tmp_path / "out", progress=False)
    assert not (tmp_path / "out" / "flight.mcap").exists()


def test_a_picture_of_another_size_is_named(folder):
    small = cv2.imread(str(folder / "001.png"))[:400]
    _, png = cv2.imencode(".png", small)
    old = hashlib.sha256((folder / "001.png").read_bytes()).hexdigest()
    (folder / "001.png").write_bytes(bytes(png))
    text = (folder / "path.toml").read_text()
    (folder / "path.toml").write_text(text.replace(old, hashlib.sha256(bytes(png)).hexdigest()))
    assert lines(folder) == [
        f"path {folder}: image 001.png is 856x400 px, its camera 856x480 px; teach the path again"
    ]


def test_a_folder_without_a_path_is_one_fault(tmp_path):
    assert lines(tmp_path) == [
        f"path {tmp_path}: the folder holds no path.toml; expected one that `noctule teach` made "
        "(a path in space is a .csv or .toml file, no folder)"
    ]


def test_a_weak_link_is_not_cached_as_if_it_were_good(tmp_path):
    pictures = [photographs(0, GOOD[0])[0], photographs(5, (2.0, 1.0, 100.0))[0]]
    folder = path_of(tmp_path / "walk", pictures)
    assert len(check_folder(folder)) == 1
    assert len(check_folder(folder)) == 1
    with pytest.raises(Exception, match=r"share 0 points \(.+\), at least 16"):
        load_path(folder)


def test_a_path_of_one_image_has_no_links_to_fail(tmp_path):
    folder = path_of(tmp_path / "one", list(photographs(0, GOOD[0])))
    assert check_path(load_path(folder)) == []


def changed(**values) -> str:
    return link_fault(replace(LINK, **values))


def test_a_sound_link_has_no_fault():
    assert link_fault(LINK) == ""


@pytest.mark.parametrize(
    ("values", "text"),
    [
        (
            {"shared": 15},
            "they share 15 points, at least 16 are needed to fly from one to the other; take a picture "
            "between them, in the same room",
        ),
        (
            {"share": 0.4},
            "no geometry, 40% of 120 shared points agree on one motion of a level camera, at least 50% must; "
            "are both from the same room, the camera level?",
        ),
        (
            {"cells": 4},
            "badly spread, their 120 shared points lie in 4 of 24 parts of the picture, at least 5 are "
            "needed; take a picture between them",
        ),
        (
            {"baseline": 0.83},
            "gap, the camera moves 0.83 mean depths between them, at most 0.7 can be flown; take a picture "
            "between them",
        ),
        (
            {"yaw": -0.9},
            "gap, the camera turns 52 deg between them, at most 40 can be flown; take a picture between them",
        ),
        (
            {"conditioned": False},
            "ill-conditioned, their 120 shared points moved by 30 px and do not tell which way the "
            "camera went; take the pictures where there is more to see",
        ),
    ],
)
def test_each_fault_of_a_link_says_what_was_found_and_what_is_needed(values, text):
    assert changed(**values) == text


def test_what_is_just_allowed_is_flown():
    assert changed(shared=16, cells=5, baseline=0.7, yaw=float(np.radians(39.9)), share=0.5) == ""


def test_all_faults_of_a_path_are_one_line_for_the_flight(tmp_path, monkeypatch):
    faults = [Fault(("000.png", "001.png"), "gap, x"), Fault((), "path p: y")]
    monkeypatch.setattr("noctule.flight.path_check.check_path", lambda path: faults)
    folder = path_of(tmp_path / "one", list(photographs(0, GOOD[0])), CAMERA)
    with pytest.raises(PathCheckError) as caught:
        require_sound(load_path(folder), f"path {folder}")
    assert str(caught.value) == f"path {folder}: images 000.png and 001.png: gap, x; path p: y"
