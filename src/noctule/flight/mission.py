"""The mission file: what flies, where, along which path, by which law, within which limits."""

from __future__ import annotations

import difflib
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import Field, PrivateAttr, ValidationError, field_validator, model_validator

from noctule.control.cascade import DelayTooLongError
from noctule.control.paths import PathPlan
from noctule.errors import NoctuleError
from noctule.estimation.identification import VehicleModelSettings
from noctule.flight.mission_groups import (
    FenceSettings,
    FlightSettings,
    PathPose,
    PathSettings,
    RecordingSettings,
    StartSettings,
)
from noctule.flight.mission_located import CeilingSettings, PersonSettings, SpacePathSettings, model_of
from noctule.flight.path_view import UnseenPathError, unseen
from noctule.flight.setting_errors import explain
from noctule.flight.supervisor import Bounds
from noctule.flight.toml_lines import key_lines
from noctule.geometry import Array
from noctule.localization.vehicle_file import load_vehicle_model
from noctule.pilots.located_settings import HandoverSettings, LocatedSettings
from noctule.pilots.settings import PilotSettings
from noctule.settings import Settings
from noctule.simulation.ceiling.room import lab_room
from noctule.simulation.dynamics import UnknownModelError, check_model_name
from noctule.simulation.spec import CameraSpec, LimitsSpec, RoomSpec, VehicleSpec

__all__ = [
    "CeilingSettings",
    "FenceSettings",
    "FlightSettings",
    "Mission",
    "MissionFileError",
    "PathPose",
    "PathSettings",
    "PersonSettings",
    "RecordingSettings",
    "SpacePathSettings",
    "StartSettings",
    "UnknownMissionError",
    "bundled_missions",
    "check_flyable",
    "load_mission",
    "parse_mission",
]
_BELOW_CEILING = 0.05  # [m], of the camera's eye
_OF_LOCATED = ("located", "handover", "ceiling", "vehicle_model", "people")


class MissionFileError(NoctuleError):
    """A mission file with mistakes, one a line."""


class UnknownMissionError(NoctuleError):
    """A name that is neither a bundled mission nor a file."""


class Mission(Settings):
    """A whole mission; every group has defaults, but it needs a path, a space_path, or both.

    With both the path in space ends where the visual one begins, and the flight is handed over there. With a
    space_path and no room it is flown in the laboratory of the experiments.
    """

    name: str = Field("mission", min_length=1, max_length=80, description="what it is called")
    description: str = Field("", max_length=200, description="one line for the list of missions")
    room: RoomSpec = RoomSpec()
    vehicle: VehicleSpec = VehicleSpec()
    camera: CameraSpec = CameraSpec()
    start: StartSettings = StartSettings()
    path: PathSettings | None = None
    pilot: PilotSettings = PilotSettings()
    space_path: SpacePathSettings | None = None
    located: LocatedSettings = LocatedSettings()
    handover: HandoverSettings = HandoverSettings()
    ceiling: CeilingSettings = CeilingSettings()
    vehicle_model: VehicleModelSettings | None = None
    people: tuple[PersonSettings, ...] = Field((), max_length=20)
    limits: LimitsSpec = LimitsSpec()
    fence: FenceSettings = FenceSettings()
    flight: FlightSettings = FlightSettings()
    recording: RecordingSettings = RecordingSettings()
    _text: str = PrivateAttr("")

    @model_validator(mode="before")
    @classmethod
    def _in_the_lab(cls, given: Any) -> Any:
        # The usual room is lower than the usual ceiling camera hangs.
        if isinstance(given, dict) and given.get("space_path") and "room" not in given:
            return {**given, "room": lab_room(0)}
        return given

    @field_validator("vehicle")
    @classmethod
    def _known_model(cls, vehicle: VehicleSpec) -> VehicleSpec:
        try:
            check_model_name(vehicle.model)
        except UnknownModelError as error:
            raise ValueError(str(error)) from None
        return vehicle

    @model_validator(mode="after")
    def _something_to_fly(self) -> Self:
        if self.path is None and self.space_path is None:
            raise ValueError("there is nothing to fly: give a path, a space_path, or both")
        for name in _OF_LOCATED if self.space_path is None else ():
            if getattr(self, name) != type(self).model_fields[name].default:
                raise ValueError(f"{name} belongs to a space_path; give one or leave it out")
        if self.path is None and self.handover != HandoverSettings():
            raise ValueError("handover is to a visual path; give a path or leave it out")
        return self

    @property
    def text(self) -> str:
        """The TOML text it was read from, empty when it was made in Python."""
        return self._text

    @property
    def law(self) -> str:
        """What it is flown by: the law of its visual path, or "located" where there is none."""
        return "located" if self.path is None else self.pilot.law

    @property
    def bounds(self) -> Bounds:
        """What the supervisor holds the flight to."""
        return Bounds(
            limits=self.limits.values(),
            fence=self.fence.values(self.room),
            picture_age=self.flight.picture_max_age_s + self.pilot.picture_latency_s,
            depth_age=self.ceiling.max_age_s,
            located_state_age=self.ceiling.silence_s,
        )

    @property
    def known_vehicle(self) -> VehicleModelSettings:
        """What a located pilot knows of the vehicle: the given model, or that of the simulated one."""
        return model_of(self.vehicle) if self.vehicle_model is None else self.vehicle_model

    def space_plan(self, name: str | None = None) -> PathPlan:
        """Return what is to be flown in space; the mission has a space_path, and is called `name` in errors.

        Raises SpacePathFileError.
        """
        assert self.space_path is not None
        name = f"mission {self.name}" if name is None else name
        return self.space_path.plan(self.limits.values(), name, key_lines(self._text))


