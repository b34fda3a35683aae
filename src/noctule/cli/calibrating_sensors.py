"""`noctule calibrate sensors`: bias, noise and delay of each sensor, from a flight beside a reference."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from noctule.cli.options import out_folder
from noctule.cli.show import as_json

if TYPE_CHECKING:
    from noctule.estimation.sensor_calibration import HeadingErrors
    from noctule.flight.sensor_flights import Kind, SensorFlight
    from noctule.flight.sensor_recording import SensorLog


def find_sensors(recording: Path, site: Path, reference: Kind | None, out: Path | None, json: bool) -> int:
    """Calibrate the sensors of a recording, keep them in sensors.toml; 0 when they could be."""
    from noctule.estimation.sensors import Sensors
    from noctule.flight.sensor_flights import calibrate_sensors
    from noctule.flight.sensor_recording import read_sensor_log
    from noctule.localization.sensors_file import SENSORS, load_sensors, save_sensors
    from noctule.reports.sensor_figures import write_heading_figures

    log = read_sensor_log(recording)
    if log.frames and not log.poses:
        log = _seen(log, site)
    folder = out or site
    known = load_sensors(folder) if (folder / SENSORS).exists() else Sensors()
    found = calibrate_sensors(log, reference, known)
    folder = out_folder(folder, "site")
    save_sensors(folder, found.sensors)
    figures = write_heading_figures(found.headings, folder)
    told = {**figures_of(found), "sensors": folder / SENSORS, "figures": figures}
    print(as_json(told) if json else in_words(told))
    return 0


def _seen(log: SensorLog, site: Path) -> SensorLog:
    """Locate the drone and its markers in the depth frames of the recording."""
    from noctule.flight.depth_recording import read_depth_recording
    from noctule.flight.sensor_flights import see
    from noctule.localization.site import load_site
    from noctule.reports.progress import with_progress

    frames = read_depth_recording(log.path).frames()
    return see(log, with_progress(frames, "locating the drone", total=log.frames), load_site(site))


def figures_of(found: SensorFlight) -> dict[str, Any]:
    """Return what JSON says of a calibration."""
    of: dict[str, Any] = {"reference": found.reference}
    for name, errors in found.headings.items():
        sensor = getattr(found.sensors, name)
        of[name] = {"delay_s": sensor.delay, "delay_sd_s": sensor.delay_sd, "heading": _heading(errors)}
        if name == "onboard":
            of[name] |= {
                **sensor.noise.model_dump(),
                "height_bias_m": sensor.height_bias,
                "heading_walk": sensor.heading_walk,
                "velocity_walk": sensor.velocity_walk,
            }
        elif name == "depth":
            of[name] |= {
                "position_bias_m": list(sensor.position_bias),
                "position_sd_m": list(sensor.position_sd),
            }
    return of


def _heading(errors: HeadingErrors) -> dict[str, Any]:
    from noctule.estimation.sensor_calibration import heading_table

    degrees = math.degrees
    return {
        "measured": int(errors.before.size),
        "mean_deg": degrees(float(errors.before.mean())),
        "sd_deg": degrees(float(errors.before.std())),
        "corrected_sd_deg": degrees(float(errors.after.std())),
        "noise_deg": degrees(errors.noise_sd),
        "table": [
            {
                "heading_deg": degrees(s.heading),
                "mean_deg": degrees(s.mean),
                "sd_deg": degrees(s.sd),
                "count": s.count,
            }
            for s in heading_table(errors)
        ],
    }


def in_words(told: dict[str, Any]) -> str:
    """Return the calibration as a person reads it; the table is the paper's Table 3."""
    names = [name for name in ("onboard", "depth", "markers") if name in told]
    lines = [f"sensors: judged by {told['reference']}; errors of the heading [deg], mean ± sd", ""]
    lines.append("  heading  " + "".join(f"{name:>18}" for name in names))
    tables = {name: {row["heading_deg"]: row for row in told[name]["heading"]["table"]} for name in names}
    for heading in sorted({heading for table in tables.values() for heading in table}):
        cells = "".join(f"{_cell(tables[name].get(heading)):>18}" for name in names)
        lines.append(f"  {heading:>7.0f}  {cells}")
    lines.append("")
    for name in names:
        of = told[name]
        heading = of["heading"]
        lines.append(
            f"{name}: stamps {1e3 * of['delay_s']:+.1f} ± {1e3 * of['delay_sd_s']:.1f} ms late; heading "
            f"{heading['mean_deg']:+.2f} ± {heading['sd_deg']:.2f} deg, corrected "
            f"{heading['corrected_sd_deg']:.2f} deg sd, of which {heading['noise_deg']:.2f} is noise"
        )
        if name == "onboard":
            lines.append(
                f"  velocity {of['velocity_sd']:.3f} m/s, climb {of['climb_sd']:.3f} m/s, height "
                f"{1e3 * of['height_bias_m']:+.0f} ± {1e3 * of['height_sd']:.0f} mm"
            )
        if name == "depth" and any(of["position_sd_m"]):
            bias, sd = (
                ", ".join(f"{1e3 * v:{form}}" for v in of[key])
                for key, form in (("position_bias_m", "+.1f"), ("position_sd_m", ".1f"))
            )
            lines.append(f"  position {bias} mm with sd {sd} mm")
    lines.append(f"for the filter: {told['sensors']}")
    return "\n".join([*lines, *(f"figure: {file}" for file in told["figures"])])


def _cell(row: dict[str, Any] | None) -> str:
    return "-" if row is None else f"{row['mean_deg']:+.2f} ± {row['sd_deg']:.2f}"
