"""A path is taught from pictures without poses, and what is taught can be repeated."""

from __future__ import annotations

import re
from itertools import pairwise

import cv2
import numpy as np
import pytest
from flight_walk import CAMERA, MOUNT, RATE, video, walk

from noctule.camera import CameraMount
from noctule.flight.footage import video_frames
from noctule.flight.mission import load_mission
from noctule.flight.path_check import check_folder, measure_path
from noctule.flight.path_folder import load_path, load_truth
from noctule.flight.teach_video import (
    PathExistsError,
    Taken,
    TeachInputError,
    frames_at,
    read_times,
    read_waypoints,
    teach_frames,
)
from noctule.vision.key_images import Frame


@pytest.fixture(scope="module")
def taught(tmp_path_factory):
    """A path of a video of three seconds."""
    folder = tmp_path_factory.mktemp("taught") / "walk"
    file = video(folder.with_suffix(".avi"))
    return folder, teach_frames(video_frames(file, CAMERA), CAMERA, MOUNT, folder)


def test_a_path_taught_from_a_video_passes_the_check_of_the_mission_that_flies_it(taught):
    folder, _ = taught
    assert check_folder(folder, load_mission("two-columns")) == []


def test_neighbours_of_a_path_from_a_video_are_well_linked(taught):
    links = measure_path(load_path(taught[0]))
    assert 2 <= len(links) <= 10
    for link in links:
        assert link.shared >= 40
        assert link.cells >= 8
        assert 0.02 < link.baseline < 0.35
    assert np.degrees(sum(link.yaw for link in links)) == pytest.approx(37.5, abs=4.0)


def test_the_first_and_last_frame_are_in_it_and_each_image_says_why(taught):
    _, taken = taught
    assert taken[0] == Taken(0.0, "first")
    assert taken[-1] == Taken(3.0, "last")
    assert all(a.stamp < b.stamp for a, b in pairwise(taken))


def test_nobody_knows_where_a_video_was_taken(taught):
    assert load_truth(taught[0]) is None


def test_teaching_twice_gives_the_same_pictures(taught, tmp_path):
    folder, taken = taught
    file = video(tmp_path / "walk.avi")
    assert teach_frames(video_frames(file, CAMERA), CAMERA, MOUNT, tmp_path / "more") == taken
    assert (tmp_path / "more" / "path.toml").read_text() == (folder / "path.toml").read_text()


def test_nothing_is_overwritten(taught, tmp_path):
    folder, _ = taught
    with pytest.raises(PathExistsError) as caught:
        teach_frames(walk(), CAMERA, MOUNT, folder)
    assert str(caught.value) == (
        f"path {folder}: this folder is not empty, and teaching overwrites nothing; choose another --out or "
        "remove it"
    )
    (tmp_path / "file").touch()
    with pytest.raises(PathExistsError) as caught:
        teach_frames(walk(), CAMERA, MOUNT, tmp_path / "file")
    assert str(caught.value) == (
        f"path {tmp_path / 'file'}: this is a file, expected a new folder; choose another --out"
    )


def grey(stamp: float, value: int = 0) -> Frame:
    return Frame(stamp, np.full((48, 64, 3), value, dtype=np.uint8))


def test_a_person_says_where_the_key_images_are(tmp_path):
    taken = teach_frames(walk(), CAMERA, MOUNT, tmp_path / "at", at=(0.0, 1.4, 3.0))
    assert [one.stamp for one in taken] == [0.0, 11.0 / RATE, 3.0]
    assert taken[1].reason == "asked for at 1.4 s"
    pixels = load_path(tmp_path / "at").images[1].pixels
    np.testing.assert_array_equal(pixels, walk()[11].pixels)


def test_of_two_frames_the_nearer_one_is_taken():
    frames = [grey(0.0), grey(0.5), grey(1.0)]
    found = [(key.index, key.reason) for key in frames_at(frames, (0.2, 0.7, 0.8), lambda i, t: None)]
    assert found == [(0, "asked for at 0.2 s"), (1, "asked for at 0.7 s"), (2, "asked for at 0.8 s")]


@pytest.mark.parametrize(
    ("frames", "end"),
    [([grey(0.0), grey(0.5)], "the last frame is at 0.50 s"), ([], "there are no frames")],
)
def test_a_time_after_the_end_is_refused(frames, end):
    with pytest.raises(TeachInputError) as caught:
        list(frames_at(frames, (0.0, 2.0), lambda i, t: None))
    time = "2" if frames else "0"
    assert str(caught.value) == f"--at asks for {time} s, {end}; give times within the footage"


def test_one_frame_is_no_path(tmp_path):
    with pytest.raises(TeachInputError) as caught:
        teach_frames(walk()[:1], CAMERA, MOUNT, tmp_path / "one")
    assert str(caught.value) == (
        "teaching: the footage gives 1 key images, at least 2 are needed; move the camera along the path"
    )
    assert not (tmp_path / "one").exists()


def test_times_are_read():
    assert read_times("0,1.5, 3.2") == (0.0, 1.5, 3.2)


@pytest.mark.parametrize("text", ["", "1", "0,x", "2,1", "1,1", "-1,2", "0,inf", "0,nan", "0;1"])
def test_times_that_make_no_path_are_refused(text):
    with pytest.raises(TeachInputError) as caught:
        read_times(text)
    assert str(caught.value) == (
        f"--at is {text!r}, expected two or more rising times in seconds, as 0,1.5,3.2"
    )


def test_waypoints_replace_the_path_of_a_mission(tmp_path):
    file = tmp_path / "way.toml"
    file.write_text("poses = [[0.5, 0.0, 1.0, 0.0], [1.0, 0.1, 1.0, 10.0]]\n")
    mission = read_waypoints(file, load_mission("two-columns"))
    assert mission.path.poses == ((0.5, 0.0, 1.0, 0.0), (1.0, 0.1, 1.0, 10.0))
    assert mission.name == "two-columns"


def wrong_waypoints(file) -> str:
    with pytest.raises(TeachInputError) as caught:
        read_waypoints(file, load_mission("two-columns"))
    return str(caught.value)


def test_waypoints_with_a_mistake_say_where(tmp_path):
    file = tmp_path / "way.toml"
    assert wrong_waypoints(file) == (
        f"waypoints {file}: cannot be read (No such file or directory); expected a .toml file with "
        "poses = [[x, y, z, heading], ...]"
    )
    file.write_text("poses = [[1, 2]\n")
    assert re.fullmatch(
        rf"waypoints {re.escape(str(file))}: this is not TOML: .+; mend it there", wrong_waypoints(file)
    )
    file.write_text("poses = [[1.0, 2.0, 3.0]]\n")
    assert wrong_waypoints(file) == (
        f"waypoints {file}:1: poses[0] is [1.0, 2.0, 3.0]; expected a list of at least 4 "
        "(x, y, z [m] and heading [deg] of each key image)"
    )


def test_a_camera_off_its_gimbal_keeps_what_was_reported(tmp_path):
    frames = [Frame(f.stamp, f.pixels, (0.01, -0.02)) for f in walk()[::6]]
    mount = CameraMount(stabilised=False)
    teach_frames(frames, CAMERA, mount, tmp_path / "tilted", at=(0.0, 1.5))
    path = load_path(tmp_path / "tilted")
    assert path.mount.stabilised is False
    assert (path.images[1].roll, path.images[1].pitch) == pytest.approx((0.01, -0.02))


def test_the_helper_writes_a_video_that_opencv_reads(tmp_path):
    capture = cv2.VideoCapture(str(video(tmp_path / "a.avi")))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == len(walk())
