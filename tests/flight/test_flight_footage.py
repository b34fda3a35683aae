"""Footage: videos, cameras and recordings become frames, and what is wrong with them is one line."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest

from noctule.camera import PinholeCamera
from noctule.flight.footage import (
    CameraFileError,
    FootageError,
    device_frames,
    device_size,
    read_camera,
    recorded_camera,
    recorded_frames,
    video_frames,
    video_size,
)
from noctule.flight.mission import load_mission
from noctule.flight.reader import read_recording
from noctule.flight.recording import FlightRecorder, sent_message
from noctule.messages import Command, Decision, FlightState, Picture, VehicleState

CAMERA = PinholeCamera.centred(64, 48, 40.0)


def picture(value: int, width: int = 64, height: int = 48) -> np.ndarray:
    pixels = np.zeros((height, width, 3), dtype=np.uint8)
    pixels[..., 0] = value  # red in RGB
    return pixels


@pytest.fixture
def film(tmp_path):
    file = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"MJPG"), 20.0, (64, 48))
    for i in range(5):
        writer.write(cv2.cvtColor(picture(40 * i + 40), cv2.COLOR_RGB2BGR))
    writer.release()
    return file


def test_a_video_gives_its_frames_in_colour_and_in_time(film):
    frames = list(video_frames(film, CAMERA))
    assert [frame.stamp for frame in frames] == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.2])
    for i, frame in enumerate(frames):
        assert frame.pixels[..., 0].mean() == pytest.approx(40 * i + 40, abs=6)
        assert frame.pixels[..., 2].mean() < 10
    assert video_size(film) == (64, 48)


def test_a_video_of_another_size_than_its_camera_is_refused(film):
    with pytest.raises(FootageError) as caught:
        next(video_frames(film, PinholeCamera.centred(640, 480, 400.0)))
    assert str(caught.value) == (
        f"video {film}: its pictures are 64x48 px, the camera's 640x480 px; give the intrinsics of the "
        "camera that took it, at this size"
    )


def test_what_is_no_video_is_refused(tmp_path):
    file = tmp_path / "notes.txt"
    file.write_text("no video")
    for wrong in (file, tmp_path / "missing.mp4"):
        with pytest.raises(FootageError) as caught:
            video_size(wrong)
        assert str(caught.value) == (
            f"video {wrong}: cannot be opened; expected a video that OpenCV can decode"
        )


class FakeCapture:
    """A camera as OpenCV gives it."""

    def __init__(self, pictures=10, opened=True, rate=25.0) -> None:
        self.pictures, self.opened, self.rate, self.released = pictures, opened, rate, False

    def __call__(self, source):
        self.source = source
        return self

    def isOpened(self) -> bool:
        return self.opened

    def get(self, _property) -> float:
        return self.rate

    def read(self):
        if self.pictures == 0:
            return False, None
        self.pictures -= 1
        return True, cv2.cvtColor(picture(200), cv2.COLOR_RGB2BGR)

    def release(self) -> None:
        self.released = True


def test_a_camera_is_read_for_the_seconds_that_were_asked_for_and_released():
    fake, times = FakeCapture(100), iter(np.arange(100.0, 200.0, 0.125))
    frames = list(device_frames(2, CAMERA, 1.0, fake, lambda: float(next(times))))
    assert fake.source == 2
    assert fake.released
    assert [frame.stamp for frame in frames] == pytest.approx(np.arange(0.125, 0.95, 0.125))
    assert frames[0].pixels[0, 0].tolist() == [200, 0, 0]


def test_a_camera_that_is_not_there_or_stops_says_so():
    with pytest.raises(FootageError) as caught:
        device_size(7, FakeCapture(opened=False))
    assert str(caught.value) == (
        "camera 7: cannot be opened; is it connected, and does no other program use it?"
    )
    with pytest.raises(FootageError) as caught:
        device_size(7, FakeCapture(0))
    assert str(caught.value) == "camera 7: it holds no picture; expected at least two"
    times = iter(np.arange(0.0, 9.0, 0.5))
    with pytest.raises(FootageError) as caught:
        list(device_frames(0, CAMERA, 9.0, FakeCapture(3), lambda: float(next(times))))
    assert str(caught.value) == "camera 0: it stopped after 2.0 s; is it still connected?"


def test_a_video_without_a_frame_rate_is_refused(tmp_path):
    with pytest.raises(FootageError) as caught:
        next(video_frames(tmp_path / "a.mp4", CAMERA, FakeCapture(rate=0.0)))
    assert str(caught.value) == (
        f"video {tmp_path / 'a.mp4'}: its frame rate is 0, expected 0.5 to 1000; convert it"
    )


def recorded(tmp_path, stabilised: bool, pictures: int = 4):
    """Write a recording in which every second tick has a new picture, 0.1 s old."""
    mission = load_mission("two-columns")
    camera = mission.camera.model_copy(
        update={"width": 64, "height": 48, "focal": 40.0, "stabilised": stabilised}
    )
    file = tmp_path / "flight.mcap"
    with FlightRecorder(file, lossless=True) as recorder:
        given = mission.model_copy(update={"camera": camera})
        recorder.attach("mission.json", "application/json", given.model_dump_json().encode())
        for i in range(2 * pictures if pictures else 3):
            stamp = 5.0 + 0.1 * i
            state = VehicleState(stamp, FlightState.FLYING, roll=0.01 * i, pitch=-0.02 * i)
            seen = Picture(stamp - 0.1, picture(20 * i)) if i % 2 and pictures else None
            sent = sent_message(stamp, Command(), Command(), "flying", "pass", "")
            recorder.tick(stamp, state, seen, (), None, sent, Decision(Command(), "x"), 1.0)
    return read_recording(file)


def test_a_recording_gives_its_pictures_with_the_attitude_at_their_exposure(tmp_path):
    recording = recorded(tmp_path, stabilised=False)
    camera, mount = recorded_camera(recording)
    assert (camera, mount.stabilised) == (CAMERA, False)
    frames = list(recorded_frames(recording))
    assert [frame.stamp for frame in frames] == pytest.approx([0.0, 0.2, 0.4, 0.6])
    for k, frame in enumerate(frames):
        # Taken at tick 2 k, delivered at tick 2 k + 1.
        assert frame.attitude == pytest.approx((0.01 * 2 * k, -0.02 * 2 * k))
        assert frame.pixels[..., 0].max() == 20 * (2 * k + 1)


def test_pictures_of_a_gimbal_are_level(tmp_path):
    assert {frame.attitude for frame in recorded_frames(recorded(tmp_path, stabilised=True))} == {(0.0, 0.0)}


def test_a_recording_without_pictures_is_refused(tmp_path):
    recording = recorded(tmp_path, stabilised=True, pictures=0)
    with pytest.raises(FootageError) as caught:
        next(recorded_frames(recording))
    assert str(caught.value) == (f"recording {recording.path}: it holds no picture; expected at least two")


CAMERA_TOML = "width = 64\nheight = 48\nfx = 40.0\nfy = 41.0\ncx = 31.0\ncy = 24.0\n"


def test_a_camera_file_is_read(tmp_path):
    file = tmp_path / "camera.toml"
    file.write_text(CAMERA_TOML)
    camera = read_camera(file)
    assert camera.intrinsics == PinholeCamera(64, 48, 40.0, 41.0, 31.0, 24.0)
    assert camera.mount.stabilised is False
    file.write_text(CAMERA_TOML + "stabilised = true\nt_body_camera = [0.1, 0.0, 0.02]\n")
    assert read_camera(file).mount.stabilised is True
    assert read_camera(file).mount.t_body_camera.tolist() == [0.1, 0.0, 0.02]


def wrong_camera(file) -> str:
    with pytest.raises(CameraFileError) as caught:
        read_camera(file)
    return str(caught.value)


def test_a_camera_file_with_a_mistake_says_where(tmp_path):
    file = tmp_path / "camera.toml"
    assert wrong_camera(file) == (
        f"camera file {file}: cannot be read (No such file or directory); expected a .toml file with width, "
        "height, fx, fy, cx, cy"
    )
    file.write_text("width = ")
    text = wrong_camera(file)
    assert re.fullmatch(rf"camera file {re.escape(str(file))}: this is not TOML: .+; mend it there", text)
    file.write_text(CAMERA_TOML.replace("fx = 40.0", "fx = -4"))
    assert wrong_camera(file) == f"camera file {file}:3: fx is -4; expected above 0 to 100000 ([px])"
