"""The flight's surroundings, from the mission that a recording carries: room, hull, limits, key images."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pydantic import ValidationError

from noctule.flight.mission import Mission
from noctule.flight.reader import Recording
from noctule.geometry import Array
from noctule.messages import Limits
from noctule.pilots.perception import safety_box
from noctule.reports.flight_log import Hull, Solid
from noctule.reports.located_scene import LocatedScene, located_scene
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
    located: LocatedScene = field(default_factory=LocatedScene)

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
    """Return what the recording's notes and files say; what cannot be read is left out with a note."""
    flight = recording.notes.get("flight", {})
    about: dict[str, str] = {name: flight[name] for name in ("mission", "law", "seed") if name in flight}
    about["pictures"] = "exact" if recording.lossless else "compressed"
    about |= dict(sorted(recording.notes.get("versions", {}).items()))
    text = recording.files.get("mission.toml", b"").decode("utf-8", "replace")
    key_poses = _key_poses(recording.notes.get("truth", {}).get("key_poses", "[]"))
    scene = Scene(about=about, text=text, key_poses=key_poses)
    try:
        mission = Mission.model_validate_json(recording.files.get("mission.json", b""))
    except ValidationError:
        remark = "The mission in this recording cannot be read: no room is drawn, limits are the usual ones."
        return replace(scene, notes=(remark,))
    if flight.get("simulated") == "true":
        scene = replace(scene, solids=room_solids(mission.room), room=room_corners(mission.room))
    vehicle, pilot = mission.vehicle, mission.pilot
    box = safety_box(mission.camera.width, mission.camera.height)
    return replace(
        scene,
        limits=mission.limits.values(),
        hull=Hull(vehicle.hull_diameter / 2.0, vehicle.hull_height),
        epsilon_limit=pilot.published.epsilon_last_px if pilot.law == "published" else None,
        safety_area=(box.left, box.top, box.right, box.bottom),
        located=located_scene(mission),
    )


def _key_poses(text: str) -> Array:
    rows = json.loads(text)
    return np.array([row[:4] for row in rows], dtype=np.float64).reshape(-1, 4)
