"""What a path file in TOML holds."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationInfo, model_validator

from noctule.control.paths import SpeedSettings, Stop, StopError, TurnSettings
from noctule.settings import Settings

Metres = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Place = tuple[Metres, Metres, Metres]
# A path in millimetres is still read, to be told from a slip of the pen.
Length = Annotated[float, Field(ge=-1e6, le=1e6)]
Node = tuple[Length, Length, Length]
Degrees = Annotated[float, Field(ge=-3600.0, le=3600.0)]
_NEEDED = {
    "line": ("points",),
    "spline": ("points",),
    "arc": ("centre", "radius", "sweep_deg"),
    "ellipse": ("centre", "half_axes"),
    "eight": ("centre", "half_axes"),
}
_ALLOWED = {
    "line": ("points", "radius"),
    "spline": ("points",),
    "arc": ("centre", "radius", "begin_deg", "sweep_deg", "climb"),
    "ellipse": ("centre", "half_axes", "rise"),
    "eight": ("centre", "half_axes", "rise"),
}


class SegmentEntry(Settings):
    """A piece of the path."""

    kind: Literal["line", "arc", "ellipse", "eight", "spline"] = Field(description="its shape")
    points: tuple[Node, ...] | None = Field(
        None, min_length=2, max_length=2000, description="line, spline: x, y, z of each point [m]"
    )
    radius: float | None = Field(
        None, gt=0.0, le=1e6, description="arc: its radius; line: that of rounded corners [m]"
    )
    centre: Node | None = Field(None, description="arc, ellipse, eight: x, y, z [m]")
    half_axes: tuple[Length, Length] | None = Field(None, description="ellipse, eight: along x and y [m]")
    rise: Length | None = Field(None, description="ellipse, eight: half of the height it moves through [m]")
    begin_deg: Degrees | None = Field(None, description="arc: from the centre to its first point [deg]")
    sweep_deg: Degrees | None = Field(None, description="arc: how far around, counterclockwise [deg]")
    climb: Length | None = Field(None, description="arc: height gained [m]")
    cruise: float | None = Field(None, gt=0.0, le=5.0, description="speed on this piece [m/s]")

    @model_validator(mode="after")
    def _fits_its_kind(self) -> Self:
        for name in _NEEDED[self.kind]:
            if getattr(self, name) is None:
                raise ValueError(f"{name} is missing; {_a(self.kind)} needs {', '.join(_NEEDED[self.kind])}")
        # A recording's mission holds every field, those left out as None.
        given = {name for name in self.model_fields_set if getattr(self, name) is not None}
        for name in sorted(given - {"kind", "cruise", *_ALLOWED[self.kind]}):
            raise ValueError(
                f"{name} means nothing to {_a(self.kind)}; it takes {', '.join(_ALLOWED[self.kind])}, cruise"
            )
        return self


class HeadingEntry(Settings):
    """Where the nose points."""

    rule: Literal["along", "fixed", "point"] = Field("along", description="along the path, fixed, at a point")
    yaw_deg: Degrees = Field(0.0, description="fixed: the heading [deg]")
    x: Metres | None = Field(None, description="point: world x [m]")
    y: Metres | None = Field(None, description="point: world y [m]")

    @model_validator(mode="after")
    def _point_is_given(self) -> Self:
        if (self.rule == "point") != (self.x is not None and self.y is not None):
            raise ValueError('x and y are the point to look at: give both with rule = "point", else neither')
        return self


class StopEntry(Settings):
    """A stop, at a time or at a place."""

    seconds: float = Field(ge=0.0, le=3600.0, description="how long [s]")
    time: float | None = Field(None, ge=0.0, le=36000.0, description="[s] since the path was begun")
    s: float | None = Field(None, ge=0.0, le=1e5, description="[m] along the path, counted on over laps")
    yaw_deg: Degrees | None = Field(None, description="heading to turn to while hovering [deg]")
    turn_after: float = Field(0.0, ge=0.0, le=3600.0, description="[s] into the stop")
    keep_yaw: bool = Field(True, description="fly on with that heading; false: by the rule again")

    @model_validator(mode="after")
    def _makes_a_stop(self) -> Self:
        try:
            self.stop()
        except StopError as error:
            raise ValueError(str(error).removeprefix("stop: ")) from None
        return self

    def stop(self) -> Stop:
        """Return it as the plan has it. Raises StopError."""
        yaw = None if self.yaw_deg is None else math.radians(self.yaw_deg)
        return Stop(self.seconds, self.time, self.s, yaw, self.turn_after, self.keep_yaw)


class SpacePathEntries(Settings):
    """A path file."""

    closed: bool = Field(False, description="the last piece leads back to the first")
    laps: int | None = Field(
        None, ge=1, le=1000, description="times around a closed path; left out, once, or endless"
    )
    endless: bool = Field(False, description="around a closed path until the flight ends")
    speed: SpeedSettings = SpeedSettings()
    turning: TurnSettings | None = Field(None, description="how the wanted heading moves")
    heading: HeadingEntry = HeadingEntry()
    stops: tuple[StopEntry, ...] = Field((), max_length=1000)
    segments: tuple[SegmentEntry, ...] = Field(min_length=1, max_length=1000, description="pieces, in order")

    @model_validator(mode="after")
    def _ends_or_not(self, info: ValidationInfo) -> Self:
        # Recordings (JSON) of before laps could be left out hold endless paths with a lap.
        if self.endless and self.laps is not None and (info.mode != "json" or self.laps > 1):
            raise ValueError(f"endless = true and laps = {self.laps} contradict each other; give one of them")
        return self

    @property
    def rounds(self) -> int | None:
        """How often it is flown; None without an end."""
        return None if self.endless else self.laps or 1


def _a(kind: str) -> str:
    return f"an {kind}" if kind[0] in "ae" else f"a {kind}"
