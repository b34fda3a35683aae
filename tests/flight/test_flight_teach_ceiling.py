"""Where the drone is put down, to teach a simulated camera."""

from __future__ import annotations

import numpy as np
import pytest

import noctule.flight.teach_ceiling as teaching
from noctule.flight.teach_ceiling import teach_ceiling
from noctule.localization.calibration.offset import Standing, TooFewMeasurementsError, measure_offset
from noctule.localization.placing import slanted
from noctule.simulation.ceiling import CeilingSpec, lab_room
from noctule.simulation.ceiling.flights import sees_whole


def test_the_drone_stands_where_the_camera_sees_it_wherever_the_camera_hangs():
    usual, moved = CeilingSpec(), CeilingSpec(x_m=3.0, y_m=2.0, z_m=2.8)
    places = [place.tolist() for place in teaching._stools(0, usual)]
    assert places[: len(teaching._STOOLS)] == [list(stool) for stool in teaching._STOOLS]
    assert all(sees_whole(usual.camera, np.array(place)) for place in places)
    elsewhere = teaching._stools(0, moved)
    assert len(elsewhere) == len(places) > len(teaching._STOOLS)
    assert all(sees_whole(moved.camera, place) for place in elsewhere)
    assert not all(sees_whole(moved.camera, np.array(place)) for place in teaching._STOOLS)


def test_the_stools_tell_what_slanting_rays_are_off_by():
    spec, slant = CeilingSpec(), -0.01
    eye = spec.camera.t_world_camera
    standings = [
        Standing(place, np.tile(place + slanted(slant, eye, place), (30, 1)))
        for place in teaching._stools(0, spec)
    ]
    assert measure_offset(standings, eye).slant == pytest.approx(slant, abs=2e-4)


def standing(place, count=60, seed=0):
    middle = np.add(place, (0.0, 0.0, 0.01))
    return Standing(np.array(place), np.random.default_rng(seed).normal(middle, 0.002, (count, 3)))


def test_a_stool_on_which_the_drone_is_seen_badly_has_no_say():
    eye = CeilingSpec().camera.t_world_camera
    well = [standing(place, seed=k) for k, place in enumerate(teaching._STOOLS[:3])]
    badly = [standing(teaching._STOOLS[3], count=24), standing(teaching._STOOLS[4], count=0)]
    found = teaching._offset([badly[0], *well, badly[1]], eye)
    assert (found.places, found.bias) == (3, pytest.approx(measure_offset(well, eye).bias))
    with pytest.raises(TooFewMeasurementsError, match="place 3: the drone was measured 24 times"):
        teaching._offset([*well[:2], badly[0]], eye)


def test_a_site_is_kept_for_its_camera_room_and_seed_and_only_so_many(monkeypatch):
    taught = []

    class Lesson:
        def __init__(self, stage, seed, show):
            taught.append((stage.spec.hull, stage.room.seed, seed))
            self.site = taught[-1]

    monkeypatch.setattr(teaching, "teach_stage", Lesson)
    monkeypatch.setattr(teaching, "_taught", {})
    plain, hull = CeilingSpec(), CeilingSpec(hull=True)
    first = teach_ceiling(plain, lab_room(0), 0)
    assert teach_ceiling(plain, lab_room(0), 0) is first
    # A flight's colour picture teaches nothing.
    assert teach_ceiling(CeilingSpec(colour=True), lab_room(0), 0) is first
    for spec, room, seed in ((hull, 0, 0), (plain, 1, 0), (plain, 0, 1)):
        assert teach_ceiling(spec, lab_room(room), seed) == (spec.hull, room, seed)
    assert len(taught) == 4
    teach_ceiling(hull, lab_room(1), 1)
    assert len(teaching._taught) == 4
    teach_ceiling(plain, lab_room(0), 0)
    assert len(taught) == 6
