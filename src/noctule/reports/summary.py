"""The figures of a flight in words: the rows of the table, and one sentence that says how it ended."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the table: what it is and what was measured, with its unit."""

    label: str
    value: str


_DIGITS = {"m": 3, "°": 2, "px": 1, "s": 1, "ms": 2, "cm": 1, "m/s": 3, "rad/s": 3, "x": 1}
# Key of the summary, or path of keys, then label and unit: the order of the table.
_KNOWN: tuple[tuple[tuple[str, ...], str, str], ...] = (
    (("duration_s",), "Duration, from the first tick in hover", "s"),
    (("position_error_m",), "Position error at the end", "m"),
    (("yaw_error_deg",), "Heading error at the end", "°"),
    (("epsilon_px",), "Mean distance of the points at the end", "px"),
    (("min_clearance_m",), "Least clearance, surface to surface", "m"),
    (("max_command_step", "linear"), "Largest command step per tick, linear", "m/s"),
    (("max_command_step", "angular"), "Largest command step per tick, angular", "rad/s"),
    (("tick_ms", "median"), "Time of a tick, median", "ms"),
    (("tick_ms", "p95"), "Time of a tick, 95th percentile", "ms"),
    (("realtime_factor",), "Flight time per wall time", "x"),
)
# Of flights whose path somebody knows.
_OF_THE_PATH = (
    ("cross_track_max_m", "Largest distance from the path"),
    ("cross_track_mean_m", "Mean distance from the path"),
)
_NOT_FIGURES = {"outcome", "reason", "recording", "report", "seed", "law", "mission", "laps"} | {
    key for key, _ in _OF_THE_PATH
}


def number(value: float | None, unit: str, missing: str = "not available") -> str:
    """Return `value` with its unit, or `missing` where it was not measured."""
    if value is None or not math.isfinite(value):
        return missing
    space = "" if unit == "°" else " "
    return f"{value:.{_DIGITS.get(unit, 3)}f}{space}{unit}"


def find(summary: Mapping[str, Any], path: tuple[str, ...]) -> Any:
    """Return the entry of a nested summary at `path`, None where there is none."""
    entry: Any = summary
    for step in path:
        if not isinstance(entry, Mapping):
            return None
        entry = entry.get(step)
    return entry


def flight_rows(summary: Mapping[str, Any]) -> list[Row]:
    """Return the table of a flight: the figures that every flight reports, then whatever else it holds."""
    rows = [Row(label, number(find(summary, path), unit)) for path, label, unit in _KNOWN]
    known = {path[0] for path, _, _ in _KNOWN} | _NOT_FIGURES
    rows += [
        Row(label, number(summary[key], "m")) for key, label in _OF_THE_PATH if summary.get(key) is not None
    ]
    rows += [Row(key.replace("_", " "), _plain(value)) for key, value in summary.items() if key not in known]
    laps = summary.get("laps") or ()
    # Of a single lap all is said above.
    rows += [Row(f"Lap {k + 1}", _lap(lap)) for k, lap in enumerate(laps) if len(laps) > 1]
    return rows


def _lap(lap: Mapping[str, Any]) -> str:
    most, mean = (number(lap.get(f"cross_track_{k}_m"), "m") for k in ("max", "mean"))
    return f"{number(lap.get('duration_s'), 's')}, {mean} from the path on average, {most} at most"


def _plain(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}" if math.isfinite(value) else "not available"
    if isinstance(value, Mapping):
        return ", ".join(f"{k.replace('_', ' ')} {_plain(v)}" for k, v in value.items())
    return "not available" if value is None else str(value)


def in_words(summary: Mapping[str, Any], recorded_s: float) -> str:
    """Return one sentence on how the flight ended; `recorded_s` [s] is the length of the recording."""
    outcome = summary.get("outcome")
    duration = number(_finite(summary.get("duration_s"), recorded_s), "s")
    reason = str(summary.get("reason") or "").rstrip(".")
    because = f": {reason}." if reason else "."
    if outcome == "reached":
        return f"The drone reached the last image after {duration}{_how_near(summary)}."
    sentences = {
        "collided": f"The drone touched something after {duration}{because}",
        "stuck": f"The drone did not get to the last image and gave up after {duration}{because}",
        "lost": f"The drone no longer recognised its surroundings after {duration}{because}",
        "aborted": f"The flight was ended early, after {duration}{because}",
    }
    unknown = f"The recording ends after {recorded_s:.1f} s, and no outcome was written to it."
    unknown = f"The recording ends after {recorded_s:.1f} s, and no outcome was written to it."
    return sentences.get(str(outcome), unknown)


def _finite(value: Any, instead: float) -> float:
    return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else instead


def _how_near(summary: Mapping[str, Any]) -> str:
    error, clearance = summary.get("position_error_m"), summary.get("min_clearance_m")
    text = ""
    if error is not None and math.isfinite(error):
        text += f", {number(100.0 * error, 'cm')} from where that was taken"
    if clearance is not None and math.isfinite(clearance):
        text += f", and never came nearer than {number(clearance, 'm')} to anything"
    return text
