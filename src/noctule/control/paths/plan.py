"""A path as it is to be flown: speed, heading, stops, laps."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from noctule.control.paths.heading import AlongPath, HeadingRule, TurnSettings
from noctule.control.paths.space_path import PathShapeError, SpacePath
from noctule.control.paths.speed import SpeedProfile, SpeedSettings


class StopError(PathShapeError):
    """A stop that the path does not have."""


@dataclass(frozen=True, slots=True)
class Stop:
    """A stop on the path, at a time or at a place, and a change of heading while hovering there."""

    seconds: float  # [s]; at a place it begins on arrival, at a time it ends `seconds` after that time
    time: float | None = None  # [s] since the path was begun
    s: float | None = None  # [m] from the path's beginning, counted on over the laps
    yaw: float | None = None  # [rad] to turn to; None: the heading stays with the rule
    turn_after: float = 0.0  # [s] into the stop
    keep_yaw: bool = True  # also fly on with it; otherwise the rule holds again after the stop

    def __post_init__(self) -> None:
        """Refuse a stop that is nowhere, or does not do what it says."""
        if (self.time is None) == (self.s is None):
            raise StopError("stop: give either its time or its place s")
        numbers = [v for v in (self.seconds, self.time, self.s, self.turn_after) if v is not None]
        if not all(math.isfinite(v) and v >= 0.0 for v in numbers):
            raise StopError(f"stop: its times and places are {numbers}; expected numbers, none below 0")
        if self.time is not None and self.seconds == 0.0:
            raise StopError("stop: seconds is 0 at a time; expected more than 0")
        if self.turn_after > self.seconds:
            raise StopError(
                f"stop: turn_after = {self.turn_after:g} s is beyond its end at {self.seconds:g} s; "
                "turn earlier or stop longer"
            )
        if self.yaw is not None and not self.keep_yaw and self.turn_after == self.seconds:
            raise StopError(
                f"stop: it turns at its end at {self.seconds:g} s and does not keep the heading; "
                "turn earlier or keep it"
            )


@dataclass(frozen=True, slots=True)
class PathPlan:
    """All that it takes to fly a path; `planning.plan` makes one."""

    path: SpacePath
    profile: SpeedProfile
    speed: SpeedSettings
    heading: HeadingRule = field(default_factory=AlongPath)
    turning: TurnSettings = field(default_factory=TurnSettings)
    timed: tuple[Stop, ...] = ()  # in the order of their times
    placed: tuple[Stop, ...] = ()  # in the order of their places
    laps: int | None = 1  # None: around a closed path without end

    @property
    def total(self) -> float:
        """The way to fly [m]; infinite without an end."""
        if self.laps is None:
            return math.inf
        return self.laps * self.path.length
