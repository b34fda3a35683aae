import math
from dataclasses import replace

import numpy as np
import pytest
from localization_flights import CAMERA, HOME, background, drone, frame, locator, template
from localization_rays import BOX, PERSON, TRAY, Thing

from noctule.geometry import Pose, wrap_angle
from noctule.localization.located import Located, LocatorSettings, LocatorState
from noctule.localization.locator import Locator
from noctule.localization.placing import slanted
from noctule.localization.tracker import Prediction
from noctule.messages import DepthFrame


def orbit(k: int) -> Pose:
    t = k / 30.0
    return Pose(
        np.array([0.1 + 0.3 * math.cos(t), 0.1 + 0.4 * math.sin(t), 1.2 + 0.1 * math.sin(0.7 * t)]),
        wrap_angle(0.4 + 0.5 * t),
    )


def fly(it: Locator, ks: range, *things: Thing) -> list[Located]:
    return [it.step(frame(k, drone(orbit(k)), *things)) for k in ks]


@pytest.fixture(scope="module")
def flight():
    return fly(locator(), range(30))


def test_a_start_is_confirmed_over_three_frames(flight):
    assert [f.state for f in flight[:3]] == [LocatorState.SEARCHING] * 2 + [LocatorState.TRACKING]
    assert flight[0].reason == "confirming: a drone was found in 1 of 3 frames"
    assert flight[1].measurement is None
    assert flight[2].measurement is not None


def test_a_flight_is_followed_in_every_frame(flight):
    for k, located in enumerate(flight[2:], start=2):
        m = located.measurement
        assert m is not None
        assert located.reason == ""
        assert m.stamp == k / 30.0
        assert m.source == "registration"
        assert np.linalg.norm(m.position - orbit(k).position) < 0.02


def test_the_half_turn_is_right_within_half_a_second(flight):
    certain = [k for k, located in enumerate(flight) if located.heading_certain]
    assert certain[0] < 15
    for k in certain:
        assert abs(math.degrees(wrap_angle(flight[k].measurement.yaw - orbit(k).yaw))) < 4.0


def test_until_the_half_turn_is_decided_the_heading_is_worth_nothing(flight):
    for located in flight[2:]:
        sd = math.degrees(math.sqrt(located.measurement.covariance[3, 3]))
        assert (sd < 3.0) if located.heading_certain else (sd > 80.0)


@pytest.mark.parametrize("yaw", [-2.5, -0.9, 0.6, 2.1])
def test_every_start_ends_with_the_right_heading(yaw):
    it = locator()
    out = [it.step(frame(k, drone(Pose(HOME.position, yaw)))) for k in range(15)]
    assert out[-1].heading_certain
    assert abs(math.degrees(wrap_angle(out[-1].measurement.yaw - yaw))) < 4.0


def test_two_locators_answer_the_same_bit_for_bit():
    a, b = fly(locator(), range(6)), fly(locator(), range(6))
    for x, y in zip(a, b, strict=True):
        assert x.reason == y.reason
        if x.measurement is not None:
            np.testing.assert_array_equal(x.measurement.position, y.measurement.position)
            np.testing.assert_array_equal(x.measurement.covariance, y.measurement.covariance)


def test_a_person_who_walks_up_does_not_break_the_track():
    it = locator()
    fly(it, range(4))
    for k in range(4, 24):
        at = orbit(k).position[:2] + np.array([0.9 - 0.02 * k, 0.05])
        person = Thing(Pose(np.array([*at, 0.0]), 0.3), PERSON)
        located = it.step(frame(k, drone(orbit(k)), person))
        assert located.measurement is not None, located.reason
        assert np.linalg.norm(located.measurement.position - orbit(k).position) < 0.03


@pytest.mark.parametrize("solids", [TRAY, BOX, PERSON])
def test_another_thing_alone_is_never_tracked(solids):
    it = locator()
    for k in range(12):
        z = 0.0 if solids is PERSON else 1.0
        thing = Thing(Pose(np.array([0.1 + 0.02 * k, 0.1, z]), 0.1 * k), solids)
        located = it.step(frame(k, thing))
        assert located.measurement is None
        assert located.state is LocatorState.SEARCHING


def test_an_empty_room_says_so():
    located = locator().step(frame(0))
    assert located.measurement is None
    assert located.reason == "nothing in view: no foreground is as large as a drone"


def test_a_drone_that_vanishes_is_lost_with_a_reason_and_found_again():
    it = locator()
    fly(it, range(5))
    gone = [it.step(frame(k)) for k in range(5, 25)]
    assert all(f.state is LocatorState.LOST and f.measurement is None for f in gone)
    assert gone[0].reason.startswith("low score: ")
    assert gone[0].reason.endswith(" % of what the drone would score, expected at least 33 %")
    assert gone[-1].reason == "nothing in view: no foreground is as large as a drone"
    back = fly(it, range(25, 30))
    assert back[-1].state is LocatorState.TRACKING
    assert np.linalg.norm(back[-1].measurement.position - orbit(29).position) < 0.02


def test_a_drone_under_a_lid_is_occluded_and_goes_on_when_it_is_taken_away():
    it = locator()
    fly(it, range(5))
    lid = Thing(Pose(orbit(5).position + np.array([0.0, -0.15, 0.5]), 0.0), TRAY)
    hidden = [it.step(frame(k, drone(orbit(k)), lid)) for k in range(5, 9)]
    assert all(f.measurement is None for f in hidden)
    assert any(f.reason.startswith("occluded: ") for f in hidden), [f.reason for f in hidden]
    assert fly(it, range(9, 10))[0].measurement is not None


