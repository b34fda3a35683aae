import json

import numpy as np
import pytest

from noctule.flight import parse_mission
from noctule.flight.codec import encode_pose
from noctule.flight.reader import RecordingFileError, read_recording
from noctule.flight.recording import FlightRecorder, sent_message
from noctule.geometry import Pose
from noctule.messages import (
    ColumnBox,
    Command,
    Decision,
    Diagnostics,
    FlightState,
    Outcome,
    Picture,
    Truth,
    VehicleState,
)
from noctule.reports import EmptyRecordingError, load_flight_log, poster, write_report
from noctule.reports.loading import flight_log
from noctule.reports.page import png_size
from noctule.reports.scene import room_corners, room_solids
from noctule.simulation.spec import RoomSpec

MISSION = """
name = "tiny <b>"
[room]
furniture = 2
[[room.columns]]
x = 1.0
y = 0.1
diameter = 0.11
hue = 0.3
[path]
poses = [[1.5, 0.0, 1.0, 0.0]]
[pilot]
law = "published"
"""
GOAL = Pose(np.array([1.5, 0.0, 1.0]), 0.1)
START = 5.0  # [s], the clock does not begin with the flight


def decision(i, n):
    diagnostics = Diagnostics(
        target_index=i // 6,
        epsilon_px=50.0 - i,
        error=np.arange(6.0) + i,
        activations={"visibility": 0.25, "avoidance": float(i > 3)} if i else {},
        points_current=np.full((3, 2), 20.0 + i),
        points_ref=np.full((3, 2), 22.0),
        columns=(ColumnBox(5.0 + i, 2.0, 9.0 + 2 * i, 40.0, np.zeros(2), np.zeros(2)),) if i % 2 else (),
        task_errors={"avoidance": 0.5},
    )
    outcome = Outcome.REACHED if i == n - 1 else None
    return Decision(Command(0.1 * i), "flying", diagnostics, (), outcome, "there" if outcome else "")


def write_flight_file(path, n=12, truth=True, summary=True, mission=MISSION, ticks_before=2, pictures=True):
    rng = np.random.default_rng(3)
    with FlightRecorder(path) as recorder:
        recorder.note("flight", {"mission": "tiny <b>", "law": "published", "seed": "4", "simulated": "true"})
        recorder.note("versions", {"noctule": "9.9.9"})
        if truth:
            recorder.note("truth", {"key_poses": f"[{encode_pose(GOAL)}, {encode_pose(GOAL)}]"})
        if mission:
            parsed = parse_mission(mission, "tiny")
            recorder.attach("mission.toml", "application/toml", mission.encode())
            recorder.attach("mission.json", "application/json", parsed.model_dump_json().encode())
        for k in range(-ticks_before, n):
            stamp = START + k / 30.0
            given = decision(k, n) if k >= 0 else None
            pixels = rng.integers(0, 255, (48, 86, 3), dtype=np.uint8)
            asked = Command() if given is None else given.command
            recorder.tick(
                stamp,
                VehicleState(stamp, FlightState.FLYING),
                Picture(stamp, pixels) if pictures else None,
                (),
                Truth(
                    stamp, Pose(np.array([0.1 * k, 0.0, 1.0]), 0.0), np.array([0.3, 0.4, 0.0]), 1.0 - 0.05 * k
                )
                if truth
                else None,
                sent_message(stamp, asked, Command(0.05 * max(k, 0)), "flying", "send", ""),
                given,
                2.0 + k,
            )
        if summary:
            values = {"outcome": "reached", "duration_s": 7.5, "tick_ms": {"median": 1.5, "p95": None}}
            recorder.note("summary", {name: json.dumps(value) for name, value in values.items()})
    return path


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_flight_file(tmp_path_factory.mktemp("flights") / "flight.mcap")


@pytest.fixture(scope="module")
def log(recording):
    return load_flight_log(recording)


def test_time_begins_with_the_pilot_s_first_tick(log):
    assert log.times == pytest.approx(np.arange(12) / 30.0)
    assert log.truth.times == pytest.approx(log.times)


def test_the_series_are_what_was_recorded(log):
    assert log.asked[:, 0] == pytest.approx(0.1 * np.arange(12))
    assert log.sent[:, 0] == pytest.approx(0.05 * np.arange(12))
    assert log.epsilon.tolist() == [50.0 - i for i in range(12)]
    assert log.errors[5].tolist() == [5.0, 6.0, 7.0, 8.0, 9.0, 10.0]
    assert log.tick_ms.tolist() == [2.0 + i for i in range(12)]
    assert log.target_index.tolist() == [0] * 6 + [1] * 6
    assert log.truth.position[:, 0] == pytest.approx(0.1 * np.arange(12))
    assert log.truth.speed == pytest.approx(0.5)
    assert log.truth.clearance == pytest.approx(1.0 - 0.05 * np.arange(12))


def test_tasks_come_in_the_order_of_the_hierarchy_and_silent_ticks_are_not_a_number(log):
    assert list(log.activations) == ["avoidance", "visibility"]
    assert np.isnan(log.activations["avoidance"][0])
    assert log.activations["avoidance"][1:].tolist() == [0.0] * 3 + [1.0] * 8


