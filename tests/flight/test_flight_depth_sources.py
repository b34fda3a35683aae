"""Sources of depth frames: a recording, a folder, the simulated room, a device of another package."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import cv2
import numpy as np
import pytest

from noctule.camera import CEILING_CAMERA, PinholeCamera
from noctule.devices.protocols import DeviceError
from noctule.flight import depth_sources
from noctule.flight.depth_recording import DepthRecorder
from noctule.flight.depth_scene import Scene, passer_by, simulated_source
from noctule.flight.depth_sources import (
    UnknownDepthDeviceError,
    device_source,
    folder_source,
    recording_source,
)
from noctule.messages import DepthFrame

SMALL = PinholeCamera.centred(8, 6, 10.0)


class FakeDevice:
    """Ten frames a second, then silence."""

    intrinsics = SMALL
    opened = closed = 0

    def __init__(self, last: int = 100) -> None:
        self.number, self.last = 0, last

    def open(self) -> None:
        self.opened += 1

    def close(self) -> None:
        self.closed += 1

    def read(self, timeout: float) -> DepthFrame:
        if self.number == self.last:
            raise DeviceError("camera 'fake': no frame for 2 s")
        self.number += 1
        return DepthFrame(5.0 + self.number / 10.0, np.full((6, 8), 1000, np.uint16))


@pytest.fixture
def installed(monkeypatch):
    """Pretend that a package brings the device `fake`."""
    devices = []

    def make() -> FakeDevice:
        devices.append(FakeDevice())
        return devices[-1]

    class Point:
        name = "fake"

        def load(self):
            return make

    monkeypatch.setattr(depth_sources, "entry_points", lambda group: [Point()])
    return devices


def test_a_device_of_another_package_is_watched_for_so_many_seconds_and_closed(installed):
    source = device_source("fake", 1.0)
    (device,) = installed
    assert (source.name, source.count, source.camera, source.intrinsics) == ("device fake", None, None, SMALL)
    assert device.opened == 0  # until its frames are asked for
    assert [f.stamp for f in source.frames()] == pytest.approx([5.1 + k / 10 for k in range(10)])
    assert (device.opened, device.closed) == (1, 1)


def test_a_device_that_falls_silent_is_closed_and_says_so(installed):
    source = device_source("fake", 100.0)
    installed[0].last = 3
    with pytest.raises(DeviceError, match="no frame for 2 s"):
        list(source.frames())
    assert installed[0].closed == 1


def test_an_unknown_device_is_one_line(installed, monkeypatch):
    with pytest.raises(UnknownDepthDeviceError) as caught:
        device_source("kinect", 1.0)
    assert str(caught.value) == (
        "depth camera 'kinect' is not known; expected one of: fake; a package adds one as an entry point of "
        "the group 'noctule.depth_sources'"
    )
    monkeypatch.setattr(depth_sources, "entry_points", lambda group: [])
    with pytest.raises(UnknownDepthDeviceError, match="no installed package brings one"):
        device_source("kinect", 1.0)


def test_the_group_of_entry_points_is_what_packages_are_told(monkeypatch):
    asked = []
    monkeypatch.setattr(depth_sources, "entry_points", lambda group: asked.append(group) or [])
    with pytest.raises(UnknownDepthDeviceError):
        device_source("kinect", 1.0)
    assert asked == ["noctule.depth_sources"]
    assert EntryPoint("kinect", "a:b", asked[0]).group == depth_sources.ENTRY_POINT_GROUP


def test_a_recording_and_a_folder_give_the_same_frames(tmp_path):
    images = np.random.default_rng(2).integers(0, 9000, (4, 6, 8), dtype=np.uint16)
    (tmp_path / "depth").mkdir()
    with DepthRecorder(tmp_path / "a.mcap", CEILING_CAMERA) as recorder:
        for k, depth in enumerate(images):
            recorder.frame(DepthFrame(k / 4.0, depth))
            cv2.imwrite(str(tmp_path / "depth" / f"{k / 4.0:.2f}.png"), depth)
    recorded, filed = recording_source(tmp_path / "a.mcap"), folder_source(tmp_path)
    assert (recorded.count, filed.count) == (4, 4)
    assert recorded.intrinsics == CEILING_CAMERA.intrinsics
    assert filed.intrinsics is None
    for a, b in zip(recorded.frames(), filed.frames(), strict=True):
        assert a.stamp == b.stamp
        assert np.array_equal(a.depth, b.depth)
    assert (recorded.truth, filed.truth) == ({}, {})


def test_a_scene_is_the_same_each_time_and_another_one_for_another_seed():
    def first(seed: int) -> np.ndarray:
        return next(simulated_source(Scene("none", seed, seconds=0.1)).frames()).depth

    assert np.array_equal(first(1), first(1))
    assert not np.array_equal(first(1), first(2))


def test_calibrating_and_flying_share_the_room_but_not_the_errors_of_the_sensor():
    empty, path = (next(Scene(flight, 3, seconds=0.1).frames()).depth for flight in ("none", "path"))
    both = (empty > 0) & (path > 0)
    apart = np.abs(empty.astype(int) - path)[both]
    assert 0.3 < np.mean(apart > 0)
    assert np.median(apart) < 60  # [mm], two steps at three metres


def test_only_a_scene_with_a_flight_has_a_truth_and_it_is_of_every_frame():
    assert simulated_source(Scene("none", 0, seconds=1.0)).truth == {}
    for flight in ("manual", "path"):
        source = simulated_source(Scene(flight, 0, seconds=1.0))
        assert (source.count, len(source.truth)) == (30, 30)
        stamps = [stamp for stamp, _ in Scene(flight, 0, seconds=1.0).poses()]
        assert list(source.truth) == stamps


def test_the_path_is_the_papers_ellipse_flown_at_its_speed_heading_along_it():
    poses = [pose for _, pose in Scene("path", 0, seconds=20.0).poses()]
    x = np.array([pose.position for pose in poses])
    on_it = ((x[:, 0] - 0.08) / 0.5) ** 2 + ((x[:, 1] - 0.1) / 0.8) ** 2
    assert on_it == pytest.approx(np.ones(len(x)))
    steps = np.diff(x, axis=0)
    assert np.linalg.norm(steps, axis=1) * 30.0 == pytest.approx(np.full(len(steps), 0.3), rel=1e-3)
    heading = np.array([[np.cos(p.yaw), np.sin(p.yaw)] for p in poses[:-1]])
    flat = steps[:, :2] / np.linalg.norm(steps[:, :2], axis=1, keepdims=True)
    assert (heading * flat).sum(axis=1) == pytest.approx(np.ones(len(flat)), abs=1e-3)


def test_the_person_walks_past_at_60_cm():
    path = np.array([pose.position for _, pose in Scene("path", 0, seconds=14.0).poses()])
    walker = passer_by()
    least = min(
        np.linalg.norm(path[:, :2] - [at.x, at.y], axis=1).min()
        for at in map(walker.at, np.arange(0, 8, 0.02))
    )
    assert least == pytest.approx(0.6, abs=0.02)


def test_markers_bring_colour_and_nothing_else_does():
    (with_markers,) = Scene("path", 0, markers=True, seconds=0.04).frames()
    (without,) = Scene("path", 0, seconds=0.04).frames()
    assert with_markers.colour.shape == (480, 640, 3)
    assert without.colour is None
