"""sensors.toml: what the filter takes off each sensor's measurements, and how far it believes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from noctule.estimation.sensors import Sensors
from noctule.localization.site_files import FORMAT, SiteFileError, read_toml, toml, write_whole

SENSORS = "sensors.toml"
_CALIBRATE = "make it with `noctule calibrate sensors RECORDING --site SITE`"
_SITE = "give that of `noctule calibrate camera`, or make one"
_HEADER = """\
# What is wrong with the sensors and how far to believe them. Metres, radians, seconds.
# delay: stamps are this much too late. heading: what is said too much, a constant and cosines and sines of
# 1, 2, ... times the heading that is said. walk: how fast what is left of a bias moves.
"""


def save_sensors(folder: Path, sensors: Sensors) -> None:
    """Write sensors.toml; raises SiteFileError."""
    text = _HEADER + toml({"format": FORMAT}) + _tables("", sensors.model_dump(mode="json"))
    write_whole(folder / SENSORS, text.encode("utf-8"))


def load_sensors(folder: Path) -> Sensors:
    """Read sensors.toml; raises SiteFileError, SiteFormatError."""
    return read_toml(folder / SENSORS, Sensors, _CALIBRATE)


def sensors_of(folder: Path) -> Sensors:
    """Return what a site was calibrated to; where it never was, nothing is taken off.

    Raises SiteFileError for a folder that is none, or a file that is damaged, and SiteFormatError.
    """
    if not folder.is_dir():
        raise SiteFileError(f"site {folder}: is no folder; {_SITE}")
    return load_sensors(folder) if (folder / SENSORS).exists() else Sensors()


def _tables(prefix: str, values: dict[str, Any]) -> str:
    text = ""
    for name, value in values.items():
        numbers = {key: item for key, item in value.items() if not isinstance(item, dict)}
        below = {key: item for key, item in value.items() if isinstance(item, dict)}
        text += f"\n[{prefix}{name}]\n{toml(numbers)}" + _tables(f"{prefix}{name}.", below)
    return text
