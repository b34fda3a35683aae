"""What a simulated room, vehicle and camera are made of: the settings, and how they are read from TOML."""

from __future__ import annotations

import colorsys
import tomllib
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from noctule.camera import CameraMount, PinholeCamera
from noctule.errors import NoctuleError
from noctule.messages import Limits
from noctule.settings import Settings
from noctule.simulation.navdata import NavdataSpec

Metres = Annotated[float, Field(ge=-100.0, le=100.0, description="[m]")]
Unit = Annotated[float, Field(ge=0.0, le=1.0)]


class RoomError(NoctuleError):
    """A room that cannot be built as it was described."""


class WorldFileError(NoctuleError):
    """A TOML text that does not describe a world."""


class ColumnSpec(Settings):
    """A vertical column that stands on the floor, one saturated colour all over."""

    x: Metres = Field(description="centre, world x [m]")
    y: Metres = Field(description="centre, world y [m]")
    width: float | None = Field(None, ge=0.005, le=2.0, description="box: extent along its y [m]")
    depth: float | None = Field(None, ge=0.005, le=2.0, description="box: extent along its x [m]")
    diameter: float | None = Field(None, ge=0.005, le=2.0, description="cylinder: diameter [m]")
    yaw: float = Field(0.0, ge=-7.0, le=7.0, description="box: turned about the vertical [rad]")
    height: float = Field(2.0, gt=0.0, le=20.0, description="top above the floor [m]")
    colour: tuple[Unit, Unit, Unit] | None = Field(None, description="RGB, 0 to 1")
    hue: float | None = Field(None, ge=0.0, lt=1.0, description="hue of a saturated colour, 0 red, 1/3 green")

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        box = self.width is not None and self.depth is not None
        half_box = (self.width is None) != (self.depth is None)
        if half_box or box == (self.diameter is not None):
            raise ValueError("give either width and depth (a box) or diameter (a cylinder)")
        if self.colour is not None and self.hue is not None:
            raise ValueError("give colour or hue, not both")
        return self

    def rgb(self, drawn_hue: float) -> tuple[float, float, float]:
        """Return the colour, RGB 0 to 1; `drawn_hue` holds when the description names none."""
        if self.colour is not None:
            return self.colour
        return colorsys.hsv_to_rgb(drawn_hue if self.hue is None else self.hue, 0.92, 0.9)


FurnitureKind = Literal["bookcase", "cabinet", "table", "sofa", "crates", "plant", "panel", "person"]


class FurnitureSpec(Settings):
    """A piece of furniture (or a person) at a place."""

    kind: FurnitureKind
    x: Metres = Field(description="centre, world x [m]")
    y: Metres = Field(description="centre, world y [m]")
    yaw: float = Field(0.0, ge=-7.0, le=7.0, description="its front looks along this heading [rad]")
    width: float = Field(1.0, ge=0.1, le=5.0, description="extent across its front [m]")
    depth: float = Field(0.4, ge=0.05, le=3.0, description="extent from back to front [m]")
    height: float = Field(1.2, ge=0.1, le=12.0, description="top above the floor [m]")


class KeepClear(Settings):
    """A rectangle on the floor that drawn furniture stays away from."""

    x_min: Metres = -1.2
    x_max: Metres = 5.2
    y_min: Metres = -1.3
    y_max: Metres = 1.3
    margin: float = Field(0.9, ge=0.0, le=5.0, description="distance kept from the rectangle [m]")


class LightSpec(Settings):
    """A lamp that shines in all directions."""

    x: Metres
    y: Metres
    z: float = Field(2.6, ge=0.0, le=20.0, description="[m]")
    intensity: float = Field(0.3, ge=0.0, le=2.0, description="1 is a bright room by itself")


