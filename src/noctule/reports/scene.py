"""The flight's surroundings, from the mission that a recording carries: room, hull, limits, key images."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from noctule.flight.reader import Recording
from noctule.geometry import Array
from noctule.messages import Limits
from noctule.reports.flight_log import Hull, Solid
from noctule.simulation.layout import draw_layout, room_layout
from noctule.simulation.spec import RoomSpec


@dataclass(frozen=True, slots=True)
class Scene:
    """What a recording says of where and with what was flown; empty where it says nothing."""

    about: dict[str, str] = field(default_factory=dict)
    text: str = ""
    limits: Limits = field(default_factory=Limits)
    hull: Hull = field(default_factory=Hull)
    solids: tuple[Solid, ...] = ()
    room: Array | None = None
    key_poses: Array = field(default_factory=lambda: np.empty((0, 4)))
    epsilon_limit: float | None = None
    safety_area: tuple[float, float, float, float] | None = None
    notes: tuple[str, ...] = ()

    def drawn(self) -> dict[str, Any]:
        """Return the fields that a FlightLog has under the same names."""
        names = ("limits", "hull", "solids", "room", "key_poses", "epsilon_limit", "safety_area")
        return {name: getattr(self, name) for name in names}


def room_solids(spec: RoomSpec) -> tuple[Solid, ...]:
    """Return everything that stands in a simulated room, with its heights."""
    standing = draw_layout(spec).solids
    prints = [p for p in room_layout(spec) if p.kind != "wall"]
    return tuple(
        Solid(p.kind, p.polygon, s.centre[2] - s.half[2], s.centre[2] + s.half[2], p.name, p.rgb)
        for p, s in zip(prints, standing, strict=True)
    )


def room_corners(spec: RoomSpec) -> Array:
    """Return the lowest and the highest corner between the walls, (2, 3) [m]."""
    return np.array([[spec.x_min, spec.y_min, 0.0], [spec.x_max, spec.y_max, spec.size[2]]])


def read_scene(recording: Recording) -> Scene:
    """Return what the recording's notes and files say."""
    return Scene()
