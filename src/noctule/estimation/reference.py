"""Where a vehicle really was, as far as something better than its sensors tells: what they are judged by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.errors import NoctuleError
from noctule.geometry import Array

LONGEST_GAP = 0.25  # [s], over which a reference is interpolated
_RATE = 50.0  # [Hz], of the grid on which positions are differentiated
_HALF = 7  # samples to each side of it that a slope is fitted to: 0.14 s


class ReferenceError(NoctuleError):
    """Stamps, headings and positions that make no reference."""


@dataclass(frozen=True, slots=True)
class Reference:
    """Headings and, where they are known, positions and velocities over time."""

    stamps: Array  # (n,) [s], ascending
    yaw: Array  # (n,) [rad], unwrapped
    position: Array | None = None  # (n, 3) [m], world
    v_world: Array | None = None  # (n, 3) [m/s]

    def __post_init__(self) -> None:
        """Refuse what cannot be interpolated."""
        n = self.stamps.size
        parts = [self.yaw.shape == (n,)]
        parts += [a is None or a.shape == (n, 3) for a in (self.position, self.v_world)]
        if n < 2 or not all(parts) or not (np.diff(self.stamps) > 0.0).all():
            raise ReferenceError(
                f"reference: {n} stamps, headings {self.yaw.shape}; expected two or more ascending stamps "
                "and as many headings, positions and velocities"
            )
        object.__setattr__(self, "yaw", np.unwrap(self.yaw))

    def covers(self, stamps: Array) -> NDArray[np.bool_]:
        """Return at which of the stamps (m,) it can be asked: inside, and not within a gap."""
        k = np.clip(np.searchsorted(self.stamps, stamps, side="right"), 1, self.stamps.size - 1)
        inside = (stamps >= self.stamps[0]) & (stamps <= self.stamps[-1])
        covered: NDArray[np.bool_] = inside & (self.stamps[k] - self.stamps[k - 1] <= LONGEST_GAP)
        return covered

    def yaw_at(self, stamps: Array) -> Array:
        """Return headings (m,) [rad], unwrapped."""
        return np.interp(stamps, self.stamps, self.yaw)

    def position_at(self, stamps: Array) -> Array:
        """Return positions (m, 3) [m]; call it only where positions are known."""
        assert self.position is not None
        return _columns(stamps, self.stamps, self.position)

    def v_heading_at(self, stamps: Array) -> Array:
        """Return velocities (m, 3) [m/s] in the levelled heading frame FLU, where velocities are known."""
        assert self.v_world is not None
        v = _columns(stamps, self.stamps, self.v_world)
        yaw = self.yaw_at(stamps)
        c, s = np.cos(yaw), np.sin(yaw)
        return np.column_stack([c * v[:, 0] + s * v[:, 1], c * v[:, 1] - s * v[:, 0], v[:, 2]])


def with_velocities(reference: Reference) -> Reference:
    """Return the reference with velocities, the slopes of its positions over 0.3 s, where it has any."""
    if reference.position is None or reference.v_world is not None:
        return reference
    first, last = reference.stamps[0], reference.stamps[-1]
    grid = np.arange(first, last, 1.0 / _RATE)
    if grid.size < 4 * _HALF:
        return reference
    k = np.arange(-_HALF, _HALF + 1)
    slope = -k / (k @ k) * _RATE  # convolve turns it around
    even = _columns(grid, reference.stamps, reference.position)
    # The slope of a line that goes on as it began and ended: no step at either end.
    before = 2.0 * even[:1] - even[_HALF:0:-1]
    after = 2.0 * even[-1:] - even[-2 : -_HALF - 2 : -1]
    padded = np.concatenate([before, even, after])
    v = np.column_stack([np.convolve(padded[:, a], slope, mode="valid") for a in range(3)])
    v_world = _columns(reference.stamps, grid, v)
    return Reference(reference.stamps, reference.yaw, reference.position, v_world)


def _columns(at: Array, stamps: Array, values: Array) -> Array:
    return np.column_stack([np.interp(at, stamps, values[:, a]) for a in range(values.shape[1])])
