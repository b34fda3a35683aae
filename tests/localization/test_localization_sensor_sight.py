"""Depth frames of a recording of sensors: where the drone was in them, as the site knows it."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from localization_flights import CAMERA, HOME, background, drone, frame, template

from noctule.flight.sensor_flights import see
from noctule.flight.sensor_recording import SensorLog
from noctule.localization.site import Site, SiteCamera

EMPTY = SensorLog(Path("s.mcap"), (), (), (), (), 12)


@pytest.fixture
def site():
    detectors = SimpleNamespace(named=lambda _: None)  # all of a plausible size are tried
    return Site(SiteCamera(CAMERA), background(), detectors, template())


def flown(count: int = 12) -> list:
    return [frame(k, drone(HOME)) for k in range(count)]


def test_frames_are_located_and_without_colour_hold_no_markers(site):
    log = see(EMPTY, flown(), site)
    assert len(log.poses) >= 8  # the first frames confirm that it is the drone
    assert log.headings == ()
    off = np.array([pose.position for pose in log.poses]) - HOME.position
    assert np.linalg.norm(off.mean(axis=0)) < 0.03
    assert [pose.stamp for pose in log.poses] == sorted(pose.stamp for pose in log.poses)


def test_the_sites_offset_is_taken_off(site):
    moved = replace(site, camera=SiteCamera(CAMERA, offset=np.array([0.1, 0.0, -0.2])))
    plain, corrected = see(EMPTY, flown(), site), see(EMPTY, flown(), moved)
    for a, b in zip(plain.poses, corrected.poses, strict=True):
        np.testing.assert_allclose(a.position - b.position, [0.1, 0.0, -0.2], atol=1e-12)


def test_markers_are_looked_for_where_there_is_colour(site):
    grey = np.full((*flown(1)[0].depth.shape, 3), 120, np.uint8)
    coloured = [replace(one, colour=grey) for one in flown()]
    assert see(EMPTY, coloured, site).headings == ()  # none is on
    red_and_blue = []
    for one in flown():
        colour = grey.copy()
        ahead = np.array([np.cos(HOME.yaw), np.sin(HOME.yaw), 0.0])
        for rgb, side in (((200, 20, 25), 1.0), ((20, 30, 190), -1.0)):
            u, v = np.round(CAMERA.project((HOME.position + 0.1 * side * ahead)[None]))[0].astype(int)
            colour[v - 3 : v + 4, u - 3 : u + 4] = rgb
        red_and_blue.append(replace(one, colour=colour))
    headings = see(EMPTY, red_and_blue, site).headings
    assert len(headings) >= 8
    assert np.mean([heading.yaw for heading in headings]) == pytest.approx(HOME.yaw, abs=0.2)
