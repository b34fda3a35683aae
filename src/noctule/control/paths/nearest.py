"""The nearest point of a path, searched near where it last was."""

from __future__ import annotations

import numpy as np

from noctule.compiled import compiled
from noctule.control.paths.space_path import PathPoint, SpacePath, sample, segment_of
from noctule.geometry import Array

WINDOW = 0.3  # [m], how far along the path the nearest point may have moved since the last tick
RIDGE = 0.02  # [m]; what lies behind a rise of the distance by more is another branch


def nearest(path: SpacePath, x: Array, last: float, low: float = -np.inf, high: float = np.inf) -> float:
    """Return the arc length [m] of the point nearest to `x` (3,) [m], searched within WINDOW of `last` [m].

    The search goes from `last` both ways along the segments and ends where the distance has risen by RIDGE
    above the least so far, so that it stays on its own branch where the path crosses itself or comes back
    close by. `low` and `high` [m] bound it. Around a closed path the arc length counts on.
    """
    low, high = max(low, last - WINDOW), min(high, last + WINDOW)
    return nearest_between(
        path.s, path.position, path.tangent, path.curvature, path.closed, x, last, low, high
    )


def foot(
    path: SpacePath, x: Array, last: float, low: float = -np.inf, high: float = np.inf
) -> tuple[PathPoint, float]:
    """Return the nearest point as `nearest` finds it, and how fast [m/s] it moves along the path.

    `x` (8,) is the state: x, y, z [m], yaw [rad], their rates in the world.
    """
    low, high = max(low, last - WINDOW), min(high, last + WINDOW)
    s, flown, p = foot_between(
        path.s, path.position, path.tangent, path.curvature, path.closed, x, last, low, high
    )
    return PathPoint(s, p[:3], p[3:6], p[6:]), flown


def nearest_anywhere(path: SpacePath, x: Array) -> float:
    """Return the arc length [m], within once around, of the point of the whole path nearest to `x` (3,)."""
    i = int(np.argmin(((path.position - x) ** 2).sum(axis=1)))
    return path.within(nearest(path, x, float(path.s[i])))


@compiled
def nearest_between(
    nodes: Array,
    position: Array,
    tangent: Array,
    curvature: Array,
    closed: bool,
    x: Array,
    last: float,
    low: float,
    high: float,
) -> float:
    """Return what `nearest` does, with all its bounds given; all lengths are those of the counting s."""
    total = nodes[-1]
    if not closed:
        low, high = max(low, 0.0), min(high, total)
    if high <= low:
        return low
    last = min(max(last, low), high)
    lap = np.floor(last / total) if closed else 0.0
    first = segment_of(nodes, last - lap * total)
    best, best_s = np.inf, last
    for way in (1, -1):
        i, offset, least = first, lap * total, np.inf
        while True:
            begin, length = nodes[i] + offset, nodes[i + 1] - nodes[i]
            if begin > high or begin + length < low:
                break
            if length > 0.0:
                # The foot on the chord, within the bounds.
                dot, square = 0.0, 0.0
                for k in range(3):
                    chord = position[i + 1, k] - position[i, k]
                    dot += chord * (x[k] - position[i, k])
                    square += chord * chord
                s = min(max(begin + length * min(max(dot / square, 0.0), 1.0), low), high)
                u = (s - begin) / length
                distance = 0.0
                for k in range(3):
                    gap = position[i, k] + u * (position[i + 1, k] - position[i, k]) - x[k]
                    distance += gap * gap
                distance = np.sqrt(distance)
                if distance < best - 1e-12:
                    best, best_s = distance, s
                least = min(least, distance)
                if distance > least + RIDGE:
                    break
            i += way
            if i < 0 or i > nodes.size - 2:
                if not closed:
                    break
                offset += way * total
                i = 0 if way > 0 else nodes.size - 2
    return _refined(nodes, position, tangent, curvature, closed, x, best_s, low, high)


@compiled
def foot_between(
    nodes: Array,
    position: Array,
    tangent: Array,
    curvature: Array,
    closed: bool,
    x: Array,
    last: float,
    low: float,
    high: float,
) -> tuple[float, float, Array]:
    """Return what `foot` does, the point as (9,), with all its bounds given."""
    s = nearest_between(nodes, position, tangent, curvature, closed, x, last, low, high)
    total = nodes[-1]
    within = s - np.floor(s / total) * total if closed else min(max(s, 0.0), total)
    p = sample(nodes, position, tangent, curvature, within)
    return s, foot_speed(p[:3], p[3:6], p[6:], x), p


@compiled
def foot_speed(position: Array, tangent: Array, curvature: Array, x: Array) -> float:
    """Return how fast [m/s] the nearest point, as in PathPoint, moves along the path under `x` (8,)."""
    along, inside = 0.0, 0.0
    for k in range(3):
        along += x[4 + k] * tangent[k]
        inside += (x[k] - position[k]) * curvature[k]
    return along / max(1.0 - inside, 0.2)


@compiled
def _refined(
    nodes: Array,
    position: Array,
    tangent: Array,
    curvature: Array,
    closed: bool,
    x: Array,
    s: float,
    low: float,
    high: float,
) -> float:
    """Take the chord's error out: Newton's method on (x - p(s)) . t(s) = 0."""
    total = nodes[-1]
    for _ in range(3):
        q = sample(nodes, position, tangent, curvature, s - np.floor(s / total) * total if closed else s)
        along, bend = 0.0, 0.0
        for k in range(3):
            along += (x[k] - q[k]) * q[3 + k]
            bend += (x[k] - q[k]) * q[6 + k]
        # Beyond the centre of the curve there is no foot to converge to.
        move = along / max(1.0 - bend, 0.2)
        s = min(max(s + min(max(move, -0.01), 0.01), low), high)
    return s
