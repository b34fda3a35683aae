"""What nodes send each other: contributions of information, and their bytes.

The layout is fixed, in the frame of `framing`: size n, name of the source, sequence, stamp, yaw and heading
bias of the linearisation, i and jump (n numbers each), the upper triangle of I row by row. Nothing read from
the wire is believed before it is checked: the matrix is positive semidefinite, or the message is refused.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.compiled import compiled
from noctule.estimation.filter_state import (
    SIZES,
    YAW,
    StateEstimate,
    heading_bias_index,
    velocity_bias_index,
)
from noctule.estimation.framing import (
    NAME_BYTES,
    OVERHEAD,
    MessageError,
    packed_name,
    seal,
    unpacked_name,
    unseal,
)
from noctule.estimation.information_filter import contribution
from noctule.estimation.measurements import Component, Measurement, linearise
from noctule.geometry import Array, wrap_angle

MAGIC = b"NOCI"
_LARGEST = 1e15  # finite is not enough: what is much larger overflows when it is multiplied
_HALF_TURNED_SD, _RELEASED = 0.1, 0.05  # [rad], [m/s]
_LARGEST_JUMP = 1e4  # [m, rad, m/s, rad/s]
_HEAD = struct.Struct(f"<H{NAME_BYTES}sQddd")


class ContributionError(MessageError):
    """Numbers that no measurement contributes."""


@dataclass(frozen=True, slots=True)
class Contribution:
    """What one measurement adds to an information filter's y and Y."""

    stamp: float  # [s], of the measurement
    source: str  # what measured it
    sequence: int  # the source's count; with stamp and source the id, so that none counts twice
    i: Array  # (n,) H' R^-1 z
    I: Array  # (n, n) H' R^-1 H  # noqa: E741 - the paper's name
    yaw: float  # [rad], where it was linearised, as the sender counts turns
    heading_bias: float  # [rad], likewise; 0 when the state has none
    jump: Array | None = None  # (n,) j of the covariance j j' to be added before: see gating


@compiled
def linear_contribution(
    x: Array, components: NDArray[np.int64], z: Array, R: Array
) -> tuple[Array, Array, float, float]:
    """Return (i, I) of the numbers z (m,) with covariance R (m, m), linearised at x (n,).

    And the yaw and the heading bias there [rad]; 0 when the state has none.
    """
    residual, H = linearise(x, components, z)
    i, I = contribution(x, residual, H, R)  # noqa: E741
    b = heading_bias_index(x.size)
    bias = x[b] if b >= 0 else 0.0
    return i, I, x[YAW], bias


def contribution_of(x: Array, measurement: Measurement, jump: Array | None = None) -> Contribution:
    """Return what `measurement` contributes, linearised at x (n,); it keeps the measurement's id."""
    z = measurement
    i, I, yaw, bias = linear_contribution(x, z.components, z.z, z.R)  # noqa: E741
    return Contribution(z.stamp, z.source, z.sequence, i, I, yaw, bias, jump)


def half_turned(known: StateEstimate, source: str, sequence: int) -> tuple[Contribution, ...]:
    """Return what turns the yaw of all who add it by half a turn, at the stamp of `known`.

    Nothing else moves. The biases of the velocities are let go: they were found with the nose at the tail.
    """
    n, x = known.x.size, known.x
    jumps = np.diag([math.pi if k == YAW else _RELEASED for k in range(n)])
    yaw = Measurement(
        known.stamp,
        np.array([Component.YAW], dtype=np.int64),
        np.array([wrap_angle(float(x[YAW]) + math.pi)]),
        np.array([[_HALF_TURNED_SD**2]]),
        source,
        sequence,
    )
    parts = [contribution_of(x, yaw, jumps[YAW])]
    first = velocity_bias_index(n)
    for k in range(first, first + 2) if first >= 0 else ():
        nothing, count = np.zeros(n), sequence + len(parts)
        parts.append(
            Contribution(known.stamp, source, count, nothing, np.zeros((n, n)), float(x[YAW]), 0.0, jumps[k])
        )
    return tuple(parts)


