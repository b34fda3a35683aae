"""Whole missions in a small room with a small camera: teach, fly, record, replay."""

from __future__ import annotations

import errno
import json
import os
import signal
import threading
from dataclasses import replace

import numpy as np
import pytest

import noctule.flight.mcap_recorder as recording_module
import noctule.flight.mission_flight as mission_flight
from noctule.flight import (
    Aborted,
    RecordingError,
    fly_mission,
    load_path,
    load_truth,
    parse_mission,
    read_recording,
    teach,
)
from noctule.flight.mission_flight import settled
from noctule.flight.reader import RecordingFileError
from noctule.flight.replay import recorded_mission, recorded_path, replay
from noctule.flight.summary import summary_of
from noctule.flight.teach import TeachError
from noctule.geometry import wrap_angle
from noctule.pilots.route import RouteError

MISSION = """
name = "short walk"
[room]
furniture = 8
size = [7.0, 6.0, 3.0]
[[room.columns]]
x = 0.9
y = 0.3
diameter = 0.1
hue = 0.83
[camera]
width = 428
height = 240
focal = 255.0
[start]
spread_m = 0.02
[path]
poses = [[0.5, 0.0, 1.0, 0.0], [0.8, -0.1, 1.1, 8.0]]
[pilot]
column_hue_deg = 298.8
[flight]
time_limit_s = 1.2
[recording]
lossless = true
"""


@pytest.fixture(scope="module")
def mission():
    return parse_mission(MISSION, "short.toml")


@pytest.fixture(scope="module")
def flights(mission, tmp_path_factory):
    """The same flight twice."""
    out = tmp_path_factory.mktemp("flights")
    (out / "b").mkdir()
    first = fly_mission(mission, 3, out / "a", progress=False)
    (out / "a" / "paths").rename(out / "b" / "paths")
    return first, fly_mission(mission, 3, out / "b", progress=False)


def test_the_time_limit_ends_it_and_everything_is_reported(flights):
    result, _ = flights
    summary = result.summary
    assert (summary["outcome"], summary["reason"]) == ("stuck", "the time limit of 1.2 s has passed")
    assert summary["duration_s"] == pytest.approx(1.2)
    assert 0.3 < summary["position_error_m"] < 1.2
    assert summary["min_clearance_m"] > 0.0
    assert summary["max_command_step"]["linear"] <= 1.0 / 30.0
    assert summary["recording"] == str(result.recording)
    assert json.loads((result.out / "summary.json").read_text()) == summary


def test_the_same_seed_gives_the_same_flight_bit_for_bit(flights):
    a, b = (read_recording(f.recording) for f in flights)
    assert [t.told.SerializeToString() for t in a.ticks] == [t.told.SerializeToString() for t in b.ticks]
    assert [t.picture for t in a.ticks] == [t.picture for t in b.ticks]
    assert [t.sent for t in a.ticks] == [t.sent for t in b.ticks]
    assert repr([t.truth for t in a.ticks]) == repr([t.truth for t in b.ticks])


def test_a_replay_through_a_fresh_pilot_gives_the_same_commands_bit_for_bit(flights):
    outcome = replay(read_recording(flights[0].recording))
    assert outcome.ticks == 37
    assert outcome.exact
    assert str(outcome) == "replay: all 37 commands are the same, bit for bit"


def test_a_replay_that_differs_says_where_and_by_how_much(flights):
    recording = read_recording(flights[0].recording)
    ticks = list(recording.ticks)
    told = type(ticks[20].told)()
    told.CopyFrom(ticks[20].told)
    told.state.v_body[0] += 0.3
    ticks[20] = replace(ticks[20], told=told)
    outcome = replay(replace(recording, ticks=tuple(ticks)))
    assert outcome.first_difference is not None
    assert outcome.first_difference >= 20
    assert outcome.worst > 0.0
    assert "the pictures are lossless, so this is a fault" in str(outcome)
    lossy = replace(outcome, lossless=False)
    assert str(lossy).endswith("the pictures are lossy, so it is close, not exact")


