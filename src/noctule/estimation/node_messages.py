"""What else nodes tell each other: the commands that were sent, and all that a node knows.

A message of commands repeats those of the last second, so that none is lost with a message. A snapshot lets
a node that was restarted begin where another is. Both are checked as contributions are before they are used.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from noctule.estimation.contributions import Contribution, from_bytes, to_bytes
from noctule.estimation.events import Event, Input, Key, Snapshot
from noctule.estimation.filter_state import SIZES, YAW
from noctule.estimation.framing import NAME_BYTES, MessageError, packed_name, seal, unpacked_name, unseal

_LARGEST, _LARGEST_INPUT = 1e15, 1000.0  # what is much larger overflows when it is multiplied
_FARTHEST, _MOST_TURNED, _SUREST = 1000.0, 1e6, 1e-5  # [m, m/s], [rad]; deviations are larger
INPUTS, SNAPSHOT = b"NOCU", b"NOCS"
_COUNT = struct.Struct("<H")
_INPUT = struct.Struct(f"<{NAME_BYTES}sQd?4d")
_KEY = struct.Struct(f"<Hdi{NAME_BYTES}sQdB")
_PART = struct.Struct("<cI")


def inputs_to_bytes(inputs: Sequence[Input]) -> bytes:
    """Return the message of at most 65535 commands. Raises MessageError."""
    return seal(INPUTS, _COUNT.pack(len(inputs)) + b"".join(map(_packed_input, inputs)))


def inputs_from_bytes(data: bytes) -> tuple[Input, ...]:
    """Return the commands of a message. Raises MessageError."""
    body = unseal(INPUTS, data, "commands", _COUNT.size)
    (count,) = _COUNT.unpack_from(body)
    if len(body) != _COUNT.size + count * _INPUT.size:
        raise MessageError(
            f"commands: {len(body)} bytes for {count} of them; expected {_COUNT.size + count * _INPUT.size}"
        )
    return tuple(_unpacked_input(body, _COUNT.size + k * _INPUT.size) for k in range(count))


def snapshot_to_bytes(snapshot: Snapshot) -> bytes:
    """Return the message of what a node knows. Raises MessageError.

    A node's filter holds contributions and commands only; raw measurements are not sent.
    """
    n, key = snapshot.x.size, snapshot.key
    name = packed_name(key.source, "snapshot") if key.source else bytes(NAME_BYTES)
    in_force = int(snapshot.input is not None)
    head = _KEY.pack(n, key.stamp, key.rank, name, key.sequence, snapshot.at, in_force)
    numbers = np.concatenate([snapshot.x, snapshot.P[np.triu_indices(n)]])
    body = [head, numbers.astype("<f8").tobytes()]
    if snapshot.input is not None:
        body.append(_packed_input(snapshot.input))
    body += [_packed_event(event) for event in snapshot.events]
    return seal(SNAPSHOT, b"".join(body))


def snapshot_from_bytes(data: bytes) -> Snapshot:
    """Return what the node that sent the message knows. Raises MessageError."""
    body = unseal(SNAPSHOT, data, "snapshot", _KEY.size)
    n, stamp, rank, name, sequence, at, in_force = _KEY.unpack_from(body)
    count = n + n * (n + 1) // 2
    place = _KEY.size + 8 * count
    if n not in SIZES or len(body) < place + in_force * _INPUT.size:
        raise MessageError(
            f"snapshot: {len(data)} bytes for a state of {n} numbers; expected more, or 8 to 11"
        )
    numbers = np.frombuffer(body, "<f8", count, _KEY.size).astype(np.float64)
    P = np.zeros((n, n))
    P[np.triu_indices(n)] = numbers[n:]
    P = P + np.triu(P, 1).T
    finite = np.isfinite([stamp, at]).all() and bool((np.abs(numbers) <= _LARGEST).all())
    if not (finite and np.linalg.eigvalsh(P)[0] > 0.0):
        raise MessageError("snapshot: its covariance is not positive definite, or holds no numbers; refused")
    reach = np.full(n, _FARTHEST)
    reach[YAW] = _MOST_TURNED
    x = numbers[:n].copy()
    if (np.abs(x) > reach).any() or np.diag(P).min() < _SUREST**2:
        raise MessageError(
            f"snapshot: reaches {np.abs(np.delete(x, YAW)).max():.3g} m with deviations from "
            f"{np.sqrt(np.diag(P).min()):.3g} on; expected at most {_FARTHEST:.0f} and at least {_SUREST:g}: "
            "refused"
        )
    source = unpacked_name(name, "snapshot") if name.strip(b"\0") else ""
    held: Input | None = None
    if in_force:
        held = _unpacked_input(body, place)
        place += _INPUT.size
    events = []
    while place < len(body):
        event, place = _unpacked_event(body, place)
        events.append(event)
    return Snapshot(Key(stamp, rank, source, sequence), at, x, P, held, {}, tuple(events))


def _packed_input(sent: Input) -> bytes:
    u = np.zeros(4) if sent.u is None else sent.u
    name = packed_name(sent.source, "command")
    if not 0 <= sent.sequence < 2**64:
        raise MessageError(
            f"command {sent.sequence} of {sent.source!r}: expected a sequence of 0 to 2^64 - 1"
        )
    return _INPUT.pack(name, sent.sequence, sent.stamp, sent.u is not None, *u.tolist())


def _unpacked_input(body: bytes, place: int) -> Input:
    name, sequence, stamp, known, *u = _INPUT.unpack_from(body, place)
    if not (np.isfinite(stamp) and (np.abs(u) <= _LARGEST_INPUT).all()):
        raise MessageError(f"command at {stamp} s: {u}; expected finite numbers, of the inputs up to 1000")
    return Input(stamp, np.array(u) if known else None, unpacked_name(name, "command"), sequence)


def _packed_event(event: Event) -> bytes:
    if isinstance(event, Contribution):
        kind, data = b"c", to_bytes(event)
    elif isinstance(event, Input):
        kind, data = b"u", inputs_to_bytes([event])
    else:
        raise MessageError(
            f"snapshot: holds a measurement of {event.source!r}; expected contributions: send that of a node"
        )
    return _PART.pack(kind, len(data)) + data


def _unpacked_event(body: bytes, place: int) -> tuple[Event, int]:
    if place + _PART.size > len(body):
        raise MessageError("snapshot: ends in the middle of an event")
    kind, length = _PART.unpack_from(body, place)
    begin = place + _PART.size
    data = body[begin : begin + length]
    event: Event
    if kind == b"c":
        event = from_bytes(data)
    elif kind == b"u":
        inputs = inputs_from_bytes(data)
        if len(inputs) != 1:
            raise MessageError(f"snapshot: holds an event of {len(inputs)} commands; expected 1")
        event = inputs[0]
    else:
        raise MessageError(f"snapshot: holds an event of kind {kind!r}; expected b'c' or b'u'")
    return event, begin + length