def parse_mission(text: str, name: str, base: Path | None = None) -> Mission:
    """Read a mission from TOML text; `name` stands in its errors, files are relative to `base`.

    Raises
    ------
    MissionFileError
        With one line per mistake: file, line, field, given value, accepted range.
    """
    try:
        mission = Mission.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise MissionFileError(f"{name}: this is not TOML: {error}; mend it there") from None
    except ValidationError as error:
        raise MissionFileError(explain(error, Mission, text, name)) from None
    mission = _with_files(mission, base)
    mission._text = text
    if mission.space_path is not None:
        check_flyable(mission, name)
    return mission


def _with_files(mission: Mission, base: Path | None) -> Mission:
    """Return the mission with its files found, relative to `base`, and the small ones read."""
    update: dict[str, Any] = {}
    if mission.path is not None and mission.path.folder is not None and base is not None:
        update["path"] = mission.path.model_copy(update={"folder": base / mission.path.folder})
    if mission.space_path is not None:
        update["space_path"] = mission.space_path.read(base)
    ceiling = mission.ceiling
    if ceiling.vehicle is not None and mission.vehicle_model is None:
        file = ceiling.vehicle if base is None else base / ceiling.vehicle
        update["vehicle_model"] = load_vehicle_model(file)
    if ceiling.site is not None and base is not None:
        update["ceiling"] = ceiling.model_copy(update={"site": base / ceiling.site})
    return mission.model_copy(update=update)


def check_flyable(mission: Mission, name: str) -> PathPlan:
    """Return the plan of a mission's path in space, refused where it cannot be flown.

    Raises
    ------
    SpacePathFileError
        When the path asks for more than the limits, at its place on the path.
    MissionFileError
        When it, or the start, is outside of the fence, the ceiling camera outside of the room, it never
        ends, or the vehicle answers too late.
    UnseenPathError
        When the ceiling camera cannot see the drone somewhere along it, or at the start.
    """
    plan = mission.space_plan(name)
    fence = mission.fence.values(mission.room)
    ceiling = mission.ceiling.spec
    begin = mission.start.nominal.position
    _require_in_room(mission, name)
    for position, what in ((plan.path.position, "space_path: it"), (begin[None], "start: it")):
        outside = ((position < np.array(fence.low)) | (position > np.array(fence.high))).any(axis=1)
        if outside.any():
            raise MissionFileError(
                f"{name}: {what} is outside of the fence at {_place(plan, position, int(outside.argmax()))}; "
                f"expected x {fence.low[0]:g} to {fence.high[0]:g}, y {fence.low[1]:g} to {fence.high[1]:g}, "
                f"z {fence.low[2]:g} to {fence.high[2]:g} m"
            )
        found = unseen(ceiling.camera, ceiling.nearest_m, ceiling.farthest_m, position)
        if found is not None:
            k, why = found
            raise UnseenPathError(f"{name}: {what} is at {_place(plan, position, k)} {why}")
    if plan.laps is None and mission.located.end_after_s is None:
        raise MissionFileError(
            f"{name}: space_path: it is endless, and nothing ends it; give laps, or located.end_after_s"
        )
    try:
        mission.located.follower.cascade.check_delay(mission.known_vehicle.delay_s)
    except DelayTooLongError as error:
        raise MissionFileError(f"{name}: {error}") from None
    return plan


def _require_in_room(mission: Mission, name: str) -> None:
    camera, room = mission.ceiling, mission.room
    x, y, z = camera.x_m, camera.y_m, camera.z_m
    if room.x_min < x < room.x_max and room.y_min < y < room.y_max and z <= room.size[2] - _BELOW_CEILING:
        return
    raise MissionFileError(
        f"{name}: ceiling: the camera hangs at ({x:.2f}, {y:.2f}, {z:.2f}) m, outside of the room; "
        f"expected x {room.x_min:g} to {room.x_max:g}, y {room.y_min:g} to {room.y_max:g}, z up to "
        f"{room.size[2] - _BELOW_CEILING:g} m; move it, or make room.size larger"
    )


def _place(plan: PathPlan, position: Array, k: int) -> str:
    """Return in words where position k of the path, or of the one place where the flight begins, is."""
    if len(position) > 1:
        return plan.path.place(float(plan.path.s[k]))
    x, y, z = position[0]
    return f"({x:.2f}, {y:.2f}, {z:.2f})"


def _bundled() -> dict[str, str]:
    folder = files("noctule.flight") / "missions"
    found = [f for f in folder.iterdir() if f.name.endswith(".toml")]
    return {f.name.removesuffix(".toml"): f.read_text("utf-8") for f in sorted(found, key=lambda f: f.name)}


def bundled_missions() -> dict[str, str]:
    """Return the missions that come with Noctule: name -> what it is, in one line."""
    return {name: parse_mission(text, name).description for name, text in _bundled().items()}


def load_mission(name_or_path: str | Path) -> Mission:
    """Return a bundled mission by its name, or the mission in a file.

    Raises
    ------
    UnknownMissionError
        When there is neither.
    MissionFileError
        With one line per mistake in the file.
    """
    name, path = str(name_or_path), Path(name_or_path)
    bundled = _bundled()
    if name in bundled:
        return parse_mission(bundled[name], f"mission {name}")
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        if path.suffix == ".toml" or path.parent != Path("."):
            why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
            raise UnknownMissionError(f"mission file {name}: cannot be read ({why})") from None
        near = difflib.get_close_matches(name, bundled, n=1, cutoff=0.4)
        hint = (
            f"did you mean {near[0]}?" if near else f"expected one of {', '.join(bundled)}, or a .toml file"
        )
        raise UnknownMissionError(f"there is no mission {name!r}; {hint}") from None
    return parse_mission(text, name, path.parent)