class RoomSpec(Settings):
    """A room with walls, furniture, columns and lamps; what is not described is drawn from the seed."""

    seed: int = Field(0, ge=0, description="draws textures, furniture and colours")
    corner: tuple[Metres, Metres] = Field((-3.0, -3.5), description="smallest x and y inside the walls [m]")
    size: tuple[
        Annotated[float, Field(ge=2.0, le=60.0)],
        Annotated[float, Field(ge=2.0, le=60.0)],
        Annotated[float, Field(ge=1.5, le=20.0)],
    ] = Field((10.5, 7.0, 3.0), description="inner extent along x, y and z [m]")
    furniture: int | tuple[FurnitureSpec, ...] = Field(16, description="how many to draw, or the list itself")
    pictures: int = Field(28, ge=0, le=60, description="pictures on the walls")
    lamps: int = Field(5, ge=0, le=60, description="hanging lamps to draw, away from `keep_clear`")
    keep_clear: KeepClear = KeepClear()
    columns: tuple[ColumnSpec, ...] = ()
    lights: tuple[LightSpec, ...] = (LightSpec(x=0.0, y=0.0), LightSpec(x=4.5, y=0.0))
    ambient: float = Field(0.75, ge=0.0, le=1.0, description="light that comes from everywhere")

    @model_validator(mode="after")
    def _inside(self) -> Self:
        if isinstance(self.furniture, int) and not 0 <= self.furniture <= 60:
            raise ValueError(f"furniture is {self.furniture}, expected 0 to 60 pieces or a list")
        things = [(f"columns[{i}]", c.x, c.y) for i, c in enumerate(self.columns)]
        if not isinstance(self.furniture, int):
            things += [(f"furniture[{i}]", f.x, f.y) for i, f in enumerate(self.furniture)]
        for name, x, y in things:
            if not (self.x_min <= x <= self.x_max and self.y_min <= y <= self.y_max):
                raise ValueError(
                    f"{name} stands at ({x:g}, {y:g}), outside the walls: "
                    f"x {self.x_min:g} to {self.x_max:g}, y {self.y_min:g} to {self.y_max:g}"
                )
        return self

    @property
    def x_min(self) -> float:
        """The wall behind the start [m]."""
        return self.corner[0]

    @property
    def x_max(self) -> float:
        """The wall ahead of the start [m]."""
        return self.corner[0] + self.size[0]

    @property
    def y_min(self) -> float:
        """The wall to the right of the start [m]."""
        return self.corner[1]

    @property
    def y_max(self) -> float:
        """The wall to the left of the start [m]."""
        return self.corner[1] + self.size[1]


class LimitsSpec(Settings):
    """What the vehicle's autopilot allows; the defaults are the experiments'."""

    forward: float = Field(0.6, gt=0.0, le=10.0, description="[m/s]")
    left: float = Field(0.6, gt=0.0, le=10.0, description="[m/s]")
    up: float = Field(0.5, gt=0.0, le=10.0, description="[m/s]")
    yaw_rate: float = Field(0.8, gt=0.0, le=10.0, description="[rad/s]")
    acceleration: float = Field(1.0, gt=0.0, le=10.0, description="length of the vector [m/s^2]")
    yaw_acceleration: float = Field(2.0, gt=0.0, le=50.0, description="[rad/s^2]")

    def values(self) -> Limits:
        """Return them as the record that travels between rooms."""
        return Limits(**self.model_dump())


Acceleration = Annotated[float, Field(ge=-50.0, le=50.0)]


class PushSpec(Settings):
    """Somebody pushes the vehicle while it flies."""

    time_s: float = Field(ge=0.0, le=3600.0, description="when it begins, on the flight's clock [s]")
    seconds: float = Field(0.2, gt=0.0, le=60.0, description="how long it lasts [s]")
    acceleration_m_s2: tuple[Acceleration, Acceleration, Acceleration] = Field(
        description="world axes [m/s^2]; it adds to what the autopilot's limits allow"
    )
    yaw_rad_s2: Acceleration = Field(0.0, description="of the heading [rad/s^2]")