def test_the_recording_stands_alone_mission_path_and_versions(flights, mission):
    recording = read_recording(flights[0].recording)
    assert recording.files["mission.toml"].decode() == MISSION
    assert recorded_mission(recording).model_dump() == settled(mission, 3, None).model_dump()
    path = recorded_path(recording)
    flown = load_path(next((flights[1].out / "paths").iterdir()))
    np.testing.assert_array_equal(path.images[1].pixels, flown.images[1].pixels)
    assert recording.notes["flight"]["seed"] == "3"
    assert recording.notes["versions"]["noctule"]
    assert summary_of(recording) == flights[0].summary


def test_the_pilots_path_holds_no_truth(flights):
    recording = read_recording(flights[0].recording)
    assert b"truth" not in recording.files["path.zip"]
    assert len(json.loads(recording.notes["truth"]["key_poses"])) == 2


def test_key_images_are_taken_where_the_mission_says_and_the_truth_says_where(flights, mission):
    folder = next((flights[1].out / "paths").iterdir())
    truth = load_truth(folder)
    assert truth is not None
    for pose, (x, y, z, yaw_deg) in zip(truth, mission.path.poses, strict=True):
        assert np.linalg.norm(pose.position - [x, y, z]) < 0.002
        assert abs(np.degrees(wrap_angle(pose.yaw - np.radians(yaw_deg)))) < 0.1


def test_teaching_twice_gives_the_same_folder_without_flying_again(flights, mission):
    out = flights[1].out
    before = next((out / "paths").iterdir())
    stamp = (before / "path.toml").stat().st_mtime_ns
    assert teach(settled(mission, 3, None), 3, out) == before
    assert (before / "path.toml").stat().st_mtime_ns == stamp
    assert len(list((out / "paths").iterdir())) == 1


def test_columns_are_not_in_the_pictures_that_are_taught(mission, flights, tmp_path):
    bare = mission.model_copy(update={"room": mission.room.model_copy(update={"columns": ()})})
    again = load_path(teach(bare, 3, tmp_path))
    known = load_path(next((flights[1].out / "paths").iterdir()))
    for a, b in zip(again.images, known.images, strict=True):
        np.testing.assert_array_equal(a.pixels, b.pixels)


def test_a_pose_inside_a_thing_cannot_be_taught(mission, tmp_path):
    sofa = '[[room.furniture]]\nkind = "cabinet"\nx = 1.2\ny = 0.0\nheight = 2.0\n'
    text = (
        MISSION.replace("furniture = 8\n", "").replace("[[0.5, 0.0, 1.0, 0.0], ", "[[1.2, 0.0, 1.0, 0.0], ")
        + sofa
    )
    with pytest.raises(TeachError) as caught:
        teach(parse_mission(text, "sofa.toml"), 0, tmp_path)
    assert str(caught.value) == (
        "teaching: on the way to pose 0 (1.2, 0, 1) the vehicle touched cabinet_0; "
        "is the pose inside the room and free?"
    )


