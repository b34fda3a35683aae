"""What a command line changes in a mission."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, TypeVar

from noctule.errors import NoctuleError
from noctule.settings import Settings

if TYPE_CHECKING:
    from noctule.experiments import OvalOptions
    from noctule.flight.mission import Mission

Group = TypeVar("Group", bound=Settings)


class OptionValueError(NoctuleError):
    """An option whose value the mission does not accept."""


class OtherExperimentError(NoctuleError):
    """An option of another experiment."""


def changed(
    mission: Mission,
    law: str | None = None,
    attitude_sd_deg: float | None = None,
    time_limit_s: float | None = None,
) -> Mission:
    """Return `mission` with what is not None put in its place.

    An `attitude_sd_deg` above 0 [deg] takes the camera off its gimbal: pictures show roll and pitch, the
    vehicle reports them with errors of that size, and the pilot is told so.

    Raises
    ------
    OptionValueError
        When a value is out of the mission's range, or the mission has nothing that it is about.
    """
    for option, value in (("--law", law), ("--attitude-sd", attitude_sd_deg)):
        if value is not None and mission.path is None:
            raise OptionValueError(
                f"{option} is of flights along a visual path, and {mission.name} has none; leave it out"
            )
    pilot, vehicle, camera, flight = mission.pilot, mission.vehicle, mission.camera, mission.flight
    if law is not None:
        pilot = _with(pilot, "--law", law=law)
    if attitude_sd_deg is not None:
        pilot = _with(pilot, "--attitude-sd", attitude_sd_deg=attitude_sd_deg)
        vehicle = _with(vehicle, "--attitude-sd", attitude_sd=math.radians(attitude_sd_deg))
        camera = _with(camera, "--attitude-sd", stabilised=attitude_sd_deg == 0.0)
    if time_limit_s is not None:
        flight = _with(flight, "--time-limit", time_limit_s=time_limit_s)
    return mission.model_copy(update={"pilot": pilot, "vehicle": vehicle, "camera": camera, "flight": flight})


def _with(group: Group, option: str, **values: object) -> Group:
    from pydantic import ValidationError

    try:
        return type(group).model_validate({**group.model_dump(), **values})
    except ValidationError as error:
        first = error.errors()[0]
        raise OptionValueError(f"{option}: {first['msg'].lower()}, found {first['input']}") from None


def as_it_is(mission: Mission, seed: int) -> Mission:
    """Return `mission`, which every seed flies."""
    return mission


def oval_options(name: str, laps: int | None, latency_s: float | None, columns: bool) -> OvalOptions | None:
    """Return what is asked of the flight over the oval; None for an experiment without one.

    Raises
    ------
    OptionValueError
        When a value is out of range.
    OtherExperimentError
        When an option is given that the experiment does not have.
    """
    from noctule.experiments import EXPERIMENTS, OvalExperiment, OvalOptions

    given: dict[str, tuple[str, object]] = {}
    if laps is not None:
        given["--laps"] = ("laps", laps)
    if latency_s is not None:
        given["--latency"] = ("latency_s", latency_s)
    if columns:
        given["--columns"] = ("columns", True)
    if not isinstance(EXPERIMENTS[name], OvalExperiment):
        ovals = [n for n, e in EXPERIMENTS.items() if isinstance(e, OvalExperiment)]
        for option in given:
            raise OtherExperimentError(
                f"{option} belongs to {' and '.join(ovals)}, found with {name}; leave it out"
            )
        return None
    options = OvalOptions()
    for option, (field, value) in given.items():
        options = _with(options, option, **{field: value})
    return options


def of_experiment(
    name: str,
    law: str,
    attitude_sd_deg: float,
    time_limit_s: float | None,
    options: OvalOptions | None,
    seed: int,
) -> Mission:
    """Return the mission of an experiment of the papers; each seed draws its own."""
    from noctule.experiments import EXPERIMENTS, OvalExperiment
    from noctule.pilots import PilotSettings

    # Asked here first, where a value out of range is one line.
    pilot = _with(PilotSettings(), "--attitude-sd", attitude_sd_deg=attitude_sd_deg)
    pilot = _with(pilot, "--law", law=law)
    experiment = EXPERIMENTS[name]
    if isinstance(experiment, OvalExperiment) and options is not None:
        mission = experiment.mission(seed, pilot.law, pilot.attitude_sd_deg, options)
    else:
        mission = experiment.mission(seed, pilot.law, pilot.attitude_sd_deg)
    return changed(mission, time_limit_s=time_limit_s)


def refuse_others(name: str, given: Mapping[str, object]) -> None:
    """Raise OtherExperimentError for an option, by its name, that was given (is not None)."""
    for option, value in given.items():
        if value is not None:
            raise OtherExperimentError(f"{option} does not belong to {name}; leave it out")


def measured_options(name: str, given: Mapping[str, object]) -> Settings:
    """Return the options of an experiment that measures; what was not given is None.

    Raises
    ------
    OptionValueError
        When a value is out of range.
    OtherExperimentError
        When an option is given that the experiment does not have.
    """
    from noctule.experiments.measured import MEASURED

    return options_of(name, MEASURED[name].options(), given)


def options_of(name: str, options: Group, given: Mapping[str, object]) -> Group:
    """Return `options` with what is given (is not None) put in its place; raises as `measured_options`."""
    known = type(options).model_fields
    flags = {option: f"--{option.replace('_', '-')}" for option in given}
    refuse_others(name, {flags[option]: value for option, value in given.items() if option not in known})
    for option, value in given.items():
        if value is not None:
            options = _with(options, flags[option], **{option: value})
    return options
