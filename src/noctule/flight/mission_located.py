"""The groups of a mission file that belong to flights below a depth camera in the room."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from noctule.control.paths import PathPlan
from noctule.estimation.identification import VehicleModelSettings
from noctule.flight.mission_groups import Metres
from noctule.flight.space_path_entries import Degrees, Place, SegmentEntry, SpacePathEntries
from noctule.flight.space_path_file import plan_of_entries, read_path_text, space_path_of
from noctule.messages import Limits
from noctule.settings import Settings
from noctule.simulation.ceiling import CeilingSpec, Hiding, Walker, walk_past
from noctule.simulation.spec import VehicleSpec

_OF_A_FILE = {"file", "text"}
HalfAxis = Annotated[float, Field(gt=0.0, le=100.0)]


class SpacePathSettings(SpacePathEntries):
    """The path in space: a file, or here what such a file holds."""

    file: Path | None = Field(None, description=".csv or .toml, relative to the mission file")
    text: str | None = Field(None, description="what the file held, in a recording; leave it out")
    segments: tuple[SegmentEntry, ...] = Field((), max_length=1000, description="pieces, in order")

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.file is None) == (not self.segments):
            raise ValueError("give either the file of a path or its segments")
        given = sorted(
            name
            for name in self.model_fields_set - _OF_A_FILE
            if getattr(self, name) != type(self).model_fields[name].default
        )
        if self.file is not None and given:
            raise ValueError(f"the file {self.file} says all of it; leave {', '.join(given)} out here")
        return self

    def read(self, base: Path | None) -> SpacePathSettings:
        """Return the settings with what the file holds, found relative to `base`.

        Raises SpacePathFileError.
        """
        if self.file is None or self.text is not None:
            return self
        file = self.file if base is None else base / self.file
        return self.model_copy(update={"file": file, "text": read_path_text(file)})

    def plan(self, limits: Limits, name: str, lines: dict[tuple[str | int, ...], int]) -> PathPlan:
        """Return what is to be flown within `limits`; `name` and `lines` are the mission file's, for errors.

        Raises SpacePathFileError.
        """
        if self.file is not None:
            read = self.read(None)
            assert read.text is not None
            return space_path_of(self.file, read.text, limits)

        def where(k: int) -> str:
            line = lines.get(("space_path", "segments", k))
            return f"{name}{'' if line is None else f':{line}'}: space_path.segments[{k}]"

        return plan_of_entries(self, name, where, limits)


class HidingSettings(Settings):
    """A board held between the camera and a place, in simulation."""

    place: Place = Field(description="x, y, z of what it hides [m]")
    begin_s: float = Field(ge=0.0, le=36000.0, description="when it is there, on the flight's clock [s]")
    seconds: float = Field(ge=0.0, le=3600.0, description="for how long [s]")
    yaw_deg: Degrees = Field(0.0, description="it comes from where this points [deg]")
    slide_s: float = Field(1.0, ge=0.0, le=60.0, description="for which it is pushed in and pulled out [s]")


class CeilingSettings(CeilingSpec):
    """The depth camera in the room: how it is simulated, and what it was taught."""

    site: Path | None = Field(None, description="taught site; left out, a simulated one is taught first")
    vehicle: Path | None = Field(None, description="vehicle.toml of `noctule identify`")
    boards: tuple[HidingSettings, ...] = Field((), max_length=100, description="held before it")
    max_age_s: float = Field(
        12.0, gt=0.0, le=600.0, description="without a frame for longer the supervisor steps in [s]"
    )
    silence_s: float = Field(
        9.0, gt=0.0, le=600.0, description="without a report for longer the supervisor steps in [s]"
    )

    @property
    def spec(self) -> CeilingSpec:
        """The simulated camera alone."""
        return CeilingSpec(**{name: getattr(self, name) for name in CeilingSpec.model_fields})

    def hidings(self) -> tuple[Hiding, ...]:
        """Return the boards as things that move."""
        eye = (self.x_m, self.y_m, self.z_m)
        return tuple(
            Hiding(b.place, b.begin_s, b.seconds, eye, yaw=math.radians(b.yaw_deg), slide=b.slide_s)
            for b in self.boards
        )


class PersonSettings(Settings):
    """Somebody who walks around an ellipse below the camera, in simulation."""

    x: Metres | None = Field(None, description="its middle, world x [m]")
    y: Metres | None = Field(None, description="its middle, world y [m]")
    turn_deg: Degrees = Field(0.0, description="heading of the first half axis [deg]")
    passes_m: float | None = Field(
        None, gt=0.0, le=10.0, description="instead of x and y: as near as this to the space path [m]"
    )
    bearing_deg: Degrees = Field(0.0, description="on this side of it [deg]")
    half_axes: tuple[HalfAxis, HalfAxis] = Field((0.9, 0.6), description="[m]")
    speed: float = Field(0.8, ge=-3.0, le=3.0, description="counterclockwise [m/s]")
    start: float = Field(0.0, ge=-1000.0, le=1000.0, description="along it, where the walk begins [m]")
    look: int = Field(0, ge=0, le=100, description="whose clothes")

    @model_validator(mode="after")
    def _somewhere(self) -> Self:
        if (self.x is None) != (self.y is None) or (self.x is None) == (self.passes_m is None):
            raise ValueError("give either x and y or passes_m")
        return self

    def walker(self, plan: PathPlan) -> Walker:
        """Return the person as one who moves."""
        turn = math.radians(self.turn_deg)
        centre = (self.x or 0.0, self.y or 0.0)
        walker = Walker(centre, self.half_axes, turn, self.speed, self.start, look=self.look)
        if self.passes_m is None:
            return walker
        return walk_past(plan.path.position, self.passes_m, walker, math.radians(self.bearing_deg))


def model_of(vehicle: VehicleSpec) -> VehicleModelSettings:
    """Return what `noctule identify` would find for a simulated vehicle: a velocity loop's lag, and a delay.

    Where the drag alone is quicker than the loop, the identified vehicle answers as quickly as it.
    """
    rates = [1.0 / vehicle.lag] * 4
    if vehicle.model == "identified":
        rates = [max(rate, drag) for rate, drag in zip(rates, vehicle.k[1::2], strict=True)]
    k = tuple(rate for rate in rates for _ in range(2))
    return VehicleModelSettings(k=k, delay_s=vehicle.command_latency)