@pytest.mark.parametrize(
    ("depth", "name"),
    [
        (np.zeros((480, 640), np.uint16), "wrong resolution"),
        (np.zeros((360, 480), np.uint16), "all zero"),
        (np.full((360, 480), 3, np.uint16), "wrong unit"),
        (np.full((360, 480), 2.5), "wrong unit"),
    ],
)
def test_a_frame_that_cannot_be_used_is_named_and_ends_nothing(depth, name):
    it = locator()
    fly(it, range(5))
    bad = it.step(DepthFrame(5 / 30.0, depth))
    assert bad.measurement is None
    assert bad.reason.split(":")[0] == name
    assert bad.state is LocatorState.LOST
    assert it.step(frame(6, drone(orbit(6)))).measurement is not None


def test_a_filters_prediction_is_looked_at():
    it = locator()
    fly(it, range(5))
    told = Prediction(orbit(20), np.diag([0.03, 0.03, 0.03, 0.1]) ** 2)
    assert it.step(frame(20, drone(orbit(20))), told).measurement is not None
    alone = locator()
    fly(alone, range(5))
    at = alone.step(frame(5, drone(Pose(orbit(5).position + np.array([0.5, 0.0, 0.0]), 0.0))))
    assert at.measurement is None  # half a metre in a frame is no drone


def test_the_calibrated_offset_is_taken_off():
    plain, moved = locator(), Locator(CAMERA, background(), template(), offset=np.array([0.01, 0.02, -0.03]))
    a, b = fly(plain, range(4))[-1], fly(moved, range(4))[-1]
    np.testing.assert_allclose(
        a.measurement.position - b.measurement.position, [0.01, 0.02, -0.03], atol=1e-12
    )


def test_what_slanting_rays_are_off_by_is_taken_off():
    plain = Locator(CAMERA, background(), template())
    drawn = Locator(CAMERA, background(), replace(template(), slant=-0.01))
    a, b = fly(plain, range(4))[-1].measurement, fly(drawn, range(4))[-1].measurement
    off = slanted(-0.01, CAMERA.t_world_camera, a.position)
    assert np.abs(off).max() > 1e-5
    np.testing.assert_allclose(a.position - b.position, off, atol=1e-12)
    assert a.yaw == b.yaw


def test_a_detector_decides_what_is_looked_at():
    class Picky:
        def propose(self, blobs, camera):
            return tuple(blobs)[:1]

    it = Locator(CAMERA, background(), template(), Picky())
    assert it.step(frame(0, drone(HOME))).diagnostics.proposals == 1


def test_where_a_detector_proposes_nothing_what_has_a_plausible_size_is_tried():
    class Blind:
        def propose(self, blobs, camera):
            return ()

    it = Locator(CAMERA, background(), template(), Blind())
    assert fly(it, range(4))[-1].measurement is not None
    empty = Locator(CAMERA, background(), template(), Blind()).step(frame(0))
    assert empty.reason == "nothing in view: no foreground is as large as a drone"
    assert empty.diagnostics.proposals == 0


def test_a_stricter_start_needs_more_frames():
    it = locator(LocatorSettings(start_frames=5))
    assert [f.state for f in fly(it, range(5))][3:] == [LocatorState.SEARCHING, LocatorState.TRACKING]


def test_outside_the_picture_is_said():
    it = locator()
    fly(it, range(5))
    away = Prediction(Pose(np.array([0.1, 4.0, 1.2]), 0.0), np.eye(4) * 1e-4)
    reason = it.step(frame(5), away).reason
    assert reason.startswith("outside the picture: it would be at (")
    assert reason.endswith(" px of 480x360")


def test_a_drone_that_was_hidden_for_a_moment_goes_on_without_being_confirmed():
    it = locator()
    fly(it, range(10))
    for k in range(10, 40):  # a second: longer than the track coasts
        assert it.step(frame(k)).measurement is None
    back = it.step(frame(40, drone(orbit(10))))
    assert back.measurement is not None
    assert back.heading_certain
    assert abs(wrap_angle(back.measurement.yaw - orbit(10).yaw)) < math.radians(4.0)


def test_a_drone_that_comes_back_elsewhere_is_confirmed_first():
    it = locator()
    fly(it, range(10))
    for k in range(10, 40):
        it.step(frame(k))
    elsewhere = Pose(orbit(10).position + np.array([-0.5, 0.0, 0.0]), 0.4)
    answers = [it.step(frame(k, drone(elsewhere))) for k in range(40, 43)]
    assert [a.measurement is not None for a in answers] == [False, False, True]


def test_the_right_thing_is_found_though_the_detector_proposes_another():
    class Wrong:
        def propose(self, blobs, camera):
            return tuple(sorted(blobs, key=lambda b: -b.area))[:1]

    it = Locator(CAMERA, background(), template(), Wrong())
    person = Thing(Pose(np.array([0.9, 0.9, 0.0]), 0.3), PERSON)
    answers = [it.step(frame(k, drone(HOME), person)) for k in range(3)]
    assert answers[-1].measurement is not None
    assert np.linalg.norm(answers[-1].measurement.position - HOME.position) < 0.03
