"""A heading at a place that is known: of the blob that is there, and of no other."""

import math

import numpy as np
import pytest
from localization_sightings import stage

from noctule.camera import CEILING_CAMERA
from noctule.geometry import Pose, wrap_angle
from noctule.localization.heading.near import FARTHEST, heading_near
from noctule.localization.heading.shape import HARMONIC
from noctule.simulation.ceiling import ThingPose

PLACE = np.array([0.2, 0.1, 1.2])


@pytest.fixture(scope="module")
def seen():
    room, background = stage(True)
    person = ThingPose("person", -0.6, -0.5, 0.3)
    return room.frame(50.0, Pose(PLACE, 0.4), [person]), background


def test_the_drones_heading_is_measured_beside_a_person(seen):
    frame, background = seen
    heading = heading_near(HARMONIC, frame, PLACE, background, CEILING_CAMERA, 0.3)
    assert heading is not None
    assert abs(wrap_angle(heading.yaw - 0.4)) < math.radians(4.0)
    assert heading.stamp == 50.0


def test_where_no_blob_is_near_nothing_is_measured(seen):
    frame, background = seen
    away = PLACE + np.array([FARTHEST + 0.1, 0.0, 0.0])
    assert heading_near(HARMONIC, frame, away, background, CEILING_CAMERA) is None


def test_an_empty_room_has_no_heading():
    room, background = stage(True)
    assert heading_near(HARMONIC, room.frame(51.0, None), PLACE, background, CEILING_CAMERA) is None
