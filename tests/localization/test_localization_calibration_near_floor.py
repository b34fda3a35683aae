"""A drone on the floor: single readings hardly tell it from the floor, means of half a second do."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from localization_sightings import stage

from noctule.camera import CEILING_CAMERA
from noctule.geometry import Pose
from noctule.localization.calibration.near_floor import WINDOW, near_floor, steadied
from noctule.localization.locator import Locator
from noctule.localization.template import build_template
from noctule.messages import DepthFrame
from noctule.simulation.ceiling import CeilingSpec, manual_flight
from noctule.vision.depth.background import Background


def level(shape, deviation=12.0) -> Background:
    mean, spread = np.full(shape, 3000.0, np.float32), np.full(shape, deviation, np.float32)
    count = np.full(shape, 90, np.int32)
    return Background(mean, spread, count, np.full(shape, 2952, np.uint16), 90, 4.0)


def test_a_drone_on_the_floor_is_measured_by_means_and_not_by_single_frames():
    room, background = stage(False)
    flight = manual_flight(3, 30.0, 2.0, CeilingSpec())
    samples = [(room.frame(100.0 + stamp, pose), pose) for stamp, pose in flight]
    template = build_template(samples, background.nearest, CEILING_CAMERA)
    true = np.array([0.1, -0.7, 0.05])
    frames = [room.frame(500.0 + k / 30.0, Pose(true, 0.4)) for k in range(WINDOW + 7)]
    single = Locator(CEILING_CAMERA, background, template)
    assert all(single.step(frame).measurement is None for frame in frames)
    locator = Locator(CEILING_CAMERA, *near_floor(background, template))
    located = [locator.step(frame).measurement for frame in steadied(frames, background)]
    errors = np.array([m.position - true for m in located if m is not None])
    assert len(errors) == 6  # all but the two that confirm
    assert np.abs(errors.mean(axis=0)).max() < 0.004


def test_the_floor_is_still_told_from_a_drone_by_more_than_a_step_of_the_sensor():
    background = level((4, 4))
    background.count[0] = 10  # hardly ever seen: as before
    low, _ = near_floor(background, stage_template())
    assert (low.nearest[1:] == 3000 - 24).all()
    assert (low.nearest[0] == 2952).all()


def stage_template():
    from localization_flights import template

    return template()


@settings(max_examples=30)
@given(
    st.lists(st.integers(2970, 3030) | st.just(0), min_size=WINDOW, max_size=WINDOW),
    st.integers(0, WINDOW // 2 - 1),
)
def test_a_mean_is_of_readings_of_one_thing_and_no_reading_is_none(readings, edges):
    """Some readings of an edge are of the drone, 80 mm nearer: they do not draw the mean."""
    stack = np.array(readings, np.uint16)
    if np.count_nonzero(stack) < WINDOW:
        edges = 0
    stack[:edges] = 2900
    frames = [DepthFrame(0.1 * k, np.full((1, 1), z, np.uint16)) for k, z in enumerate(stack)]
    (steady,) = steadied(frames, level((1, 1), deviation=24.0))
    assert steady.stamp == frames[-1].stamp
    own = stack[edges:][stack[edges:] > 0]
    expected = int(own.mean() + 0.5) if len(own) >= 5 else 0
    assert steady.depth[0, 0] == expected


def test_too_few_frames_are_no_mean():
    assert not list(steadied([DepthFrame(0.0, np.zeros((1, 1), np.uint16))] * 14, level((1, 1))))
