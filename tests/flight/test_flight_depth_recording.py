"""Recordings of a depth camera: without loss, readable after any cut, named when damaged."""

from __future__ import annotations

import errno
import os
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from noctule.camera import CEILING_CAMERA
from noctule.flight import depth_image, depth_recording
from noctule.flight import mcap_recorder as recording_module
from noctule.flight.depth_recording import DepthRecorder, read_depth_recording
from noctule.flight.reader import RecordingFileError, whole_records
from noctule.flight.recording import RecordingError
from noctule.messages import DepthFrame, PoseMeasurement


def frames(n: int, shape: tuple[int, int] = (48, 64), colour: bool = False) -> list[DepthFrame]:
    """Noise, which is the hardest to compress, with stamps that are no whole nanoseconds."""
    rng = np.random.default_rng(5)
    depth = rng.integers(0, 65536, (n, *shape), dtype=np.uint16)
    pictures = rng.integers(0, 256, (n, *shape, 3), dtype=np.uint8) if colour else [None] * n
    return [DepthFrame(k / 30.0, depth[k], pictures[k]) for k in range(n)]


def write(path: Path, shown: list[DepthFrame], **options) -> Path:
    with DepthRecorder(path, CEILING_CAMERA, **options) as recorder:
        for frame in shown:
            recorder.frame(frame)
    return path


def test_what_is_read_is_what_was_written_bit_for_bit_with_the_exact_stamps(tmp_path):
    shown = frames(40)
    recording = read_depth_recording(write(tmp_path / "a.mcap", shown))
    assert (recording.count, recording.complete) == (40, True)
    read = list(recording.frames())
    assert [frame.stamp for frame in read] == [frame.stamp for frame in shown]
    for before, after in zip(shown, read, strict=True):
        assert after.depth.dtype == np.uint16
        assert np.array_equal(before.depth, after.depth)
        assert after.colour is None


def test_the_frames_can_be_read_again_and_again(tmp_path):
    recording = read_depth_recording(write(tmp_path / "a.mcap", frames(5)))
    assert [f.stamp for f in recording.frames()] == [f.stamp for f in recording.frames()]


def test_the_camera_is_recorded_to_the_last_bit(tmp_path):
    camera = read_depth_recording(write(tmp_path / "a.mcap", frames(1))).camera
    assert camera.intrinsics == CEILING_CAMERA.intrinsics
    assert np.array_equal(camera.R_world_camera, CEILING_CAMERA.R_world_camera)
    assert np.array_equal(camera.t_world_camera, CEILING_CAMERA.t_world_camera)
    with DepthRecorder(tmp_path / "b.mcap") as recorder:
        recorder.frame(frames(1)[0])
    assert read_depth_recording(tmp_path / "b.mcap").camera is None


def test_colour_is_lossless_when_it_is_asked_for_and_otherwise_close(tmp_path):
    shown = frames(3, colour=True)
    # Smooth, as pictures are; noise is not what JPEG is for.
    shown = [replace(f, colour=np.repeat(f.colour[:1, :1], 48, 0).repeat(64, 1)) for f in shown]
    read = list(read_depth_recording(write(tmp_path / "a.mcap", shown, lossless_colour=True)).frames())
    assert all(np.array_equal(a.colour, b.colour) for a, b in zip(shown, read, strict=True))
    read = list(read_depth_recording(write(tmp_path / "b.mcap", shown)).frames())
    assert all(np.abs(a.colour.astype(int) - b.colour).max() <= 8 for a, b in zip(shown, read, strict=True))


def test_frames_with_and_without_colour_may_follow_each_other(tmp_path):
    shown = frames(4, colour=True)
    shown[1] = replace(shown[1], colour=None)
    read = list(read_depth_recording(write(tmp_path / "a.mcap", shown)).frames())
    assert [f.colour is None for f in read] == [False, True, False, False]


def test_the_same_frames_give_the_same_file(tmp_path):
    a, b = (write(tmp_path / name, frames(8, colour=True)) for name in ("a.mcap", "b.mcap"))
    assert a.read_bytes() == b.read_bytes()


def test_viewers_find_depth_as_a_foxglove_image_of_16_bits(tmp_path):
    path = write(tmp_path / "a.mcap", frames(2))
    with path.open("rb") as file:
        reader = make_reader(file)
        schemas = {channel.topic: schema.name for schema, channel, _ in reader.iter_messages()}
    assert schemas == {"/depth": "foxglove.RawImage", "/exposure": "noctule.depth.Exposure"}


@pytest.fixture(scope="module")
def three_seconds(tmp_path_factory) -> bytes:
    return write(tmp_path_factory.mktemp("recorded") / "a.mcap", frames(90)).read_bytes()


