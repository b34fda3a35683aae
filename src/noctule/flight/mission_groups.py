"""The groups of a mission file that belong to flights of every kind."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from noctule.flight.fence import Fence
from noctule.geometry import Pose, wrap_angle
from noctule.pilots.route import backwards, laps
from noctule.settings import Settings
from noctule.simulation.spec import RoomSpec

Metres = Annotated[float, Field(ge=-100.0, le=100.0)]


PathPose = Annotated[
    tuple[Annotated[float, Field(ge=-360.0, le=360.0)], ...], Field(min_length=4, max_length=4)
]
"""x, y, z [m] and heading [deg]."""

CurvePiece = tuple[Annotated[float, Field(gt=0.0, le=1000.0)], Annotated[float, Field(ge=-100.0, le=100.0)]]
"""Length [m] and curvature [1/m], positive to the left."""


class StartSettings(Settings):
    """Where the flight begins, in hover or on the floor."""

    x: Metres = Field(0.0, description="world x [m]")
    y: Metres = Field(0.0, description="world y [m]")
    z: float = Field(1.0, ge=0.1, le=20.0, description="height [m]")
    yaw_deg: float = Field(0.0, ge=-180.0, le=180.0, description="heading [deg]")
    on_floor: bool = Field(False, description="it stands on the floor there and takes off to z first")
    spread_m: float = Field(0.0, ge=0.0, le=1.0, description="each seed moves the start by up to this [m]")
    spread_deg: float = Field(
        0.0, ge=0.0, le=45.0, description="each seed turns the start by up to this [deg]"
    )

    @property
    def nominal(self) -> Pose:
        """Where the mission says that the flight begins."""
        return Pose(np.array([self.x, self.y, self.z]), wrap_angle(float(np.radians(self.yaw_deg))))

    def pose(self, seed: int) -> Pose:
        """Return where the flight of `seed` really begins."""
        # A stream of its own, so that no other draw of the seed moves the start.
        draw = np.random.default_rng([seed, 0x57A47]).uniform(-1.0, 1.0, 4)
        turn = float(np.radians(self.spread_deg * draw[3]))
        return Pose(self.nominal.position + self.spread_m * draw[:3], wrap_angle(self.nominal.yaw + turn))


class PathSettings(Settings):
    """The visual path: a folder of key images, or poses where a simulated flight takes them."""

    folder: Path | None = Field(None, description="path folder, relative to the mission file")
    poses: tuple[PathPose, ...] | None = Field(
        None, min_length=1, max_length=500, description="x, y, z [m] and heading [deg] of each key image"
    )
    laps: int = Field(1, ge=1, le=100, description="a closed path is flown this often without a stop")
    reverse: bool = Field(False, description="from the last image to the first, tail first")
    curve: tuple[CurvePiece, ...] | None = Field(
        None,
        min_length=1,
        max_length=200,
        description="pieces of the true curve from the start: length [m], curvature [1/m]; only the judge "
        "reads it, without it straight lines through the true poses hold",
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.folder is None) == (self.poses is None):
            raise ValueError("give either a folder of key images or the poses to take them from")
        return self

    def route(self, n_images: int) -> tuple[int, ...]:
        """Return the indices of the path's images in the order in which they are flown."""
        forward = laps(n_images, self.laps)
        return backwards(forward) if self.reverse else forward


class FenceSettings(Settings):
    """The box that the vehicle must not leave; a side that is not given is the room's."""

    x_min: Metres | None = Field(None, description="[m]")
    x_max: Metres | None = Field(None, description="[m]")
    y_min: Metres | None = Field(None, description="[m]")
    y_max: Metres | None = Field(None, description="[m]")
    z_min: float = Field(0.15, ge=0.0, le=20.0, description="lowest height [m]")
    z_max: float | None = Field(None, ge=0.1, le=20.0, description="highest height [m]")
    inside: float = Field(0.25, ge=0.0, le=5.0, description="from the walls, where no side is given [m]")
    margin_per_second: float = Field(0.005, ge=0.0, le=1.0, description="growth of the margin [m/s]")
    margin_per_metre: float = Field(0.02, ge=0.0, le=1.0, description="growth of the margin [m/m]")

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        for axis in "xyz":
            low, high = getattr(self, f"{axis}_min"), getattr(self, f"{axis}_max")
            if low is not None and high is not None and low >= high:
                raise ValueError(
                    f"{axis}_min is {low:g} and {axis}_max {high:g}; the first must be the smaller"
                )
        return self

    def values(self, room: RoomSpec) -> Fence:
        """Return the record that the supervisor takes."""

        def side(given: float | None, wall: float) -> float:
            return wall if given is None else given

        low = (
            side(self.x_min, room.x_min + self.inside),
            side(self.y_min, room.y_min + self.inside),
            self.z_min,
        )
        high = (
            side(self.x_max, room.x_max - self.inside),
            side(self.y_max, room.y_max - self.inside),
            side(self.z_max, room.size[2] - self.inside),
        )
        return Fence(low, high, self.margin_per_second, self.margin_per_metre)


class FlightSettings(Settings):
    """How the loop runs."""

    rate_hz: float = Field(30.0, ge=5.0, le=120.0, description="ticks a second")
    time_limit_s: float = Field(120.0, gt=0.0, le=3600.0, description="after this the flight is stuck [s]")
    match_delay_s: float = Field(
        0.15, ge=0.0, le=5.0, description="simulated delay of the matching worker [s]"
    )
    picture_max_age_s: float = Field(
        0.5, gt=0.0, le=5.0, description="pictures that are late by more: the supervisor hovers [s]"
    )
    seed: int = Field(0, ge=0, description="draws what the mission leaves open")
    land: bool = Field(False, description="land at the end, or stay in hover")


class RecordingSettings(Settings):
    """What is kept of the flight."""

    lossless: bool = Field(False, description="exact pictures, for replay bit for bit")
    depth: bool = Field(False, description="the depth frames too, exactly; without them no replay")
    jpeg_quality: int = Field(80, ge=10, le=100, description="of lossy pictures")
