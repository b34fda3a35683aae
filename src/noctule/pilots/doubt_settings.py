"""The limits of doubt: after how long, and how far off, a located pilot does what."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from noctule.settings import Settings

Seconds = Annotated[float, Field(ge=0.0, le=600.0)]


class Ages(Settings):
    """How old the newest word of a sensor may be."""

    fly_on_s: Seconds = Field(description="older: the pilot flies on by what remains [s]")
    slow_s: Seconds = Field(description="older: it flies slowly [s]")
    hover_s: Seconds = Field(description="older: it hovers [s]")
    land_s: Seconds = Field(description="older: it lands [s]")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if not self.fly_on_s <= self.slow_s <= self.hover_s <= self.land_s:
            raise ValueError("fly_on_s, slow_s, hover_s and land_s must not fall from one to the next")
        return self


class DoubtSettings(Settings):
    """When a located pilot doubts where it is, and how it gets back."""

    unseen: Ages = Field(
        Ages(fly_on_s=0.15, slow_s=0.5, hover_s=1.0, land_s=10.0), description="by the camera in the room"
    )
    silent: Ages = Field(
        Ages(fly_on_s=0.25, slow_s=0.5, hover_s=6.0, land_s=8.0), description="the vehicle's reports"
    )
    blind: Ages = Field(
        Ages(fly_on_s=0.15, slow_s=0.25, hover_s=0.4, land_s=2.0),
        description="neither: how long both have been gone",
    )
    slow_m: float = Field(0.08, gt=0.0, le=10.0, description="the position's deviation: above, slowly [m]")
    hover_m: float = Field(0.15, gt=0.0, le=10.0, description="above, hover [m]")
    land_m: float = Field(0.8, gt=0.0, le=10.0, description="above, land [m]")
    slow_deg: float = Field(10.0, gt=0.0, le=180.0, description="the yaw's deviation: above, slowly [deg]")
    hover_deg: float = Field(20.0, gt=0.0, le=180.0, description="above, hover [deg]")
    land_deg: float = Field(60.0, gt=0.0, le=180.0, description="above, land [deg]")
    jump_m: float = Field(
        0.5, gt=0.0, le=10.0, description="a correction by more than this is not flown on at once [m]"
    )
    well_s: float = Field(0.5, ge=0.0, le=60.0, description="well for this long: believed again [s]")
    rest_s: float = Field(1.0, ge=0.0, le=60.0, description="hovers this long before it lands [s]")
    slow_pace: float = Field(0.3, ge=0.0, le=1.0, description="times the wanted speed, when slow")
    brake_s: float = Field(1.0, gt=0.0, le=60.0, description="from full pace to none [s]")
    rise_s: float = Field(1.5, gt=0.0, le=60.0, description="and back [s]")
    trust_m: float = Field(
        0.2, gt=0.0, le=10.0, description="hovering, position errors count less above this deviation [m]"
    )
    distrust_m: float = Field(0.5, gt=0.0, le=10.0, description="and not at all above this one [m]")
    search_s: float = Field(10.0, gt=0.0, le=600.0, description="to find the drone at the beginning [s]")
    search_poses: int = Field(10, ge=1, le=1000, description="that must agree in a row to begin")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for names in (("slow_m", "hover_m", "land_m"), ("slow_deg", "hover_deg", "land_deg")):
            values = [getattr(self, name) for name in names]
            if values != sorted(values):
                raise ValueError(f"{', '.join(names)} must not fall from one to the next")
        if self.distrust_m <= self.trust_m:
            raise ValueError("distrust_m must be above trust_m")
        return self
