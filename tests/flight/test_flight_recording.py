"""Recordings: what goes in comes out, and what a crash or a full disk leaves behind can be read."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from noctule.flight import codec
from noctule.flight.reader import RecordingFileError, read_recording, whole_records
from noctule.flight.recording import FlightRecorder, RecordingError, sent_message
from noctule.geometry import Pose
from noctule.messages import (
    ColumnBox,
    Command,
    Decision,
    Diagnostics,
    FlightState,
    MatchRequest,
    MatchResult,
    Outcome,
    Picture,
    Truth,
    VehicleState,
)

RNG = np.random.default_rng(5)


def noise_picture(stamp: float) -> Picture:
    return Picture(stamp, RNG.integers(0, 255, (24, 32, 3)).astype(np.uint8))


def write_ticks(recorder: FlightRecorder, count: int, begin: int = 0) -> list[Picture]:
    pictures = []
    for i in range(begin, begin + count):
        stamp = i / 30.0
        picture = noise_picture(stamp - 0.033)
        pictures.append(picture)
        command = Command(0.01 * i, -0.1, 0.2, 1.0 / 3.0)
        recorder.tick(
            stamp,
            VehicleState(stamp, FlightState.FLYING),
            picture,
            (),
            Truth(stamp, Pose(np.array([i, 0.0, 1.0]), 0.1), np.zeros(3), 0.5),
            sent_message(stamp, command, command, "flying", "pass", ""),
            Decision(command, "flying"),
            2.5,
        )
    return pictures


def test_every_field_of_every_message_comes_back_as_it_went_in(tmp_path):
    state = VehicleState(
        0.1, FlightState.LANDING, 0.01, -0.02, 3.0, np.array([0.1, 0.2, 1 / 3]), 1.1, 0.8, 0.25
    )
    matches = (
        MatchResult(0.05, 3, RNG.normal(size=(5, 2)), RNG.normal(size=(5, 2))),
        MatchResult(0.06, 4, np.empty((0, 2)), np.empty((0, 2)), "nothing alike"),
    )
    diagnostics = Diagnostics(
        7,
        5.5,
        RNG.normal(size=6),
        RNG.normal(size=3),
        -0.3,
        {"avoidance": 0.25, "visibility": 1.0},
        RNG.normal(size=(4, 2)),
        RNG.normal(size=(4, 2)),
        (ColumnBox(1.0, 2.0, 3.0, 4.0, np.array([1.0, 3.0]), np.array([3.0, 3.0])),),
        {"avoidance": 0.125},
    )
    decision = Decision(
        Command(0.1, 0.2, 0.3, 0.4),
        "flying",
        diagnostics,
        (MatchRequest(7), MatchRequest(0)),
        Outcome.LOST,
        "gone",
    )
    truth = Truth(
        0.1,
        Pose(np.array([1.0, 2.0, 3.0]), 0.1, 0.2, 0.3),
        np.array([0.4, 0.5, 0.6]),
        -0.01,
        ("sofa_1", "wall"),
    )
    picture = noise_picture(1 / 30)
    sent = sent_message(0.1, decision.command, Command(0.05), "hover", "bound", "the fence is near")
    with FlightRecorder(tmp_path / "a.mcap", lossless=True) as recorder:
        recorder.note("flight", {"lossless": "true", "seed": "3"})
        recorder.attach("mission.toml", "application/toml", b"name = 'x'\n")
        recorder.tick(0.1, state, picture, matches, truth, sent, decision, 4.5)
    recording = read_recording(tmp_path / "a.mcap")
    (tick,) = recording.ticks
    told = tick.observation()
    assert recording.complete
    assert recording.lossless
    assert recording.notes["flight"]["seed"] == "3"
    assert recording.files == {"mission.toml": b"name = 'x'\n"}
    assert told.stamp == 0.1
    assert told.picture is not None
    assert told.picture.stamp == picture.stamp
    np.testing.assert_array_equal(told.picture.pixels, picture.pixels)
    np.testing.assert_equal(repr(told.state), repr(state))
    np.testing.assert_equal(repr(told.matches), repr(matches))
    np.testing.assert_equal(repr(tick.decision), repr(decision))
    np.testing.assert_equal(repr(tick.truth), repr(truth))
    assert (tick.asked, tick.sent) == (decision.command, Command(0.05))
    assert (tick.supervisor, tick.action, tick.reason) == ("hover", "bound", "the fence is near")
    assert tick.tick_ms == 4.5


def test_what_the_vehicle_does_not_say_stays_unsaid(tmp_path):
    state = VehicleState(0.0, FlightState.FLYING)
    with FlightRecorder(tmp_path / "a.mcap") as recorder:
        recorder.tick(0.0, state, None, (), None, sent_message(0.0, Command(), Command(), "", "", ""))
    (tick,) = read_recording(tmp_path / "a.mcap").ticks
    assert tick.observation().state == state
    assert tick.observation().picture is None
    assert (tick.truth, tick.decision) == (None, None)
    assert np.isnan(tick.tick_ms)


@settings(deadline=None)
@given(st.lists(st.floats(allow_nan=False), min_size=4, max_size=4))
def test_commands_survive_bit_for_bit(values):
    command = Command(*values)
    assert (
        codec.decode_command(codec.pb.Command.FromString(codec.encode_command(command).SerializeToString()))
        == command
    )


def test_the_same_flight_gives_the_same_file(tmp_path):
    contents = []
    for name in ("a", "b"):
        global RNG
        RNG = np.random.default_rng(8)
        with FlightRecorder(tmp_path / name) as recorder:
            recorder.note("flight", {"lossless": "false", "seed": "1", "law": "noctule"})
            write_ticks(recorder, 70)
        contents.append((tmp_path / name).read_bytes())
    assert contents[0] == contents[1]


def test_lossy_pictures_are_close_and_the_recording_says_so(tmp_path):
    smooth = np.linspace(0, 255, 64 * 48 * 3).reshape(48, 64, 3).astype(np.uint8)
    with FlightRecorder(tmp_path / "a.mcap", jpeg_quality=95) as recorder:
        sent = sent_message(0.0, Command(), Command(), "", "", "")
        recorder.tick(0.0, VehicleState(0.0, FlightState.FLYING), Picture(0.0, smooth), (), None, sent)
    recording = read_recording(tmp_path / "a.mcap")
    seen = recording.ticks[0].observation().picture
    assert seen is not None
    assert not recording.lossless
    assert 0.0 < np.abs(seen.pixels.astype(float) - smooth).mean() < 3.0


def test_two_recordings_in_one_process_do_not_see_each_other(tmp_path):
    with FlightRecorder(tmp_path / "a") as one, FlightRecorder(tmp_path / "b") as two:
        write_ticks(one, 3)
        write_ticks(two, 5)
        write_ticks(one, 2, begin=3)
    assert len(read_recording(tmp_path / "a").ticks) == 5
    assert len(read_recording(tmp_path / "b").ticks) == 5
    assert [t.stamp for t in read_recording(tmp_path / "a").ticks] == [i / 30.0 for i in range(5)]


def test_any_mcap_reader_opens_it_and_finds_foxglove_pictures_and_described_messages(tmp_path):
    with FlightRecorder(tmp_path / "a.mcap") as recorder:
        write_ticks(recorder, 2)
    with (tmp_path / "a.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    kinds = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}
    assert kinds == {
        "/camera": "foxglove.CompressedImage",
        "/observation": "noctule.flight.Observation",
        "/decision": "noctule.flight.Decision",
        "/sent": "noctule.flight.Sent",
        "/truth": "noctule.flight.Truth",
    }


@pytest.fixture(scope="module")
def two_seconds(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "flight.mcap"
    with FlightRecorder(path) as recorder:
        recorder.note("flight", {"seed": "1"})
        write_ticks(recorder, 61)
    return path.read_bytes()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**9))
def test_a_file_cut_anywhere_gives_the_ticks_before_the_cut(two_seconds, tmp_path_factory, at):
    cut = two_seconds[: 8 + at % (len(two_seconds) - 8)]
    path = tmp_path_factory.getbasetemp() / "cut.mcap"
    path.write_bytes(cut)
    recording = read_recording(path)
    assert not recording.complete
    assert [t.stamp for t in recording.ticks] == [i / 30.0 for i in range(len(recording.ticks))]
    assert whole_records(cut)[0] <= len(cut)


def test_a_file_cut_at_its_last_byte_still_has_every_tick(two_seconds, tmp_path):
    (tmp_path / "cut").write_bytes(two_seconds[:-1])
    recording = read_recording(tmp_path / "cut")
    assert len(recording.ticks) == 61
    assert recording.notes["flight"] == {"seed": "1"}


def test_zeros_behind_the_last_record_are_no_ticks(two_seconds, tmp_path):
    whole, _ = whole_records(two_seconds[: len(two_seconds) // 2])
    (tmp_path / "cut").write_bytes(two_seconds[:whole] + bytes(5000))
    assert not read_recording(tmp_path / "cut").complete


_FLY = """
import sys, os, signal
sys.path.insert(0, {tests!r})
from pathlib import Path
from test_flight_recording import FlightRecorder, RecordingError, write_ticks
"""


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    script = _FLY.format(tests=str(Path(__file__).parent)) + code
    return subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False
    )


def test_a_killed_process_leaves_all_but_the_last_second(tmp_path):
    path = tmp_path / "killed.mcap"
    done = run_python(f"""
