"""Who is there, and who is missing since when: heartbeats of the nodes, and what the wire says of them.

The wire knows whose process is there. The heartbeat comes from the thread that measures and assimilates, so
one whose process answers but whose work hangs is found missing too.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from noctule.estimation.framing import MessageError, seal, unseal

BEAT_EVERY = 0.1  # [s]
SILENT = 1.0  # [s] without a heartbeat, and a node is missing
FORGOTTEN = 60.0  # [s] that it is missing, and it is no longer told
_MAGIC = b"NOCB"
_HEAD = struct.Struct("<dQ")
_MOST_TEXT = 160  # bytes
_MOST_PEERS = 64


@dataclass(frozen=True, slots=True)
class Beat:
    """What a node says of itself."""

    stamp: float  # [s], of its clock
    shared: int  # contributions so far
    reason: str = ""  # why it measures nothing


def beat_to_bytes(beat: Beat) -> bytes:
    """Return the message of a heartbeat."""
    text = beat.reason.encode()[:_MOST_TEXT].decode(errors="ignore").encode()
    return seal(_MAGIC, _HEAD.pack(beat.stamp, beat.shared) + text)


def beat_from_bytes(data: bytes) -> Beat:
    """Return the heartbeat of a message. Raises MessageError."""
    body = unseal(_MAGIC, data, "heartbeat", _HEAD.size)
    stamp, shared = _HEAD.unpack_from(body)
    text = body[_HEAD.size :].decode(errors="replace")
    if not np.isfinite(stamp) or len(body) > _HEAD.size + _MOST_TEXT or not (text.isprintable() or not text):
        raise MessageError(
            f"heartbeat: {len(data)} bytes at {stamp} s; expected a finite stamp and at most {_MOST_TEXT} "
            "bytes of text"
        )
    return Beat(stamp, shared, text)


@dataclass(slots=True)
class Peer:
    """What is known of another node."""

    since: float  # [s], there or missing
    there: bool
    heard: float  # [s], of the last heartbeat, or when it was first seen
    why: str = ""  # it is missing
    beat: Beat | None = None


class RollCall:
    """The other nodes by name; times are those of the caller."""

    def __init__(self) -> None:
        self.peers: dict[str, Peer] = {}
        self.losses = 0  # how often somebody went missing

    def alive(self, name: str, now: float) -> None:
        """Note that the wire says a node is there."""
        self._there(name, now)

    def beat(self, name: str, beat: Beat, now: float) -> None:
        """Note a node's heartbeat."""
        peer = self._there(name, now)
        if peer is not None:
            peer.beat = beat

    def gone(self, name: str, now: float) -> None:
        """Note that the wire says a node is there no more, from its last heartbeat on."""
        peer = self.peers.get(name)
        if peer is not None:
            self._missing(name, min(now, peer.heard), "its connection ended")

    def check(self, now: float) -> None:
        """Find those whose heartbeat has stopped, and forget those that are long gone."""
        for name, peer in list(self.peers.items()):
            if peer.there and now - peer.heard > SILENT:
                self._missing(name, peer.heard, "it hangs")
            if not peer.there and now - peer.since > FORGOTTEN:
                del self.peers[name]

    @property
    def there(self) -> tuple[str, ...]:
        """The names of those that are there."""
        return tuple(sorted(name for name, peer in self.peers.items() if peer.there))

    def _there(self, name: str, now: float) -> Peer | None:
        peer = self.peers.get(name)
        if peer is None:
            if len(self.peers) >= _MOST_PEERS:
                gone = [other for other, known in self.peers.items() if not known.there]
                if not gone:
                    return None
                del self.peers[min(gone, key=lambda other: self.peers[other].since)]
            peer = self.peers[name] = Peer(now, True, now)
        if not peer.there:
            peer.there, peer.since, peer.why = True, now, ""
        peer.heard = now
        return peer

    def _missing(self, name: str, since: float, why: str) -> None:
        peer = self.peers.get(name)
        if peer is not None and peer.there:
            peer.there, peer.since, peer.why = False, since, why
            self.losses += 1
