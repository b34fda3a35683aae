"""How well each method measures the heading: by a flight whose poses the learned template gave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from noctule.camera import FixedCamera
from noctule.errors import NoctuleError
from noctule.geometry import Pose
from noctule.localization.heading.ellipse import EllipseHeading
from noctule.localization.heading.markers import MarkerHeading
from noctule.localization.heading.shape import ShapeHeading
from noctule.localization.heading.turns import mean_and_variance, nearest_turn
from noctule.localization.learning.bootstrap import drone_sighting
from noctule.messages import DepthFrame
from noctule.vision.depth.background import Background

MIN_HEADINGS = 30
Method = TypeVar("Method", EllipseHeading, ShapeHeading, MarkerHeading)


class TooFewHeadingsError(NoctuleError):
    """A method measured the heading in too few frames to say how well it does."""


def calibrate_heading(
    method: Method,
    frames: Sequence[DepthFrame],
    poses: Sequence[Pose | None],
    background: Background,
    camera: FixedCamera,
) -> Method:
    """Return the method with its axis and its standard deviation as this flight shows them.

    `poses` are those of `LearnedTemplate`: far better than any method by shape. The axis takes off the mean
    error; the others are counted in the method's own deviations, so that one which knows good frames from bad
    keeps that. Raises TooFewHeadingsError.
    """
    errors: list[float] = []
    said: list[float] = []  # deviations [rad]
    for frame, pose in zip(frames, poses, strict=True):
        sighting = None if pose is None else drone_sighting(frame, background, camera)
        measured = None if pose is None or sighting is None else method.measure(sighting, pose.yaw)
        if pose is not None and measured is not None:
            errors.append(measured.yaw - pose.yaw)
            said.append(float(np.sqrt(measured.variance)))
    if len(errors) < MIN_HEADINGS:
        raise TooFewHeadingsError(
            f"heading by {method.name}: measured in {len(errors)} of {len(frames)} frames, at least "
            f"{MIN_HEADINGS} are needed; fly longer, and for markers check that both are on and lit"
        )
    bias, _ = mean_and_variance(np.array(errors), method.period)
    rest = np.array([nearest_turn(error - bias, 0.0, method.period) for error in errors])
    scale = float(np.sqrt(np.mean((rest / said) ** 2)))
    return replace(method, axis=method.axis + bias, sd=method.sd * scale)