class VehicleSpec(Settings):
    """A simulated quadcopter: how it moves and how well it knows itself."""

    model: str = Field("first_order", description="a name of `noctule.simulation.dynamics`' registry")
    lag: float = Field(0.3, gt=0.01, le=5.0, description="time constant of the velocity loop [s]")
    k: tuple[float, float, float, float, float, float, float, float] = Field(
        (4.7202, 0.2660, 6.2330, 0.5328, 2.6504, 2.5761, 2.3788, 1.5216),
        description="k1 to k8 of the identified model (Table 1, AR.Drone 2.0)",
    )
    limits: LimitsSpec = LimitsSpec()
    command_latency: float = Field(0.0, ge=0.0, le=1.0, description="from send to effect [s]")
    land_after: float = Field(
        2.0, ge=0.0, le=60.0, description="hover after an expired command, then land [s]"
    )
    tilt_lag: float = Field(0.06, gt=0.0, le=1.0, description="time constant of roll and pitch [s]")
    gusts: float = Field(0.0, ge=0.0, le=20.0, description="sd of a white acceleration at 300 Hz [m/s^2]")
    hull_diameter: float = Field(0.4, gt=0.0, le=3.0, description="[m]")
    hull_height: float = Field(0.12, gt=0.0, le=2.0, description="[m]")
    report_rate: float = Field(30.0, ge=1.0, le=300.0, description="reports of its state [Hz]")
    attitude_sd: float = Field(
        0.0,
        ge=0.0,
        le=0.5,
        description="sd of the error of reported roll and pitch [rad]; half its variance is a bias of the "
        "flight, half a Gauss-Markov process",
    )
    attitude_drift_time: float = Field(5.0, gt=0.0, le=600.0, description="time constant of that process [s]")
    velocity_noise: float = Field(0.02, ge=0.0, le=2.0, description="sd of each report, each axis [m/s]")
    velocity_bias: float = Field(0.01, ge=0.0, le=2.0, description="sd of the flight's bias, each axis [m/s]")
    height_noise: float = Field(0.01, ge=0.0, le=2.0, description="sd of each report [m]")
    yaw_drift: float = Field(0.0005, ge=0.0, le=0.1, description="sd of the drift of reported yaw [rad/s]")
    navdata: NavdataSpec | None = Field(
        None,
        description="reports as a low-cost vehicle's: irregular, late, lossy; the rates and errors above "
        "then hold for roll and pitch alone",
    )
    loop_on_measured: bool = Field(
        True,
        description="with navdata, the onboard loop holds the velocity that the vehicle measures: the true "
        "one plus navdata's wandering bias (noise averages out), so a hovering vehicle drifts; `first_order` "
        "then flies its command less the whole bias, `identified` less the share of the response that is its "
        "loop's, none where drag alone is as quick as `lag`. Take-off and landing go by height instead",
    )
    pushes: tuple[PushSpec, ...] = Field((), description="on top of gusts; those that overlap add up")


class CameraSpec(Settings):
    """A front camera without distortion."""

    width: int = Field(856, ge=16, le=1920, description="[px]")
    height: int = Field(480, ge=16, le=1200, description="[px]")
    focal: float = Field(510.0, ge=10.0, le=10000.0, description="[px]")
    ahead: float = Field(0.09, ge=-1.0, le=1.0, description="in front of the hull's centre [m]")
    rate: float = Field(30.0, ge=1.0, le=120.0, description="[Hz]")
    latency: float = Field(1.0 / 30.0, ge=0.0, le=2.0, description="from exposure to delivery [s]")
    stabilised: bool = Field(True, description="pictures show neither roll nor pitch")
    noise: float = Field(1.5, ge=0.0, le=50.0, description="sd of each pixel's noise [grey levels]")

    @property
    def intrinsics(self) -> PinholeCamera:
        """The pinhole."""
        return PinholeCamera.centred(self.width, self.height, self.focal)

    @property
    def mount(self) -> CameraMount:
        """How it sits on the body."""
        return CameraMount(np.array([self.ahead, 0.0, 0.0]), self.stabilised)


class StartSpec(Settings):
    """Where a flight begins."""

    x: Metres = 0.0
    y: Metres = 0.0
    z: float = Field(1.0, ge=0.0, le=20.0, description="[m]")
    yaw: float = Field(0.0, ge=-7.0, le=7.0, description="[rad]")


class WorldSpec(Settings):
    """All that a simulated world is made of."""

    room: RoomSpec = RoomSpec()
    vehicle: VehicleSpec = VehicleSpec()
    camera: CameraSpec = CameraSpec()
    start: StartSpec = StartSpec()
    seed: int = Field(0, ge=0, description="draws gusts and noise")


def world_from_toml(text: str) -> WorldSpec:
    """Read a world from TOML text; raises WorldFileError with the first thing that is wrong."""
    try:
        return WorldSpec.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise WorldFileError(f"world file: not TOML: {error}; mend that line") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "world"
        raise WorldFileError(
            f"world file: {where}: {first['msg']}, found {first['input']!r}; "
            "see simulation/room.toml for an example"
        ) from None
