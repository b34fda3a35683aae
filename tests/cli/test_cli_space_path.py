"""`noctule path show` on a path file, and the figure that it draws."""

import cv2
import numpy as np
import pytest

from noctule.cli.space_paths import figures_of, in_words
from noctule.control.paths import Stop, line, loc_1, loc_2, plan, polyline
from noctule.reports import ReportWriteError
from noctule.reports.space_path_figure import space_path_figure, write_space_path_figure
from noctule.reports.style import house_style

WAY = "x,y,z\n0,0,1\n1,0,1\n1,1,1.2\n"


def test_a_path_file_is_drawn_and_told_in_one_line(noctule, tmp_path):
    (tmp_path / "way.csv").write_text(WAY)
    said = noctule("path", "show", "way.csv")
    assert said.code == 0
    first, second = said.out.splitlines()
    assert first.startswith("path way.csv: 2.08 m")
    assert first.endswith(
        "(one way), 0.24 to 0.30 m/s, height 0.98 to 1.20 m, smallest radius 0.24 m at s = 1.03 m, 0 stops"
    )
    assert second == "figure: way.png"
    assert cv2.imread(str(tmp_path / "way.png")).shape == (690, 1350, 3)


def test_the_figures_are_one_json_object(noctule, tmp_path):
    (tmp_path / "way.csv").write_text(WAY)
    said = noctule("path", "show", "way.csv", "--json", "--out", "drawn/here.png")
    found = said.last_json
    assert found["figure"] == "drawn/here.png"
    assert found["length_m"] == pytest.approx(2.08, abs=0.01)
    slow, fast = found["speed_mps"]
    assert found["length_m"] / fast < found["lap_s"] < found["length_m"] / slow
    assert (tmp_path / "drawn" / "here.png").is_file()


def test_a_mistake_in_a_path_file_is_one_line(noctule, tmp_path):
    (tmp_path / "way.csv").write_text(WAY.replace("1,1,1.2", "1,1,high"))
    said = noctule("path", "show", "way.csv")
    assert said.code == 2
    assert said.err == "noctule: way.csv:4: z is 'high'; expected a number, -100 to 100 [m]\n"
    assert not (tmp_path / "way.png").exists()


MISSION = """
[space_path]
speed = { cruise = 0.3 }
[[space_path.segments]]
kind = "line"
points = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]]
"""


def test_the_path_of_a_mission_is_drawn_before_it_is_flown(noctule, tmp_path):
    (tmp_path / "my.toml").write_text(MISSION)
    said = noctule("path", "show", "my.toml")
    assert said.code == 0, said.err
    assert said.out.startswith("path my.toml: 1.00 m (one way), 0.30 m/s")
    assert (tmp_path / "my.png").is_file()
    (tmp_path / "my.toml").write_text(MISSION.replace("cruise", "crusie"))
    assert "did you mean cruise?" in noctule("path", "show", "my.toml").err


def test_a_file_that_holds_no_path_in_space_is_one_line(noctule, tmp_path):
    (tmp_path / "by-sight.toml").write_text('[path]\nfolder = "walk"\n')
    said = noctule("path", "show", "by-sight.toml")
    assert (said.code, said.err) == (
        2,
        "noctule: path by-sight.toml: a mission without a path in space; show its path's folder instead\n",
    )
    (tmp_path / "flight.mcap").write_bytes(b"x")
    said = noctule("path", "show", "flight.mcap")
    assert (said.code, said.err) == (
        2,
        "noctule: path flight.mcap: a file of another kind; expected a folder of key images, "
        "waypoints (.csv), a path file or a mission (.toml)\n",
    )


def test_a_folder_is_still_a_visual_path(noctule, tmp_path):
    (tmp_path / "walk.csv").mkdir()
    said = noctule("path", "show", "walk.csv")
    assert said.code == 2
    assert said.err == (
        "noctule: path walk.csv: the folder holds no path.toml; expected one that `noctule teach` made "
        "(a path in space is a .csv or .toml file, no folder)\n"
    )