def to_bytes(part: Contribution) -> bytes:
    """Return the message of a contribution. Raises ContributionError or MessageError when it is none."""
    name = packed_name(part.source, "contribution")
    check(part)
    n = part.i.size
    jump = np.zeros(n) if part.jump is None else part.jump
    head = _HEAD.pack(n, name, part.sequence, part.stamp, part.yaw, part.heading_bias)
    numbers = np.concatenate([part.i, jump, part.I[np.triu_indices(n)]])
    return seal(MAGIC, head + numbers.astype("<f8").tobytes())


def from_bytes(data: bytes) -> Contribution:
    """Return the contribution of a message. Raises ContributionError or MessageError for anything else."""
    body = unseal(MAGIC, data, "contribution", _HEAD.size)
    n, name, sequence, stamp, yaw, heading_bias = _HEAD.unpack_from(body)
    if n not in SIZES or len(data) != message_length(n):
        raise ContributionError(
            f"contribution: {len(data)} bytes for a state of {n} numbers; expected {SIZES[0]} to {SIZES[-1]} "
            f"numbers in {', '.join(str(message_length(k)) for k in SIZES)} bytes"
        )
    source = unpacked_name(name, "contribution")
    numbers = np.frombuffer(body, "<f8", _count(n), _HEAD.size).astype(np.float64)
    I = np.zeros((n, n))  # noqa: E741
    I[np.triu_indices(n)] = numbers[2 * n :]
    I = I + np.triu(I, 1).T  # noqa: E741
    i, jump = numbers[:n].copy(), numbers[n : 2 * n].copy()
    part = Contribution(stamp, source, sequence, i, I, yaw, heading_bias, jump if jump.any() else None)
    check(part)
    return part


def message_length(n: int) -> int:
    """Return how many bytes the message of a state of `n` numbers has."""
    return OVERHEAD + _HEAD.size + 8 * _count(n)


def _count(n: int) -> int:
    return 2 * n + n * (n + 1) // 2


def check(part: Contribution) -> None:
    """Raise ContributionError unless the contribution is one that a measurement can have made."""
    n = part.i.size
    who = f"contribution {part.sequence} of {part.source!r}"
    jump = np.zeros(n) if part.jump is None else part.jump
    if n not in SIZES or part.i.shape != (n,) or part.I.shape != (n, n) or jump.shape != (n,):
        raise ContributionError(
            f"{who}: i {part.i.shape}, I {part.I.shape}, jump {jump.shape}; "
            f"expected (n,), (n, n) and (n,) with n from {SIZES[0]} to {SIZES[-1]}"
        )
    scalars = (part.stamp, part.yaw, part.heading_bias)
    arrays = (part.i, part.I, jump)
    if not (all(np.isfinite(a).all() for a in arrays) and all(map(math.isfinite, scalars))):
        raise ContributionError(f"{who}: holds numbers that are not finite; it is refused")
    size = max(float(np.abs(a).max()) for a in (part.i, part.I, np.array(scalars)))
    if size > _LARGEST or np.abs(jump).max() > _LARGEST_JUMP:
        raise ContributionError(f"{who}: holds numbers beyond what any sensor says; it is refused")
    if not 0 <= part.sequence < 2**64:
        raise ContributionError(f"{who}: its sequence is out of range; expected 0 to 2^64 - 1")
    if not np.array_equal(part.I, part.I.T):
        raise ContributionError(f"{who}: I is not symmetric; it is refused")
    values, vectors = np.linalg.eigh(part.I)
    scale = float(np.abs(values).max())
    if values[0] < -1e-9 * scale:
        raise ContributionError(
            f"{who}: I has an eigenvalue of {values[0]:.3g}; expected none below 0: no measurement makes this"
        )
    # A measurement says nothing of directions that it has no information on.
    silent = np.abs(vectors.T @ part.i)[values <= 1e-9 * scale]
    if silent.size and silent.max() > 1e-6 * max(1.0, float(np.abs(part.i).max())):
        raise ContributionError(f"{who}: i speaks of directions in which I holds nothing; it is refused")
