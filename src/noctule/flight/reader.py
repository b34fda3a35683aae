"""Reads a recording, whole or cut short by a crash or a full disk."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from mcap.records import Attachment, Channel, Header, Message, Metadata

from noctule.flight import codec
from noctule.flight.depth_image import decode_depth, pb
from noctule.flight.mcap_file import (
    MAGIC,
    UNREADABLE,
    RecordingFileError,
    records_of,
    stored_records,
    whole_records,
)
from noctule.flight.recording import FORMAT
from noctule.flight.recording_pictures import decode_picture
from noctule.messages import Command, Decision, DepthFrame, Observation, Picture, Truth

__all__ = [
    "MAGIC",
    "UNREADABLE",
    "Recording",
    "RecordingFileError",
    "StoredDepth",
    "Tick",
    "decode_picture",
    "read_recording",
    "records_of",
    "whole_records",
]


@dataclass(frozen=True, slots=True)
class StoredDepth:
    """A depth frame that was kept; unpacked only when it is asked for."""

    path: Path  # of the recording, for what goes wrong
    stamp: float  # [s], exposure
    packed: Callable[[], bytes] = field(repr=False)  # gives the message on /depth
    colour: bytes | None = field(default=None, repr=False)  # PNG or JPEG

    def frame(self) -> DepthFrame:
        """Return the frame; raises RecordingFileError."""
        colour = None if self.colour is None else decode_picture(self.colour)
        return DepthFrame(self.stamp, decode_depth(self.packed(), self.path), colour)


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
    depth: StoredDepth | None = None  # None where there was none, or only its stamp was kept

    @property
    def depth_stamp(self) -> float | None:
        """The exposure [s] of the depth frame that the pilot was given, kept or not; None without one."""
        return self.told.depth_stamp if self.told.HasField("depth_stamp") else None

    def observation(self) -> Observation:
        """Return what the pilot was told; decodes the picture and the depth frame."""
        picture = None
        if self.picture is not None:
            picture = Picture(self.told.picture_stamp, decode_picture(self.picture))
        state = codec.decode_state(self.told.state)
        depth = None if self.depth is None else self.depth.frame()
        sent = codec.decode_command(self.told.sent) if self.told.HasField("sent") else None
        return Observation(self.stamp, state, picture, codec.decode_matches(self.told), depth, sent)


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
    def depth_kept(self) -> bool:
        """Whether every depth frame that the pilot was given is here."""
        return all(t.depth is not None for t in self.flown if t.depth_stamp is not None)

    @property
    def flown(self) -> tuple[Tick, ...]:
        """The ticks at which the pilot was asked."""
        return tuple(t for t in self.ticks if t.decision is not None)


class _Builder:
    """Puts the messages of each tick together; a tick without its last message is dropped."""

    def __init__(self, path: Path) -> None:
        self.ticks: list[Tick] = []
        self._path = path
        self._parts: dict[str, Any] = {}

    def add(self, topic: str, data: bytes, packed: Callable[[], bytes]) -> None:
        self._parts[topic] = packed if topic == "/depth" else _KINDS[topic].FromString(data)
        if topic == "/sent":
            self._finish()

    def _finish(self) -> None:
        parts, self._parts = self._parts, {}
        told, sent, decision = parts["/observation"], parts["/sent"], parts.get("/decision")
        image = parts.get("/camera")
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
                truth=codec.decode_truth(parts["/truth"]) if "/truth" in parts else None,
                depth=self._depth(parts),
            )
        )

    def _depth(self, parts: dict[str, Any]) -> StoredDepth | None:
        exposure = parts.get("/exposure")
        if exposure is None or "/depth" not in parts:
            return None
        colour = parts["/colour"].data if exposure.colour else None
        return StoredDepth(self._path, exposure.stamp, parts["/depth"], colour)


_KINDS: dict[str, Any] = {
    "/camera": CompressedImage,
    "/depth": None,  # stays packed
    "/colour": CompressedImage,
    "/exposure": pb.Exposure,
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
    builder = _Builder(path)
    for record, packed in stored_records(io.BytesIO(data[len(MAGIC) : whole_records(data)[0]])):
        if isinstance(record, Header) and record.profile != FORMAT:
            raise RecordingFileError(
                f"recording {path}: its format is {record.profile!r}, this version reads {FORMAT!r}; "
                "read it with the version that wrote it"
            )
        if isinstance(record, Channel):
            names[record.id] = record.topic
        elif isinstance(record, Message) and names.get(record.channel_id) in _KINDS:
            builder.add(names[record.channel_id], record.data, packed)
        elif isinstance(record, Metadata):
            notes[record.name] = dict(record.metadata)
        elif isinstance(record, Attachment):
            files[record.name] = record.data
    return Recording(path, tuple(builder.ticks), notes, files, whole_records(data)[1])
