"""Recordings of located flights: where the pilot was, what the ceiling camera saw, what was sent before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from noctule.flight.depth_recording import read_depth_recording
from noctule.flight.mcap_file import RecordingFileError
from noctule.flight.proto import flight_pb2
from noctule.flight.reader import read_recording
from noctule.flight.recording import FlightRecorder, sent_message
from noctule.messages import (
    Command,
    Decision,
    DepthFrame,
    Doubt,
    FlightState,
    PoseMeasurement,
    VehicleState,
    Whereabouts,
)

NO_COMMAND = sent_message(0.0, Command(), Command(), "flying", "pass", "")


def frame(i: int, colour: bool = False) -> DepthFrame:
    rng = np.random.default_rng(i)
    depth = rng.integers(0, 5000, (48, 64)).astype(np.uint16)
    picture = rng.integers(0, 255, (48, 64, 3)).astype(np.uint8) if colour else None
    return DepthFrame(i / 30.0 - 0.04, depth, picture)


def somewhere(measured: bool) -> Whereabouts:
    rng = np.random.default_rng(7)
    seen = PoseMeasurement(0.06, rng.normal(size=3), 0.4, rng.normal(size=(4, 4)), "registration")
    return Whereabouts(
        0.1,
        rng.normal(size=3),
        1 / 3,
        rng.normal(size=4),
        0.008,
        0.02,
        rng.normal(size=4),
        12.5,
        3.75,
        True,
        Doubt.SLOW,
        "the camera has not seen the drone for 0.4 s",
        seen if measured else None,
        "" if measured else "occluded: 12 % of the drone can be seen",
    )


def write(path, count: int, depth: bool, colour: bool = False) -> list[DepthFrame]:
    frames = [frame(i, colour) for i in range(count)]
    with FlightRecorder(path, depth=depth, lossless=True) as recorder:
        for i, seen in enumerate(frames):
            stamp = i / 30.0
            recorder.tick(
                stamp,
                VehicleState(stamp, FlightState.FLYING),
                None,
                (),
                None,
                NO_COMMAND,
                Decision(Command(), "follow", whereabouts=somewhere(i % 2 == 0)),
                1.0,
                depth=seen if i % 3 else None,
                sent_before=Command(0.1 * i, 0.2) if i else None,
            )
    return frames


@pytest.mark.parametrize("measured", [True, False])
def test_where_the_pilot_was_comes_back_as_it_went_in_with_what_was_measured_or_why_not(tmp_path, measured):
    decision = Decision(Command(), "follow", whereabouts=somewhere(measured))
    with FlightRecorder(tmp_path / "a.mcap") as recorder:
        recorder.tick(0.0, VehicleState(0.0, FlightState.FLYING), None, (), None, NO_COMMAND, decision, 1.0)
    (tick,) = read_recording(tmp_path / "a.mcap").ticks
    assert tick.decision is not None
    assert repr(tick.decision.whereabouts) == repr(decision.whereabouts)


def test_a_path_that_is_not_begun_has_a_time_that_is_no_number_also_when_it_is_read(tmp_path):
    unbegun = Whereabouts(0.0, np.zeros(3), 0.0, np.zeros(4), 0.01, 0.01, np.zeros(4))
    with FlightRecorder(tmp_path / "a.mcap") as recorder:
        recorder.tick(
            0.0,
            VehicleState(0.0, FlightState.FLYING),
            None,
            (),
            None,
            NO_COMMAND,
            Decision(Command(), "to start", whereabouts=unbegun),
        )
    (tick,) = read_recording(tmp_path / "a.mcap").ticks
    assert np.isnan(tick.decision.whereabouts.path_time)
    assert np.isnan(tick.decision.whereabouts.s)
    assert tick.decision.whereabouts.doubt is Doubt.SURE


def test_a_pilot_that_is_not_located_and_a_first_tick_stay_so(tmp_path):
    with FlightRecorder(tmp_path / "a.mcap") as recorder:
        recorder.tick(
            0.0,
            VehicleState(0.0, FlightState.FLYING),
            None,
            (),
            None,
            NO_COMMAND,
            Decision(Command(), "flying"),
        )
    recording = read_recording(tmp_path / "a.mcap")
    (tick,) = recording.ticks
    assert tick.decision.whereabouts is None
    told = tick.observation()
    assert (told.depth, told.sent, tick.depth_stamp) == (None, None, None)
    assert recording.depth_kept


@pytest.mark.parametrize("colour", [False, True])
def test_depth_frames_that_are_kept_come_back_to_the_last_millimetre(tmp_path, colour):
    frames = write(tmp_path / "a.mcap", 10, depth=True, colour=colour)
    recording = read_recording(tmp_path / "a.mcap")
    assert recording.depth_kept
    for i, (tick, given) in enumerate(zip(recording.ticks, frames, strict=True)):
        told = tick.observation()
        assert told.sent == (Command(0.1 * i, 0.2) if i else None)
        if i % 3 == 0:
            assert told.depth is None
        else:
            assert told.depth is not None
            assert told.depth.stamp == given.stamp == tick.depth_stamp
            assert told.depth.depth.dtype == np.uint16
            np.testing.assert_array_equal(told.depth.depth, given.depth)
            assert (told.depth.colour is None) == (not colour)
            if colour:
                np.testing.assert_array_equal(told.depth.colour, given.colour)


def test_frames_that_are_not_kept_leave_their_stamps_and_the_recording_says_so(tmp_path):
    frames = write(tmp_path / "small.mcap", 10, depth=False)
    write(tmp_path / "large.mcap", 10, depth=True)
    recording = read_recording(tmp_path / "small.mcap")
    assert not recording.depth_kept
    assert [t.depth_stamp for t in recording.ticks] == [
        f.stamp if i % 3 else None for i, f in enumerate(frames)
    ]
    assert all(t.observation().depth is None for t in recording.ticks)
    small, large = ((tmp_path / name).stat().st_size for name in ("small.mcap", "large.mcap"))
    assert large > 2 * small


def test_what_reads_recordings_of_depth_cameras_reads_the_frames_of_a_flight_too(tmp_path):
    frames = write(tmp_path / "a.mcap", 10, depth=True)
    seen = read_depth_recording(tmp_path / "a.mcap")
    given = [f for i, f in enumerate(frames) if i % 3]
    assert seen.count == len(given)
    for read, one in zip(seen.frames(), given, strict=True):
        assert read.stamp == one.stamp
        np.testing.assert_array_equal(read.depth, one.depth)


def test_a_flight_with_depth_that_was_cut_short_gives_whole_ticks_with_whole_frames(tmp_path):
    path = tmp_path / "a.mcap"
    frames = write(path, 200, depth=True)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    ticks = read_recording(path).ticks
    assert 10 < len(ticks) < 200
    for i, tick in enumerate(ticks):
        depth = tick.observation().depth
        if i % 3:
            assert depth is not None
            np.testing.assert_array_equal(depth.depth, frames[i].depth)


def test_a_frame_that_was_changed_after_the_flight_is_one_line(tmp_path):
    path = tmp_path / "a.mcap"
    write(path, 2, depth=True)
    stored = read_recording(path).ticks[1].depth
    assert stored is not None
    message = RawImage.FromString(stored.packed())
    message.height = 47
    with pytest.raises(RecordingFileError) as caught:
        replace(stored, packed=message.SerializeToString).frame()
    assert str(caught.value) == (
        f"recording {path}: a depth frame of 64x47 px holds 6144 bytes; was the file changed after it was "
        "recorded?"
    )


def test_the_messages_of_older_recordings_are_still_read():
    # Written by the version before pilots were located: fields 1 to 4 and 1 to 8 only.
    told = flight_pb2.Observation.FromString(b"\x09" + np.float64(0.5).tobytes())
    assert told.stamp == 0.5
    assert not told.HasField("depth_stamp")
    assert not told.HasField("sent")
    answered = flight_pb2.Decision.FromString(b"\x1a\x06flying")
    assert answered.phase == "flying"
    assert not answered.HasField("whereabouts")
