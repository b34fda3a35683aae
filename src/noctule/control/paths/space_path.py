"""A path in space: nodes along the arc length, and what is between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from noctule.compiled import compiled
from noctule.errors import NoctuleError
from noctule.geometry import Array

STEP = 0.01  # [m], between nodes
SAME_PLACE = 1e-3  # [m]
SAME_DIRECTION = np.radians(1.0)  # [rad]; a larger change of direction is a corner
MOST_NODES = 200_000
_TIP = 1e-4  # [m]; a smaller radius is none: the curve comes to a tip
_GAUSS_X, _GAUSS_W = np.polynomial.legendre.leggauss(8)

Curve = Callable[[Array], tuple[Array, Array, Array]]
"""From parameters (m,) to positions and their first and second derivatives, (m, 3) each."""


class PathShapeError(NoctuleError):
    """Numbers that make no path."""


class PathLengthError(PathShapeError):
    """A path so long that its nodes would not be kept."""


def require_length(length: float) -> None:
    """Refuse a length [m] beyond that of MOST_NODES nodes, before they are made; raises PathLengthError."""
    if not length <= MOST_NODES * STEP:
        raise PathLengthError(f"path: it is {length:.0f} m long; expected at most {MOST_NODES * STEP:.0f} m")


@dataclass(frozen=True, slots=True)
class PathPoint:
    """A point of a path."""

    s: float  # [m], along the path from its beginning
    position: Array  # (3,) [m], world
    tangent: Array  # (3,) unit, the direction of flight
    curvature: Array  # (3,) [1/m], towards the centre of the curve


@dataclass(frozen=True, slots=True)
class SpacePath:
    """A path by its nodes, about `STEP` apart; at a corner there are two at the same place."""

    s: Array  # (n,) [m], arc length
    position: Array  # (n, 3) [m], world
    tangent: Array  # (n, 3) unit
    curvature: Array  # (n, 3) [1/m], the derivative of the tangent by s
    closed: bool = False  # the last node is the first again

    def __post_init__(self) -> None:
        """Refuse nodes that are no path."""
        n = len(self.s)
        shapes = [np.shape(a) for a in (self.position, self.tangent, self.curvature)]
        if n < 2 or shapes != [(n, 3)] * 3:
            raise PathShapeError(f"path of {n} nodes, arrays {shapes}; expected 2 or more and (n, 3) each")
        for name in ("s", "position", "tangent", "curvature"):
            array = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if not np.isfinite(array).all():
                raise PathShapeError(f"path: its {name} holds values that are not finite; expected numbers")
            object.__setattr__(self, name, array)

    @property
    def length(self) -> float:
        """How long it is [m]; of a closed path, once around."""
        return float(self.s[-1])

    @property
    def start(self) -> PathPoint:
        """Where it begins."""
        return self.at(0.0)

    @property
    def end(self) -> PathPoint:
        """Where it ends, as one arrives there."""
        return PathPoint(self.length, self.position[-1], self.tangent[-1], self.curvature[-1])

    @property
    def corners(self) -> Array:
        """The arc lengths [m] at which the direction jumps; of a closed path also the seam's, 0."""
        twins = np.flatnonzero(np.diff(self.s) == 0.0)
        places = self.s[twins]
        if self.closed and turn(self.tangent[-1], self.tangent[0]) > SAME_DIRECTION:
            places = np.concatenate([[0.0], places])
        return np.asarray(places)

    def within(self, s: float) -> float:
        """Return the arc length on the path's nodes: around a closed path, at the ends of an open one."""
        length = self.length
        return s % length if self.closed else min(max(s, 0.0), length)

    def at(self, s: float) -> PathPoint:
        """Return the point at the arc length `s` [m]; s counts on around a closed path."""
        p = sample(self.s, self.position, self.tangent, self.curvature, self.within(s))
        return PathPoint(s, p[:3], p[3:6], p[6:])

    def place(self, s: float) -> str:
        """Return in words where `s` [m] is."""
        x, y, z = self.at(s).position
        return f"s = {s:.2f} m ({x:.2f}, {y:.2f}, {z:.2f})"


def turn(a: Array, b: Array) -> float:
    """Return the angle [rad] between two unit vectors (3,)."""
    return float(2.0 * np.arcsin(min(1.0, 0.5 * float(np.linalg.norm(b - a)))))


@compiled
def segment_of(nodes: Array, s: float) -> int:
    """Return which segment of the nodes (n,) holds s; at a corner the one behind it."""
    i = int(np.searchsorted(nodes, s, side="right")) - 1
    return min(max(i, 0), nodes.size - 2)


