"""`loc-1`, `loc-2`, `loc-3`: section 6.4 of the paper on localization, paths flown below the ceiling camera.

An ellipse with the heading along it and a stop; an eight whose heading turns by 180 deg in the stop; the
eight with pushes on the way. A person walks by at 0.6 m. The paper has plots only: the numbers are the
design's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from pydantic import Field

from noctule.experiments.loc_flight_draws import draw_pushes, draw_walk, draw_wrong
from noctule.flight.mission import (
    CeilingSettings,
    FlightSettings,
    Mission,
    SpacePathSettings,
    StartSettings,
    check_flyable,
)
from noctule.flight.mission_located import HidingSettings
from noctule.flight.space_path_entries import HeadingEntry, SegmentEntry, StopEntry
from noctule.pilots.located_settings import LocatedSettings
from noctule.settings import Settings
from noctule.simulation import LimitsSpec, VehicleSpec
from noctule.simulation.ceiling import lab_room
from noctule.simulation.navdata import NavdataSpec

SECONDS = 82.0  # of the path's time
BEGIN = 4.0  # [s] after the pilot's first tick
HIDDEN_AT = 20.0  # [s] of the path's time
_TICK = 1.0 / 30.0  # [s]; the pilot is first asked one tick after the flight's clock starts
_SPARE = 30.0  # [s], to find the drone and to end in
_GUSTS = 0.6  # [m/s^2], white at 300 Hz
_SPREAD_M, _SPREAD_DEG = 0.05, 3.0  # of the start
_MIDDLE = (0.08, 0.1, 1.2)  # [m]
_LIMITS = LimitsSpec(forward=1.0, left=1.0, up=1.0, yaw_rate=1.5, acceleration=5.0, yaw_acceleration=10.0)

Model = Literal["identified", "first_order"]


class LocFlightOptions(Settings):
    """What may be asked of a flight below the ceiling camera."""

    hull: bool = Field(False, description="the drone wears its indoor hull")
    alone: bool = Field(False, description="nobody walks about")
    hide: float = Field(0.0, ge=0.0, le=60.0, description="a board hides the drone for so long [s]")
    model: Model = Field("identified", description="how the vehicle flies")
    wrong_model: float = Field(
        0.0, ge=0.0, le=0.9, description="each of k1 to k8 that the pilot knows is off by this share"
    )
    command_delay: float = Field(
        0.02, ge=0.0, le=1.0, description="from sending a command to its effect; the pilot knows it [s]"
    )
    beyond: bool = Field(False, description="fly though the delay is longer than was shown stable")
    seconds: float = Field(SECONDS, ge=1.0, le=600.0, description="of the path's time [s]")


@dataclass(frozen=True, slots=True)
class LocFlight:
    """An experiment that is flown below the ceiling camera: a mission for every seed."""

    name: str
    title: str
    shape: SegmentEntry
    heading: HeadingEntry
    stop: StopEntry
    start: tuple[float, float, float, float]  # x, y, z [m], heading [deg]: the path's first point
    pushes: tuple[float, ...]  # [s] of the path's time

    def mission(self, seed: int, options: LocFlightOptions = LocFlightOptions()) -> Mission:  # noqa: B008
        """Return the mission of `seed`.

        It draws the room and all errors, the start (0.05 m, 3 deg), the pushes' directions, where the person
        walks, and which numbers of a wrong model are too large.

        Raises
        ------
        MissionFileError
            When the commands take effect later than the gains were shown to be stable with.
        """
        x, y, z, yaw_deg = self.start
        pushes = draw_pushes(seed, tuple(_TICK + BEGIN + time for time in self.pushes))
        vehicle = VehicleSpec(
            model=options.model,
            limits=_LIMITS,
            command_latency=options.command_delay,
            gusts=_GUSTS,
            navdata=NavdataSpec(),
            pushes=pushes,
        )
        mission = Mission(
            name=self.name,
            description=self.title,
            room=lab_room(seed),
            vehicle=vehicle,
            start=StartSettings(x=x, y=y, z=z, yaw_deg=yaw_deg, spread_m=_SPREAD_M, spread_deg=_SPREAD_DEG),
            space_path=self._path(),
            located=_located(options),
            ceiling=CeilingSettings(hull=options.hull, boards=_boards(options)),
            people=() if options.alone else (draw_walk(seed),),
            limits=_LIMITS,
            flight=FlightSettings(seed=seed, time_limit_s=BEGIN + options.seconds + _SPARE),
        )
        if options.wrong_model > 0.0:
            wrong = draw_wrong(seed, mission.known_vehicle, options.wrong_model)
            mission = mission.model_copy(update={"vehicle_model": wrong})
        check_flyable(mission, self.name)
        return mission

    def _path(self) -> SpacePathSettings:
        return SpacePathSettings(
            closed=True,
            endless=True,
            heading=self.heading,
            stops=(self.stop,),
            segments=(self.shape,),
        )


def _located(options: LocFlightOptions) -> LocatedSettings:
    settings = LocatedSettings(begin_at_s=BEGIN, end_after_s=options.seconds)
    if not options.beyond:
        return settings
    follower, cascade = settings.follower, settings.follower.cascade
    longest = max(cascade.longest_delay_s, options.command_delay)
    cascade = cascade.model_copy(update={"longest_delay_s": longest})
    return settings.model_copy(update={"follower": follower.model_copy(update={"cascade": cascade})})


def _boards(options: LocFlightOptions) -> tuple[HidingSettings, ...]:
    if options.hide == 0.0:
        return ()
    return (HidingSettings(place=_MIDDLE, begin_s=_TICK + BEGIN + HIDDEN_AT, seconds=options.hide),)


_EIGHT: dict[str, Any] = {
    "shape": SegmentEntry(kind="eight", centre=_MIDDLE, half_axes=(0.45, 0.8), rise=0.1),
    "heading": HeadingEntry(rule="fixed", yaw_deg=0.0),
    "start": (0.08, 0.1, 1.3, 0.0),
}


LOC_FLIGHTS: dict[str, LocFlight] = {
    "loc-1": LocFlight(
        "loc-1",
        "6.4: an ellipse, heading along it, a stop of 30 s with pushes.",
        SegmentEntry(kind="ellipse", centre=_MIDDLE, half_axes=(0.5, 0.8), rise=0.12),
        HeadingEntry(rule="along"),
        StopEntry(seconds=30.0, time=40.0),
        (0.58, 0.1, 1.2, 90.0),
        (43.0, 48.0, 53.0, 58.0, 63.0),
    ),
    "loc-2": LocFlight(
        "loc-2",
        "6.4: an eight, a stop of 30 s with pushes in which the heading turns by 180 degrees.",
        stop=StopEntry(seconds=30.0, time=40.0, yaw_deg=180.0, turn_after=4.0),
        pushes=(50.0, 55.0, 60.0, 65.0),
        **_EIGHT,
    ),
    "loc-3": LocFlight(
        "loc-3",
        "6.4: an eight with pushes on the way and a stop of 12 s.",
        stop=StopEntry(seconds=12.0, time=40.0, yaw_deg=180.0, turn_after=4.0),
        pushes=(18.0, 30.0, 60.0, 72.0),
        **_EIGHT,
    ),
}
"""The experiments by the name that `noctule experiment` takes."""
