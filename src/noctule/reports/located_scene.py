"""What a mission says of a located flight: the path that was wanted, the pushes, the people who walk by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from noctule.control.paths import SpacePath
from noctule.errors import NoctuleError
from noctule.flight.mission import Mission
from noctule.geometry import Array
from noctule.reports.located_log import Push
from noctule.simulation.ceiling import Walker
from noctule.simulation.spec import PushSpec

Walk = Callable[[float], tuple[float, float] | None]
"""Where somebody is at a time [s] of the flight's clock: x, y [m]; None while not in the room."""


@dataclass(frozen=True, slots=True)
class LocatedScene:
    """Of missions without a path in space, and of those that cannot be read, all is empty."""

    path: SpacePath | None = None
    pushed: tuple[PushSpec, ...] = ()
    walked: tuple[Walk, ...] = ()

    def pushes(self, start: float) -> tuple[Push, ...]:
        """Return the pushes, with times since `start` [s] of the flight's clock."""
        return tuple(
            Push(p.time_s - start, p.seconds, float(np.linalg.norm(p.acceleration_m_s2))) for p in self.pushed
        )

    def walks(self, stamps: Array) -> tuple[Array, ...]:
        """Return where people were at `stamps` (n,) [s], (n, 2) [m] each."""
        nowhere = (np.nan, np.nan)
        return tuple(np.array([at(stamp) or nowhere for stamp in stamps.tolist()]) for at in self.walked)


def located_scene(mission: Mission) -> LocatedScene:
    """Return what a mission says of its path, its pushes and its people."""
    if mission.space_path is None:
        return LocatedScene(pushed=mission.vehicle.pushes)
    try:
        plan = mission.space_plan()
    except NoctuleError:  # a rule that is newer than the recording: the way itself can still be drawn
        return LocatedScene(pushed=mission.vehicle.pushes)
    walkers = [person.walker(plan) for person in mission.people]
    return LocatedScene(plan.path, mission.vehicle.pushes, tuple(_walk(one) for one in walkers))


def _walk(walker: Walker) -> Walk:
    def at(stamp: float) -> tuple[float, float]:
        pose = walker.at(stamp)
        return pose.x, pose.y

    return at
