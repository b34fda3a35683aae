"""Path files: what they hold, and every mistake in one line with file, line and field."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from noctule.control.paths import (
    AlongPath,
    FacePoint,
    FixedHeading,
    GivenHeading,
    loc_1,
    loc_2,
    nearest_anywhere,
)
from noctule.control.paths.heading import heading_at
from noctule.flight.space_path_entries import SpacePathEntries
from noctule.flight.space_path_file import SpacePathFileError, read_space_path
from noctule.messages import Limits

EIGHT = """\
endless = true

[heading]
rule = "fixed"

[[stops]]
time = 40
seconds = 30
yaw_deg = 180
turn_after = 4

[[segments]]
kind = "eight"
centre = [0.08, 0.1, 1.2]
half_axes = [0.45, 0.8]
rise = 0.1
"""
TOUR = """\
[speed]
cruise = 0.4

[heading]
rule = "point"
x = 0.5
y = 2.0

[[segments]]  # line 9
kind = "line"
points = [[0, 0, 1], [1, 0, 1]]

[[segments]]
kind = "arc"
centre = [1.0, 0.5, 1.0]
radius = 0.5
begin_deg = -90
sweep_deg = 180
cruise = 0.2

[[segments]]
kind = "spline"
points = [[1, 1, 1], [0.5, 1, 1], [0, 1, 1]]

