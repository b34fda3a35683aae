"""What the sensors of a node say, as readings: navigation data, depth frames, colour markers.

What the site's calibration makes of it is for `senses`, in the node's own thread.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from noctule.camera import FixedCamera
from noctule.estimation.events import Input
from noctule.flight.codec import decode_state
from noctule.flight.network.pacing import Schedule, paced
from noctule.flight.network.process import Nothing, Reading
from noctule.flight.network.senses import Sight
from noctule.flight.reader import Recording
from noctule.geometry import Pose, wrap_angle
from noctule.localization.heading.markers import MarkerHeading
from noctule.localization.heading.near import heading_near
from noctule.localization.learning.bootstrap import drone_sighting
from noctule.localization.locator import Locator
from noctule.localization.tracker import Prediction
from noctule.messages import DepthFrame, FlightState, VehicleState
from noctule.simulation.navdata import Navdata, NavdataSpec
from noctule.vision.depth.background import Background

MARKERS = "markers"  # the source of headings from a depth node's own camera
_STEPS = 300  # a second, of the simulated link


Expectation = Callable[[float], Prediction | None]
"""Where to look in the frame exposed at a time [s]."""


def _nowhere(stamp: float) -> Prediction | None:
    return None


def recorded_navdata(
    recording: Recording,
    schedule: Schedule,
    name: str,
    stop: threading.Event,
) -> Iterator[Reading]:
    """Yield what a vehicle reported and was told in a recorded flight, in real time."""
    return paced(_recorded(recording, schedule, name), stop)


def _recorded(recording: Recording, schedule: Schedule, name: str) -> Iterator[tuple[float, list[Reading]]]:
    newest = -np.inf
    for k, tick in enumerate(recording.ticks):
        at = schedule.shared(tick.stamp)
        readings: list[Reading] = [Input(at, tick.sent.as_array(), name, k)]
        state = decode_state(tick.told.state)
        if state.stamp > newest:
            newest = state.stamp
            readings.append(replace(state, stamp=schedule.shared(state.stamp)))
        yield at, readings


def simulated_navdata(
    poses: list[tuple[float, Pose]], seed: int, schedule: Schedule, stop: threading.Event
) -> Iterator[Reading]:
    """Yield what a vehicle that flies along `poses`, (stamp [s], pose), reports of itself, in real time."""
    return paced(_simulated(poses, seed, schedule), stop)


def _simulated(
    poses: list[tuple[float, Pose]], seed: int, schedule: Schedule
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
            yield schedule.shared(step / _STEPS), [replace(report, stamp=schedule.shared(report.stamp))]


def located(
    frames: Iterable[DepthFrame | Nothing],
    locator: Locator,
    expected: Expectation = _nowhere,
    markers: Background | None = None,
) -> Iterator[Reading]:
    """Yield where a depth camera sees the vehicle in each frame, or why it does not.

    `expected` is asked for the prediction of each frame. With the room's background as `markers`, the heading
    of the colour markers is looked for where the vehicle was found.
    """
    method = MarkerHeading()
    for frame in frames:
        if isinstance(frame, Nothing):
            yield frame
            continue
        found = locator.step(frame, expected(frame.stamp))
        if found.measurement is None:
            yield Nothing(found.reason)
            continue
        yield Sight(found.measurement, found.heading_certain)
        if markers is not None and frame.colour is not None:
            heading = heading_near(method, frame, found.measurement.position, markers, locator.camera)
            if heading is not None:
                yield replace(heading, source=MARKERS)


def marked(
    frames: Iterable[DepthFrame | Nothing], background: Background, camera: FixedCamera, name: str
) -> Iterator[Reading]:
    """Yield the heading that colour markers tell in each frame, or why there is none."""
    markers = MarkerHeading()
    for frame in frames:
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
            yield replace(heading, source=name)
