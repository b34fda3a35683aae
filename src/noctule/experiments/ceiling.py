"""The simulated laboratory with its ceiling camera, taught, and every method on blobs with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from noctule.camera import FixedCamera
from noctule.flight.teach_ceiling import RATE, teach_stage
from noctule.geometry import Array
from noctule.localization.detection.samples import FlightSamples
from noctule.localization.detector_file import Detectors
from noctule.localization.heading.ellipse import EllipseHeading
from noctule.localization.heading.markers import MarkerHeading
from noctule.localization.heading.method import HeadingMethod
from noctule.localization.heading.shape import AXIS, HARMONIC, PLANE
from noctule.localization.learning.headings import calibrate_heading
from noctule.localization.locator import Locator
from noctule.localization.site import Site, locator_of
from noctule.localization.template import Template
from noctule.simulation.ceiling import CeilingSpec, DepthStage
from noctule.vision.depth.background import Background

__all__ = ["RATE", "TaughtCamera", "stamps", "teach_camera"]


@dataclass(frozen=True, slots=True)
class TaughtCamera:
    """A camera in a room, and all that it was taught."""

    stage: DepthStage
    site: Site
    headings: tuple[HeadingMethod, ...]  # on blobs, calibrated on the manual flight
    samples: FlightSamples  # of the manual flight, for Fig. 11
    stamp: float  # [s], later frames begin here

    @property
    def camera(self) -> FixedCamera:
        """Where it hangs."""
        return self.stage.camera

    @property
    def background(self) -> Background:
        """The empty room."""
        return self.site.background

    @property
    def detectors(self) -> Detectors:
        """What the drone's blob looks like."""
        return self.site.detectors

    @property
    def template(self) -> Template:
        """The drone's top view."""
        return self.site.template

    @property
    def offset(self) -> Array:
        """Measured minus true, world, (3,) [m]."""
        return self.site.camera.offset

    def locator(self) -> Locator:
        """Return the default method, which has seen nothing yet."""
        return locator_of(self.site)


@lru_cache(maxsize=1)
def teach_camera(seed: int, hull: bool, markers: bool = False) -> TaughtCamera:
    """Draw a room and teach its camera: background, manual flight, template, detectors, offset, headings.

    The last one is kept: its stage draws every frame anew, by its stamp.
    """
    stage = DepthStage(CeilingSpec(hull=hull, markers=markers), seed)
    lessons = teach_stage(stage, seed)
    background = lessons.site.background
    frames, poses, camera = lessons.frames, lessons.poses, stage.camera
    ellipse = calibrate_heading(EllipseHeading(), frames, poses, background, camera)
    shapes = [calibrate_heading(m, frames, poses, background, camera) for m in (PLANE, AXIS, HARMONIC)]
    headings: tuple[HeadingMethod, ...] = (ellipse, *shapes, MarkerHeading())
    return TaughtCamera(stage, lessons.site, headings, lessons.samples, lessons.stamp)


def stamps(begin: float, count: int) -> Iterator[float]:
    """Yield the stamps [s] of frames at the camera's rate."""
    for k in range(count):
        yield begin + k / RATE
