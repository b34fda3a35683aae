"""Calibrated headings: mean error zero and errors as large as said, for the drone that flew."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from localization_sightings import stage

from noctule.camera import CEILING_CAMERA
from noctule.geometry import Pose, wrap_angle
from noctule.localization.heading.markers import MarkerHeading
from noctule.localization.heading.shape import AXIS, HARMONIC
from noctule.localization.heading.turns import nearest_turn
from noctule.localization.learning.bootstrap import drone_sighting
from noctule.localization.learning.headings import TooFewHeadingsError, calibrate_heading
from noctule.messages import DepthFrame
from noctule.simulation.ceiling.flights import spread_poses


@cache
def spread(hull: bool, seed: int, n: int = 80) -> tuple[list[DepthFrame], list[Pose]]:
    room, _ = stage(hull)
    poses = spread_poses(seed, n, room.spec)
    return [room.frame(1000.0 + 100.0 * seed + i, pose) for i, pose in enumerate(poses)], poses


def errors(method, hull: bool, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors [rad] and the deviations [rad] that the method said."""
    found = []
    for frame, pose in zip(*spread(hull, seed), strict=True):
        measured = method.measure(drone_sighting(frame, stage(hull)[1], CEILING_CAMERA), pose.yaw)
        if measured is not None:
            found.append((measured.yaw - pose.yaw, np.sqrt(measured.variance)))
    return tuple(np.array(found).T)


@pytest.mark.parametrize(("method", "hull"), [(HARMONIC, True), (AXIS, False)])
def test_errors_in_other_frames_are_as_large_as_said(method, hull) -> None:
    fitted = calibrate_heading(method, *spread(hull, 1), stage(hull)[1], CEILING_CAMERA)
    error, said = errors(fitted, hull, 2)
    assert 0.5 < np.mean((error / said) ** 2) < 2.0
    assert abs(error.mean()) < 0.5 * said.mean()


def test_with_the_hull_the_harmonic_is_far_better_than_without() -> None:
    sd = {
        hull: calibrate_heading(HARMONIC, *spread(hull, 1), stage(hull)[1], CEILING_CAMERA).sd
        for hull in (True, False)
    }
    assert np.degrees(sd[True]) < 1.5
    assert sd[False] > 3.0 * sd[True]


def test_an_axis_that_lies_otherwise_on_the_drone_is_found() -> None:
    """Poses whose heading 0 lies 0.3 rad beside ours: the cross is that much off."""
    frames, poses = spread(True, 1)
    turned = [Pose(p.position, wrap_angle(p.yaw - 0.3), p.roll, p.pitch) for p in poses]
    plain = calibrate_heading(HARMONIC, frames, poses, stage(True)[1], CEILING_CAMERA)
    fitted = calibrate_heading(HARMONIC, frames, turned, stage(True)[1], CEILING_CAMERA)
    assert nearest_turn(fitted.axis - plain.axis, 0.0, HARMONIC.period) == pytest.approx(0.3, abs=1e-6)
    assert fitted.sd == pytest.approx(plain.sd)


def test_frames_without_a_pose_are_left_out() -> None:
    frames, poses = spread(True, 1)
    gaps = [None if i % 2 else pose for i, pose in enumerate(poses)]
    half = calibrate_heading(HARMONIC, frames[::2], poses[::2], stage(True)[1], CEILING_CAMERA)
    assert calibrate_heading(HARMONIC, frames, gaps, stage(True)[1], CEILING_CAMERA) == half


def test_a_method_that_hardly_ever_measures_is_refused() -> None:
    with pytest.raises(TooFewHeadingsError) as caught:
        calibrate_heading(MarkerHeading(), *spread(True, 1), stage(True)[1], CEILING_CAMERA)
    assert str(caught.value) == (
        "heading by markers: measured in 0 of 80 frames, at least 30 are needed; fly longer, and for markers "
        "check that both are on and lit"
    )
