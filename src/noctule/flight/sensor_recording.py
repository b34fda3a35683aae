"""Recordings of sensors side by side: depth or what was made of it, markers, reports, the truth.

A recording of a depth camera with `/observation` and `/truth` as flights have them, and `/heading`. All of
one clock, which is what a flight recorded here and depth recorded there do not have.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from mcap.records import Channel, Message

from noctule.camera import FixedCamera
from noctule.flight import codec
from noctule.flight.depth_recording import DepthRecorder, pb
from noctule.flight.reader import MAGIC, RecordingFileError, records_of
from noctule.messages import HeadingMeasurement, PoseMeasurement, Truth, VehicleState


class SensorRecorder(DepthRecorder):
    """Writes what several sensors measured; raises as `McapRecorder` does."""

    def __init__(self, path: Path, camera: FixedCamera | None = None) -> None:
        super().__init__(path, camera)
        heading = foxglove.Schema(
            name=pb.Located.DESCRIPTOR.full_name,
            encoding="protobuf",
            data=codec.file_schema(pb.Located.DESCRIPTOR.file),
        )
        self._own["Heading"] = foxglove.Channel(
            "/heading", schema=heading, message_encoding="protobuf", context=self._context
        )
        for name in ("Observation", "Truth"):
            self._own[name] = self._channel(getattr(codec.pb, name))

    def state(self, state: VehicleState) -> None:
        """Write a report of the vehicle."""
        self._put("Observation", state.stamp, codec.encode_observation(state.stamp, state, None, ()))

    def heading(self, heading: HeadingMeasurement) -> None:
        """Write a heading that was measured by itself."""
        message = pb.Located(
            stamp=heading.stamp, yaw=heading.yaw, source=heading.source, covariance=[heading.variance]
        )
        self._put("Heading", heading.stamp, message)

    def truth(self, truth: Truth) -> None:
        """Write the truth."""
        self._put("Truth", truth.stamp, codec.encode_truth(truth))

    def _put(self, name: str, stamp: float, message: Any) -> None:
        self._check()
        self._jobs.put(lambda: self._send(name, message, max(round(stamp * 1e9), 0)))
        self._flush_each_second(stamp)


@dataclass(frozen=True, slots=True)
class SensorLog:
    """What sensors measured, each by the stamps of its own, ascending, none twice."""

    path: Path
    states: tuple[VehicleState, ...]
    poses: tuple[PoseMeasurement, ...]
    headings: tuple[HeadingMeasurement, ...]
    truth: tuple[Truth, ...]
    frames: int  # depth frames, which are read by `read_depth_recording`


def read_sensor_log(path: Path) -> SensorLog:
    """Read a recording of sensors, or of a flight; one that was cut short up to there.

    Raises
    ------
    RecordingFileError
        When the file is missing or no recording.
    """
    found: dict[str, dict[float, Any]] = {
        name: {} for name in ("/observation", "/located", "/heading", "/truth")
    }
    topics: dict[int, str] = {}
    frames = 0
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordingFileError(
                    f"recording {path}: this is no MCAP file; expected the .mcap file of sensors or of a "
                    "flight"
                )
            for record in records_of(file):
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message):
                    topic = topics.get(record.channel_id, "")
                    frames += topic == "/exposure"
                    _add(found, topic, record.data)
    except OSError as error:
        raise RecordingFileError(
            f"recording {path}: cannot be read ({error.strerror}); expected the .mcap file of sensors or of "
            "a flight"
        ) from error
    states, poses, headings, truth = (
        tuple(values[stamp] for stamp in sorted(values)) for values in found.values()
    )
    return SensorLog(path, states, poses, headings, truth, frames)


def _add(found: dict[str, dict[float, Any]], topic: str, data: bytes) -> None:
    value: Any = None
    if topic == "/observation":
        value = codec.decode_state(codec.pb.Observation.FromString(data).state)
    elif topic == "/truth":
        value = codec.decode_truth(codec.pb.Truth.FromString(data))
    elif topic in ("/located", "/heading"):
        message = pb.Located.FromString(data)
        if topic == "/heading":
            value = HeadingMeasurement(message.stamp, message.yaw, message.covariance[0], message.source)
        elif message.position:
            covariance = np.array(message.covariance).reshape(4, 4)
            position = np.array(message.position)
            value = PoseMeasurement(message.stamp, position, message.yaw, covariance, message.source)
    if value is not None:
        found[topic].setdefault(value.stamp, value)