@pytest.mark.parametrize("share", [0.36, 0.5, 0.71, 0.9, 0.98, 0.9999])
def test_a_file_cut_anywhere_gives_all_whole_frames_before_the_cut(share, three_seconds, tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(three_seconds[: int(share * len(three_seconds))])
    recording = read_depth_recording(path)
    read = list(recording.frames())
    assert (recording.complete, recording.count) == (False, None)
    assert max(30 * int(3 * share - 0.05), 30) <= len(read) <= 90
    assert all(np.array_equal(a.depth, b.depth) for a, b in zip(frames(90), read, strict=False))


def test_a_file_cut_within_its_first_second_says_that_it_holds_nothing(three_seconds, tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(three_seconds[: len(three_seconds) // 10])
    assert message(path).startswith(f"recording {path}: it holds no whole depth frame")


def test_a_killed_recorder_leaves_all_but_the_last_second(tmp_path):
    path = tmp_path / "a.mcap"
    recorder = DepthRecorder(path)
    for frame in frames(65, shape=(8, 8)):  # tiny: no chunk fills up, only flushing writes
        recorder.frame(frame)
    written = threading.Event()
    recorder._jobs.put(written.set)
    assert written.wait(10.0)
    data = path.read_bytes()
    recorder.close()
    path.write_bytes(data)
    recording = read_depth_recording(path)
    assert not recording.complete
    assert sum(1 for _ in recording.frames()) >= 31


def test_a_damaged_chunk_ends_what_can_be_read_and_nothing_before_it(three_seconds, tmp_path):
    data = bytearray(three_seconds)
    at = len(data) * 2 // 3
    data[at : at + 64] = bytes(64)
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    read = list(read_depth_recording(path).frames())
    assert 20 < len(read) < 90
    assert all(np.array_equal(a.depth, b.depth) for a, b in zip(frames(90), read, strict=False))


def test_a_full_disk_is_one_line_and_what_was_seen_can_be_read(tmp_path, monkeypatch):
    write_all = recording_module._AppendOnlyFile._write_all

    def full(self, data: memoryview) -> None:
        if self._size + len(data) > 200_000:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write_all(self, data)

    monkeypatch.setattr(recording_module._AppendOnlyFile, "_write_all", full)
    path = tmp_path / "a.mcap"
    with pytest.raises(RecordingError) as caught:
        write(path, frames(90))
    assert str(caught.value) == (
        f"recording {path}: No space left on device; what was flown until then can be read, free some space "
        "or name another folder with --out"
    )
    assert whole_records(path.read_bytes())[0] == path.stat().st_size
    assert sum(1 for _ in read_depth_recording(path).frames()) > 0


def test_where_the_drone_was_seen_is_recorded_with_its_covariance_and_the_reason_where_it_was_not(tmp_path):
    path = tmp_path / "a.mcap"
    covariance = np.arange(16.0).reshape(4, 4)
    measurement = PoseMeasurement(0.1, np.array([1.0, -2.0, 0.5]), -3.0, covariance, "registration")
    with DepthRecorder(path) as recorder:
        recorder.frame(frames(1)[0])
        recorder.located(0.1, measurement, "", 55.0, 0.4)
        recorder.located(0.2, None, "lost: too few readings", None, 0.2)
    seen, lost = read_depth_recording(path).located()
    assert (seen.stamp, list(seen.position), seen.yaw) == (0.1, [1.0, -2.0, 0.5], -3.0)
    assert (list(seen.covariance), seen.source) == (covariance.ravel().tolist(), "registration")
    assert (seen.reason, seen.score, seen.frame_ms) == ("", 55.0, 0.4)
    assert (list(lost.position), lost.HasField("yaw"), lost.HasField("score")) == ([], False, False)
    assert lost.reason == "lost: too few readings"


def message(path: Path) -> str:
    with pytest.raises(RecordingFileError) as caught:
        list(read_depth_recording(path).frames())
    return str(caught.value)


def test_a_file_that_is_missing_or_something_else_is_one_line(tmp_path):
    path = tmp_path / "a.mcap"
    assert message(path) == (
        f"recording {path}: cannot be read (No such file or directory); expected the .mcap file of a depth "
        "camera"
    )
    path.write_text("width = 640\n")
    assert message(path) == (
        f"recording {path}: this is no MCAP file; expected the .mcap file of a depth camera"
    )
    with DepthRecorder(path):
        pass
    assert message(path) == (
        f"recording {path}: it holds no whole depth frame; expected the .mcap file of a depth camera, with "
        "/depth and /exposure"
    )


def test_a_camera_or_a_frame_that_makes_no_sense_is_one_line(tmp_path, monkeypatch):
    path = tmp_path / "a.mcap"
    monkeypatch.setattr(depth_recording, "_camera_note", lambda camera: {"intrinsics": "[640]"})
    write(path, frames(1))
    assert message(path) == (
        f"recording {path}: its camera cannot be read; was the file changed after it was recorded?"
    )
    monkeypatch.undo()
    make = depth_image.RawImage
    monkeypatch.setattr(depth_image, "RawImage", lambda **v: make(**{**v, "encoding": "bayer_rggb8"}))
    assert message(write(path, frames(1))) == (
        f"recording {path}: its depth is encoded as 'bayer_rggb8', expected 16UC1 (millimetres)"
    )
    monkeypatch.setattr(depth_image, "RawImage", lambda **v: make(**{**v, "data": b"ab"}))
    assert message(write(path, frames(1))) == (
        f"recording {path}: a depth frame of 64x48 px holds 2 bytes; was the file changed after it was "
        "recorded?"
    )


def test_depth_in_metres_is_read_as_it_is_for_the_health_check_to_name(tmp_path, monkeypatch):
    make = depth_image.RawImage
    metres = np.full((48, 64), 2.5, dtype="<f4")
    monkeypatch.setattr(
        depth_image,
        "RawImage",
        lambda **v: make(**{**v, "encoding": "32FC1", "step": 256, "data": metres.tobytes()}),
    )
    (frame,) = read_depth_recording(write(tmp_path / "a.mcap", frames(1))).frames()
    assert np.array_equal(frame.depth, metres)
    assert frame.depth.dtype == np.float32