recorder = FlightRecorder(Path({str(path)!r}))
write_ticks(recorder, 100)
recorder._jobs.put(lambda: os.kill(os.getpid(), signal.SIGKILL))
recorder.close()
""")
    assert done.returncode == -9
    recording = read_recording(path)
    assert not recording.complete
    assert len(recording.ticks) >= 90  # flushed at 1, 2 and 3 s


def test_a_full_disk_is_one_line_and_what_was_written_can_be_read(tmp_path):
    path = tmp_path / "full.mcap"
    done = run_python(f"""
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (90_000, 90_000))
try:
    with FlightRecorder(Path({str(path)!r})) as recorder:
        for second in range(20):
            write_ticks(recorder, 30, begin=30 * second)
            recorder.flush()
except RecordingError as error:
    print(error)
""")
    assert done.stdout == (
        f"recording {path}: File too large; what was flown until then can be read, "
        "free some space or name another folder with --out\n"
    )
    assert done.stderr == ""
    recording = read_recording(path)
    assert 0 < len(recording.ticks) < 600
    assert whole_records(path.read_bytes())[0] == path.stat().st_size  # cut to whole records


def test_a_device_that_is_full_from_the_start_is_one_line():
    if not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    with pytest.raises(RecordingError, match=r"^recording /dev/full: No space left on device; "):
        FlightRecorder(Path("/dev/full")).close()


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError) as caught:
        FlightRecorder(tmp_path / "file" / "flight.mcap")
    assert str(caught.value) == (
        f"recording {tmp_path}/file/flight.mcap: cannot be written (File exists); "
        "name another folder with --out"
    )


def test_a_message_that_cannot_be_written_is_told_at_the_end(tmp_path):
    recorder = FlightRecorder(tmp_path / "a.mcap")
    recorder.attach("name", "text/plain", "no bytes")  # type: ignore[arg-type]
    with pytest.raises(
        RecordingError, match=r"a message could not be written \(.*\); what was flown until then"
    ):
        recorder.close()


def test_closing_twice_is_closing_once(tmp_path):
    recorder = FlightRecorder(tmp_path / "a.mcap")
    recorder.close()
    recorder.close()
    assert read_recording(tmp_path / "a.mcap").complete


def test_a_file_that_is_no_recording_is_one_line(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("not a recording")
    with pytest.raises(RecordingFileError) as caught:
        read_recording(path)
    assert str(caught.value) == f"recording {path}: this is no MCAP file; expected the .mcap file of a flight"


def test_a_missing_recording_is_one_line(tmp_path):
    path = tmp_path / "none.mcap"
    with pytest.raises(RecordingFileError) as caught:
        read_recording(path)
    assert str(caught.value) == (
        f"recording {path}: cannot be read (No such file or directory); expected the .mcap file of a flight"
    )


def test_a_recording_of_another_format_is_one_line(tmp_path, two_seconds):
    path = tmp_path / "old.mcap"
    path.write_bytes(two_seconds.replace(b"noctule-flight-1", b"noctule-flight-9"))
    with pytest.raises(
        RecordingFileError, match=re.escape("its format is 'noctule-flight-9', this version reads")
    ):
        read_recording(path)