@compiled
def sample(nodes: Array, position: Array, tangent: Array, curvature: Array, s: float) -> Array:
    """Return position, unit tangent and curvature at s, (9,): cubic between nodes, the others linear."""
    i = segment_of(nodes, s)
    length = nodes[i + 1] - nodes[i]
    u = (s - nodes[i]) / length if length > 0.0 else 0.0
    a, b = u * u * (3.0 - 2.0 * u), u * (1.0 - u) * length
    p = np.empty(9)
    norm = 0.0
    for k in range(3):
        t0, t1 = tangent[i, k], tangent[i + 1, k]
        p[k] = (1.0 - a) * position[i, k] + a * position[i + 1, k] + b * ((1.0 - u) * t0 - u * t1)
        p[3 + k] = (1.0 - u) * t0 + u * t1
        p[6 + k] = (1.0 - u) * curvature[i, k] + u * curvature[i + 1, k]
        norm += p[3 + k] * p[3 + k]
    norm = np.sqrt(norm)
    for k in range(3):
        p[3 + k] /= norm
    return p


def of_curve(curve: Curve, begin: float, end: float, pieces: int, closed: bool = False) -> SpacePath:
    """Return the path along a smooth curve from one parameter to another.

    The arc length is integrated over `pieces` equal parts of the parameter (Gauss-Legendre, 8 points each),
    and inverted by Newton's method, so nodes are on the curve and at their place to rounding. Raises
    PathShapeError.
    """
    breaks = np.linspace(begin, end, pieces + 1)
    lengths = np.concatenate([[0.0], np.cumsum(_length(curve, breaks[:-1], breaks[1:]))])
    total = float(lengths[-1])
    if not (np.isfinite(total) and total > SAME_PLACE):
        raise PathShapeError(f"path: it is {total:g} m long; expected more than {SAME_PLACE:g} m")
    require_length(total)
    s = np.linspace(0.0, total, max(2, int(np.ceil(total / STEP)) + 1))
    u = np.interp(s, lengths, breaks)
    for _ in range(4):
        k = np.clip(np.searchsorted(breaks, u, side="right") - 1, 0, pieces - 1)
        error = lengths[k] + _length(curve, breaks[k], u) - s
        u = np.clip(u - error / _rate(curve, u), begin, end)
    p, d1, d2 = curve(u)
    rate = np.linalg.norm(d1, axis=1, keepdims=True)
    if not (rate > 1e-6 * total / (end - begin)).all():
        raise _back_on_itself(p[int(rate.argmin())])
    t = d1 / rate
    flips = np.flatnonzero((t[:-1] * t[1:]).sum(axis=1) < 0.5)
    if flips.size:
        i = int(flips[0])
        raise _too_tight(p[i], *curve(np.linspace(u[i], u[i + 1], 65))[1:])
    bend = (d2 - (d2 * t).sum(axis=1, keepdims=True) * t) / rate**2
    return SpacePath(s, p, t, bend, closed)


def _back_on_itself(p: Array) -> PathShapeError:
    x, y, z = p
    return PathShapeError(
        f"path: the curve turns back on itself at ({x:.2f}, {y:.2f}, {z:.2f}); lead it around"
    )


def _too_tight(p: Array, d1: Array, d2: Array) -> PathShapeError:
    """Return what is wrong behind p (3,), where the direction turns by 60 deg within a step or more.

    `d1` and `d2` (m, 3) are the curve's derivatives there.
    """
    rate, across = np.linalg.norm(d1, axis=1), np.linalg.norm(np.cross(d1, d2), axis=1)
    radius = float((rate**3 / np.maximum(across, 1e-12)).min())
    if not _TIP <= radius <= STEP:
        return _back_on_itself(p)
    x, y, z = p
    return PathShapeError(
        f"path: the curve at ({x:.2f}, {y:.2f}, {z:.2f}) has a radius of {radius:.4f} m, too tight to be "
        f"flown; make it wider than {STEP:g} m"
    )


def _rate(curve: Curve, u: Array) -> Array:
    rate = np.linalg.norm(curve(u)[1], axis=1)
    return np.asarray(np.maximum(rate, 1e-12))


def _length(curve: Curve, begin: Array, end: Array) -> Array:
    """Return the lengths (m,) of the curve between parameters (m,) and (m,)."""
    half = 0.5 * (end - begin)
    at = 0.5 * (begin + end)[:, None] + half[:, None] * _GAUSS_X
    rates = np.linalg.norm(curve(at.ravel())[1], axis=1).reshape(at.shape)
    return np.asarray((rates * _GAUSS_W).sum(axis=1) * half)