def test_words_name_laps_stops_and_speeds():
    assert in_words(figures_of(loc_1())).startswith(
        "4.17 m (closed, without end), 0.30 m/s, height 1.08 to 1.32 m"
    )
    assert in_words(figures_of(loc_1())).endswith(", 1 stop")
    ring = polyline([(0, 0, 1), (1, 0, 1), (1, 1, 1)], radius=0.1, closed=True)
    assert "(closed, 2 laps)" in in_words(figures_of(plan(ring, laps=2)))
    assert in_words(figures_of(plan(line((0, 0, 1), (2, 0, 1))))) == (
        "2.00 m (one way), 0.30 m/s, height 1.00 to 1.00 m, 0 stops"
    )


def test_every_stop_is_told_with_where_how_long_and_its_turn(noctule, tmp_path):
    (tmp_path / "stops.toml").write_text(
        "stops = [{ time = 3, seconds = 4 }, { s = 1, seconds = 2, yaw_deg = 90, turn_after = 1.5 },\n"
        "  { s = 1.5, seconds = 1, yaw_deg = -30, keep_yaw = false }]\n"
        '[[segments]]\nkind = "line"\npoints = [[0, 0, 1], [2, 0, 1]]\n'
    )
    assert noctule("path", "show", "stops.toml").out.splitlines()[1:-1] == [
        "stop at s = 1.00 m (1.00, 0.00, 1.00): 2 s, turns to 90\N{DEGREE SIGN} after 1.5 s",
        "stop at s = 1.50 m (1.50, 0.00, 1.00): 1 s, turns to -30\N{DEGREE SIGN}, then by the rule again",
        "stop at 3 s: 4 s",
    ]
    found = noctule("path", "show", "stops.toml", "--json").last_json
    assert found["stops"] == 3
    assert [(stop["s_m"], stop["time_s"], stop["seconds"]) for stop in found["stop_list"]] == [
        (1.0, None, 2.0), (1.5, None, 1.0), (None, 3.0, 4.0)
    ]  # fmt: skip
    assert found["stop_list"][0]["turn_deg"] == pytest.approx(90.0)


def drawn(made):
    with house_style():
        figure = space_path_figure(made, "a path")
    return figure


def test_the_figure_shows_the_path_from_above_its_height_and_its_speed():
    made = plan(loc_2().path, stops=(Stop(3.0, s=1.5), Stop(5.0, time=9.0)), laps=1)
    top, height, speed = drawn(made).axes
    np.testing.assert_allclose(top.lines[0].get_xydata(), made.path.position[:, :2])
    np.testing.assert_allclose(height.lines[0].get_ydata(), made.path.position[:, 2])
    np.testing.assert_allclose(speed.lines[0].get_ydata(), made.profile.v)
    words = [text.get_text() for text in top.texts]
    assert "start" in words
    assert "3 s" in words
    assert "9 to 14 s: stop, wherever it is then" in words
    assert top.get_aspect() == 1.0


def test_stops_at_the_same_place_share_a_label():
    def labels(*stops, laps=1):
        path = loc_2().path if laps > 1 else line((0, 0, 1), (2, 0, 1))
        return [t.get_text() for t in drawn(plan(path, stops=stops, laps=laps)).axes[0].texts]

    words = labels(Stop(2.0, s=1.0), Stop(3.0, s=1.0), Stop(4.0, s=1.5))
    assert "2 s + 3 s" in words
    assert "4 s" in words
    assert not {"2 s", "3 s"} & set(words)
    lap = loc_2().path.length
    assert "2 \N{MULTIPLICATION SIGN} 1 s" in labels(Stop(1.0, s=1.0), Stop(1.0, s=1.0 + lap), laps=2)
    assert "and 2 more" in labels(*(Stop(0.1, time=0.5 * k) for k in range(1, 7)))[-1]


def test_arrows_point_where_the_nose_does():
    top = drawn(plan(line((0, 0, 1), (0, 2, 1)))).axes[0]
    arrows = [t for t in top.texts if t.arrow_patch is not None]
    assert len(arrows) == 24
    for arrow in arrows:
        (x0, y0), (x1, y1) = arrow.xyann, arrow.xy
        assert {x0, x1} == {0.0} or abs(x1 - x0) < 1e-9
        assert abs(y1 - y0) == pytest.approx(0.192)
    vertical = drawn(plan(line((0, 0, 1), (0, 0, 2)))).axes[0]
    assert not [t for t in vertical.texts if t.arrow_patch is not None]


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ReportWriteError, match="cannot be written"):
        write_space_path_figure(loc_1(), "x", tmp_path / "file" / "figure.png")
