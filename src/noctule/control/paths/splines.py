"""Smooth paths through waypoints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from noctule.control.paths.shapes import Point
from noctule.control.paths.space_path import SAME_PLACE, Curve, PathShapeError, SpacePath, of_curve
from noctule.geometry import Array

MOST_WAYPOINTS = 2000
_PIECES = 8  # of each span, for the arc length


def spline(points: Sequence[Point] | Array, closed: bool = False) -> SpacePath:
    """Return a path through waypoints (m, 3) [m] whose curvature does not jump.

    A cubic spline over centripetal knots (square roots of the chords): natural at the ends of an open path,
    periodic around a closed one, whose first point is not to be given again. Raises PathShapeError.
    """
    p = np.asarray(points, dtype=np.float64)
    least = 3 if closed else 2
    if p.ndim != 2 or p.shape[1] != 3 or len(p) < least or not np.isfinite(p).all():
        raise PathShapeError(f"spline: waypoints {p.shape}, expected ({least} or more, 3) finite numbers")
    if len(p) > MOST_WAYPOINTS:
        raise PathShapeError(f"spline: {len(p)} waypoints, expected at most {MOST_WAYPOINTS}; thin them out")
    if closed:
        p = np.vstack([p, p[:1]])
    chords = np.linalg.norm(np.diff(p, axis=0), axis=1)
    if (chords < SAME_PLACE).any():
        k = int(np.flatnonzero(chords < SAME_PLACE)[0])
        other = (k + 1) % (len(p) - 1) if closed else k + 1
        raise PathShapeError(f"spline: waypoint {other + 1} is where waypoint {k + 1} is; leave one out")
    knots = knots_of(p)
    bend = _second_derivatives(p, np.diff(knots), closed)

    def curve(u: Array) -> tuple[Array, Array, Array]:
        k = np.clip(np.searchsorted(knots, u, side="right") - 1, 0, len(knots) - 2)
        h = (knots[k + 1] - knots[k])[:, None]
        b = (u - knots[k])[:, None] / h
        a = 1.0 - b
        m0, m1, p0, p1 = bend[k], bend[k + 1], p[k], p[k + 1]
        position = a * p0 + b * p1 + ((a**3 - a) * m0 + (b**3 - b) * m1) * h**2 / 6.0
        first = (p1 - p0) / h + ((3.0 * b**2 - 1.0) * m1 - (3.0 * a**2 - 1.0) * m0) * h / 6.0
        return position, first, a * m0 + b * m1

    # Knots count in square roots of metres; equal parts of the parameter would miss the short spans.
    return _per_span(curve, knots, closed)


def knots_of(points: Array) -> Array:
    """Return the centripetal knots (m,) of waypoints (m, 3)."""
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(np.sqrt(chords))])


def _second_derivatives(p: Array, h: Array, closed: bool) -> Array:
    """Return the spline's second derivatives by the knots' parameter, (m, 3)."""
    n = len(p)
    slopes = np.diff(p, axis=0) / h[:, None]
    A, rhs = np.zeros((n, n)), np.zeros((n, 3))
    for k in range(1, n - 1):
        A[k, k - 1 : k + 2] = h[k - 1], 2.0 * (h[k - 1] + h[k]), h[k]
        rhs[k] = 6.0 * (slopes[k] - slopes[k - 1])
    if closed:
        A[0, 0], A[0, 1], A[0, n - 2] = 2.0 * (h[-1] + h[0]), h[0], h[-1]
        rhs[0] = 6.0 * (slopes[0] - slopes[-1])
        A[-1, 0], A[-1, -1] = 1.0, -1.0
    else:
        A[0, 0] = A[-1, -1] = 1.0
    return np.asarray(np.linalg.solve(A, rhs))


def _per_span(curve: Curve, knots: Array, closed: bool) -> SpacePath:
    spans = len(knots) - 1

    def even(u: Array) -> tuple[Array, Array, Array]:
        k = np.clip(np.floor(u).astype(np.int64), 0, spans - 1)
        h = (knots[k + 1] - knots[k])[:, None]
        p, d1, d2 = curve(knots[k] + (u - k) * h[:, 0])
        return p, d1 * h, d2 * h**2

    return of_curve(even, 0.0, float(spans), _PIECES * spans, closed)
