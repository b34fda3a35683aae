"""Mission files: what they say, and one clear line for each mistake in them."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.flight.mission import (
    Mission,
    MissionFileError,
    StartSettings,
    UnknownMissionError,
    bundled_missions,
    load_mission,
    parse_mission,
)
from noctule.flight.toml_lines import key_lines, line_of

PATH = "[path]\nposes = [[1.5, 0.0, 1.0, 0.0]]\n"


def mistakes(text: str) -> str:
    with pytest.raises(MissionFileError) as caught:
        parse_mission(text, "my.toml")
    return str(caught.value)


def test_bundled_missions_have_names_and_one_line_each():
    missions = bundled_missions()
    assert set(missions) >= {"one-column", "two-columns"}
    assert all(text and "\n" not in text for text in missions.values())
    assert all(load_mission(name).name == name for name in missions)


def test_the_two_column_mission_is_the_papers_experiment():
    mission = load_mission("two-columns")
    assert mission.path.poses == ((1.5, 0, 1, 0), (2, 0, 1, 0), (3.5, 0, 1, 0), (4.5, 0.5, 0.5, 30))
    round_one, flat = mission.room.columns
    assert (round_one.x, round_one.diameter) == (0.9, 0.11)
    assert (flat.x, flat.width, flat.depth) == (2.9, 0.05, 0.02)
    assert mission.pilot.law == "noctule"
    limits = mission.limits.values()
    assert (limits.forward, limits.up, limits.yaw_rate, limits.acceleration) == (0.6, 0.5, 0.8, 1.0)


def test_the_pilots_hue_is_that_of_the_columns_it_has_to_avoid():
    for name in bundled_missions():
        mission = load_mission(name)
        for column in mission.room.columns:
            assert column.hue is not None
            assert mission.pilot.column_hue_deg == pytest.approx(360.0 * column.hue)


def test_the_supervisor_is_given_the_missions_limits_and_fence():
    bounds = parse_mission(PATH + "[limits]\nforward = 0.4\n[fence]\nz_max = 1.8\n", "my.toml").bounds
    assert bounds.limits.forward == 0.4
    assert bounds.fence.high[2] == 1.8


def test_a_fence_that_is_not_given_stands_inside_the_rooms_walls():
    text = PATH + "[room]\ncorner = [-1.0, -2.0]\nsize = [8.0, 5.0, 3.5]\n[fence]\nx_max = 4.0\n"
    fence = parse_mission(text, "my.toml").bounds.fence
    assert fence.low == (-0.75, -1.75, 0.15)
    assert fence.high == (4.0, 2.75, 3.25)


def test_every_mistake_is_a_line_of_its_own_with_file_line_field_value_and_range():
    text = """
