"""Where depth frames come from: a recording, a folder of images, the simulated room, a device.

A package adds a device by an entry point of the group `noctule.depth_sources`: a function without arguments
that returns a `noctule.devices.protocols.DepthCamera`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path

from noctule.camera import FixedCamera, PinholeCamera
from noctule.devices.protocols import DepthCamera
from noctule.errors import NoctuleError
from noctule.flight.depth_footage import read_depth_folder
from noctule.flight.depth_recording import read_depth_recording
from noctule.geometry import Pose
from noctule.messages import DepthFrame

ENTRY_POINT_GROUP = "noctule.depth_sources"
_PATIENCE = 2.0  # [s], for the next frame of a device


class UnknownDepthDeviceError(NoctuleError):
    """A depth camera that no installed package brings."""


@dataclass(frozen=True, slots=True)
class DepthSource:
    """A stream of depth frames; `frames` begins it anew each time, with a device at what it sees by then."""

    name: str  # for messages: "recording flight.mcap"
    frames: Callable[[], Iterator[DepthFrame]]
    count: int | None = None  # frames, where it is known
    camera: FixedCamera | None = None  # where the source knows it
    intrinsics: PinholeCamera | None = None  # where the source knows at least this
    truth: Mapping[float, Pose] = field(default_factory=dict)  # by stamp; for the judge only, in simulation
    start_yaw: float | None = None  # [rad], of the drone in the first frame, by eye; in simulation


def recording_source(path: Path) -> DepthSource:
    """Return the frames of a recording; raises RecordingFileError."""
    recording = read_depth_recording(path)
    intrinsics = None if recording.camera is None else recording.camera.intrinsics
    return DepthSource(f"recording {path}", recording.frames, recording.count, recording.camera, intrinsics)


def folder_source(folder: Path, scale: float = 1000.0) -> DepthSource:
    """Return the frames of a folder of images; raises DepthFolderError."""
    found = read_depth_folder(folder, scale)
    return DepthSource(f"folder {folder}", found.frames, found.count)


def device_source(name: str, seconds: float) -> DepthSource:
    """Return what a device sees for `seconds`; raises UnknownDepthDeviceError, its frames DeviceError."""
    found = {point.name: point for point in entry_points(group=ENTRY_POINT_GROUP)}
    if name not in found:
        known = f"expected one of: {', '.join(sorted(found))}" if found else "no installed package brings one"
        raise UnknownDepthDeviceError(
            f"depth camera {name!r} is not known; {known}; a package adds one as an entry point of the group "
            f"{ENTRY_POINT_GROUP!r}"
        )
    device: DepthCamera = found[name].load()()
    return DepthSource(f"device {name}", lambda: _watch(device, seconds), None, None, device.intrinsics)


def _watch(device: DepthCamera, seconds: float) -> Iterator[DepthFrame]:
    device.open()
    try:
        frame = device.read(_PATIENCE)
        begin = frame.stamp
        while frame.stamp - begin < seconds:
            yield frame
            frame = device.read(_PATIENCE)
    finally:
        device.close()
