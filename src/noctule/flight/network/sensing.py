"""What the sensors of a node say, as readings: navigation data, depth frames, colour markers."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from noctule.camera import FixedCamera
from noctule.estimation.events import Input
from noctule.estimation.measurements import NavdataNoise, of_heading, of_pose, of_vehicle_state
from noctule.flight.codec import decode_state
from noctule.flight.network.pacing import Schedule, paced
from noctule.flight.network.process import Nothing, Reading
from noctule.flight.reader import Recording
from noctule.geometry import Pose, wrap_angle
from noctule.localization.heading.markers import MarkerHeading
from noctule.localization.learning.bootstrap import drone_sighting
from noctule.localization.locator import Locator
from noctule.messages import DepthFrame, FlightState, VehicleState
from noctule.simulation.navdata import Navdata, NavdataSpec
from noctule.vision.depth.background import Background

_NOISE = NavdataNoise()
_STEPS = 300  # a second, of the simulated link


def recorded_navdata(
    recording: Recording,
    schedule: Schedule,
    name: str,
    stop: threading.Event,
    noise: NavdataNoise = _NOISE,
) -> Iterator[Reading]:
    """Yield what a vehicle reported and was told in a recorded flight, in real time."""
    return paced(_recorded(recording, schedule, name, noise), stop)


def _recorded(
    recording: Recording, schedule: Schedule, name: str, noise: NavdataNoise
) -> Iterator[tuple[float, list[Reading]]]:
    newest = -np.inf
    for k, tick in enumerate(recording.ticks):
        at = schedule.shared(tick.stamp)
        readings: list[Reading] = [Input(at, tick.sent.as_array(), name, k)]
        state = decode_state(tick.told.state)
        if state.stamp > newest:
            newest = state.stamp
            readings.append(_report(replace(state, stamp=schedule.shared(state.stamp)), noise, k, name))
        yield at, readings


def _report(state: VehicleState, noise: NavdataNoise, sequence: int, name: str) -> Reading:
    measured = of_vehicle_state(state, noise, sequence, name)
    return Nothing("the vehicle reports nothing") if measured is None else measured


def simulated_navdata(
    poses: list[tuple[float, Pose]], seed: int, schedule: Schedule, name: str, stop: threading.Event
) -> Iterator[Reading]:
    """Yield what a vehicle that flies along `poses`, (stamp [s], pose), reports of itself, in real time."""
    return paced(_simulated(poses, seed, schedule, name), stop)


def _simulated(
    poses: list[tuple[float, Pose]], seed: int, schedule: Schedule, name: str
) -> Iterator[tuple[float, list[Reading]]]:
    navdata = Navdata(NavdataSpec(), np.random.SeedSequence(seed), _STEPS)
    stamps = np.array([stamp for stamp, _ in poses])
    where = np.array([pose.position for _, pose in poses])
    yaw = np.unwrap([pose.yaw for _, pose in poses])
    v_world = np.gradient(where, stamps, axis=0)

    def true(stamp: float) -> VehicleState:
        x, y, z = (float(np.interp(stamp, stamps, v_world[:, i])) for i in range(3))
        heading = float(np.interp(stamp, stamps, yaw))
        c, s = np.cos(heading), np.sin(heading)
        v_body = np.array([c * x + s * y, c * y - s * x, z])
        height = float(np.interp(stamp, stamps, where[:, 2]))
        return VehicleState(stamp, FlightState.FLYING, yaw=wrap_angle(heading), v_body=v_body, height=height)

    for step in range(int(stamps[-1] * _STEPS)):
        report = navdata.step(step, partial(true, step / _STEPS))
        if report is not None:
            own = replace(report, stamp=schedule.shared(report.stamp))
            yield schedule.shared(step / _STEPS), [_report(own, _NOISE, step, name)]


def located(frames: Iterable[DepthFrame | Nothing], locator: Locator, name: str) -> Iterator[Reading]:
    """Yield where a depth camera sees the vehicle in each frame, or why it does not."""
    for k, frame in enumerate(frames):
        if isinstance(frame, Nothing):
            yield frame
            continue
        found = locator.step(frame)
        if found.measurement is None:
            yield Nothing(found.reason)
        else:
            yield of_pose(replace(found.measurement, source=name), k)


def marked(
    frames: Iterable[DepthFrame | Nothing], background: Background, camera: FixedCamera, name: str
) -> Iterator[Reading]:
    """Yield the heading that colour markers tell in each frame, or why there is none."""
    markers = MarkerHeading()
    for k, frame in enumerate(frames):
        if isinstance(frame, Nothing):
            yield frame
            continue
        if frame.colour is None:
            yield Nothing("the camera gives no colour")
            continue
        sighting = drone_sighting(frame, background, camera)
        heading = None if sighting is None else markers.measure(sighting)
        if heading is None:
            yield Nothing("no drone in view" if sighting is None else "its markers are not seen")
        else:
            yield of_heading(replace(heading, source=name), k)
