"""Reads a recording, whole or cut short by a crash or a full disk."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Header, Message, Metadata
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from noctule.errors import NoctuleError
from noctule.flight import codec
from noctule.flight.recording import FORMAT
from noctule.messages import Command, Decision, Observation, Picture, Truth

MAGIC = b"\x89MCAP0\r\n"
"""What every MCAP file begins and ends with."""
UNREADABLE = (McapError, ValueError, struct.error, ZstdError)
"""What the MCAP library raises where a file was cut or damaged."""
_FOOTER = 0x02


class RecordingFileError(NoctuleError):
    """A file that is no recording of a flight."""


@dataclass(frozen=True, slots=True)
class Tick:
    """One tick of the loop, as it was recorded."""

    stamp: float  # [s]
    told: Any  # pb.Observation
    picture: bytes | None  # PNG or JPEG
    decision: Decision | None  # None where the pilot was not asked
    tick_ms: float  # [ms], picture to command; NaN without a decision
    asked: Command
    sent: Command
    supervisor: str  # its state
    action: str
    reason: str
    truth: Truth | None

    def observation(self) -> Observation:
        """Return what the pilot was told; decodes the picture."""
        picture = None
        if self.picture is not None:
            picture = Picture(self.told.picture_stamp, decode_picture(self.picture))
        state = codec.decode_state(self.told.state)
        return Observation(self.stamp, state, picture, codec.decode_matches(self.told))


@dataclass(frozen=True, slots=True)
class Recording:
    """A flight as it was recorded."""

    path: Path
    ticks: tuple[Tick, ...]
    notes: dict[str, dict[str, str]]  # what the recorder was told to note, by name
    files: dict[str, bytes] = field(repr=False)  # what was attached, by name
    complete: bool = True  # False: the flight's end is missing

    @property
    def lossless(self) -> bool:
        """Whether the pictures are exactly those that the pilot saw."""
        return self.notes.get("flight", {}).get("lossless") == "true"

    @property
    def flown(self) -> tuple[Tick, ...]:
        """The ticks at which the pilot was asked."""
        return tuple(t for t in self.ticks if t.decision is not None)


def decode_picture(data: bytes) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return the RGB picture (height, width, 3) of PNG or JPEG data."""
    bgr = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR)
    if bgr is None:
        raise RecordingFileError(
            "recording: a picture cannot be decoded; was the file changed after the flight?"
        )
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def whole_records(data: bytes) -> tuple[int, bool]:
    """Return how many bytes of an MCAP file are whole records, and whether the file was closed."""
    at = len(MAGIC)
    while at + 9 <= len(data):
        kind, length = struct.unpack_from("<BQ", data, at)
        if kind == 0 or at + 9 + length > len(data):
            return at, False
        at += 9 + length
        if kind == _FOOTER:
            return at, data[at:] == MAGIC
    return at, False


def records_of(stream: IO[bytes]) -> Iterator[Any]:
    """Yield the records of an MCAP file whose magic was read, up to where it was cut or damaged."""
    try:
        yield from StreamReader(stream, skip_magic=True, validate_crcs=True).records
    except UNREADABLE:
        # The end of what can be read: nothing behind it is lost by stopping here.
        return


class _Builder:
    """Puts the messages of each tick together; a tick without its last message is dropped."""

    def __init__(self) -> None:
        self.ticks: list[Tick] = []
        self._parts: dict[str, Any] = {}

    def add(self, name: str, message: Any) -> None:
        self._parts[name] = message
        if name == "Sent":
            self._finish()

    def _finish(self) -> None:
        parts, self._parts = self._parts, {}
        told, sent, decision = parts["Observation"], parts["Sent"], parts.get("Decision")
        image = parts.get("CompressedImage")
        self.ticks.append(
            Tick(
                stamp=told.stamp,
                told=told,
                picture=None if image is None else image.data,
                decision=None if decision is None else codec.decode_decision(decision),
                tick_ms=float("nan") if decision is None else decision.tick_ms,
                asked=codec.decode_command(sent.asked),
                sent=codec.decode_command(sent.sent),
                supervisor=sent.supervisor_state,
                action=sent.action,
                reason=sent.reason,
                truth=codec.decode_truth(parts["Truth"]) if "Truth" in parts else None,
            )
        )


_KINDS = {
    "/camera": CompressedImage,
    "/observation": codec.pb.Observation,
    "/decision": codec.pb.Decision,
    "/sent": codec.pb.Sent,
    "/truth": codec.pb.Truth,
}


def read_recording(path: Path) -> Recording:
    """Read a recording; one that was cut short gives all whole ticks before the cut (`complete` is False).

    Raises
    ------
    RecordingFileError
        When the file is missing or no recording of a flight.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingFileError(
            f"recording {path}: cannot be read ({error.strerror}); expected the .mcap file of a flight"
        ) from error
    if not data.startswith(MAGIC):
        raise RecordingFileError(
            f"recording {path}: this is no MCAP file; expected the .mcap file of a flight"
        )
    names: dict[int, str] = {}
    notes: dict[str, dict[str, str]] = {}
    files: dict[str, bytes] = {}
    builder = _Builder()
    for record in records_of(io.BytesIO(data[len(MAGIC) : whole_records(data)[0]])):
        if isinstance(record, Header) and record.profile != FORMAT:
            raise RecordingFileError(
                f"recording {path}: its format is {record.profile!r}, this version reads {FORMAT!r}; "
                "read it with the version that wrote it"
            )
        if isinstance(record, Channel):
            names[record.id] = record.topic
        elif isinstance(record, Message) and names.get(record.channel_id) in _KINDS:
            kind = _KINDS[names[record.channel_id]]
            builder.add(kind.DESCRIPTOR.name, kind.FromString(record.data))
        elif isinstance(record, Metadata):
            notes[record.name] = dict(record.metadata)
        elif isinstance(record, Attachment):
            files[record.name] = record.data
    return Recording(path, tuple(builder.ticks), notes, files, whole_records(data)[1])
