"""An MCAP file as it lies on the disk: its whole records, also where it was cut short."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from functools import partial
from typing import IO, Any

from mcap.exceptions import McapError
from mcap.records import Chunk
from mcap.stream_reader import StreamReader, breakup_chunk
from zstandard import ZstdError

from noctule.errors import NoctuleError

MAGIC = b"\x89MCAP0\r\n"
"""What every MCAP file begins and ends with."""
UNREADABLE = (McapError, ValueError, struct.error, ZstdError)
"""What the MCAP library raises where a file was cut or damaged."""
_FOOTER = 0x02


class RecordingFileError(NoctuleError):
    """A file that is no recording of a flight."""


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
    for record, _ in stored_records(stream):
        yield record


def stored_records(stream: IO[bytes]) -> Iterator[tuple[Any, Callable[[], bytes]]]:
    """Yield what `records_of` does, and with each message what gets its data again from its packed chunk.

    Holding that instead of the data holds the file's bytes only, a quarter of a depth frame's.
    """
    try:
        for record in StreamReader(stream, skip_magic=True, validate_crcs=True, emit_chunks=True).records:
            if isinstance(record, Chunk):
                for index, inner in enumerate(breakup_chunk(record, validate_crc=True)):
                    yield inner, partial(_unpacked, record, index)
            else:
                yield record, partial(getattr, record, "data", b"")
    except UNREADABLE:
        # The end of what can be read: nothing behind it is lost by stopping here.
        return


def _unpacked(chunk: Chunk, index: int) -> bytes:
    message: Any = breakup_chunk(chunk)[index]
    return bytes(message.data)
