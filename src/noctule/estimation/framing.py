"""The frame of every message between nodes: magic, version, body, CRC-32 of all before; little-endian."""

from __future__ import annotations

import struct
import zlib

from noctule.errors import NoctuleError

VERSION = 1
NAME_BYTES = 16
_HEAD = struct.Struct("<4sH")
_CRC = struct.Struct("<I")
OVERHEAD = _HEAD.size + _CRC.size


class MessageError(NoctuleError):
    """Bytes that are no message of a node."""


def seal(magic: bytes, body: bytes) -> bytes:
    """Return the message of a body."""
    data = _HEAD.pack(magic, VERSION) + body
    return data + _CRC.pack(zlib.crc32(data))


def unseal(magic: bytes, data: bytes, what: str, least: int = 0) -> bytes:
    """Return the body, at least `least` bytes, of a message of the kind `what`. Raises MessageError."""
    if len(data) < OVERHEAD + least:
        raise MessageError(
            f"{what}: {len(data)} bytes; expected at least {OVERHEAD + least}: is the peer a node?"
        )
    found, version = _HEAD.unpack_from(data)
    if found != magic or version != VERSION:
        raise MessageError(
            f"{what}: begins with {found!r} version {version}; expected {magic!r} version {VERSION}: "
            "run the same version of noctule on every node"
        )
    if _CRC.unpack_from(data, len(data) - _CRC.size)[0] != zlib.crc32(data[: -_CRC.size]):
        raise MessageError(f"{what}: its checksum does not match; it was damaged or cut on the way")
    return data[_HEAD.size : -_CRC.size]


def packed_name(name: str, what: str) -> bytes:
    """Return a source's name as it stands in a message. Raises MessageError."""
    raw = name.encode()
    if not 0 < len(raw) <= NAME_BYTES or b"\0" in raw:
        raise MessageError(
            f"{what} of {name!r}: its name has {len(raw)} bytes; expected 1 to {NAME_BYTES} and no zero "
            "among them: give the sensor a shorter name"
        )
    return raw.ljust(NAME_BYTES, b"\0")


def unpacked_name(raw: bytes, what: str) -> str:
    """Return a source's name out of a message. Raises MessageError."""
    try:
        name = raw.rstrip(b"\0").decode()
    except UnicodeDecodeError:
        name = ""
    if not name or "\0" in name:
        raise MessageError(f"{what}: names its source {raw!r}; expected text")
    return name
