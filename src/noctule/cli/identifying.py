"""`noctule identify`: the model of a vehicle from recordings of its flights."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from noctule.cli.options import Flag, out_folder
from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.estimation.identification import Identification, Validation
    from noctule.flight.model_flights import ModelFlights
    from noctule.geometry import Array

Method = Literal["output-error", "published"]
_GOOD = 0.995  # a fit of which nothing is left to speak of
_COLOURED = 0.3  # correlation of neighbouring residuals above which deviations are to be trusted less


class IdentifyInputError(NoctuleError):
    """Recordings that do not go together."""


def identify(
    *recordings: Path,
    method: Method = "output-error",
    validation: Path | None = None,
    out: Path | None = None,
    json: Flag = False,
) -> int:
    """Identify how a vehicle answers commands: k1 to k8 and the delay, with their uncertainties.

    Writes vehicle.toml, which predicts for the filter, and draws what was measured beside the model. A model
    whose fit is below 0 on an axis is told and drawn, not written.

    Parameters
    ----------
    recordings
        Flights (.mcap) that move every axis, best one axis after the other by the deformed sinusoid.
    method
        output-error compares velocities, and finds the delay too. published is the least squares (15) of the
        paper on differentiated velocities; noise biases it.
    validation
        A flight to try the model on, best one that moves all axes at once.
    out
        The folder for vehicle.toml and the figures; left out, a new one under flights/.
    json
        End standard output with one JSON object.
    """
    if not recordings:
        raise IdentifyInputError("no recording given, expected the .mcap files of flights")
    from noctule.cli.show import as_json
    from noctule.estimation.identification import VehicleModelSettings, check_excitation
    from noctule.localization.vehicle_file import VEHICLE, save_vehicle_model

    given = [_flights(path) for path in recordings]
    scale = _same_scale(recordings, given)
    tried = None if validation is None else _flights(validation)
    if tried is not None and validation is not None:
        _same_scale((recordings[0], validation), (given[0], tried))
    _refuse_repeated(recordings, validation)
    found = _identified(method, recordings, given)
    check_excitation(found)
    model = VehicleModelSettings.of(found, scale)
    folder = out_folder(out, "identify")
    summary = {"method": method, **figures_of(found), "full_scale": list(model.full_scale)}
    summary["fit"] = _tried(found, given, "Identification", folder / "identification.png")
    if tried is not None:
        summary["validation_fit"] = _tried(found, [tried], "Validation", folder / "validation.png")
    poor = _poor(summary)
    if not poor:
        save_vehicle_model(folder / VEHICLE, model)
    summary["vehicle_model"] = None if poor else folder / VEHICLE
    summary["figures"] = sorted(folder.glob("identification*.png")) + sorted(folder.glob("validation.png"))
    if not poor:
        print(as_json(summary) if json else in_words(summary))
        return 0
    error = (
        f"identification: the fit is {poor}, worse than the mean velocity; expected more than 0; "
        f"{VEHICLE} was not written: "
        + ("identify by output-error" if method == "published" else "are all flights of this vehicle?")
    )
    print(f"noctule: {error}", file=sys.stderr)
    print(as_json({**summary, "error": error}) if json else in_words(summary))
    return 2


def _poor(summary: Mapping[str, Any]) -> str:
    """Return the fits below 0, by flight and axis; nothing where there are none."""
    flights = (("", summary["fit"]), (" of the validation", summary.get("validation_fit", {})))
    return ", ".join(
        f"{_percent(fit)} on {axis}{of}" for of, fits in flights for axis, fit in fits.items() if fit < 0.0
    )


def _refuse_repeated(recordings: tuple[Path, ...], validation: Path | None) -> None:
    """Raise IdentifyInputError for a flight that is given twice, under one name or as a copy."""
    seen: dict[str, Path] = {}
    for path in recordings:
        content = _content(path)
        if content in seen:
            raise IdentifyInputError(
                f"recording {path}: is given twice, before as {seen[content]}; expected each flight once: it "
                "would count twice, and deviations be too small; leave one out"
            )
        seen[content] = path
    trained = None if validation is None else seen.get(_content(validation))
    if trained is not None:
        raise IdentifyInputError(
            f"--validation {validation}: is the recording {trained} that the model is identified from; "
            "expected another flight: a model is not tried on what it was fitted to"
        )


def _content(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _flights(path: Path) -> ModelFlights:
    from noctule.flight.model_flights import model_flights
    from noctule.flight.reader import read_recording

    return model_flights(read_recording(path))


def _same_scale(paths: tuple[Path, ...], given: list[ModelFlights] | tuple[ModelFlights, ...]) -> Array:
    for path, flights in zip(paths, given, strict=True):
        if (flights.full_scale != given[0].full_scale).any():
            raise IdentifyInputError(
                f"recording {path}: an input of 1 is the command {flights.full_scale.tolist()}, in "
                f"{paths[0]} it is {given[0].full_scale.tolist()}; expected flights of one vehicle"
            )
    return given[0].full_scale


def _identified(method: Method, recordings: tuple[Path, ...], given: list[ModelFlights]) -> Identification:
    from noctule.estimation import identification

    parts = [part for flights in given for flight in flights.flights for part in flight.parts()]
    if not parts:
        seconds = sum(
            float(flight.stamps[-1] - flight.stamps[0]) for flights in given for flight in flights.flights
        )
        raise IdentifyInputError(
            f"recording {', '.join(map(str, recordings))}: what was sent is always the same, on every axis "
            f"in {seconds:.0f} s of flight; expected inputs that vary: fly the deformed sinusoid on each axis"
        )
    return identification.identify(parts) if method == "output-error" else identification.published(parts)


def _tried(found: Identification, given: list[ModelFlights], title: str, file: Path) -> dict[str, float]:
    """Simulate the flights and draw them; return the fit of each axis on the flight that moved it longest."""
    from noctule.estimation.identification import AXES, validate
    from noctule.reports.identification_figures import write_velocities_figure

    flights = [flight for one in given for flight in one.flights]
    simulated: list[Validation] = [validate(found, flight) for flight in flights]
    for k, flight in enumerate(simulated):
        name = file if k == 0 else file.with_stem(f"{file.stem}-{k + 1}")
        write_velocities_figure(flight, title, name)
    fits = {}
    for a, axis in enumerate(AXES):
        moved = [one for one in simulated if one.moved[a]]
        fits[axis] = max(moved, key=lambda one: one.stamps.size).fit[a].item() if moved else float("nan")
    return fits


def figures_of(found: Identification) -> dict[str, Any]:
    """Return what JSON says of an identification."""
    parameters = {
        f"k{i + 1}": {"estimate": k, "sd": sd}
        for i, (k, sd) in enumerate(zip(found.k.tolist(), found.sd.tolist(), strict=True))
    }
    residuals = {
        fit.axis: {"sd": fit.residual_sd, "correlation": fit.residual_correlation} for fit in found.axes
    }
    return {
        "parameters": parameters,
        "delay_s": found.delay,
        "delay_sd_s": found.delay_sd,
        "residuals": residuals,
    }


def in_words(summary: Mapping[str, Any]) -> str:
    """Return the summary as a person reads it."""
    k = summary["parameters"]
    lines = [f"identified by {summary['method']}: a = k_u u - k_v v", ""]
    lines.append(f"  {'axis':<8}  {'k_u':>22}  {'k_v [1/s]':>22}  {'fit':>7}  {'validation':>10}")
    tried = summary.get("validation_fit", {})
    for a, (axis, fit) in enumerate(summary["fit"].items()):
        cells = [f"k{2 * a + i} {_with_sd(k[f'k{2 * a + i}'])}" for i in (1, 2)]
        valid = _percent(tried[axis]) if tried else "-"
        lines.append(f"  {axis:<8}  {cells[0]:>22}  {cells[1]:>22}  {_percent(fit):>7}  {valid:>10}")
    if summary["method"] == "output-error":
        lines += ["", f"delay: {1e3 * summary['delay_s']:.1f} ± {1e3 * summary['delay_sd_s']:.1f} ms"]
    else:
        lines += ["", "delay: taken for 0; this method finds none"]
    loud = [
        axis
        for axis, left in summary["residuals"].items()
        if abs(left["correlation"]) > _COLOURED and not summary["fit"][axis] > _GOOD
    ]
    if loud:
        known = summary["method"] == "output-error"
        lines.append(
            f"note: what is left on {', '.join(loud)} is no white noise (gusts, or a model too simple); "
            + ("deviations allow for it, but trust them less" if known else "do not trust the deviations")
        )
    if summary["method"] == "output-error" and summary["delay_s"] > (longest := _longest_delay()):
        lines.append(
            f"note: the delay is longer than the {longest:g} s that the path follower flies with; it will "
            "refuse this vehicle: mend the link"
        )
    if summary["vehicle_model"] is not None:
        lines.append(f"vehicle model: {summary['vehicle_model']}")
    return "\n".join([*lines, *(f"figure: {file}" for file in summary["figures"])])


def _longest_delay() -> float:
    from noctule.control.cascade.settings import CascadeSettings

    return CascadeSettings().longest_delay_s


def _with_sd(value: Mapping[str, float]) -> str:
    return f"{value['estimate']:.4f} ± {value['sd']:.2g}"


def _percent(share: float) -> str:
    return "-" if share != share else f"{100.0 * share:.1f} %"
