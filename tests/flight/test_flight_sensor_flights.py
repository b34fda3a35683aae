"""Calibrating from a recording: by the truth, by markers, or not at all."""

import math
from dataclasses import replace

import numpy as np
import pytest
from flight_sensors import DEPTH_BIAS, HEADING_BIAS, HEIGHT_BIAS, write_sensors

from noctule.estimation.sensor_calibration import SensorFlightError
from noctule.estimation.sensors import RoomSensor, Sensors
from noctule.flight.sensor_flights import NoReferenceError, NoSensorsError, calibrate_sensors
from noctule.flight.sensor_recording import read_sensor_log


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return read_sensor_log(write_sensors(tmp_path_factory.mktemp("sensors") / "s.mcap"))


@pytest.mark.parametrize("kind", ["truth", "markers"])
def test_the_onboard_sensor_is_found_by_either_reference(log, kind):
    flight = calibrate_sensors(log, kind)
    onboard = flight.sensors.onboard
    errors = flight.headings["onboard"]
    assert errors.before.mean() == pytest.approx(HEADING_BIAS, abs=0.05)
    assert errors.after.std() == pytest.approx(0.02, rel=0.15)
    assert onboard.noise.velocity_sd == pytest.approx(0.05, rel=0.2)
    assert onboard.delay == pytest.approx(0.0, abs=0.01)
    # By markers the height's reference is the depth's, which has its own bias.
    expected = HEIGHT_BIAS - (DEPTH_BIAS[2] if kind == "markers" else 0.0)
    assert onboard.height_bias == pytest.approx(expected, abs=0.004)


def test_with_ground_truth_depth_and_markers_are_judged_too(log):
    flight = calibrate_sensors(log)
    assert flight.reference == "ground truth"
    assert set(flight.headings) == {"onboard", "depth", "markers"}
    np.testing.assert_allclose(flight.sensors.depth.position_bias, DEPTH_BIAS, atol=0.001)
    assert flight.sensors.depth.heading_sd == pytest.approx(0.01, rel=0.2)  # half turns are no errors
    assert flight.sensors.markers.heading_sd == pytest.approx(0.005, rel=0.2)


def test_by_markers_depth_is_judged_by_its_heading_alone(log):
    flight = calibrate_sensors(replace(log, truth=()))
    assert flight.reference == "colour markers"
    assert set(flight.headings) == {"onboard", "depth"}
    assert flight.sensors.depth.position_bias == (0.0, 0.0, 0.0)
    assert flight.sensors.depth.heading_sd < math.radians(1.5)


def test_sensors_that_the_recording_does_not_hold_stay_as_they_were(log):
    known = Sensors(markers=RoomSensor(heading_sd=0.123))
    flight = calibrate_sensors(replace(log, headings=(), poses=()), known=known)
    assert flight.sensors.markers == known.markers
    assert flight.sensors.depth == known.depth
    assert flight.sensors.onboard != known.onboard


def test_markers_without_depth_are_a_reference_of_headings(log):
    flight = calibrate_sensors(replace(log, truth=(), poses=()))
    assert set(flight.headings) == {"onboard"}
    assert flight.sensors.onboard.height_bias == 0.0


def refused(log, **options):
    with pytest.raises((NoReferenceError, NoSensorsError, SensorFlightError)) as raised:
        calibrate_sensors(log, **options)
    return str(raised.value)


def test_without_a_reference_nothing_is_calibrated(log):
    assert refused(replace(log, truth=(), headings=())) == (
        f"recording {log.path}: holds neither ground truth nor headings of markers, expected one to judge "
        "sensors by; fly with colour markers on, in sight of the camera"
    )
    assert refused(replace(log, truth=()), kind="truth") == (
        f"recording {log.path}: holds no ground truth, expected that of a simulated flight; use a recording "
        "of one, or --reference markers"
    )


def test_without_a_sensor_nothing_is_calibrated(log):
    assert refused(replace(log, states=(), poses=(), headings=())) == (
        f"recording {log.path}: holds no reports with a heading and no located depth frames, expected one of "
        "them beside the reference; record the vehicle's reports too"
    )


def test_a_flight_that_is_too_short_or_does_not_turn_is_refused(tmp_path):
    short = read_sensor_log(write_sensors(tmp_path / "short.mcap", seconds=20.0))
    assert refused(short) == (
        "onboard: measured beside the reference for 19.4 s, expected at least 30 s; fly longer, in sight"
    )
    straight = read_sensor_log(write_sensors(tmp_path / "straight.mcap", turning=0.05))
    assert refused(straight) == (
        "onboard: headings of 60 to 90, 90 to 120, 120 to 150, ... deg are missing (10 of 12 sectors), "
        "expected all; turn the drone through them"
    )
