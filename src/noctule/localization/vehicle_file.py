"""vehicle.toml: the identified model of a vehicle, for all that predicts how it moves."""

from __future__ import annotations

from pathlib import Path

from noctule.estimation.identification import VehicleModelSettings
from noctule.localization.site_files import FORMAT, read_toml, toml, write_whole
from noctule.settings import Settings

VEHICLE = "vehicle.toml"
_IDENTIFY = "make it with `noctule identify RECORDING --out FOLDER`"
_HEADER = """\
# The identified model of a vehicle. k1, k3, k5, k7: acceleration by an input of 1, on forward, left, up
# [m/s^2] and yaw [rad/s^2]; k2, k4, k6, k8: drag [1/s]. sd: their standard deviations.
# full_scale: the command that is an input of 1 [m/s, rad/s].
"""


class _VehicleFile(Settings):
    vehicle_model: VehicleModelSettings


def save_vehicle_model(file: Path, model: VehicleModelSettings) -> None:
    """Write the model into a TOML file; raises SiteFileError."""
    text = f"{_HEADER}{toml({'format': FORMAT})}\n[vehicle_model]\n{toml(model.model_dump(mode='json'))}"
    write_whole(file, text.encode("utf-8"))


def load_vehicle_model(file: Path) -> VehicleModelSettings:
    """Return what `save_vehicle_model` wrote; raises SiteFileError, SiteFormatError."""
    return read_toml(file, _VehicleFile, _IDENTIFY).vehicle_model
