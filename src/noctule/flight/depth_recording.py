"""Depth frames in MCAP files: written as they come at 30 Hz, read back as a stream, without loss.

Frames are as `depth_image` says. What localization made of each is on `/located`, and on `/pose` for viewers.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from foxglove.channels import PoseInFrameChannel
from foxglove.mcap import MCAPCompression
from foxglove.messages import Pose as DrawnPose
from foxglove.messages import PoseInFrame, Quaternion, Vector3
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage as CompressedImagePb
from mcap.reader import make_reader
from mcap.records import Channel, Message, Metadata

from noctule.camera import FixedCamera, PinholeCamera
from noctule.flight.depth_image import DepthChannels, decode_depth, drawn_at, pb
from noctule.flight.mcap_file import MAGIC, UNREADABLE, RecordingFileError, records_of
from noctule.flight.mcap_recorder import McapRecorder
from noctule.flight.recording_pictures import decode_picture
from noctule.messages import DepthFrame, PoseMeasurement

__all__ = ["FORMAT", "DepthRecorder", "DepthRecording", "pb", "read_depth_recording"]

FORMAT = "noctule-depth-1"


class DepthRecorder(McapRecorder):
    """Writes what a depth camera sees, and where the vehicle was seen; raises as `McapRecorder` does."""

    def __init__(
        self,
        path: Path,
        camera: FixedCamera | None = None,
        *,
        lossless_colour: bool = False,
        jpeg_quality: int = 90,
    ) -> None:
        super().__init__(path, FORMAT, MCAPCompression.Zstd)
        self._pose = PoseInFrameChannel("/pose", context=self._context)
        self._own: dict[str, foxglove.Channel] = {
            name: self._channel(getattr(pb, name)) for name in ("Exposure", "Located")
        }
        self._frames = DepthChannels(self._context, self._own["Exposure"], lossless_colour, jpeg_quality)
        if camera is not None:
            self.note("camera", _camera_note(camera))

    def frame(self, frame: DepthFrame) -> None:
        """Write one frame; its arrays must not change after they are handed in."""
        self._check()
        self._jobs.put(lambda: self._frames.log(frame, drawn_at(frame.stamp)[0]))
        self._flush_each_second(frame.stamp)

    def _send(self, name: str, message: Any, time_ns: int) -> None:
        self._own[name].log(message.SerializeToString(deterministic=True), log_time=time_ns)

    def located(
        self,
        stamp: float,
        measurement: PoseMeasurement | None,
        reason: str,
        score: float | None = None,
        frame_ms: float = math.nan,
    ) -> None:
        """Write what was made of the frame of this `stamp` [s]: a measurement, or the reason for none."""
        self._check()
        message = pb.Located(stamp=stamp, reason=reason, score=score, frame_ms=frame_ms)
        if measurement is not None:
            message.position.extend(float(v) for v in measurement.position)
            message.yaw, message.source = measurement.yaw, measurement.source
            message.covariance.extend(float(v) for v in measurement.covariance.ravel())
        self._jobs.put(lambda: self._log_located(message))
        self._flush_each_second(stamp)

    def _log_located(self, message: Any) -> None:
        time_ns, when = drawn_at(message.stamp)
        self._send("Located", message, time_ns)
        if message.position:
            x, y, z = message.position
            turned = Quaternion(x=0.0, y=0.0, z=math.sin(message.yaw / 2), w=math.cos(message.yaw / 2))
            pose = DrawnPose(position=Vector3(x=x, y=y, z=z), orientation=turned)
            drawn = PoseInFrame(timestamp=when, frame_id="world", pose=pose)
            self._pose.log(drawn, log_time=time_ns)


def _camera_note(camera: FixedCamera) -> dict[str, str]:
    k = camera.intrinsics
    return {
        "intrinsics": json.dumps([k.width, k.height, k.fx, k.fy, k.cx, k.cy]),
        "R_world_camera": json.dumps(np.asarray(camera.R_world_camera).tolist()),
        "t_world_camera": json.dumps(np.asarray(camera.t_world_camera).tolist()),
    }


def _noted_camera(note: dict[str, str]) -> FixedCamera:
    width, height, *rest = json.loads(note["intrinsics"])
    R, t = (
        np.array(json.loads(note[name]), dtype=np.float64) for name in ("R_world_camera", "t_world_camera")
    )
    return FixedCamera(PinholeCamera(int(width), int(height), *rest), R.reshape(3, 3), t.reshape(3))


@dataclass(frozen=True, slots=True)
class DepthRecording:
    """A recording of a depth camera; its frames are read from the disk one by one."""

    path: Path
    camera: FixedCamera | None  # None where the recorder was not told
    count: int | None  # frames; None where the recording was cut short
    complete: bool  # False: its end is missing

    def frames(self) -> Iterator[DepthFrame]:
        """Yield the frames, all whole ones before the cut of a file cut short; raises RecordingFileError."""
        parts: dict[str, Any] = {}
        for topic, data in _messages(self.path):
            if topic == "/depth":
                parts = {"depth": data}
            elif topic == "/colour":
                parts["colour"] = CompressedImagePb.FromString(data).data
            elif topic == "/exposure" and "depth" in parts:
                exposure = pb.Exposure.FromString(data)
                colour = decode_picture(parts["colour"]) if exposure.colour else None
                yield DepthFrame(exposure.stamp, decode_depth(parts["depth"], self.path), colour)
                parts = {}

    def located(self) -> Iterator[Any]:
        """Yield what was made of the frames, as pb.Located; raises RecordingFileError."""
        for topic, data in _messages(self.path):
            if topic == "/located":
                yield pb.Located.FromString(data)


def _messages(path: Path) -> Iterator[tuple[str, bytes]]:
    topics: dict[int, str] = {}
    for record in _records(path):
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message):
            yield topics.get(record.channel_id, ""), record.data


def _records(path: Path) -> Iterator[Any]:
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordingFileError(
                    f"recording {path}: this is no MCAP file; expected the .mcap file of a depth camera"
                )
            yield from records_of(file)
    except OSError as error:
        raise RecordingFileError(
            f"recording {path}: cannot be read ({error.strerror}); expected the .mcap file of a depth camera"
        ) from error


def read_depth_recording(path: Path) -> DepthRecording:
    """Open a recording of a depth camera; one that was cut short is read up to there (`complete` is False).

    Raises
    ------
    RecordingFileError
        When the file is missing, no MCAP file, or holds no whole depth frame.
    """
    camera: FixedCamera | None = None
    topics: dict[int, str] = {}
    for record in _records(path):
        if isinstance(record, Metadata) and record.name == "camera":
            try:
                camera = _noted_camera(dict(record.metadata))
            except (KeyError, ValueError, TypeError):
                raise RecordingFileError(
                    f"recording {path}: its camera cannot be read; was the file changed after it was "
                    "recorded?"
                ) from None
        elif isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message) and topics.get(record.channel_id) == "/exposure":
            break
    else:
        raise RecordingFileError(
            f"recording {path}: it holds no whole depth frame; expected the .mcap file of a depth camera, "
            "with /depth and /exposure"
        )
    count = _count(path)
    return DepthRecording(path, camera, count, count is not None)


def _count(path: Path) -> int | None:
    """Return the number of frames that the end of the file tells, None where it has none."""
    with path.open("rb") as file:
        file.seek(-len(MAGIC), io.SEEK_END)
        if file.read() != MAGIC:
            return None
        file.seek(0)
        try:
            summary = make_reader(file).get_summary()
        except UNREADABLE:
            return None
    if summary is None or summary.statistics is None:
        return None
    counts = summary.statistics.channel_message_counts
    return sum(counts.get(i, 0) for i, channel in summary.channels.items() if channel.topic == "/exposure")
