"""The [located] group of a mission file: a pilot that knows where it is."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from noctule.estimation.delayed import FilterSettings
from noctule.localization.located import LocatorSettings
from noctule.pilots.doubt_settings import DoubtSettings
from noctule.pilots.following import FollowerSettings
from noctule.settings import Settings


class LocatedSettings(Settings):
    """How a path in space is flown by the camera in the room and the vehicle's own sensors."""

    follower: FollowerSettings = FollowerSettings()
    doubt: DoubtSettings = DoubtSettings()
    locator: LocatorSettings = LocatorSettings()
    filter: FilterSettings = FilterSettings()
    begin_at_s: float | None = Field(
        None,
        ge=0.0,
        le=3600.0,
        description="the path is begun this long after the pilot's first tick, if it has settled then [s]",
    )
    end_after_s: float | None = Field(
        None, gt=0.0, le=36000.0, description="of the path's time: then it is left, for endless ones [s]"
    )

    @model_validator(mode="after")
    def _can_wait(self) -> Self:
        if self.begin_at_s is not None and not self.follower.go_to_start:
            raise ValueError("begin_at_s waits at the path's start; follower.go_to_start must be true")
        return self


class HandoverSettings(Settings):
    """How a located flight ends in a visual one."""

    warm_up_s: float = Field(
        5.0, gt=0.0, le=120.0, description="to recognise the first key image in, or the flight ends [s]"
    )
    agree_s: float = Field(0.3, ge=0.0, le=10.0, description="recognised for this long: hand over [s]")
    blend_s: float = Field(1.0, ge=0.0, le=10.0, description="from one pilot's commands to the other's [s]")
