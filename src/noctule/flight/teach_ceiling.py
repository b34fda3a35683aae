"""A simulated ceiling camera, taught as a person would teach a real one, once for each room.

Nothing here is handed a true pose but what a person can know: the room was empty, the drone flew alone, its
nose pointed to world x at the start, and for the constant offset it stood on stools at measured places.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from noctule.geometry import Array, Pose, wrap_angle
from noctule.localization.calibration.offset import (
    MovedDroneError,
    Offset,
    ScatterError,
    Standing,
    TooFewMeasurementsError,
    check_measured,
    measure_offset,
)
from noctule.localization.detection.samples import FlightSamples
from noctule.localization.learning.detectors import fit_detectors
from noctule.localization.learning.template import learn_template
from noctule.localization.site import Site, SiteCamera, locator_of
from noctule.messages import DepthFrame, PoseMeasurement
from noctule.simulation.ceiling import CeilingSpec, DepthStage, manual_flight, spread_poses
from noctule.simulation.ceiling.flights import sees_whole
from noctule.simulation.spec import RoomSpec
from noctule.vision.depth import learn_background

RATE = 30.0  # [Hz]
_EMPTY_FRAMES = 120
_FLIGHT_SECONDS = 60.0
_FLIGHT_RATE = 6.0  # [Hz], neighbouring frames of a slow flight say the same
# From below the camera to the far side of the picture, so that the slant is told; turned by quarters on each,
# so that what the template's middle is off by averages out.
_STOOLS = ((0.1, -0.7, 0.7), (-0.4, 0.0, 0.7), (0.6, 0.5, 0.9), (-0.3, 1.0, 0.7), (0.4, 1.3, 0.8))
_STOOL_FRAMES = 15  # of each quarter
_QUARTERS = 4
_BETWEEN = 1.0  # [s], so that no two frames of a seed share a stamp: the stamp draws the sensor's errors
_SPARE_STOOLS = 5  # tried where the drone is seen badly on others
_FEWEST_STOOLS = 3  # with two, one that was seen badly would be taken for slant
_STEPS = 3 + len(_STOOLS)

_KEPT = 4  # sites
_taught: dict[tuple[str, str, int], Site] = {}

Progress = Callable[[float, str], None]
"""Told how much is done, 0 to 1, and what comes now."""


@dataclass(frozen=True, slots=True)
class Lessons:
    """The site that a camera was taught, and what it was taught with."""

    site: Site
    frames: tuple[DepthFrame, ...]  # of the manual flight
    poses: tuple[Pose | None, ...]  # of those frames, as they were learned
    samples: FlightSamples  # of the same, for Fig. 11
    stamp: float  # [s], later frames begin here


def _silent(done: float, text: str) -> None:
    pass


def teach_stage(stage: DepthStage, seed: int, show: Progress = _silent) -> Lessons:
    """Teach the camera of a stage: background, manual flight of `seed`, detectors, template, offset.

    Raises what learning raises where the camera does not see enough of the drone.
    """
    spec, camera = stage.spec, stage.camera
    show(0.0, "learning the empty room")
    background = learn_background(stage.frame(k / RATE, None).depth for k in range(_EMPTY_FRAMES))
    begin = _EMPTY_FRAMES / RATE + _BETWEEN
    show(1.0 / _STEPS, "a flight by hand")
    flight = manual_flight(seed, _FLIGHT_SECONDS, _FLIGHT_RATE, spec)
    frames = [stage.frame(begin + stamp, pose) for stamp, pose in flight]
    detectors, samples = fit_detectors(frames, background, camera)
    show(2.0 / _STEPS, "learning the drone's top view")
    learned = learn_template(frames, background, camera, start_yaw=flight[0][1].yaw)
    site = Site(SiteCamera(camera), background, detectors, learned.template)
    begin += _FLIGHT_SECONDS + _BETWEEN
    standing: list[Standing] = []
    for true in _stools(seed, spec):
        if sum(map(_seen_well, standing)) == len(_STOOLS):
            break
        done = min(3 + len(standing), _STEPS - 1) / _STEPS
        show(done, "the drone on stools, for the offset")
        found: list[PoseMeasurement | None] = []
        for quarter in range(_QUARTERS):
            locator, pose = locator_of(site), Pose(true, wrap_angle(0.5 * math.pi * quarter))
            found += [
                locator.step(stage.frame(begin + k / RATE, pose)).measurement for k in range(_STOOL_FRAMES)
            ]
            begin += _STOOL_FRAMES / RATE + _BETWEEN
        standing.append(Standing(true, np.array([m.position for m in found if m is not None])))
    offset = _offset(standing, camera.t_world_camera)
    site = replace(
        site,
        camera=replace(site.camera, offset=offset.bias),
        template=replace(site.template, slant=offset.slant),
    )
    show(1.0, "")
    return Lessons(site, tuple(frames), tuple(learned.poses), samples, begin)


def _seen_well(standing: Standing) -> bool:
    try:
        check_measured(standing.measured, "offset")
    except (TooFewMeasurementsError, MovedDroneError, ScatterError):
        return False
    return True


def _offset(standing: Sequence[Standing], eye: Array) -> Offset:
    """Return the offset of the places where the drone was seen well; raises as `measure_offset` does."""
    well = [one for one in standing if _seen_well(one)]
    return measure_offset(well if len(well) >= _FEWEST_STOOLS else standing, eye)


def _stools(seed: int, spec: CeilingSpec) -> Sequence[Array]:
    """Return places (3,) [m] that the camera sees: those below its usual place, or some of what it sees.

    After them come spare ones.
    """
    places = [np.array(place) for place in _STOOLS]
    spread = [pose.position for pose in spread_poses(seed, len(_STOOLS) + _SPARE_STOOLS, spec)]
    if all(sees_whole(spec.camera, place) for place in places):
        return places + spread[:_SPARE_STOOLS]
    return spread


def teach_ceiling(spec: CeilingSpec, room: RoomSpec, seed: int, show: Progress = _silent) -> Site:
    """Return the site of a simulated camera in a room; the last few are kept within a process."""
    key = (spec.model_copy(update={"colour": False}).model_dump_json(), room.model_dump_json(), seed)
    if key not in _taught:
        while len(_taught) >= _KEPT:
            _taught.pop(next(iter(_taught)))
        # Another stream than the flight's: lessons and flights differ in the sensor's errors.
        own = int(np.random.SeedSequence([seed, 0x5EE]).generate_state(1)[0])
        _taught[key] = teach_stage(DepthStage(spec, own, room), seed, show).site
    return _taught[key]
