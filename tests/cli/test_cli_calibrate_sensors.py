"""`noctule calibrate sensors` and `noctule experiment loc-fusion`, on made-up flights."""

import math
from pathlib import Path

import numpy as np
import pytest

from noctule.cli.measuring import figures_text
from noctule.estimation.measurements import NavdataNoise
from noctule.flight.sensor_recording import SensorRecorder
from noctule.geometry import Pose, rot_z, wrap_angle
from noctule.localization.sensors_file import load_sensors
from noctule.messages import FlightState, HeadingMeasurement, Truth, VehicleState


def write_flight(path: Path, seconds: float = 45.0, truth: bool = True, markers: bool = False) -> Path:
    """A flight whose vehicle says 0.2 rad (1 + sin of the heading) too much."""
    rng = np.random.default_rng(0)
    with SensorRecorder(path) as recorder:
        for k in range(int(seconds * 30)):
            t = k / 30.0
            yaw = wrap_angle(0.4 * t + 0.7 * math.sin(0.6 * t))
            v = np.array([0.4 * math.cos(0.4 * t), 0.3 * math.sin(0.5 * t), 0.1 * math.sin(0.3 * t)])
            said = yaw + 0.2 * (1.0 + math.sin(yaw)) + 0.02 * rng.standard_normal()
            v_body = rot_z(yaw).T @ v + 0.05 * rng.standard_normal(3)
            recorder.state(
                VehicleState(t, FlightState.FLYING, yaw=wrap_angle(said), v_body=v_body, height=1.25)
            )
            if truth:
                recorder.truth(Truth(t, Pose(np.array([0.0, 0.0, 1.2]), yaw), v, 1.0))
            if markers and k % 5 == 0:
                recorder.heading(HeadingMeasurement(t, yaw, 0.0001, "markers"))
    return path


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    return write_flight(tmp_path_factory.mktemp("flight") / "sensors.mcap", markers=True)


def test_it_tells_the_table_writes_what_the_filter_loads_and_draws(noctule, flight):
    said = noctule("calibrate", "sensors", str(flight), "--site", "lab")
    assert said.code == 0, said.err
    lines = said.out.splitlines()
    assert lines[0] == "sensors: judged by ground truth; errors of the heading [deg], mean ± sd"
    assert [int(line.split()[0]) for line in lines[3:13]] == list(range(18, 360, 36))
    assert any(line.startswith("onboard: stamps ") for line in lines)
    assert lines[-3:] == [
        "for the filter: lab/sensors.toml",
        "figure: lab/sensors-flight.png",
        "figure: lab/sensors-heading.png",
    ]
    assert Path("lab/sensors-heading.png").stat().st_size > 10_000
    onboard = load_sensors(Path("lab")).onboard
    assert onboard.height_bias == pytest.approx(0.05, abs=0.001)
    assert onboard.heading.constant == pytest.approx(0.2, abs=0.05)
    assert onboard.noise.heading_sd == pytest.approx(0.02, rel=0.2)


def test_json_has_every_sensor_with_its_table(noctule, flight):
    told = noctule("calibrate", "sensors", str(flight), "--site", "lab", "--json").last_json
    assert told["reference"] == "ground truth"
    onboard = told["onboard"]
    assert onboard["heading"]["mean_deg"] == pytest.approx(math.degrees(0.2), abs=3.0)
    assert onboard["heading"]["corrected_sd_deg"] < 0.3 * onboard["heading"]["sd_deg"]
    assert len(onboard["heading"]["table"]) == 10
    assert onboard["velocity_sd"] == pytest.approx(0.05, rel=0.2)
    assert set(told["markers"]) == {"delay_s", "delay_sd_s", "heading"}


def test_markers_are_the_reference_where_they_are_asked_for(noctule, flight):
    tokens = (
        "calibrate",
        "sensors",
        str(flight),
        "--site",
        "lab",
        "--reference",
        "markers",
        "--out",
        "m",
        "--json",
    )
    told = noctule(*tokens).last_json
    assert told["reference"] == "colour markers"
    assert "markers" not in told
    assert not Path("lab").exists()
    assert load_sensors(Path("m")).onboard.noise.velocity_sd == NavdataNoise().velocity_sd  # no positions


def test_what_a_second_recording_does_not_hold_is_kept(noctule, flight, tmp_path):
    noctule("calibrate", "sensors", str(flight), "--site", "lab")
    before = load_sensors(Path("lab"))
    other = write_flight(tmp_path / "other.mcap")
    assert noctule("calibrate", "sensors", str(other), "--site", "lab").code == 0
    assert load_sensors(Path("lab")).markers == before.markers


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"seconds": 12.0},
            "onboard: measured beside the reference for 11.5 s, expected at least 30 s; fly longer, in sight",
        ),
        (
            {"truth": False},
            "recording bad.mcap: holds neither ground truth nor headings of markers, expected one to judge "
            "sensors by; fly with colour markers on, in sight of the camera",
        ),
    ],
)
def test_a_recording_that_nothing_can_be_learned_from_is_one_line(noctule, options, message):
    write_flight(Path("bad.mcap"), **options)
    said = noctule("calibrate", "sensors", "bad.mcap", "--site", "lab")
    assert said.code == 2
    assert said.err == f"noctule: {message}\n"
    assert not Path("lab").exists()


def test_a_recording_that_is_missing_is_one_line(noctule):
    said = noctule("calibrate", "sensors", "none.mcap", "--site", "lab")
    assert said.code == 2
    assert said.err == (
        "noctule: recording none.mcap: cannot be read (No such file or directory); expected the .mcap file "
        "of sensors or of a flight\n"
    )


def test_options_of_loc_fusion_are_its_own(noctule):
    said = noctule("experiment", "loc-pose", "--markers", "node")
    assert said.code == 2
    assert "--markers" in said.err
    said = noctule("experiment", "loc-fusion", "--markers", "both")
    assert said.code == 2
    assert said.err.startswith('noctule: invalid value "both" for --markers')


def test_loc_fusion_measures_with_the_options_that_are_asked(noctule, monkeypatch):
    asked = []

    def measured(seed, options, progress):
        asked.append((seed, options))
        return {"fused": {"yaw_sd_deg": 0.5, "position_rms_m": None}}

    from noctule.experiments import measured as experiments

    pretended = experiments.MEASURED["loc-fusion"]
    monkeypatch.setitem(
        experiments.MEASURED,
        "loc-fusion",
        type(pretended)(pretended.title, pretended.options, measured, pretended.steps),
    )
    said = noctule(
        "experiment", "loc-fusion", "--hull", "--person", "--markers", "node", "--seed", "7", "--json"
    )
    assert said.code == 0, said.err
    ((seed, options),) = asked
    assert seed == 7
    assert (options.hull, options.person, options.markers) == (True, True, "node")
    assert said.last_json == {"seed": 7, "fused": {"yaw_sd_deg": 0.5, "position_rms_m": None}}


def test_what_a_source_does_not_measure_is_a_dash():
    text = figures_text(
        {"onboard": {"yaw_sd_deg": 9.1, "position_rms_m": None}, "fused": {"position_rms_m": 0.004}}
    )
    assert [line.split() for line in text.splitlines()] == [
        [],
        ["yaw_sd_deg", "position_rms_m"],
        ["onboard", "9.1", "-"],
        ["fused", "0.004"],
    ]
