"""What a recording says of its sensors: which one is the reference, and how the others compare with it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from noctule.errors import NoctuleError
from noctule.estimation.reference import Reference, with_velocities
from noctule.estimation.reports import Reports
from noctule.estimation.sensor_calibration import (
    HeadingErrors,
    calibrate_onboard,
    calibrate_room,
)
from noctule.estimation.sensors import Sensors
from noctule.flight.sensor_recording import SensorLog
from noctule.localization.heading.markers import MarkerHeading
from noctule.localization.heading.near import heading_near
from noctule.localization.site import Site, locator_of, straightened
from noctule.messages import DepthFrame, HeadingMeasurement, PoseMeasurement

Kind = Literal["truth", "markers"]
_NAMES: dict[Kind, str] = {"truth": "ground truth", "markers": "colour markers"}
UNCALIBRATED = Sensors()
_FEWEST = 2  # measurements that anything can be made of


class NoReferenceError(NoctuleError):
    """A recording with nothing to judge its sensors by."""


class NoSensorsError(NoctuleError):
    """A recording without a sensor to judge."""


@dataclass(frozen=True, slots=True)
class SensorFlight:
    """What came of a recording."""

    sensors: Sensors  # those that it does not hold are as they were given
    headings: dict[str, HeadingErrors]  # by sensor: onboard, depth, markers
    reference: str  # in words


def calibrate_sensors(
    log: SensorLog, kind: Kind | None = None, known: Sensors = UNCALIBRATED
) -> SensorFlight:
    """Calibrate every sensor of a recording; `kind` None takes the truth where there is one.

    With markers as the reference, depth says where the vehicle was; then its positions are not judged.

    Raises
    ------
    NoReferenceError, NoSensorsError
        When the recording does not hold what is needed.
    SensorFlightError
        When the flight is too short, or does not turn through all headings.
    """
    kind = kind or ("truth" if log.truth else "markers")
    reference = with_velocities(_of_truth(log) if kind == "truth" else _of_markers(log))
    headings: dict[str, HeadingErrors] = {}
    found = known
    states = [state for state in log.states if state.yaw is not None]
    if len(states) >= _FEWEST:
        onboard, headings["onboard"] = calibrate_onboard(Reports.of_states(states), reference)
        found = found.model_copy(update={"onboard": onboard})
    if len(log.poses) >= _FEWEST:
        reports = Reports.of_poses(log.poses).faced(reference)
        by_markers = kind == "markers"
        if by_markers:  # its positions are the reference's
            reports = replace(reports, position=None)
        depth, headings["depth"] = calibrate_room("depth", reports, reference, same_exposures=by_markers)
        found = found.model_copy(update={"depth": depth})
    if kind == "truth" and len(log.headings) >= _FEWEST:
        reports = Reports.of_headings(log.headings)
        markers, headings["markers"] = calibrate_room("markers", reports, reference)
        found = found.model_copy(update={"markers": markers})
    if not headings:
        raise NoSensorsError(
            f"recording {log.path}: holds no reports with a heading and no located depth frames, expected "
            "one of them beside the reference; record the vehicle's reports too"
        )
    return SensorFlight(found, headings, _NAMES[kind])


def see(log: SensorLog, frames: Iterable[DepthFrame], site: Site) -> SensorLog:
    """Return the log with what the depth frames of the recording show: the drone and its markers."""
    camera, locator = site.camera.camera, locator_of(site)
    method = MarkerHeading()
    poses: list[PoseMeasurement] = []
    headings: list[HeadingMeasurement] = []
    for frame in straightened(frames, site.camera):
        pose = locator.step(frame).measurement
        if pose is None:
            continue
        poses.append(pose)
        if frame.colour is not None:
            heading = heading_near(method, frame, pose.position, site.background, camera)
            headings += [] if heading is None else [heading]
    return replace(log, poses=tuple(poses), headings=tuple(headings))


def _of_truth(log: SensorLog) -> Reference:
    if len(log.truth) < _FEWEST:
        raise NoReferenceError(
            f"recording {log.path}: holds no ground truth, expected that of a simulated flight; use a "
            "recording of one, or --reference markers"
        )
    return Reference(
        _stamps(log.truth),
        np.array([truth.pose.yaw for truth in log.truth]),
        np.array([truth.pose.position for truth in log.truth]),
        np.array([truth.v_world for truth in log.truth]),
    )


def _of_markers(log: SensorLog) -> Reference:
    if len(log.headings) < _FEWEST:
        raise NoReferenceError(
            f"recording {log.path}: holds neither ground truth nor headings of markers, expected one to "
            "judge sensors by; fly with colour markers on, in sight of the camera"
        )
    marks = Reference(_stamps(log.headings), np.array([heading.yaw for heading in log.headings]))
    stamps = _stamps(log.poses)
    covered = marks.covers(stamps)
    if covered.sum() < _FEWEST:
        return marks
    positions = np.array([pose.position for pose in log.poses])
    return Reference(stamps[covered], marks.yaw_at(stamps[covered]), positions[covered])


def _stamps(values: Sequence[object]) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array([getattr(value, "stamp") for value in values], dtype=np.float64)  # noqa: B009
