"""vehicle.toml: written, read, and refused when it is damaged."""

import tomllib

import pytest

from noctule.estimation.identification import VehicleModelSettings
from noctule.estimation.vehicle_model import TABLE_1
from noctule.localization.site_files import SiteFileError, SiteFormatError
from noctule.localization.vehicle_file import load_vehicle_model, save_vehicle_model

MODEL = VehicleModelSettings(
    k=tuple(1.01 * k for k in TABLE_1),
    sd=(0.01, 0.001, 0.02, 0.003, 0.02, 0.02, 0.01, 0.01),
    delay_s=0.0667,
    delay_sd_s=0.0004,
    full_scale=(17.7, 11.7, 1.03, 1.56),
)


def test_what_was_written_is_read(tmp_path):
    save_vehicle_model(tmp_path / "sites" / "vehicle.toml", MODEL)
    assert load_vehicle_model(tmp_path / "sites" / "vehicle.toml") == MODEL


def test_any_reader_of_toml_finds_the_model(tmp_path):
    save_vehicle_model(tmp_path / "vehicle.toml", MODEL)
    text = (tmp_path / "vehicle.toml").read_text("utf-8")
    values = tomllib.loads(text)
    assert values["format"] == 1
    assert values["vehicle_model"]["k"] == list(MODEL.k)
    assert values["vehicle_model"]["sd"] == list(MODEL.sd)
    assert values["vehicle_model"]["delay_s"] == 0.0667
    assert text.startswith("# The identified model of a vehicle.")


def test_a_hand_written_file_needs_nothing_but_k(tmp_path):
    file = tmp_path / "vehicle.toml"
    file.write_text(f"format = 1\n[vehicle_model]\nk = {list(TABLE_1)}\n")
    found = load_vehicle_model(file)
    assert found.model().input_gains == pytest.approx(TABLE_1[0::2])
    assert found.delay_s == 0.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("format = 1\n", "vehicle_model is missing"),
        ("format = 1\n[vehicle_model]\nk = [1, 2]\n", "vehicle_model.k[2] is missing"),
        (
            "format = 1\n[vehicle_model]\ndelay_s = -1.0\n",
            "vehicle_model.delay_s is -1.0, input should be greater than or equal to 0",
        ),
        (
            "format = 1\n[vehicle_model]\nk = [0, 1, 1, 1, 1, 1, 1, 1]\n",
            "vehicle_model.k[0] is 0, input should be greater than 0",
        ),
        ("format = 1\n[vehicle_model]\nspeed = 1\n", "unknown key vehicle_model.speed"),
    ],
)
def test_a_damaged_file_is_one_line(tmp_path, text, message):
    file = tmp_path / "vehicle.toml"
    file.write_text(text)
    with pytest.raises(SiteFileError) as told:
        load_vehicle_model(file)
    assert str(told.value) == (
        f"site file {file}: {message}; make it with `noctule identify RECORDING --out FOLDER`"
    )


def test_another_format_is_refused(tmp_path):
    file = tmp_path / "vehicle.toml"
    file.write_text("format = 7\n")
    with pytest.raises(SiteFormatError, match="found format 7, this version reads format 1"):
        load_vehicle_model(file)