[path]
poses = [[1.5, 0.0, 1.0, 0.0]]
[pilot]
law = "nox"
[limits]
forward = 90
[recording]
jpeg_quality = "high"
"""
    assert mistakes(text).split("\n") == [
        'my.toml:5: pilot.law is "nox"; expected one of published, noctule (control law)',
        "my.toml:7: limits.forward is 90; expected above 0 to 10 ([m/s])",
        'my.toml:9: recording.jpeg_quality is "high"; expected a whole number, 10 to 100 (of lossy pictures)',
    ]


def test_an_unknown_key_is_told_with_the_nearest_known_one():
    assert (
        mistakes(PATH + "[flihgt]\nrate_hz = 30\n") == "my.toml:3: unknown key flihgt; did you mean flight?"
    )
    assert (
        mistakes(PATH + "[flight]\nrate_hx = 30\n")
        == "my.toml:4: unknown key flight.rate_hx; did you mean rate_hz?"
    )
    assert mistakes("[path]\nzzz = 1\nfolder = 'a'\n") == (
        "my.toml:2: unknown key path.zzz; expected one of curve, folder, laps, poses, reverse"
    )


def test_a_mistake_in_an_array_of_tables_is_told_with_its_index_and_line():
    text = (
        PATH
        + "[[room.columns]]\nx = 1\ny = 0\ndiameter = 0.1\n[[room.columns]]\nx = 2\ny = 0\ndiameter = 9.0\n"
    )
    assert (
        mistakes(text)
        == "my.toml:10: room.columns[1].diameter is 9.0; expected 0.005 to 2 (cylinder: diameter [m])"
    )


def test_a_rule_between_fields_is_told_where_its_group_begins():
    assert mistakes(PATH + "[fence]\nx_min = 9\nx_max = 7.5\n") == (
        "my.toml:3: fence: x_min is 9 and x_max 7.5; the first must be the smaller"
    )
    assert mistakes("[path]\nfolder = 'a'\nposes = [[0, 0, 1, 0]]\n") == (
        "my.toml:1: path: give either a folder of key images or the poses to take them from"
    )


def test_poses_of_the_wrong_length_or_kind_are_told_by_their_index():
    assert mistakes("[path]\nposes = [[0, 0, 1, 0], [1, 2, 3]]\n") == (
        "my.toml:2: path.poses[1] is [1, 2, 3]; expected a list of at least 4 "
        "(x, y, z [m] and heading [deg] of each key image)"
    )
    assert mistakes('[path]\nposes = [[0, 0, "up", 0]]\n') == (
        'my.toml:2: path.poses[0][2] is "up"; expected a number '
        "(x, y, z [m] and heading [deg] of each key image)"
    )


def test_what_may_be_a_number_or_a_list_is_told_once():
    assert mistakes(PATH + '[room]\nfurniture = "much"\n') == (
        'my.toml:4: room.furniture is "much"; expected a whole number (how many to draw, or the list itself)'
    )
    text = PATH + '[[room.furniture]]\nkind = "sofa"\nx = 1.0\ny = 1000.0\n'
    assert (
        mistakes(text)
        == "my.toml:6: room.furniture[0].y is 1000.0; expected -100 to 100 (centre, world y [m])"
    )


def test_a_missing_group_is_told():
    assert mistakes("name = 'x'\n") == (
        "my.toml: there is nothing to fly: give a path, a space_path, or both"
    )


def test_text_that_is_not_toml_is_told_with_its_line():
    assert (
        mistakes("[path]\nposes = [\n")
        == "my.toml: this is not TOML: Invalid value (at end of document); mend it there"
    )


def test_no_message_holds_an_address_or_the_validators_words():
    text = (
        PATH
        + "[start]\nz = nan\nyaw_deg = 'north'\n[room]\nsize = [1]\n[flight]\nseed = -1\nland = 'no way'\n"
    )
    told = mistakes(text)
    assert "http" not in told
    assert "pydantic" not in told
    assert len(told.split("\n")) == 7


def test_a_name_that_is_nearly_a_bundled_mission_is_put_right():
    with pytest.raises(UnknownMissionError) as caught:
        load_mission("two-colums")
    assert str(caught.value) == "there is no mission 'two-colums'; did you mean two-columns?"


def test_a_name_that_is_like_no_mission_lists_them():
    with pytest.raises(
        UnknownMissionError, match=r"^there is no mission 'xyzzy'; expected one of .*, or a \.toml file$"
    ):
        load_mission("xyzzy")


def test_a_mission_file_that_is_not_there_is_one_line(tmp_path):
    with pytest.raises(UnknownMissionError) as caught:
        load_mission(tmp_path / "my.toml")
    assert str(caught.value) == f"mission file {tmp_path}/my.toml: cannot be read (No such file or directory)"


def test_a_path_folder_is_taken_relative_to_the_mission_file(tmp_path):
    (tmp_path / "my.toml").write_text("[path]\nfolder = 'walk'\n")
    mission = load_mission(tmp_path / "my.toml")
    assert mission.path.folder == tmp_path / "walk"
    assert mission.text == "[path]\nfolder = 'walk'\n"


def test_a_mission_survives_the_json_of_a_recording():
    mission = load_mission("two-columns")
    again = Mission.model_validate_json(mission.model_dump_json())
    assert again.model_dump() == mission.model_dump()


def test_a_seed_moves_the_start_within_its_spread_and_always_the_same_way():
    start = StartSettings(spread_m=0.05, spread_deg=3.0)
    poses = [start.pose(seed) for seed in range(50)]
    offsets = np.array([[*(p.position - [0, 0, 1]), np.degrees(p.yaw)] for p in poses])
    assert (np.abs(offsets) <= [0.05, 0.05, 0.05, 3.0]).all()
    assert (np.abs(offsets).max(axis=0) > [0.04, 0.04, 0.04, 2.4]).all()
    np.testing.assert_array_equal(start.pose(7).position, poses[7].position)


def test_without_a_spread_every_seed_starts_at_the_same_place():
    start = StartSettings(x=1.0, yaw_deg=90.0)
    assert start.pose(3).yaw == pytest.approx(np.pi / 2)
    np.testing.assert_array_equal(start.pose(3).position, start.nominal.position)


TRICKY = """# a comment = 1
name = "a [table] = 'x'"
[room]  # [not.this]
size = [
  1, 2,  # columns = 3
  3]
