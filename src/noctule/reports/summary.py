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


_DIGITS = {"m": 3, "°": 2, "px": 1, "s": 1, "mm": 1, "ms": 2, "cm": 1, "m/s": 3, "rad/s": 3, "x": 1, "": 0}
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
# Of flights whose pilot knows where it is: key, label, unit, how many of it are one of the summary's.
_OF_THE_LOCATED: tuple[tuple[tuple[str, ...], str, str, float], ...] = (
    (("cross_track_p95_m",), "Distance from the path, 95th percentile", "mm", 1e3),
    (("hover_rms_m",), "Distance from the held point, root mean square", "mm", 1e3),
    (("heading_p95_deg",), "Heading error, 95th percentile", "°", 1.0),
    (("recovery_s", "mean"), "Time to come back after a push, mean", "s", 1.0),
    (("recovery_s", "max"), "Time to come back after a push, most", "s", 1.0),
    (("position_rms_m",), "Error of the fused position, root mean square", "mm", 1e3),
    (("position_p95_m",), "Error of the fused position, 95th percentile", "mm", 1e3),
    (("yaw_mean_deg",), "Error of the fused heading, mean", "°", 1.0),
    (("yaw_sd_deg",), "Error of the fused heading, standard deviation", "°", 1.0),
    (("slips",), "Times the heading was held half a turn wrong", "", 1.0),
    (("lost_s",), "Time without a trusted estimate", "s", 1.0),
)
JUDGED = frozenset(
    {"outcome", "reason", "doubt_s"}
    | {key for key, _ in _OF_THE_PATH}
    | {path[0] for path, *_ in _OF_THE_LOCATED}
)
"""What a judge may know better than the flight itself."""
_NOT_FIGURES = (
    {"outcome", "reason", "recording", "report", "seed", "law", "mission", "laps"}
    | {key for key, _ in _OF_THE_PATH}
    | {path[0] for path, *_ in _OF_THE_LOCATED}
)


def number(value: float | None, unit: str, missing: str = "not available") -> str:
    """Return `value` with its unit, or `missing` where it was not measured."""
    if value is None or not math.isfinite(value):
        return missing
    space = "" if unit in ("°", "") else " "
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
    # A pilot that knows where it is has no points to look at.
    blind = "cross_track_p95_m" in summary and summary.get("epsilon_px") is None
    shown = [row for row in _KNOWN if not (blind and row[0] == ("epsilon_px",))]
    rows = [Row(label, number(find(summary, path), unit)) for path, label, unit in shown]
    known = {path[0] for path, _, _ in _KNOWN} | _NOT_FIGURES
    rows += [
        Row(label, number(summary[key], "m")) for key, label in _OF_THE_PATH if summary.get(key) is not None
    ]
    found = ((label, find(summary, path), unit, scale) for path, label, unit, scale in _OF_THE_LOCATED)
    rows += [Row(label, number(scale * v, unit)) for label, v, unit, scale in found if v is not None]
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
    because = _because(summary)
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


def in_words_located(summary: Mapping[str, Any], recorded_s: float) -> str:
    """Return what `in_words` does, of a flight whose pilot knows where it is.

    One that came to track the points of key images was handed over, and has both told.
    """
    handed_over = math.isfinite(_finite(summary.get("epsilon_px"), math.nan))
    mean = _finite(summary.get("cross_track_mean_m"), math.nan)
    if handed_over:
        before = f" Before that it followed its path in space, {number(1e3 * mean, 'mm')} from it on average."
        return in_words(summary, recorded_s) + (before if math.isfinite(mean) else "")
    duration = number(_finite(summary.get("duration_s"), recorded_s), "s")
    because = _because(summary)
    if summary.get("outcome") in ("reached", "completed"):
        near = f", {number(1e3 * mean, 'mm')} from it on average" if math.isfinite(mean) else ""
        return f"The drone flew its path to the end in {duration}{near}."
    lost = f"The drone did not know where it was and landed after {duration}{because}"
    sentences = {
        "lost": lost,
        "landed_lost": lost,
        "contact": f"The drone touched something after {duration}{because}",
        "fence": f"The drone left its fence within {duration}{because}",
        "diverged": f"The drone went astray within {duration}{because}",
        "stuck": f"The drone had not flown its path to the end after {duration}{because}",
    }
    return sentences.get(str(summary.get("outcome"))) or in_words(summary, recorded_s)


def _because(summary: Mapping[str, Any]) -> str:
    """Return the reason and the end of the sentence; a reason may end in a mark of its own."""
    reason = str(summary.get("reason") or "").rstrip(".")
    return (f": {reason}" if reason else "") + ("" if reason.endswith(("?", "!")) else ".")


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
