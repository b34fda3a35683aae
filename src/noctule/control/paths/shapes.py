"""Lines, arcs, ellipses and eights, and paths made of several pieces."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from noctule.control.paths.space_path import (
    SAME_DIRECTION,
    SAME_PLACE,
    STEP,
    PathShapeError,
    SpacePath,
    of_curve,
    require_length,
    turn,
)
from noctule.geometry import Array

Point = Sequence[float] | Array

_PIECES = 256  # of a turn, for the arc length


class PathJoinError(PathShapeError):
    """Pieces that do not meet."""

    def __init__(self, message: str, piece: int) -> None:
        super().__init__(message)
        self.piece = piece  # counted from 0


def _point(name: str, point: Point, size: int = 3) -> Array:
    array = np.asarray(point, dtype=np.float64)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise PathShapeError(f"{name}: {array.tolist()}, expected {size} finite numbers")
    return array


def line(begin: Point, end: Point) -> SpacePath:
    """Return the straight path between two points (3,) [m]. Raises PathShapeError."""
    a, b = _point("line", begin), _point("line", end)
    way = b - a
    length = float(np.linalg.norm(way))
    if length < SAME_PLACE:
        raise PathShapeError(f"line: it begins and ends at {a.tolist()}; expected two points that differ")
    require_length(length)
    s = np.linspace(0.0, length, max(2, math.ceil(length / STEP) + 1))
    tangent = np.tile(way / length, (s.size, 1))
    return SpacePath(s, a + s[:, None] * tangent, tangent, np.zeros((s.size, 3)))


def arc(centre: Point, radius: float, begin: float, sweep: float, climb: float = 0.0) -> SpacePath:
    """Return a level arc, or with a climb [m] over it a part of a helix.

    `begin` [rad] is the direction from the centre (3,) to the first point, `sweep` [rad] how far it goes
    around, positive counterclockwise seen from above. Raises PathShapeError.
    """
    c = _point("arc", centre)
    if not (math.isfinite(radius) and radius > 0.0 and math.isfinite(sweep) and sweep != 0.0):
        raise PathShapeError(f"arc: radius {radius:g} m, sweep {sweep:g} rad; expected above 0 and not 0")
    rise = climb / sweep

    def curve(u: Array) -> tuple[Array, Array, Array]:
        out, along, flat = np.cos(begin + u * sweep), np.sin(begin + u * sweep), np.zeros_like(u)
        p = np.stack([c[0] + radius * out, c[1] + radius * along, c[2] + rise * sweep * u], 1)
        d1 = np.stack([-radius * along, radius * out, flat + rise], 1) * sweep
        d2 = np.stack([-radius * out, -radius * along, flat], 1) * sweep**2
        return p, d1, d2

    return of_curve(curve, 0.0, 1.0, max(4, math.ceil(_PIECES * abs(sweep) / math.tau)))


def ellipse(centre: Point, half_axes: Point, rise: float = 0.0) -> SpacePath:
    """Return the closed path (x + a cos t, y + b sin t, z + rise sin t), t from 0 to a full turn.

    `centre` (3,) and `half_axes` (2,) in metres. Raises PathShapeError.
    """
    c, (a, b) = _point("ellipse", centre), _half_axes("ellipse", half_axes)

    def curve(t: Array) -> tuple[Array, Array, Array]:
        cos, sin = np.cos(t), np.sin(t)
        p = c + np.stack([a * cos, b * sin, rise * sin], 1)
        return p, np.stack([-a * sin, b * cos, rise * cos], 1), c - p

    return of_curve(curve, 0.0, math.tau, _PIECES, closed=True)


def eight(centre: Point, half_axes: Point, rise: float = 0.0) -> SpacePath:
    """Return the closed path (x + a sin 2t, y + b sin t, z + rise cos t), t from 0 to a full turn.

    It crosses itself, as seen from above, in the centre. Raises PathShapeError.
    """
    c, (a, b) = _point("eight", centre), _half_axes("eight", half_axes)

    def curve(t: Array) -> tuple[Array, Array, Array]:
        cos, sin, cos2, sin2 = np.cos(t), np.sin(t), np.cos(2.0 * t), np.sin(2.0 * t)
        p = c + np.stack([a * sin2, b * sin, rise * cos], 1)
        d1 = np.stack([2.0 * a * cos2, b * cos, -rise * sin], 1)
        return p, d1, np.stack([-4.0 * a * sin2, -b * sin, -rise * cos], 1)

    return of_curve(curve, 0.0, math.tau, _PIECES, closed=True)


def _half_axes(name: str, half_axes: Point) -> tuple[float, float]:
    a, b = _point(name, half_axes, 2).tolist()
    if not (a > 0.0 and b > 0.0):
        raise PathShapeError(f"{name}: half axes {a:g} and {b:g} m; expected both above 0")
    return a, b


def polyline(points: Sequence[Point] | Array, radius: float = 0.0, closed: bool = False) -> SpacePath:
    """Return straight lines through points (m, 3) [m], their corners rounded by arcs of `radius` [m].

    With a radius of 0 corners stay: the vehicle has to stop there. Raises PathShapeError.
    """
    corners = [_point("line", p) for p in points]
    least = 3 if closed else 2
    if len(corners) < least:
        raise PathShapeError(f"line: {len(corners)} points, expected at least {least}")
    n = len(corners)
    ways = [corners[(k + 1) % n] - corners[k] for k in range(n if closed else n - 1)]
    require_length(math.fsum(float(np.linalg.norm(way)) for way in ways))
    inner = range(n) if closed else range(1, n - 1)
    arcs = [_rounding(corners, k, radius) if radius > 0.0 and k in inner else None for k in range(n)]
    pieces: list[SpacePath] = []
    for k, bend in enumerate(arcs if closed else arcs[:-1]):
        m = (k + 1) % n
        next_bend = arcs[m]
        begin = corners[k] if bend is None else bend.position[-1]
        end = corners[m] if next_bend is None else next_bend.position[0]
        if bend is not None and k > 0:
            pieces.append(bend)
        gap = float(np.linalg.norm(end - begin))
        if gap > SAME_PLACE and (end - begin) @ (corners[m] - corners[k]) < 0.0:
            raise _too_near(k, m, radius)
        if gap >= SAME_PLACE:
            pieces.append(line(begin, end))
        elif bend is None and next_bend is None:
            raise PathShapeError(f"line: point {m + 1} is where point {k + 1} is; leave one of them out")
    if closed and arcs[0] is not None:
        pieces.append(arcs[0])
    return joined(pieces, closed)


def _too_near(k: int, m: int, radius: float) -> PathShapeError:
    return PathShapeError(
        f"line: points {k + 1} and {m + 1} are too near to be rounded by {radius:g} m; give a smaller radius"
    )


def _rounding(points: list[Array], k: int, radius: float) -> SpacePath | None:
    """Return the arc that rounds corner k, None where the way goes straight on."""
    before, here, after = points[k - 1], points[k], points[(k + 1) % len(points)]
    ways = [here - before, after - here]
    sizes = [float(np.linalg.norm(way)) for way in ways]
    if min(sizes) < SAME_PLACE:
        raise PathShapeError(f"line: point {k + 1} is where a neighbour is; leave one of them out")
    d0, d1 = ways[0] / sizes[0], ways[1] / sizes[1]
    angle = turn(d0, d1)
    if angle < 1e-6:
        return None
    if angle > math.pi - 1e-3:
        raise PathShapeError(f"line: it turns back at point {k + 1}, which no radius rounds; stop there")
    tip = radius * math.tan(angle / 2.0)
    if tip > min(sizes) + SAME_PLACE:  # before its nodes are made: there may be any number of them
        first = k - 1 if tip > sizes[0] + SAME_PLACE else k
        raise _too_near(first % len(points), (first + 1) % len(points), radius)
    inward = (d1 - d0 * math.cos(angle)) / math.sin(angle)
    begin = here - tip * d0
    n = max(2, math.ceil(radius * angle / STEP) + 1)
    u = np.linspace(0.0, angle, n)[:, None]
    position = begin + radius * (np.sin(u) * d0 + (1.0 - np.cos(u)) * inward)
    tangent = np.cos(u) * d0 + np.sin(u) * inward
    bend = (np.cos(u) * inward - np.sin(u) * d0) / radius
    return SpacePath(radius * u[:, 0], position, tangent, bend)


def joined(pieces: Sequence[SpacePath], closed: bool = False) -> SpacePath:
    """Return one path of pieces that begin where the one before ends; raises PathJoinError."""
    if not pieces:
        raise PathShapeError("path: it has no pieces; expected at least one")
    if len(pieces) == 1 and pieces[0].closed:
        return pieces[0]
    require_length(math.fsum(piece.length for piece in pieces))
    last = len(pieces) - 1
    for k, piece in enumerate(pieces):
        if piece.closed:
            raise PathJoinError(f"piece {k + 1} is a closed path; it can only stand alone", k)
        if k < last or closed:
            there = pieces[(k + 1) % len(pieces)].position[0]
            gap = float(np.linalg.norm(there - piece.position[-1]))
            if gap > SAME_PLACE:
                x, y, z = piece.position[-1]
                n = (k + 1) % len(pieces)
                raise PathJoinError(
                    f"piece {n + 1} begins {gap:.3f} m from where piece {k + 1} ends "
                    f"({x:.3f}, {y:.3f}, {z:.3f}); let it begin there",
                    n,
                )
    s, columns = [pieces[0].s], [[getattr(pieces[0], name)] for name in _ARRAYS]
    for piece in pieces[1:]:
        smooth = turn(columns[1][-1][-1], piece.tangent[0]) <= SAME_DIRECTION
        cut = 1 if smooth else 0  # where the direction goes on, both have the same node
        if smooth and np.linalg.norm(piece.curvature[0]) > np.linalg.norm(columns[2][-1][-1]):
            columns[2][-1] = np.vstack([columns[2][-1][:-1], piece.curvature[:1]])
        s.append(s[-1][-1] + piece.s[cut:])
        for column, name in zip(columns, _ARRAYS, strict=True):
            column.append(getattr(piece, name)[cut:])
    position, tangent, curvature = (np.concatenate(column) for column in columns)
    return SpacePath(np.concatenate(s), position, tangent, curvature, closed)


_ARRAYS = ("position", "tangent", "curvature")