def test_the_surroundings_come_from_the_mission(log):
    assert log.key_poses.tolist() == [[1.5, 0.0, 1.0, 0.1]] * 2
    assert sum(s.kind == "column" for s in log.solids) == 1
    assert log.epsilon_limit == 6.0
    assert log.hull.radius == 0.2
    assert list(log.about.items()) == [
        ("mission", "tiny <b>"),
        ("law", "published"),
        ("seed", "4"),
        ("pictures", "compressed"),
        ("noctule", "9.9.9"),
    ]
    assert log.mission_text == MISSION


def test_a_column_stands_on_the_floor_as_wide_and_tall_as_described():
    spec = RoomSpec.model_validate(
        {"furniture": 0, "columns": [{"x": 1, "y": 0, "diameter": 0.2, "height": 1.7}]}
    )
    (column,) = [solid for solid in room_solids(spec) if solid.kind == "column"]
    assert (column.bottom, column.top) == pytest.approx((0.0, 1.7))
    assert np.linalg.norm(column.outline - (1.0, 0.0), axis=1) == pytest.approx(0.1)
    assert room_corners(spec).tolist() == [[-3.0, -3.5, 0.0], [7.5, 3.5, 3.0]]


def test_the_summary_of_the_flight_is_taken_as_it_was_noted(log):
    assert log.summary["duration_s"] == 7.5
    assert log.summary["tick_ms"] == {"median": 1.5, "p95": None}
    assert log.notes == ()


def test_six_pictures_are_spread_from_the_first_to_the_last(log):
    times = [s.time for s in log.snapshots]
    assert len(times) == 6
    assert times == sorted(set(times))
    assert (times[0], times[-1]) == pytest.approx((0.0, 11 / 30.0))
    assert log.snapshots[-1].pixels.shape == (48, 86, 3)
    assert log.snapshots[-1].points_current.tolist() == [[31.0, 31.0]] * 3


@pytest.mark.parametrize("n", [1, 2, 3, 7])
def test_short_flights_show_the_pictures_there_are(tmp_path, n):
    log = load_flight_log(write_flight_file(tmp_path / "short.mcap", n))
    times = [s.time for s in log.snapshots]
    assert times == sorted(set(times))
    assert min(n, 2) <= len(times) <= min(n, 6)


def test_a_recording_cut_by_kill_9_reports_what_is_there(tmp_path):
    recording = write_flight_file(tmp_path / "whole.mcap", n=100)
    data = recording.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(0.7 * len(data))])
    whole = read_recording(recording)
    page = write_report(cut)
    log = load_flight_log(cut)
    assert 2 <= len(log.times) < len(whole.flown)
    assert log.notes == (
        f"This recording was cut short: its last tick is at {log.span[1]:.1f} s, "
        "and the report shows what is there.",
        "No summary in this recording: the figures were worked out from its ticks.",
    )
    assert page == tmp_path / "cut-report" / "report.html"
    assert "This recording was cut short" in page.read_text(encoding="utf-8")


def test_a_real_drone_s_recording_has_no_truth_and_says_so(tmp_path):
    path = write_flight_file(tmp_path / "real.mcap", truth=False)
    log = load_flight_log(path)
    assert log.truth is None
    assert log.notes == ("No truth in this recording: error in metres not available.",)
    assert not (write_report(path, tmp_path / "out").parent / "views.png").exists()


def test_a_recording_without_its_mission_is_drawn_without_a_room(tmp_path):
    log = load_flight_log(write_flight_file(tmp_path / "alone.mcap", mission=""))
    assert log.solids == ()
    assert log.notes == (
        "The mission in this recording cannot be read: no room is drawn, limits are the usual ones.",
    )


def test_the_report_of_a_recording_stands_beside_it_unless_told_otherwise(recording, tmp_path):
    text = write_report(recording, tmp_path / "here").read_text(encoding="utf-8")
    assert (tmp_path / "here" / "camera.png").is_file()
    assert "tiny &lt;b&gt;" in text
    assert "tiny <b>" not in text


def test_the_poster_is_one_picture_of_its_size(recording, tmp_path):
    path = poster(recording, tmp_path / "new" / "poster.png")
    assert png_size(path.read_bytes()) == (1600, 660)


def test_a_missing_file_gives_one_line(tmp_path):
    path = tmp_path / "none.mcap"
    with pytest.raises(RecordingFileError) as error:
        write_report(path)
    assert str(error.value) == (
        f"recording {path}: cannot be read (No such file or directory); expected the .mcap file of a flight"
    )


@pytest.mark.parametrize("content", [b"", b"hello, I am a text"])
def test_something_that_is_no_recording_gives_one_line(content, tmp_path):
    path = tmp_path / "odd.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingFileError) as error:
        write_report(path)
    assert str(error.value) == f"recording {path}: this is no MCAP file; expected the .mcap file of a flight"


def test_a_flight_that_ended_before_the_pilot_was_asked_gives_one_line(tmp_path):
    path = write_flight_file(tmp_path / "early.mcap", n=0, ticks_before=3)
    with pytest.raises(EmptyRecordingError) as error:
        write_report(path)
    assert str(error.value) == (
        f"recording {path}: holds 3 ticks and at none of them a pilot was asked, expected a flight; "
        "did it end before the take-off was over?"
    )
    assert not (tmp_path / "early-report").exists()


def test_a_recording_without_pictures_has_no_snapshots(tmp_path):
    path = write_flight_file(tmp_path / "blind.mcap", n=3, pictures=False)
    assert flight_log(read_recording(path)).snapshots == ()
