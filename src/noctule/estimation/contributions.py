"""What nodes send each other: contributions of information, and their bytes.

The layout is fixed, in the frame of `framing`: size n, name of the source, sequence, stamp, yaw and heading
bias of the linearisation, i and jump (n numbers each), the upper triangle of I row by row. Nothing read from
the wire is believed before it is checked: the matrix is positive semidefinite, no surer than a sensor can be,
and speaks of a state that a vehicle can be in, at the yaw that the message names; or the message is refused.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.compiled import compiled, wrap
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
_SUREST = 1e-4  # [m, rad, m/s], the smallest deviation that a sensor may claim
_FARTHEST = 1000.0  # [m, rad, m/s, rad/s], of a state or a jump, and of the yaw that is counted in turns
# [rad], what a wrapped innovation of yaw and of heading can move them by, and more
_YAW_OFF, _BIAS_OFF = 4.0, 7.0
_COUNTED = 628.0  # [rad], beyond so many turns a contribution begins to count anew
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

    And the yaw and the heading bias there [rad]; 0 when the state has none. A yaw that was predicted through
    a hundred turns, while nobody measured, is taken back to the first.
    """
    b = heading_bias_index(x.size)
    if abs(x[YAW]) > _COUNTED or (b >= 0 and abs(x[b]) > _COUNTED):
        x = x.copy()
        x[YAW] = wrap(x[YAW])
        if b >= 0:
            x[b] = wrap(x[b])
    residual, H = linearise(x, components, z)
    i, I = contribution(x, residual, H, R)  # noqa: E741
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
            Contribution(known.stamp, source, count, nothing, np.zeros((n, n)), parts[0].yaw, 0.0, jumps[k])
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


_SOUND, _NOT_FINITE, _TOO_LARGE, _TOO_SURE, _ASYMMETRIC, _INDEFINITE, _SILENT, _ELSEWHERE = range(8)
_NO_JUMP = {n: np.zeros(n) for n in SIZES}
_NUMBER = np.dtype(np.float64)


def check(part: Contribution) -> None:
    """Raise ContributionError unless the contribution is one that a measurement can have made."""
    i, I = part.i, part.I  # noqa: E741
    n = i.size
    jump = _NO_JUMP.get(n, i) if part.jump is None else part.jump
    if n not in SIZES or i.shape != (n,) or I.shape != (n, n) or jump.shape != (n,):
        wrong = f"i {i.shape}, I {I.shape}, jump {jump.shape}; expected (n,), (n, n) and (n,) with n from "
        wrong += f"{SIZES[0]} to {SIZES[-1]}"
    elif not (i.dtype == _NUMBER and I.dtype == _NUMBER and jump.dtype == _NUMBER):
        wrong = f"its numbers are {i.dtype}, {I.dtype} and {jump.dtype}; expected float64"
    elif not 0 <= part.sequence < 2**64:
        wrong = "its sequence is out of range; expected 0 to 2^64 - 1"
    else:
        found = fault(i, I, jump, float(part.stamp), float(part.yaw), float(part.heading_bias))
        if found == _SOUND:
            return
        wrong = _reason(found, I)
    raise ContributionError(f"contribution {part.sequence} of {part.source!r}: {wrong}")


def _reason(found: int, I: Array) -> str:  # noqa: E741
    if found == _INDEFINITE:
        lowest = float(np.linalg.eigvalsh(I)[0])
        return f"I has an eigenvalue of {lowest:.3g}; expected none below 0: no measurement makes this"
    return {
        _NOT_FINITE: "holds numbers that are not finite; it is refused",
        _TOO_LARGE: "holds numbers beyond what any sensor says; it is refused",
        _TOO_SURE: f"I reaches {np.abs(I).max():.3g}; expected at most {_SUREST**-2:.3g}, "
        "a deviation of 0.1 mm",
        _ASYMMETRIC: "I is not symmetric; it is refused",
        _SILENT: "i speaks of directions in which I holds nothing; it is refused",
        _ELSEWHERE: f"i speaks of a state beyond {_FARTHEST:.0f} m or m/s, or of another yaw than it names; "
        "it is refused",
    }[found]


@compiled
def fault(i: Array, I: Array, jump: Array, stamp: float, yaw: float, heading_bias: float) -> int:  # noqa: E741
    """Return what is wrong with the numbers of a contribution: 0 when nothing is, or why it is refused."""
    n = i.size
    scale, loudest = 0.0, 1.0
    finite = np.isfinite(stamp) and np.isfinite(yaw) and np.isfinite(heading_bias)
    large = abs(stamp) > _LARGEST or abs(yaw) > _FARTHEST or abs(heading_bias) > _FARTHEST
    for k in range(n):
        finite = finite and np.isfinite(i[k]) and np.isfinite(jump[k])
        large = large or abs(i[k]) > _LARGEST or abs(jump[k]) > _FARTHEST
        loudest = max(loudest, abs(i[k]))
        for j in range(n):
            finite = finite and np.isfinite(I[k, j])
            scale = max(scale, abs(I[k, j]))
    if not finite:
        return _NOT_FINITE
    if large:
        return _TOO_LARGE
    if scale > 1.0 / _SUREST**2:
        return _TOO_SURE
    for k in range(n):
        for j in range(k):
            if abs(I[k, j] - I[j, k]) > 1e-9 * scale:
                return _ASYMMETRIC
    unsound = _unsound(i, I, 1e-9 * scale, 1e-6 * loudest)
    if unsound != _SOUND:
        return unsound
    # i = I (x + what explains the innovations), x of the sender; of x only the angles are known here.
    b = heading_bias_index(n)
    for k in range(n):
        off = i[k] - I[k, YAW] * yaw
        reach = 1e-6
        for j in range(n):
            if j == YAW:
                reach += abs(I[k, j]) * _YAW_OFF
            elif j == b:
                off -= I[k, j] * heading_bias
                reach += abs(I[k, j]) * _BIAS_OFF
            else:
                reach += abs(I[k, j]) * _FARTHEST
        if abs(off) > reach:
            return _ELSEWHERE
    return _SOUND


@compiled
def _unsound(i: Array, I: Array, nothing: float, silence: float) -> int:  # noqa: E741
    """Return what is wrong with I as a matrix of information, by elimination with the largest pivot first.

    What is left of it at `nothing` or below are directions that no measurement spoke of: there `i` has to be
    within `silence` of 0.
    """
    n = i.size
    A, r = I.copy(), i.copy()
    left = np.ones(n, dtype=np.bool_)
    for _ in range(n):
        p = -1
        for k in range(n):
            if left[k] and A[k, k] > nothing and (p < 0 or A[k, k] > A[p, p]):
                p = k
        if p < 0:
            break
        left[p] = False
        for a in range(n):
            if left[a] and A[a, p] != 0.0:
                f = A[a, p] / A[p, p]
                r[a] -= f * r[p]
                for b in range(n):
                    A[a, b] -= f * A[p, b]
    for a in range(n):
        for b in range(n):
            if left[a] and left[b] and (abs(A[a, b]) > nothing or A[a, a] < -nothing):
                return _INDEFINITE
    for a in range(n):
        if left[a] and abs(r[a]) > silence:
            return _SILENT
    return _SOUND
