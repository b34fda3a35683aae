"""Where the nose points along a path, and how it gets there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from pydantic import Field

from noctule.control.paths.space_path import PathPoint, PathShapeError, SpacePath
from noctule.geometry import Array, wrap_angle
from noctule.settings import Settings

_STEEP = 0.05  # horizontal part of a tangent below which it has no heading


@dataclass(frozen=True, slots=True)
class AlongPath:
    """The nose points along the path; on a vertical piece it stays as it was."""


@dataclass(frozen=True, slots=True)
class FixedHeading:
    """The nose always points the same way."""

    yaw: float = 0.0  # [rad]


@dataclass(frozen=True, slots=True)
class FacePoint:
    """The nose points at a place."""

    x: float  # [m], world
    y: float  # [m]


@dataclass(frozen=True, slots=True)
class GivenHeading:
    """The heading is given at places along the path and turns evenly between them."""

    s: Array  # (m,) [m]
    yaw: Array  # (m,) [rad], unwrapped

    @classmethod
    def of(cls, s: Array, yaw: Array) -> GivenHeading:
        """Return the heading that goes the short way from each `yaw` (m,) [rad] to the next."""
        turns = [wrap_angle(float(b - a)) for a, b in pairwise(yaw)]
        return cls(np.asarray(s), float(yaw[0]) + np.concatenate([[0.0], np.cumsum(turns)]))


HeadingRule = AlongPath | FixedHeading | FacePoint | GivenHeading


def heading_at(rule: HeadingRule, point: PathPoint, s: float) -> tuple[float, float] | None:
    """Return the heading [rad] at a point, and its turn along the path [rad/m]; None where it has none.

    `s` [m] is the arc length of the point within the path.
    """
    if isinstance(rule, FixedHeading):
        return wrap_angle(rule.yaw), 0.0
    if isinstance(rule, GivenHeading):
        k = min(max(int(rule.s.searchsorted(s, side="right")) - 1, 0), len(rule.s) - 2)
        slope = float((rule.yaw[k + 1] - rule.yaw[k]) / (rule.s[k + 1] - rule.s[k]))
        at = min(max(s, float(rule.s[0])), float(rule.s[-1]))
        return wrap_angle(float(rule.yaw[k]) + slope * (at - float(rule.s[k]))), slope
    tx, ty = float(point.tangent[0]), float(point.tangent[1])
    if isinstance(rule, FacePoint):
        dx, dy = rule.x - float(point.position[0]), rule.y - float(point.position[1])
        square = dx * dx + dy * dy
        if square < 1e-6:
            return None
        return math.atan2(dy, dx), (dy * tx - dx * ty) / square
    square = tx * tx + ty * ty
    if square < _STEEP**2:
        return None
    bend = (tx * float(point.curvature[1]) - ty * float(point.curvature[0])) / square
    return math.atan2(ty, tx), bend


def turn_per_metre(rule: HeadingRule, path: SpacePath) -> Array:
    """Return what the rule turns at every node, (n,) [rad/m]. Raises PathShapeError."""
    if isinstance(rule, FacePoint):
        near = np.hypot(path.position[:, 0] - rule.x, path.position[:, 1] - rule.y)
        i = int(np.argmin(near))
        if near[i] < 0.05:
            raise PathShapeError(
                f"path: it passes {near[i]:.2f} m from the point to look at, at "
                f"{path.place(float(path.s[i]))}; look at one that is farther off"
            )
    turns = np.zeros(path.s.size)
    for i in range(path.s.size):
        point = PathPoint(float(path.s[i]), path.position[i], path.tangent[i], path.curvature[i])
        found = heading_at(rule, point, point.s)
        turns[i] = 0.0 if found is None else found[1]
    return turns


class TurnSettings(Settings):
    """How the wanted heading itself moves, so that the controller never sees it jump."""

    rate: float = Field(1.2, gt=0.0, le=10.0, description="fastest turn [rad/s]")
    acceleration: float = Field(1.5, gt=0.0, le=50.0, description="change of the rate [rad/s^2]")
    gain: float = Field(3.0, gt=0.0, le=20.0, description="rate per angle close to the rule's heading [1/s]")


@dataclass(frozen=True, slots=True)
class TurnReference:
    """The wanted heading, its rate and the acceleration that the rate has now."""

    yaw: float  # [rad], wrapped
    rate: float = 0.0  # [rad/s]
    acceleration: float = 0.0  # [rad/s^2]

    def step(self, target: float, target_rate: float, dt: float, settings: TurnSettings) -> TurnReference:
        """Return the reference `dt` [s] later, on its way to a heading that itself moves.

        The short way round; of two ways equally short the counterclockwise one.
        """
        if dt <= 0.0:
            return replace(self, acceleration=0.0)
        error = wrap_angle(target - self.yaw)
        a, gain = settings.acceleration, settings.gain
        closing = gain * abs(error)
        if abs(error) > a / gain**2:
            closing = math.sqrt(2.0 * a * (abs(error) - a / (2.0 * gain**2)))
        wanted = target_rate + math.copysign(closing, error)
        wanted = min(max(wanted, -settings.rate), settings.rate)
        rate = min(max(wanted, self.rate - a * dt), self.rate + a * dt)
        yaw = wrap_angle(self.yaw + 0.5 * (self.rate + rate) * dt)
        return TurnReference(yaw, rate, (rate - self.rate) / dt)
