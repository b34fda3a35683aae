"""The simulated room with its ceiling camera, taught as a person would teach a real one, for one seed.

Nothing here is handed a true pose but what a person can know: the room was empty, the drone flew alone, its
nose pointed to world x at the start, and for the constant offset it stood on stools at measured places.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from noctule.camera import FixedCamera
from noctule.geometry import Array, Pose
from noctule.localization.calibration.offset import Standing, measure_offset
from noctule.localization.detection.samples import FlightSamples
from noctule.localization.detector_file import Detectors
from noctule.localization.heading.ellipse import EllipseHeading
from noctule.localization.heading.markers import MarkerHeading
from noctule.localization.heading.method import HeadingMethod
from noctule.localization.heading.shape import AXIS, HARMONIC, PLANE
from noctule.localization.learning.detectors import fit_detectors
from noctule.localization.learning.headings import calibrate_heading
from noctule.localization.learning.template import learn_template
from noctule.localization.locator import Locator
from noctule.localization.template import Template
from noctule.simulation.ceiling import CeilingSpec, DepthStage, manual_flight
from noctule.vision.depth import learn_background
from noctule.vision.depth.background import Background

RATE = 30.0  # [Hz]
_EMPTY_FRAMES = 120
_FLIGHT_SECONDS = 60.0
_FLIGHT_RATE = 6.0  # [Hz], neighbouring frames of a slow flight say the same
_STOOLS = ((0.1, 0.1, 0.7), (0.6, -0.5, 0.7), (-0.4, -0.5, 0.7), (-0.4, 0.6, 1.1), (0.6, 0.6, 1.1))
_STOOL_FRAMES = 45
_BETWEEN = 1.0  # [s], so that no two frames of a seed share a stamp: the stamp draws the sensor's errors


@dataclass(frozen=True, slots=True)
class TaughtCamera:
    """A camera in a room, and all that it was taught."""

    stage: DepthStage
    background: Background
    detectors: Detectors
    template: Template
    offset: Array  # (3,) [m], measured minus true, world
    headings: tuple[HeadingMethod, ...]  # on blobs, calibrated on the manual flight
    samples: FlightSamples  # of the manual flight, for Fig. 11
    stamp: float  # [s], later frames begin here

    @property
    def camera(self) -> FixedCamera:
        """Where it hangs."""
        return self.stage.camera

    def locator(self) -> Locator:
        """Return the default method, which has seen nothing yet."""
        return _locator(self.camera, self.background, self.template, self.detectors, self.offset)


@lru_cache(maxsize=1)
def teach_camera(seed: int, hull: bool, markers: bool = False) -> TaughtCamera:
    """Draw a room and teach its camera: background, manual flight, template, detectors, offset.

    The last one is kept: its stage draws every frame anew, by its stamp.
    """
    spec = CeilingSpec(hull=hull, markers=markers)
    stage = DepthStage(spec, seed)
    camera = stage.camera
    background = learn_background(stage.frame(k / RATE, None).depth for k in range(_EMPTY_FRAMES))
    begin = _EMPTY_FRAMES / RATE + _BETWEEN
    flight = manual_flight(seed, _FLIGHT_SECONDS, _FLIGHT_RATE, spec)
    frames = [stage.frame(begin + stamp, pose) for stamp, pose in flight]
    detectors, samples = fit_detectors(frames, background, camera)
    learned = learn_template(frames, background, camera, start_yaw=flight[0][1].yaw)
    template = learned.template
    shapes = [
        calibrate_heading(m, frames, learned.poses, background, camera) for m in (PLANE, AXIS, HARMONIC)
    ]
    ellipse = calibrate_heading(EllipseHeading(), frames, learned.poses, background, camera)
    headings: tuple[HeadingMethod, ...] = (ellipse, *shapes, MarkerHeading())
    begin += _FLIGHT_SECONDS + _BETWEEN
    standing = []
    for true in map(np.array, _STOOLS):
        locator = _locator(camera, background, template, detectors, np.zeros(3))
        found = [
            locator.step(stage.frame(begin + k / RATE, Pose(true, 0.0))).measurement
            for k in range(_STOOL_FRAMES)
        ]
        standing.append(Standing(true, np.array([m.position for m in found if m is not None])))
        begin += _STOOL_FRAMES / RATE + _BETWEEN
    offset = measure_offset(standing).bias
    return TaughtCamera(stage, background, detectors, template, offset, headings, samples, begin)


def _locator(
    camera: FixedCamera, background: Background, template: Template, detectors: Detectors, offset: Array
) -> Locator:
    return Locator(camera, background, template, detectors.band, offset=offset)


def stamps(begin: float, count: int) -> Iterator[float]:
    """Yield the stamps [s] of frames at the camera's rate."""
    for k in range(count):
        yield begin + k / RATE
