"""Depth frames as messages, the same in recordings of a depth camera and in recordings of flights.

`/depth` is foxglove.RawImage (16UC1, millimetres), which viewers draw as it is; the chunks of the file are
compressed with zstd: lossless, in a quarter of the time and two thirds of the size of 16-bit PNG.
`/colour` is JPEG or PNG, and `/exposure`, with the exact stamp, ends a frame.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from foxglove.channels import CompressedImageChannel, RawImageChannel
from foxglove.messages import CompressedImage, RawImage, Timestamp
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage as RawImagePb

from noctule.flight.mcap_file import RecordingFileError
from noctule.flight.proto import depth_pb2
from noctule.flight.recording_pictures import encode_picture
from noctule.messages import DepthFrame, Picture

pb: Any = depth_pb2  # its classes are made when it is imported, no type checker sees them

_TYPES = {"16UC1": "<u2", "mono16": "<u2", "32FC1": "<f4", "8UC1": "u1", "mono8": "u1"}


class DepthChannels:
    """The channels of a depth camera in a file; `exposure` is that of pb.Exposure."""

    def __init__(
        self, context: foxglove.Context, exposure: foxglove.Channel, lossless_colour: bool, jpeg_quality: int
    ) -> None:
        self._depth = RawImageChannel("/depth", context=context)
        self._colour = CompressedImageChannel("/colour", context=context)
        self._exposure = exposure
        self._lossless, self._jpeg_quality = lossless_colour, jpeg_quality

    def log(self, frame: DepthFrame, time_ns: int) -> None:
        """Write one frame, its messages at this time of the file."""
        height, width = frame.depth.shape
        when = drawn_at(frame.stamp)[1]
        message = RawImage(
            timestamp=when,
            frame_id="camera",
            width=width,
            height=height,
            encoding="16UC1",
            step=2 * width,
            data=np.ascontiguousarray(frame.depth, dtype="<u2").tobytes(),
        )
        self._depth.log(message, log_time=time_ns)
        if frame.colour is not None:
            data = encode_picture(Picture(frame.stamp, frame.colour), self._lossless, self._jpeg_quality)
            kind = "png" if self._lossless else "jpeg"
            colour = CompressedImage(timestamp=when, frame_id="camera", data=data, format=kind)
            self._colour.log(colour, log_time=time_ns)
        # Always the last of its frame: the reader takes a frame without it for cut short.
        exposure = pb.Exposure(stamp=frame.stamp, colour=frame.colour is not None)
        self._exposure.log(exposure.SerializeToString(deterministic=True), log_time=time_ns)


def drawn_at(stamp: float) -> tuple[int, Timestamp]:
    """Return the time for viewers, which is never negative: [ns], and as Foxglove says it."""
    time_ns = max(round(stamp * 1e9), 0)
    return time_ns, Timestamp(time_ns // 1_000_000_000, time_ns % 1_000_000_000)


def decode_depth(data: bytes, path: Path) -> Any:
    """Return the image (height, width) of a message on /depth; raises RecordingFileError."""
    message = RawImagePb.FromString(data)
    kind = _TYPES.get(message.encoding)
    if kind is None:
        raise RecordingFileError(
            f"recording {path}: its depth is encoded as {message.encoding!r}, expected 16UC1 (millimetres)"
        )
    row = message.width * np.dtype(kind).itemsize
    if message.step < row or len(message.data) != message.height * message.step:
        raise RecordingFileError(
            f"recording {path}: a depth frame of {message.width}x{message.height} px holds "
            f"{len(message.data)} bytes; was the file changed after it was recorded?"
        )
    rows = np.frombuffer(message.data, dtype=np.uint8).reshape(message.height, message.step)
    return np.ascontiguousarray(rows[:, :row]).view(kind)
