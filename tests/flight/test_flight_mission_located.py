"""Mission files of flights below a depth camera, and one clear line for each mistake in them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from noctule.estimation.identification import VehicleModelSettings
from noctule.flight.mission import (
    CeilingSettings,
    Mission,
    MissionFileError,
    PersonSettings,
    SpacePathSettings,
    bundled_missions,
    check_flyable,
    load_mission,
    parse_mission,
)
from noctule.flight.mission_located import model_of
from noctule.flight.space_path_file import SpacePathFileError
from noctule.localization.site_files import SiteFileError
from noctule.localization.vehicle_file import save_vehicle_model
from noctule.pilots.settings import PilotSettings
from noctule.simulation.ceiling import CeilingSpec
from noctule.simulation.ceiling.motions import gap
from noctule.simulation.ceiling.room import lab_room
from noctule.simulation.spec import VehicleSpec

LINE = """
[[space_path.segments]]
kind = "line"
points = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]]
"""
CSV = "x,y,z\n0,0,1\n0.5,0.2,1\n1,0,1.1\n"


def mission(text: str, base: Path | None = None) -> Mission:
    return parse_mission(text, "my.toml", base)


def mistakes(text: str, base: Path | None = None) -> str:
    with pytest.raises((MissionFileError, SpacePathFileError)) as caught:
        parse_mission(text, "my.toml", base)
    return str(caught.value)


def test_a_mission_needs_a_path_of_one_kind():
    assert mistakes("name = 'x'\n") == "my.toml: there is nothing to fly: give a path, a space_path, or both"


@pytest.mark.parametrize(
    ("group", "text"),
    [
        ("people", "[[people]]\nx = 1.0\ny = 0.0\n"),
        ("ceiling", "[ceiling]\nhull = true\n"),
        ("located", "[located]\nend_after_s = 3.0\n"),
        ("vehicle_model", "[vehicle_model]\ndelay_s = 0.1\n"),
        ("handover", "[handover]\nblend_s = 2.0\n"),
    ],
)
def test_what_only_a_camera_in_the_room_can_see_or_use_needs_a_path_in_space(group, text):
    path = "[path]\nposes = [[1.5, 0.0, 1.0, 0.0]]\n"
    assert mistakes(path + text) == f"my.toml: {group} belongs to a space_path; give one or leave it out"


def test_handing_over_needs_something_to_hand_over_to():
    assert mistakes(LINE + "[handover]\nblend_s = 2.0\n") == (
        "my.toml: handover is to a visual path; give a path or leave it out"
    )


def test_the_path_in_space_stands_in_the_mission_or_in_a_file_beside_it(tmp_path):
    (tmp_path / "way.csv").write_text(CSV)
    (tmp_path / "way.toml").write_text(LINE.replace("space_path.", ""))
    inline = mission(LINE).space_plan()
    by_toml = mission('[space_path]\nfile = "way.toml"\n', tmp_path).space_plan()
    by_csv = mission('[space_path]\nfile = "way.csv"\n', tmp_path).space_plan()
    assert np.array_equal(inline.path.position, by_toml.path.position)
    assert by_csv.path.position[-1] == pytest.approx([1.0, 0.0, 1.1])
    assert inline.total == pytest.approx(1.0)


def test_a_recorded_mission_holds_the_file_that_it_was_flown_along(tmp_path):
    file = tmp_path / "way.csv"
    file.write_text(CSV)
    flown = mission('[space_path]\nfile = "way.csv"\n[[people]]\npasses_m = 0.6\n', tmp_path)
    file.unlink()
    again = Mission.model_validate_json(flown.model_dump_json())
    assert again.model_dump() == flown.model_dump()
    assert np.array_equal(again.space_plan().path.position, flown.space_plan().path.position)


def test_every_mistake_about_the_path_is_one_line(tmp_path):
    assert mistakes('[space_path]\nfile = "gone.csv"\n', tmp_path) == (
        f"{tmp_path}/gone.csv: cannot be read (No such file or directory); "
        "expected the .csv or .toml file of a path"
    )
    assert mistakes("[space_path]\nclosed = true\n") == (
        "my.toml:1: space_path: give either the file of a path or its segments"
    )
    assert mistakes('[space_path]\nfile = "way.csv"\nendless = true\n', tmp_path) == (
        "my.toml:1: space_path: the file way.csv says all of it; leave endless out here"
    )
    assert mistakes(LINE.replace("points", "radius = 0.1 #")) == (
        "my.toml:2: space_path.segments[0]: points is missing; a line needs points"
    )


def test_a_path_faster_than_the_limits_is_refused_with_its_place():
    fast = "[space_path]\nspeed = { cruise = 0.7 }\n" + LINE
    assert mistakes(fast) == (
        "my.toml: path: 0.70 m/s at s = 0.00 m (0.00, 0.00, 1.00) is 0.70 m/s of level flight, the vehicle "
        "is allowed 0.6 m/s; fly slower there"
    )
    assert mission(fast + "[limits]\nforward = 0.8\nleft = 0.8\n").space_plan().total > 0.0


def test_a_path_outside_of_the_fence_is_refused_with_its_place():
    assert mistakes(LINE + "[fence]\nx_max = 0.5\n").startswith(
        "my.toml: space_path: it is outside of the fence at s = 0.5"
    )
    assert mistakes(LINE + "[fence]\nx_max = 0.5\n").endswith(
        "; expected x -2.75 to 0.5, y -2.75 to 2.75, z 0.15 to 3.35 m"
    )


def test_without_a_room_it_is_flown_in_the_laboratory():
    assert mission(LINE).room == lab_room(0)
    assert mission(LINE + "[room]\nsize = [8.0, 6.0, 3.9]\n").room.size == (8.0, 6.0, 3.9)
    again = Mission.model_validate_json(mission(LINE).model_dump_json())
    assert again.room == lab_room(0)


@pytest.mark.parametrize("place", ["z_m = 3.7", "x_m = -3.2", "y_m = 3.0"])
def test_a_ceiling_camera_outside_of_the_room_is_refused_before_it_is_taught(place):
    told = mistakes(LINE + f"[ceiling]\n{place}\n")
    assert told.startswith("my.toml: ceiling: the camera hangs at (")
    assert told.endswith(
        "m, outside of the room; expected x -3 to 3, y -3 to 3, z up to 3.55 m; "
        "move it, or make room.size larger"
    )


def test_a_ceiling_camera_that_measures_nothing_and_a_vehicle_of_another_name_are_named_with_their_line():
    told = mistakes(LINE + "[ceiling]\nnearest_m = 5.0\nfarthest_m = 2.0\n")
    assert (
        told == "my.toml:5: ceiling: nearest_m is 5 and farthest_m is 2; expected nearest_m below farthest_m"
    )
    told = mistakes(LINE + '[vehicle]\nmodel = "identifed"\n')
    assert told.startswith(
        "my.toml:5: vehicle: vehicle model 'identifed' is not known; did you mean identified?"
    )


def test_a_place_that_is_no_number_is_told_as_such():
    assert mistakes(LINE.replace("[1.0, 0.0, 1.0]", "[1.0, nan, 1.0]")).startswith(
        "my.toml:4: space_path.segments[0].points[1][1] is nan; expected a finite number"
    )


def test_an_endless_path_has_to_be_ended_by_something():
    ring = """