[[stops]]
s = 1.0
seconds = 2
"""


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def read(text, name="path.toml", limits=None):
    file = Path(name)
    file.write_text(text, encoding="utf-8")
    return read_space_path(file, limits)


def fails(text, name="path.toml", limits=None):
    with pytest.raises(SpacePathFileError) as caught:
        read(text, name, limits)
    return str(caught.value)


def test_the_paths_of_the_experiments_can_be_written_down():
    made, wanted = read(EIGHT), loc_2()
    np.testing.assert_allclose(made.path.position, wanted.path.position)
    assert made.timed == wanted.timed
    assert made.laps is None
    assert made.heading == FixedHeading(0.0)
    ellipse = EIGHT.replace("eight", "ellipse").replace("0.45", "0.5").replace("0.1\n", "0.12\n")
    made = read(ellipse.replace('rule = "fixed"', 'rule = "along"').replace("yaw_deg = 180", ""))
    np.testing.assert_allclose(made.path.position, loc_1().path.position)
    assert made.heading == AlongPath()


def test_the_files_that_the_documentation_shows_are_valid():
    page = (Path(__file__).parents[2] / "docs" / "path-following.md").read_text("utf-8")
    (example,) = re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL)
    made, wanted = read(example), loc_2()
    np.testing.assert_allclose(made.path.position, wanted.path.position)
    assert (made.timed, made.heading, made.laps) == (wanted.timed, wanted.heading, None)
    (example,) = re.findall(r"```csv\n(.*?)```", page, flags=re.DOTALL)
    assert read(example, "way.csv").path.length == pytest.approx(2.08, abs=0.01)
    (code,) = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    names: dict = {"__name__": "page"}
    exec(code, names)
    assert not names["follower"].finished


def test_pieces_are_joined_each_with_its_own_speed():
    made = read(TOUR)
    assert made.path.length == pytest.approx(2.0 + 0.5 * math.pi, rel=1e-3)
    assert made.path.corners.size == 0
    assert made.heading == FacePoint(0.5, 2.0)
    assert made.profile.at(1.0 + 0.25 * math.pi)[0] == pytest.approx(0.2)
    assert made.profile.at(0.2)[0] == pytest.approx(0.4)
    assert [(s.s, s.seconds) for s in made.placed] == [(1.0, 2.0)]


def test_a_closed_polyline_is_flown_in_laps():
    made = read('laps = 3\nclosed = true\n[[segments]]\nkind = "line"\nradius = 0.2\n'
                "points = [[0,0,1],[1,0,1],[1,1,1],[0,1,1]]\n")  # fmt: skip
    assert made.path.closed
    assert made.total == pytest.approx(3 * (4 * 0.6 + 0.4 * math.pi), rel=1e-3)


def test_waypoints_are_flown_through():
    made = read("x,y,z\n0,0,1\n1,0,1\n1,1,1.2\n0,1.5,1\n", "way.csv")
    assert made.heading == AlongPath()
    assert not made.path.closed
    for point in ((0, 0, 1), (1, 0, 1), (1, 1, 1.2), (0, 1.5, 1)):
        s = nearest_anywhere(made.path, np.array(point, dtype=float))
        np.testing.assert_allclose(made.path.at(s).position, point, atol=1e-6)


@pytest.mark.parametrize(("column", "scale"), [("yaw_deg", 1.0), ("yaw", math.pi / 180)])
def test_waypoints_may_carry_headings(column, scale):
    yaws = [0, 90, 180, -170]
    rows = [f"{x},{y},{z},{yaw * scale}" for (x, y, z), yaw in zip(
        ((0, 0, 1), (1, 0, 1), (1, 1, 1.2), (0, 1.5, 1)), yaws, strict=True)]  # fmt: skip
    made = read("\n".join([f"x,y,z,{column}", *rows]) + "\n", "way.csv")
    assert isinstance(made.heading, GivenHeading)
    s = nearest_anywhere(made.path, np.array([1.0, 0.0, 1.0]))
    assert heading_at(made.heading, made.path.at(s), s)[0] == pytest.approx(math.pi / 2, abs=1e-4)
    assert made.heading.yaw[-1] == pytest.approx(math.radians(190.0))  # the short way on from 180
    assert made.heading.s[-1] == made.path.length


def test_waypoints_that_end_where_they_begin_make_a_closed_path():
    made = read(" x , y , z , yaw_deg\n0,0,1,0\n1,0,1,90\n1,1,1,180\n0,0,1,0\n\n", "ring.csv")
    assert made.path.closed
    assert len(made.heading.s) == 4
    assert np.degrees(made.heading.yaw[-1]) % 360 == pytest.approx(0.0, abs=1e-9)


def test_headings_stay_with_their_waypoints_where_the_path_crosses_itself():
    rows = ["0,0,1,0", "1,1,1,10", "2,0,1,20", "1,-1,1,30", "0,0.02,1,40", "-1,1,1,50"]
    made = read("\n".join(["x,y,z,yaw_deg", *rows]), "eight.csv")
    assert (np.diff(made.heading.s) > 0.8).all()


def test_mistakes_in_waypoints_name_the_line_and_the_column():
    assert fails("x,y,z\n0,0,1\n\n1,zero,1\n", "way.csv") == (
        "way.csv:4: y is 'zero'; expected a number, -100 to 100 [m]"
    )
    assert fails("x,y,z,yaw\n0,0,1,inf\n1,0,1,0\n", "way.csv") == (
        "way.csv:2: yaw is 'inf'; expected a number, -3600 to 3600 [rad]"
    )
    assert fails("0,0,1\n1,0,1\n", "way.csv") == (
        "way.csv:1: the columns are 0,0,1; expected x,y,z or x,y,z,yaw_deg (or yaw, in radians)"
    )
    assert fails("x,y,z\n0,0,1\n1,0\n", "way.csv") == "way.csv:3: 2 values, expected 3: x,y,z"
    assert fails("x,y,z\n0,0,1\n", "way.csv") == "way.csv: 1 waypoints, expected 2 or more"
    assert fails("", "way.csv") == (
        "way.csv: it is empty; its first line names the columns: "
        "expected x,y,z or x,y,z,yaw_deg (or yaw, in radians)"
    )
    assert fails("x,y,z\n0,0,1\n1,0,1\n1,0,1\n", "way.csv") == (
        "way.csv:4: the waypoint is where that of line 3 is; leave one of them out"
    )
    assert fails("x,y,z\n0,0,1\n1,0,1\n0,0,1\n2,0,1\n", "way.csv").startswith(
        "way.csv: path: the curve turns back on itself at ("
    )


def test_mistakes_in_toml_name_the_line_and_the_field():
    assert fails(TOUR.replace("cruise = 0.4", "cruise = -1")) == (
        "path.toml:2: speed.cruise is -1; expected above 0 to 5 (where nothing asks for less [m/s])"
    )
    assert fails(TOUR.replace("radius", "radios")) == (
        "path.toml:16: unknown key segments[1].radios; did you mean radius?"
    )
    assert fails(TOUR.replace("radius = 0.5\n", "")) == (
        "path.toml:13: segments[1]: radius is missing; an arc needs centre, radius, sweep_deg"
    )
    assert fails(EIGHT + "radius = 2\n") == (
        "path.toml:12: segments[0]: radius means nothing to an eight; "
        "it takes centre, half_axes, rise, cruise"
    )
    assert fails(TOUR.replace("y = 2.0\n", "")) == (
        'path.toml:4: heading: x and y are the point to look at: give both with rule = "point", else neither'
    )
    assert fails(EIGHT.replace("time = 40\n", "")) == (
        "path.toml:6: stops[0]: give either its time or its place s"
    )
    assert fails("laps = 2\n") == ("path.toml: segments is missing; expected a table (pieces, in order)")
    assert fails("laps = \n").startswith("path.toml: this is not TOML: ")


def test_pieces_that_do_not_fit_name_the_piece_and_its_line():
    assert fails(TOUR.replace("[1.0, 0.5, 1.0]", "[1.1, 0.5, 1.0]")) == (
        "path.toml:13: segments[1]: piece 2 begins 0.100 m from where piece 1 ends (1.000, 0.000, 1.000); "
        "let it begin there"
    )
    assert fails(TOUR.replace("[1, 0, 1]", "[0, 0, 1]")) == (
        "path.toml:9: segments[0]: line: point 2 is where point 1 is; leave one of them out"
    )


def test_what_cannot_be_flown_is_refused_with_the_place():
    corner = '[[segments]]\nkind = "line"\npoints = [[0,0,1],[1,0,1],[1,1,1]]\n'
    assert fails(corner) == (
        "path.toml: path: a corner of 90 deg at s = 1.00 m (1.00, 0.00, 1.00) cannot be flown through; "
        "stop there (s = 1.00) or round it"
    )
    assert fails(EIGHT + "cruise = 0.7\n", limits=Limits()).startswith(
        "path.toml: path: 0.70 m/s at s = 0.00 m (0.08, 0.10, 1.30) is 0.70 m/s of level flight, "
    )
    assert fails("laps = 2\n" + corner.replace("[[seg", "[[seg")).endswith("and this one has two ends")


MILLIMETRES = "are these millimetres? lengths are in metres"


def test_millimetres_are_told_from_metres():
    points = '[[segments]]\nkind = "spline"\npoints = {}\n'
    assert fails(points.format("[[0,0,100],[1000,0,100],[1000,1000,120]]")) == (
        f"path.toml:1: segments[0]: path: it is 2061 m long; expected at most 2000 m; {MILLIMETRES}"
    )
    assert fails(points.format("[[0,0,100],[110,0,100]]")) == (
        "path.toml:1: segments[0]: path: it leads to (110.00, 0.00, 100.00); "
        f"expected x, y, z from -100 to 100 m; {MILLIMETRES}"
    )
    assert fails("x,y,z\n0,0,1\n1000,0,1\n", "way.csv") == (
        f"way.csv:3: x is '1000'; expected a number, -100 to 100 [m]; {MILLIMETRES}"
    )
    ring = '[[segments]]\nkind = "ellipse"\ncentre = [0, 0, 1200]\nhalf_axes = [4500, 3000]\n'
    assert fails(ring).endswith(MILLIMETRES)
    assert read(points.format("[[0,0,1],[99,0,1]]")).path.length == pytest.approx(99.0)
    # Long but near: the number of turns is wrong, not the unit.
    near = (
        '[[segments]]\nkind = "line"\npoints = ['
        + ",".join(f"[{20 * (k % 2)},0,1]" for k in range(150))
        + "]\n"
    )
    assert fails(near) == "path.toml:1: segments[0]: path: it is 2980 m long; expected at most 2000 m"


def test_pieces_that_are_too_long_together_are_refused_at_the_first_too_many():
    piece = '[[segments]]\nkind = "line"\npoints = [[{},0,1],[{},0,1]]\n'
    text = "".join(piece.format(*((0, 45) if k % 2 == 0 else (45, 0))) for k in range(60))
    assert fails(text) == ("path.toml:133: segments[44]: path: it is 2025 m long; expected at most 2000 m")


def test_stops_and_laps_that_contradict_themselves_name_their_line():
    late = EIGHT.replace("turn_after = 4", "turn_after = 40")
    assert fails(late).endswith(
        "stops[0]: turn_after = 40 s is beyond its end at 30 s; turn earlier or stop longer"
    )
    assert fails(
        EIGHT.replace("seconds = 30", "seconds = 0").replace("turn_after = 4", "turn_after = 0")
    ).endswith("stops[0]: seconds is 0 at a time; expected more than 0")
    assert fails("laps = 3\n" + EIGHT) == (
        "path.toml: endless = true and laps = 3 contradict each other; give one of them"
    )
    assert fails(EIGHT.replace("endless = true", "laps = 1")).startswith(
        "path.toml: stop: time = 40 s is after the end"
    )
    assert read(EIGHT.replace("endless = true", "laps = 4")).laps == 4
    # Recordings of before hold every field.
    assert (
        SpacePathEntries.model_validate_json(
            '{"endless": true, "laps": 1, "segments": [{"kind": "line", "points": [[0, 0, 1], [1, 0, 1]]}]}'
        ).rounds
        is None
    )


def test_files_that_cannot_be_read_are_told_apart(tmp_path):
    with pytest.raises(SpacePathFileError) as caught:
        read_space_path(tmp_path / "none.csv")
    assert str(caught.value) == (
        f"{tmp_path / 'none.csv'}: cannot be read (No such file or directory); "
        "expected the .csv or .toml file of a path"
    )
    assert fails("x", "path.yaml") == "path.yaml: found the ending '.yaml', expected .csv or .toml"
    (tmp_path / "raw.csv").write_bytes(b"x,y,z\n\xff\xfe")
    with pytest.raises(SpacePathFileError, match=r"raw\.csv: it is not UTF-8 text; save it as UTF-8$"):
        read_space_path(tmp_path / "raw.csv")