def test_ctrl_c_in_a_flight_is_one_line_and_leaves_a_recording_with_its_summary(mission, tmp_path, flights):
    (flights[1].out / "paths").rename(tmp_path / "paths")
    endless = mission.model_copy(update={"flight": mission.flight.model_copy(update={"time_limit_s": 600.0})})

    def interrupt() -> None:
        for _ in range(3000):
            if (tmp_path / "flight.mcap").exists() and (tmp_path / "flight.mcap").stat().st_size > 1_000_000:
                break
            threading.Event().wait(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    watcher = threading.Thread(target=interrupt)
    watcher.start()
    with pytest.raises(Aborted, match=r"^flight: ended by Ctrl-C after \d+\.\d s, hovered and landed; "):
        fly_mission(endless, 3, tmp_path, progress=False)
    watcher.join()
    (tmp_path / "paths").rename(flights[1].out / "paths")
    recording = read_recording(tmp_path / "flight.mcap")
    assert recording.complete
    assert summary_of(recording)["outcome"] == "aborted"
    assert json.loads((tmp_path / "summary.json").read_text())["outcome"] == "aborted"


def test_a_disk_that_fills_up_in_flight_is_one_line_and_what_was_flown_can_be_read(
    mission, tmp_path, flights, monkeypatch
):
    write = recording_module._AppendOnlyFile._write_all

    def full(self, data: memoryview) -> None:
        if self._size + len(data) > 8_000_000:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(self, data)

    monkeypatch.setattr(recording_module._AppendOnlyFile, "_write_all", full)
    (flights[1].out / "paths").rename(tmp_path / "paths")
    endless = mission.model_copy(update={"flight": mission.flight.model_copy(update={"time_limit_s": 600.0})})
    with pytest.raises(RecordingError) as caught:
        fly_mission(endless, 3, tmp_path, progress=False)
    (tmp_path / "paths").rename(flights[1].out / "paths")
    assert str(caught.value) == (
        f"recording {tmp_path}/flight.mcap: No space left on device; what was flown until then can be read, "
        "free some space or name another folder with --out"
    )
    recording = read_recording(tmp_path / "flight.mcap")
    assert not recording.complete
    assert len(recording.flown) > 0
    assert summary_of(recording)["outcome"] == "aborted"
    assert json.loads((tmp_path / "summary.json").read_text())["outcome"] == "aborted"


def test_ctrl_c_before_the_flight_is_one_line_too(mission, tmp_path, monkeypatch):
    def interrupted(*args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(mission_flight, "teach", interrupted)
    with pytest.raises(Aborted, match=r"^flight: ended by Ctrl-C before it began or while it was"):
        fly_mission(mission, 3, tmp_path, progress=False)


def test_a_recording_without_a_mission_or_a_path_cannot_be_replayed(flights):
    recording = replace(read_recording(flights[0].recording), files={})
    with pytest.raises(RecordingFileError) as caught:
        recorded_mission(recording)
    assert str(caught.value) == (
        f"recording {recording.path}: its mission cannot be read (none); "
        "read it with the version that wrote it"
    )
    with pytest.raises(RecordingFileError) as caught:
        recorded_path(recording)
    assert str(caught.value) == (
        f"recording {recording.path}: holds no path that can be read, expected path.zip; "
        "was it made by noctule fly?"
    )


def test_the_law_and_the_seed_of_the_command_line_win(mission):
    changed = settled(mission, 9, "published")
    assert (changed.pilot.law, changed.flight.seed, changed.room.seed) == ("published", 9, 9)
    kept = settled(mission, None, None)
    assert (kept.pilot.law, kept.flight.seed) == ("noctule", 0)
    assert changed.text == mission.text


def test_laps_are_flown_recorded_and_replayed_bit_for_bit(tmp_path):
    there_and_back = MISSION.replace("[path]\n", "[path]\nlaps = 2\nreverse = true\n")
    mission = parse_mission(there_and_back, "laps.toml")
    result = fly_mission(mission, 3, tmp_path, progress=False)
    recording = read_recording(result.recording)
    # Two images, twice, from the last to the first.
    names = [i.name for i in recorded_path(recording).images]
    assert names == ["001.png", "000.png", "001.png", "000.png"]
    poses = json.loads(recording.notes["truth"]["key_poses"])
    assert poses[0] == poses[2] != poses[1] == poses[3]
    assert replay(recording).exact
    assert result.summary["cross_track_max_m"] >= result.summary["cross_track_mean_m"] > 0.0
    assert len(result.summary["laps"]) >= 1
    bare = replace(recording, notes={k: v for k, v in recording.notes.items() if k != "summary"})
    known = {
        k: v for k, v in summary_of(bare).items() if k in ("laps", "cross_track_max_m", "position_error_m")
    }
    assert known == {k: result.summary[k] for k in known}


def test_laps_over_a_path_that_does_not_close_are_refused_before_the_flight(tmp_path):
    turned = MISSION.replace(
        "[0.8, -0.1, 1.1, 8.0]",
        "[0.55, 0.0, 1.0, 20.0], [0.55, 0.0, 1.0, 40.0], "
        "[0.55, 0.0, 1.0, 60.0], [0.55, 0.0, 1.0, 80.0], [0.55, 0.0, 1.0, 100.0]",
    )
    mission = parse_mission(turned.replace("[path]\n", "[path]\nlaps = 2\n"), "laps.toml")
    with pytest.raises(RouteError, match=r"^route: image '000\.png' cannot follow '005\.png', they show"):
        fly_mission(mission, 3, tmp_path, progress=False)
    assert not (tmp_path / "flight.mcap").exists()
