"""How fast each place of a path is flown, and what cannot be flown at all."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from noctule.control.paths.space_path import PathShapeError, SpacePath
from noctule.geometry import Array
from noctule.messages import Limits
from noctule.settings import Settings

CAPTURE = 0.03  # [m]; a stop this near is held as a point


class PathSpeedError(PathShapeError):
    """A speed that the vehicle, or the path's own limits, do not allow at a place."""


class PathCurvatureError(PathShapeError):
    """A place so curved that no useful speed is left."""


class SpeedSettings(Settings):
    """How fast a path is flown."""

    cruise: float = Field(0.3, gt=0.0, le=5.0, description="where nothing asks for less [m/s]")
    acceleration: float = Field(0.5, gt=0.0, le=20.0, description="along the path, and to brake [m/s^2]")
    lateral: float = Field(1.0, gt=0.0, le=20.0, description="towards the inside of curves [m/s^2]")
    climb: float = Field(0.5, gt=0.0, le=5.0, description="upward and downward [m/s]")
    turn_rate: float = Field(1.0, gt=0.0, le=10.0, description="of the heading [rad/s]")
    slowest: float = Field(0.05, gt=0.0, le=5.0, description="a path that asks for less is refused [m/s]")
    slow_down: bool = Field(True, description="false: a path on which the cruise cannot be held is refused")
    stop_gain: float = Field(3.5, gt=0.0, le=20.0, description="speed per distance close to a stop [1/s]")


@dataclass(frozen=True, slots=True)
class SpeedProfile:
    """The speed over the arc length; straight between the nodes."""

    s: Array  # (n,) [m], those of the path
    v: Array  # (n,) [m/s]

    def at(self, s: float) -> tuple[float, float]:
        """Return the speed [m/s] at `s` [m], and its change along the path [1/s]."""
        i = min(max(int(self.s.searchsorted(s, side="right")) - 1, 0), len(self.s) - 2)
        length = float(self.s[i + 1] - self.s[i])
        v0, v1 = float(self.v[i]), float(self.v[i + 1])
        slope = (v1 - v0) / length if length > 0.0 else 0.0
        return v0 + slope * (s - float(self.s[i])), slope


def speed_profile(
    path: SpacePath,
    settings: SpeedSettings,
    turn_per_metre: Array | None = None,
    cruise: Array | None = None,
    limits: Limits | None = None,
) -> SpeedProfile:
    """Return the fastest profile that the settings allow; stops are no part of it.

    `turn_per_metre` (n,) [rad/m] is what the heading turns along the path, `cruise` (n,) [m/s] a cruise for
    every node instead of the settings' own, `limits` those of the vehicle. Raises PathSpeedError and
    PathCurvatureError, which name the place.
    """
    asked = np.full(path.s.size, settings.cruise) if cruise is None else np.asarray(cruise, dtype=np.float64)
    if limits is not None:
        _check_limits(path, asked, limits)
    bend = np.linalg.norm(path.curvature, axis=1)
    bounds = [
        (np.sqrt(settings.lateral / np.maximum(bend, 1e-9)), "its curvature", PathCurvatureError),
        (settings.climb / np.maximum(np.abs(path.tangent[:, 2]), 1e-9), "its climb", PathSpeedError),
    ]
    if turn_per_metre is not None:
        turning = settings.turn_rate / np.maximum(np.abs(turn_per_metre), 1e-9)
        bounds.append((turning, "the turn of the heading", PathSpeedError))
    v = asked
    for bound, what, error in bounds:
        i = _first_least(bound)
        if bound[i] < settings.slowest:
            radius = f", a radius of {1.0 / bend[i]:.3f} m" if error is PathCurvatureError else ""
            raise error(
                f"path: {what} at {path.place(float(path.s[i]))}{radius} allows {bound[i]:.3f} m/s, "
                f"less than the slowest of {settings.slowest:g} m/s; make it wider or allow more there"
            )
        if not settings.slow_down and (asked > bound * (1.0 + 1e-9)).any():
            i = _first_least(bound / asked)
            raise PathSpeedError(
                f"path: {what} at {path.place(float(path.s[i]))} allows {bound[i]:.2f} m/s of the "
                f"{asked[i]:.2f} m/s asked; fly slower, make it wider, or let it slow down"
            )
        v = np.minimum(v, bound)
    return SpeedProfile(path.s, _reachable(v, path, settings.acceleration))


def _first_least(values: Array) -> int:
    """Return the first of the least values: along an arc all are equal but for their rounding."""
    return int(np.flatnonzero(values <= float(values.min()) * (1.0 + 1e-6))[0])


def _check_limits(path: SpacePath, asked: Array, limits: Limits) -> None:
    level = min(limits.forward, limits.left)
    flat = np.hypot(path.tangent[:, 0], path.tangent[:, 1])
    steep = np.abs(path.tangent[:, 2])
    for share, limit, word in ((flat, level, "level flight"), (steep, limits.up, "climb")):
        over = np.flatnonzero(asked * share > limit * (1.0 + 1e-9))
        if over.size:
            i = int(over[0])
            raise PathSpeedError(
                f"path: {asked[i]:.2f} m/s at {path.place(float(path.s[i]))} is "
                f"{asked[i] * share[i]:.2f} m/s of {word}, the vehicle is allowed {limit:g} m/s; "
                "fly slower there"
            )


def _reachable(v: Array, path: SpacePath, acceleration: float) -> Array:
    """Cut the profile so that no change of speed needs more than the acceleration, either way."""
    squares = np.square(v).tolist()
    rises = (2.0 * acceleration * np.diff(path.s)).tolist()
    n = len(squares)
    # Around a closed path what comes after the seam bounds what is before it: go around twice.
    for _ in range(2 if path.closed else 1):
        for k in range(n - 1):
            squares[k + 1] = min(squares[k + 1], squares[k] + rises[k])
        if path.closed:
            squares[0] = min(squares[0], squares[-1])
        for k in range(n - 1, 0, -1):
            squares[k - 1] = min(squares[k - 1], squares[k] + rises[k - 1])
        if path.closed:
            squares[-1] = min(squares[0], squares[-1])
    return np.asarray(np.sqrt(np.array(squares)))


def approach_speed(distance: float, settings: SpeedSettings) -> float:
    """Return the speed [m/s] at which to come to a stop `distance` [m] ahead.

    Constant deceleration, and in proportion to the distance where that is the slower: no jump of the
    acceleration at the end. Negative beyond the stop.
    """
    a, gain = settings.acceleration, settings.stop_gain
    if abs(distance) <= a / gain**2:
        return gain * distance
    return math.copysign(math.sqrt(2.0 * a * (abs(distance) - a / (2.0 * gain**2))), distance)


def braking_distance(speed: float, settings: SpeedSettings) -> float:
    """Return the distance [m] at which `approach_speed` is `speed` [m/s]."""
    a, gain = settings.acceleration, settings.stop_gain
    v = max(speed, 0.0)
    return v / gain if v <= a / gain else v * v / (2.0 * a) + a / (2.0 * gain**2)
