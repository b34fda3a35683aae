"""Heading by colour markers: a full turn, in the region of interest only, and nothing where one is hidden."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from localization_sightings import drone_seen

from noctule.camera import CEILING_CAMERA
from noctule.geometry import wrap_angle
from noctule.localization.heading.markers import MarkerHeading
from noctule.localization.heading.sighting import Sighting
from noctule.messages import DepthFrame
from noctule.simulation.ceiling import ThingPose

MARKERS = MarkerHeading()
RED, BLUE, GREY = (200, 20, 25), (20, 30, 190), (120, 120, 118)
TOP = 0.03  # [m], of the drone's body over its origin


def painted(
    sighting: Sighting, x_world, yaw: float, front=RED, back=BLUE, spread=0.12, size=0.03
) -> Sighting:
    """The sighting with discs of two colours ahead and behind, None for a marker that is hidden."""
    h, w = sighting.frame.depth.shape
    colour = np.full((h, w, 3), GREY, dtype=np.uint8)
    v, u = np.mgrid[0:h, 0:w]
    depth = np.where(sighting.frame.depth > 0, sighting.frame.depth * 1e-3, sighting.blob.depth)
    points = CEILING_CAMERA.to_world(np.column_stack([u.ravel(), v.ravel()]).astype(float), depth.ravel())
    for rgb, side in ((front, 1.0), (back, -1.0)):
        if rgb is None:
            continue
        off = np.array([side * spread * np.cos(yaw), side * spread * np.sin(yaw), TOP])
        middle = np.asarray(x_world) + off
        colour[(np.linalg.norm(points - middle, axis=1) < size).reshape(h, w)] = rgb
    frame = DepthFrame(sighting.frame.stamp, sighting.frame.depth, colour)
    return replace(sighting, frame=frame)


PLACE = np.array([0.2, 0.3, 1.2])
SEEN = painted(drone_seen(PLACE, 0.6), PLACE, 0.6)


@settings(max_examples=15, deadline=None)
@given(st.floats(-3.14, 3.14), st.floats(-0.4, 0.5), st.floats(-0.6, 0.7), st.floats(0.5, 1.8))
def test_the_heading_is_the_line_from_blue_to_red_anywhere_below_the_camera(yaw, x, y, z) -> None:
    place = np.array([x, y, z])
    measured = MARKERS.measure(painted(drone_seen(place, yaw), place, yaw))
    assert np.degrees(abs(wrap_angle(measured.yaw - yaw))) < 3.0
    assert measured.source == "markers"


def test_red_is_the_nose_so_half_a_turn_is_told_apart() -> None:
    swapped = painted(drone_seen(PLACE, 0.6), PLACE, 0.6, front=BLUE, back=RED)
    apart = wrap_angle(MARKERS.measure(SEEN).yaw - MARKERS.measure(swapped).yaw)
    assert abs(apart) == pytest.approx(np.pi, abs=1e-6)


def test_the_turn_nearest_to_the_prediction_is_answered() -> None:
    once = MARKERS.measure(SEEN).yaw
    assert MARKERS.measure(SEEN, 0.6 + 6.0 * np.pi).yaw == pytest.approx(once + 6.0 * np.pi)


@pytest.mark.parametrize("hidden", ["front", "back"])
def test_one_marker_alone_says_nothing(hidden) -> None:
    assert MARKERS.measure(painted(drone_seen(PLACE, 0.6), PLACE, 0.6, **{hidden: None})) is None


def test_a_frame_without_colour_says_nothing() -> None:
    assert MARKERS.measure(drone_seen(PLACE, 0.6)) is None


def test_markers_that_are_too_near_each_other_are_not_the_drone_s() -> None:
    assert MARKERS.measure(painted(drone_seen(PLACE, 0.6), PLACE, 0.6, spread=0.02, size=0.015)) is None


def test_specks_are_not_markers() -> None:
    assert MARKERS.measure(painted(drone_seen(PLACE, 0.6), PLACE, 0.6, size=0.003)) is None


def test_red_outside_of_the_region_of_interest_does_not_matter() -> None:
    colour = SEEN.frame.colour.copy()
    colour[:60, :] = RED
    colour[420:, :] = BLUE
    assert SEEN.blob.top >= 60
    assert SEEN.blob.bottom <= 420
    changed = replace(SEEN, frame=replace(SEEN.frame, colour=colour))
    assert MARKERS.measure(changed) == MARKERS.measure(SEEN)


def test_a_red_shirt_far_below_the_drone_is_not_its_nose() -> None:
    """Inside the region of interest, larger than the marker, but at another depth."""
    colour = SEEN.frame.colour.copy()
    floor = SEEN.frame.depth > SEEN.frame.depth[SEEN.labels == SEEN.blob.label].max() + 200
    colour[floor] = RED
    changed = replace(SEEN, frame=replace(SEEN.frame, colour=colour))
    assert MARKERS.measure(changed) == MARKERS.measure(SEEN)


def test_holes_in_the_depth_of_a_marker_are_bridged_by_the_rest() -> None:
    depth = SEEN.frame.depth.copy()
    red = (SEEN.frame.colour == RED).all(axis=2)
    depth[red] = 0
    holed = replace(SEEN, frame=replace(SEEN.frame, depth=depth))
    assert np.degrees(abs(MARKERS.measure(holed).yaw - MARKERS.measure(SEEN).yaw)) < 3.0


def test_a_person_beside_the_drone_leaves_it_its_heading() -> None:
    person = ThingPose("person", 0.2, -0.35)
    sighting = painted(drone_seen(PLACE, 0.6, things=(person,)), PLACE, 0.6)
    drone = SEEN.blob  # found before the person came
    assert np.degrees(abs(MARKERS.measure(replace(sighting, blob=drone)).yaw - 0.6)) < 3.0


def test_a_longer_base_is_a_better_measurement() -> None:
    narrow = MARKERS.measure(painted(drone_seen(PLACE, 0.6), PLACE, 0.6, spread=0.06))
    assert narrow.variance > 2.0 * MARKERS.measure(SEEN).variance
