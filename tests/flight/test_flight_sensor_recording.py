"""Recordings of sensors side by side: what was written is read, once each."""

import math

import numpy as np
import pytest
from flight_sensors import P, position_at, write_sensors

from noctule.flight.reader import RecordingFileError
from noctule.flight.recording import FlightRecorder, sent_message
from noctule.flight.sensor_recording import SensorRecorder, read_sensor_log
from noctule.messages import Command, FlightState, HeadingMeasurement, VehicleState


def test_what_was_written_is_read_back_sensor_by_sensor(tmp_path):
    log = read_sensor_log(write_sensors(tmp_path / "s.mcap", seconds=3.0))
    assert (len(log.states), len(log.poses), len(log.headings), len(log.truth)) == (90, 90, 18, 90)
    assert log.frames == 0
    state, pose, heading, truth = log.states[60], log.poses[60], log.headings[2], log.truth[60]
    assert state.stamp == pose.stamp == truth.stamp == 2.0
    assert state.flight_state is FlightState.FLYING
    assert state.v_body.shape == (3,)
    assert state.link_quality is None
    np.testing.assert_array_equal(pose.covariance, P)
    assert pose.source == "registration"
    np.testing.assert_array_equal(truth.pose.position, position_at(2.0))
    assert heading.stamp == pytest.approx(10 / 30)
    assert heading.variance == 0.0001
    assert heading.source == "markers"


def test_frames_in_which_nothing_was_located_hold_no_pose(tmp_path):
    log = read_sensor_log(write_sensors(tmp_path / "s.mcap", seconds=2.0, located=False))
    assert log.poses == ()
    assert len(log.states) == 60


def test_what_was_handed_in_out_of_order_or_twice_is_read_in_order_and_once(tmp_path):
    file = tmp_path / "s.mcap"
    with SensorRecorder(file) as recorder:
        for stamp in (2.0, 1.0, 2.0, 3.0):
            recorder.heading(HeadingMeasurement(stamp, 0.1, 0.01, "markers"))
    assert [heading.stamp for heading in read_sensor_log(file).headings] == [1.0, 2.0, 3.0]


def test_a_recording_of_a_flight_is_read_too(tmp_path):
    file = tmp_path / "flight.mcap"
    with FlightRecorder(file) as recorder:
        for tick in range(6):  # two ticks to a report
            state = VehicleState(0.1 * (tick // 2), FlightState.FLYING, yaw=0.1)
            sent = sent_message(0.05 * tick, Command(), Command(), "flying", "send", "")
            recorder.tick(0.05 * tick, state, None, (), None, sent)
    log = read_sensor_log(file)
    assert [state.stamp for state in log.states] == pytest.approx([0.0, 0.1, 0.2])
    assert log.truth == ()


def test_a_recording_cut_short_is_read_up_to_there(tmp_path):
    whole = write_sensors(tmp_path / "s.mcap", seconds=10.0)
    data = whole.read_bytes()
    whole.write_bytes(data[: len(data) // 2])
    log = read_sensor_log(whole)
    assert 0 < len(log.states) < 300
    assert math.isclose(log.states[-1].stamp, (len(log.states) - 1) / 30, abs_tol=1e-9)


def test_a_file_that_is_none_is_refused(tmp_path):
    file = tmp_path / "s.mcap"
    file.write_text("what?")
    with pytest.raises(RecordingFileError) as raised:
        read_sensor_log(file)
    assert str(raised.value) == (
        f"recording {file}: this is no MCAP file; expected the .mcap file of sensors or of a flight"
    )
    with pytest.raises(RecordingFileError) as raised:
        read_sensor_log(tmp_path / "none.mcap")
    assert str(raised.value) == (
        f"recording {tmp_path / 'none.mcap'}: cannot be read (No such file or directory); expected the .mcap "
        "file of sensors or of a flight"
    )