text = '''
[fake]
key = 1
'''
[[room.columns]]
x = 1
[[room.columns]]
x = 2
inner.deep = 3
[room.columns.more]
y = {a = 1, b = [2]}
["quoted key"]
"b c" = 1
"""


def test_keys_are_found_among_comments_strings_and_arrays():
    tomllib.loads(TRICKY)
    lines = key_lines(TRICKY)
    assert lines[("name",)] == 2
    assert lines[("room", "size")] == 4
    assert ("fake",) not in lines
    assert lines[("room", "columns", 0, "x")] == 12
    assert lines[("room", "columns", 1, "x")] == 14
    assert lines[("room", "columns", 1, "inner", "deep")] == 15
    assert lines[("room", "columns", 1, "more", "y")] == 17
    assert lines[("quoted key", "b c")] == 19


def test_a_key_without_a_line_of_its_own_has_that_of_what_is_around_it():
    lines = key_lines("[a]\nb = [1, 2]\n")
    assert line_of(lines, ("a", "b", 1)) == 2
    assert line_of(lines, ("a", "c")) == 1
    assert line_of(lines, ("z",)) is None


names = st.text("abcdefgh_-", min_size=1, max_size=6)


@settings(deadline=None)
@given(st.dictionaries(names, st.dictionaries(names, st.integers(), min_size=1, max_size=4), max_size=5))
def test_the_line_of_every_key_holds_that_key(tables):
    rows, where = [], {}
    for table, values in tables.items():
        rows.append(f"[{table}]")
        for key, value in values.items():
            rows.append(f"{key} = {value}")
            where[(table, key)] = len(rows)
    lines = key_lines("\n".join(rows))
    assert all(lines[key] == line for key, line in where.items())


@settings(deadline=None)
@given(st.text())
def test_any_text_at_all_is_walked_without_a_fault(text):
    assert all(1 <= line <= text.count("\n") + 1 for line in key_lines(text).values())


def test_missions_are_packaged_as_files_that_a_person_can_copy(tmp_path):
    source = Path(__file__).parents[2] / "src/noctule/flight/missions/two-columns.toml"
    copy = tmp_path / "mine.toml"
    copy.write_text(source.read_text("utf-8"))
    assert load_mission(copy) == load_mission("two-columns")


def test_a_path_is_flown_once_from_its_first_image_unless_the_mission_says_otherwise():
    def route(more):
        return parse_mission(PATH + more, "my.toml").path.route(3)

    assert route("") == (0, 1, 2)
    assert route("laps = 2\n") == (0, 1, 2, 0, 1, 2)
    assert route("reverse = true\n") == (2, 1, 0)
    assert route("laps = 2\nreverse = true\n") == (2, 1, 0, 2, 1, 0)


def test_laps_and_reverse_outlive_the_reading_of_a_file_with_a_folder(tmp_path):
    (tmp_path / "my.toml").write_text("[path]\nfolder = 'walk'\nlaps = 3\nreverse = true\n")
    path = load_mission(tmp_path / "my.toml").path
    assert (path.folder, path.laps, path.reverse) == (tmp_path / "walk", 3, True)


def test_laps_and_the_curve_have_a_range():
    assert mistakes(PATH + "laps = 0\n") == (
        "my.toml:3: path.laps is 0; expected 1 to 100 (a closed path is flown this often without a stop)"
    )
    assert "path.curve[0][0] is -1.0; expected " in mistakes(PATH + "curve = [[-1.0, 0.0]]\n")


def test_the_supervisor_takes_pictures_as_late_as_the_mission_allows_beside_their_latency():
    assert parse_mission(PATH, "my.toml").bounds.picture_age == pytest.approx(0.534)
    more = "[flight]\npicture_max_age_s = 0.8\n[pilot]\npicture_latency_s = 0.2\n"
    assert parse_mission(PATH + more, "my.toml").bounds.picture_age == pytest.approx(1.0)
