"""sensors.toml: what was calibrated is read back, and what is damaged is named."""

import pytest

from noctule.estimation.measurements import NavdataNoise
from noctule.estimation.sensors import HeadingCorrection, OnboardSensors, RoomSensor, Sensors
from noctule.localization.sensors_file import SENSORS, load_sensors, save_sensors, sensors_of
from noctule.localization.site_files import SiteFileError, SiteFormatError

REMEDY = "make it with `noctule calibrate sensors RECORDING --site SITE`"
CALIBRATED = Sensors(
    onboard=OnboardSensors(
        noise=NavdataNoise(heading_sd=0.0371),
        delay=0.066,
        heading=HeadingCorrection(constant=0.25, cosines=(0.1, -0.02), sines=(-0.2, 1.0 / 3.0)),
        heading_walk=0.004,
    ),
    depth=RoomSensor(position_bias=(0.001, -0.002, 0.028), heading_sd=0.01),
)


@pytest.mark.parametrize("sensors", [CALIBRATED, Sensors()])
def test_what_was_saved_is_read_back_to_the_last_bit(tmp_path, sensors):
    save_sensors(tmp_path, sensors)
    assert load_sensors(tmp_path) == sensors


def test_the_file_can_be_read_by_a_person(tmp_path):
    save_sensors(tmp_path, CALIBRATED)
    lines = (tmp_path / SENSORS).read_text().splitlines()
    assert lines[0].startswith("# What is wrong with the sensors")
    assert "[onboard.heading]" in lines
    assert "cosines = [0.1, -0.02]" in lines


def test_a_missing_file_says_how_it_is_made(tmp_path):
    with pytest.raises(SiteFileError) as raised:
        load_sensors(tmp_path)
    assert str(raised.value) == f"site file {tmp_path / SENSORS}: is missing; {REMEDY}"


@pytest.mark.parametrize(
    ("damage", "message", "kind"),
    [
        (("format = 1", "format = 9"), "found format 9, this version reads format 1", SiteFormatError),
        (("delay = 0.066", "delay = 6.6"), "onboard.delay is 6.6, input should be less than or equal to 1",
         SiteFileError),
        (("cosines = [0.1, -0.02]", "cosines = [0.1]"),
         "onboard.heading: cosines and sines are not as many; give a pair for each harmonic", SiteFileError),
    ],
)  # fmt: skip
def test_damage_is_named(tmp_path, damage, message, kind):
    save_sensors(tmp_path, CALIBRATED)
    file = tmp_path / SENSORS
    file.write_text(file.read_text().replace(*damage))
    with pytest.raises(kind) as raised:
        load_sensors(tmp_path)
    assert str(raised.value) == f"site file {file}: {message}; {REMEDY}"


def test_a_site_that_was_never_calibrated_takes_nothing_off(tmp_path):
    assert sensors_of(tmp_path) == Sensors()


def test_a_calibrated_site_takes_off_what_it_says(tmp_path):
    save_sensors(tmp_path, Sensors(onboard=OnboardSensors(delay=0.03)))
    assert sensors_of(tmp_path).onboard.delay == 0.03


def test_a_site_that_is_no_folder_is_told(tmp_path):
    with pytest.raises(SiteFileError) as told:
        sensors_of(tmp_path / "lab")
    assert str(told.value) == (
        f"site {tmp_path / 'lab'}: is no folder; give that of `noctule calibrate camera`, or make one"
    )
