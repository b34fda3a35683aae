"""Where a column stands and how wide it is, from its two edges and the vehicle's own motion.

Bearing and apparent size are measured; distance and width are not, but while the vehicle comes nearer the
column looms, and the rate of growth tells the distance without any assumption on the width. In modified
polar coordinates (bearing, log distance, log radius) both measurements are linear, so an extended Kalman
filter of three states is enough and starts well from a vague width. The polar coordinates are centred on
the camera, not on the body: only so does apparent size depend on the ratio of radius and distance alone,
and a vague start stays vague until the vehicle has moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noctule.geometry import Array, wrap_angle

_GROWTH_SD = 0.3  # of the log of apparent size between pictures; columns that overlap in the picture do worse


@dataclass(frozen=True, slots=True)
class ColumnPrior:
    """What is expected of a column before the vehicle has moved, and the noise of the measurements."""

    radius: float = 0.04  # [m], half the width
    radius_log_sd: float = 0.7  # a factor of two either way
    bearing_sd: float = 0.004  # [rad], of one edge, with what the attitude leaves
    size_sd: float = 0.002  # [rad], of the half angle between the edges: pixels and shape
    drift: float = 0.05  # [m / sqrt(s)], of the odometry


@dataclass(frozen=True, slots=True)
class ColumnEstimate:
    """A vertical column seen from the camera, in the levelled heading frame."""

    x: Array  # (3,): bearing [rad, left positive], log(distance / 1 m), log(radius / 1 m)
    P: Array  # (3, 3)
    unseen: float = 0.0  # [s] since the last measurement

    @property
    def centre(self) -> Array:
        """The axis, (2,) [m]: forward and left of the camera."""
        d = float(np.exp(self.x[1]))
        return np.array([d * np.cos(self.x[0]), d * np.sin(self.x[0])])

    @property
    def distance(self) -> float:
        """Distance of the axis from the camera [m]."""
        return float(np.exp(self.x[1]))

    @property
    def radius(self) -> float:
        """Half the width [m]."""
        return float(np.exp(self.x[2]))


def begin_column(left: float, right: float, prior: ColumnPrior) -> ColumnEstimate:
    """Start from the bearings [rad, left positive] of the two edges."""
    bearing, half = 0.5 * (left + right), max(0.5 * (left - right), 1e-3)
    x = np.array([bearing, np.log(prior.radius / np.sin(half)), np.log(prior.radius)])
    s2 = prior.radius_log_sd**2
    P = np.array(
        [
            [prior.bearing_sd**2, 0.0, 0.0],
            [0.0, s2 + (prior.size_sd / half) ** 2, s2],
            [0.0, s2, s2],
        ]
    )
    return ColumnEstimate(x, P)


def move_column(
    column: ColumnEstimate, step: Array, turn: float, dt: float, prior: ColumnPrior
) -> ColumnEstimate:
    """Predict over `dt` [s] in which the camera moved by `step` (2,) [m] (old heading frame) and turned."""
    d, b = column.distance, float(column.x[0])
    cx, cy = d * np.cos(b) - step[0], d * np.sin(b) - step[1]
    new = max(float(np.hypot(cx, cy)), 1e-3)
    bearing = float(np.arctan2(cy, cx))
    x = np.array([wrap_angle(bearing - turn), np.log(new), column.x[2]])
    # d(bearing', log d') / d(bearing, log d): a rotation scaled by d / d', in the (tangential, radial) basis.
    c, s = np.cos(b - bearing), np.sin(b - bearing)
    F = np.eye(3)
    F[:2, :2] = d / new * np.array([[c, s], [-s, c]])
    q = (prior.drift / new) ** 2 * dt
    return ColumnEstimate(x, F @ column.P @ F.T + np.diag([q, q, 0.0]), column.unseen + dt)


def _half_angle(x: Array) -> float:
    """Return half the angle [rad] between the edges of a column with state x (3,)."""
    return float(np.arcsin(min(np.exp(x[2] - x[1]), 0.99)))


def update_column(
    column: ColumnEstimate, edges: tuple[float | None, float | None], prior: ColumnPrior
) -> ColumnEstimate:
    """Update with the bearings [rad, left positive] of the left and the right edge as the camera sees them.

    An edge that lies outside the picture is None; then only the other is used.
    """
    seen = [i for i, edge in enumerate(edges) if edge is not None]
    if not seen:
        return column
    # Rows of G take (bearing, half angle) to the edges: left = bearing + half, right = bearing - half.
    G = np.array([[1.0, 1.0], [1.0, -1.0]])[seen]
    z = np.array([edges[i] for i in seen], dtype=np.float64)
    x, P = column.x, column.P
    half = _half_angle(x)
    slope = np.tan(half)  # d(half) / d(log radius): sin(half) = radius / distance
    H = G @ np.array([[1.0, 0.0, 0.0], [0.0, -slope, slope]])
    noise = G @ np.diag([prior.bearing_sd**2, prior.size_sd**2]) @ G.T
    S = H @ P @ H.T + noise
    gain = np.linalg.solve(S, H @ P).T
    x = x + gain @ (z - G @ np.array([x[0], half]))
    x[0] = wrap_angle(float(x[0]))
    A = np.eye(3) - gain @ H
    return ColumnEstimate(x, A @ P @ A.T + gain @ noise @ gain.T, 0.0)


def column_distance2(
    column: ColumnEstimate, edges: tuple[float | None, float | None], prior: ColumnPrior
) -> float:
    """Return the squared Mahalanobis distance of a detection from this column: bearing, and apparent size.

    With one edge out of the picture there is no size, and the bearing is that edge's.
    """
    left, right = edges
    half = _half_angle(column.x)
    if left is None or right is None:
        edge, expected = (left, column.x[0] + half) if left is not None else (right, column.x[0] - half)
        off = np.inf if edge is None else wrap_angle(edge - float(expected))
        return float(off**2 / (prior.bearing_sd**2 + column.P[0, 0] + half**2))
    spread = prior.bearing_sd**2 + float(column.P[0, 0]) + 0.25 * half**2
    off = wrap_angle(0.5 * (left + right) - float(column.x[0]))
    growth = np.log(max(0.5 * (left - right), 1e-3) / half)
    return float(off**2 / spread + (growth / _GROWTH_SD) ** 2)