[space_path]
closed = true
endless = true
[[space_path.segments]]
kind = "ellipse"
centre = [0.0, 0.0, 1.0]
half_axes = [0.5, 0.8]
"""
    assert mistakes(ring) == (
        "my.toml: space_path: it is endless, and nothing ends it; give laps, or located.end_after_s"
    )
    assert math.isinf(mission(ring + "[located]\nend_after_s = 10.0\n").space_plan().total)


def test_a_vehicle_that_answers_too_late_is_refused():
    late = mistakes(LINE + "[vehicle]\ncommand_latency = 0.7\n")
    assert late.startswith("my.toml: vehicle: its commands take effect after 0.70 s, the cascade was shown")
    assert "\n" not in late


def test_somebody_walks_around_a_place_or_past_the_path():
    plan = mission(LINE).space_plan()
    there = PersonSettings(x=2.0, y=1.0, turn_deg=90.0).walker(plan)
    assert (there.centre, there.turn) == ((2.0, 1.0), math.pi / 2.0)
    past = PersonSettings(passes_m=0.6, bearing_deg=90.0).walker(plan)
    assert gap(past.edge(), plan.path.position[:, :2]) == pytest.approx(0.6, abs=1e-3)
    assert past.centre[1] > 1.0
    for text in ("x = 1.0", "passes_m = 0.6\nx = 0.0\ny = 0.0", ""):
        assert mistakes(f"{LINE}[[people]]\n{text}\n").endswith("people[0]: give either x and y or passes_m")


def test_boards_are_held_before_the_missions_own_camera():
    boards = "[ceiling]\nz_m = 3.3\n[[ceiling.boards]]\nplace = [0.1, 0.2, 1.0]\n"
    boards += "begin_s = 4.0\nseconds = 5.0\n"
    (board,) = mission(LINE + boards).ceiling.hidings()
    assert (board.place, board.begin, board.seconds) == ((0.1, 0.2, 1.0), 4.0, 5.0)
    assert board.eye[2] == 3.3
    assert board.at(2.9) is None
    assert board.at(5.0) is not None


def test_the_camera_is_simulated_without_what_it_was_taught():
    settings = CeilingSettings(hull=True, site=Path("lab"), max_age_s=5.0)
    assert settings.spec == CeilingSpec(hull=True)
    assert type(settings.spec) is CeilingSpec


def test_files_are_found_beside_the_mission(tmp_path):
    save_vehicle_model(tmp_path / "vehicle.toml", VehicleModelSettings(delay_s=0.11))
    text = LINE + '[ceiling]\nsite = "lab"\nvehicle = "vehicle.toml"\n'
    found = mission(text, tmp_path)
    assert found.ceiling.site == tmp_path / "lab"
    assert found.known_vehicle.delay_s == 0.11
    with pytest.raises(SiteFileError, match=r"gone\.toml: is missing; make it with `noctule identify"):
        mission(LINE + '[ceiling]\nvehicle = "gone.toml"\n', tmp_path)


def test_without_a_model_the_pilot_knows_what_identifying_the_simulated_vehicle_would_find():
    spec = VehicleSpec(lag=0.25, command_latency=0.06)
    found = model_of(spec).model()
    assert found.input_gains == pytest.approx([4.0] * 4)
    assert found.drags == pytest.approx([4.0] * 4)
    assert found.delay == 0.06
    # Up, the identified vehicle's drag is quicker than a slow loop.
    slow = model_of(VehicleSpec(model="identified", lag=1.0)).model()
    assert slow.drags == pytest.approx([1.0, 1.0, 2.5761, 1.5216])
    given = mission(LINE + "[vehicle_model]\ndelay_s = 0.2\n")
    assert given.known_vehicle == VehicleModelSettings(delay_s=0.2)


def test_the_supervisor_leaves_a_located_pilot_its_time():
    bounds = mission(LINE + "[ceiling]\nmax_age_s = 20.0\nsilence_s = 15.0\n").bounds
    assert (bounds.depth_age, bounds.located_state_age, bounds.state_age) == (20.0, 15.0, 0.5)


def test_the_bundled_missions_below_the_camera_can_be_flown():
    located = [load_mission(name) for name in bundled_missions()]
    located = [one for one in located if one.space_path is not None]
    assert [one.name for one in located] == ["ellipse", "handover"]
    for one in located:
        assert check_flyable(one, one.name).total > 1.0


def test_the_hand_over_is_where_the_visual_path_begins():
    found = load_mission("handover")
    assert found.path is not None
    assert found.space_plan().path.position[-1] == pytest.approx(found.path.poses[0][:3])
    # Its velocities are off, so the last image is reached within what such a vehicle can hold.
    assert found.vehicle.navdata is not None
    assert found.pilot.progress.arrive_m > PilotSettings().progress.arrive_m
    assert SpacePathSettings.model_validate(found.space_path.model_dump()) == found.space_path
