"""The report of one flight: a page and its figures, made from the recording alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from noctule.errors import NoctuleError
from noctule.reports import page as html
from noctule.reports.figure_plans import plans_of
from noctule.reports.flight_log import FlightLog
from noctule.reports.landing import landing_in_words
from noctule.reports.loading import load_flight_log
from noctule.reports.page import Drawing
from noctule.reports.progress import with_progress
from noctule.reports.style import encode_png, house_style
from noctule.reports.summary import JUDGED, Row, flight_rows, in_words, in_words_located, number

PAGE = "report.html"


class ReportWriteError(NoctuleError):
    """The folder of the report cannot be written."""


def draw_figures(log: FlightLog) -> list[Drawing]:
    """Return every figure of a flight as PNG, in the order of the page; what cannot be drawn says why."""
    drawings = []
    for plan in with_progress(plans_of(log), "drawing"):
        with house_style():
            figure = plan.draw(log)
            png = None if figure is None else encode_png(figure)
        drawings.append(Drawing(plan.name, plan.title, plan.caption, png, plan.missing, plan.photograph))
    return drawings


def flight_page(log: FlightLog, drawings: list[Drawing]) -> str:
    """Return the HTML page of a flight."""
    summary, about = log.summary, log.about
    mission = about.get("mission") or "A flight"
    outcome = str(summary.get("outcome") or "")
    parts = [html.note(text) for text in log.notes]
    parts.append(html.tiles(_tiles(summary)))
    parts += [html.remark(text) for text in [_clock(log)] if text]
    parts += [html.drawing(d) for d in drawings]
    tables = html.rows_table(flight_rows(summary)), html.rows_table([Row(k, v) for k, v in about.items()])
    inside = '<div class="columns">\n<div class="scroll">{}</div>\n<div class="scroll">{}</div>\n</div>'
    parts.append(html.section("Figures and versions", inside.format(*tables)))
    if log.mission_text:
        text = html.escape(log.mission_text)
        text = f"<details><summary>Show the mission file</summary><pre>{text}</pre></details>"
        parts.append(
            html.section("Mission", text, "The file as it was given; law and seed above are what was flown.")
        )
    tell = in_words_located if log.located is not None else in_words
    words = " ".join(filter(None, (tell(summary, log.span[1] - log.span[0]), landing_in_words(log))))
    return html.page(
        title=f"{mission}: {outcome or 'no outcome'} - Noctule",
        eyebrow=_eyebrow(about),
        heading=html.escape(mission) + html.badge(outcome),
        words=words,
        body=parts,
        footer="Made by Noctule from the recording alone. World axes: x along the room, y left, z up.",
    )


def _eyebrow(about: dict[str, str]) -> str:
    parts = ["Noctule flight"]
    parts += [f"{name} {about[name]}" for name in ("law", "seed") if about.get(name)]
    return " \u00b7 ".join(parts)


def _clock(log: FlightLog) -> str:
    if not log.clock_start:
        return ""
    return (
        f"Times count from the pilot's first tick, {log.clock_start:.2f} s on the flight's clock, which "
        f"missions use: take {log.clock_start:.2f} s off the times of faults and pushes in the mission."
    )


def _tiles(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the figures that a reader looks for first; what was not measured gets no tile."""
    asked = (
        ("duration_s", "s", "duration", 1.0),
        ("cross_track_mean_m", "mm", "from the path, mean", 1e3),
        ("hover_rms_m", "mm", "from the held point, rms", 1e3),
        ("position_rms_m", "mm", "error of the estimate, rms", 1e3),
        ("heading_p95_deg", "°", "heading error, 95 %", 1.0),
        ("position_error_m", "m", "position error", 1.0),
        ("yaw_error_deg", "°", "heading error", 1.0),
        ("min_clearance_m", "m", "least clearance", 1.0),
        ("epsilon_px", "px", "points at the end", 1.0),
    )
    known = [row for row in asked if summary.get(row[0]) is not None]
    # Of flights by pictures the end says most, of others the way there.
    located = summary.get("cross_track_p95_m") is not None
    least = ("position_error_m", "yaw_error_deg") if located else ("cross_track_mean_m",)
    known = [row for row in known if row[0] not in least]
    return [(number(scale * summary[k], unit), words) for k, unit, words, scale in known]


def write_flight(log: FlightLog, out: Path) -> Path:
    """Write the page and its figures of `log` into the folder `out` and return the page's path.

    Raises
    ------
    ReportWriteError
        When the folder cannot be made or written.
    """
    drawings = draw_figures(log)
    files = {f"{d.name}.png": d.png for d in drawings if d.png is not None}
    files[PAGE] = flight_page(log, drawings).encode("utf-8")
    return write_files(files, out, PAGE)


def write_files(files: dict[str, bytes], out: Path, first: str) -> Path:
    """Write `files` (name -> bytes) into the folder `out` and return the path of `first`.

    Raises ReportWriteError.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, data in files.items():
            (out / name).write_bytes(data)
    except OSError as error:
        raise ReportWriteError(
            f"report {out}: cannot be written ({error.strerror}), expected a folder with room for a few MB; "
            "name another with --out"
        ) from error
    return out / first


def write_report(recording: Path, out: Path | None = None, judged: Mapping[str, Any] | None = None) -> Path:
    """Write the report of a recording into the folder `out` and return the path of its page.

    Without `out` the folder stands beside the recording: `flight.mcap` gives `flight-report`. A recording
    cut short by a crash gives a report of what is there, with a note. `judged` holds what somebody who knows
    more says of the outcome and the way; the page tells that instead of what the flight says of itself.

    Raises
    ------
    NoctuleError
        When the recording is missing, empty or not a recording (see `load_flight_log`), or ReportWriteError.
    """
    recording = Path(recording)
    folder = recording.with_name(f"{recording.stem}-report") if out is None else Path(out)
    log = load_flight_log(recording)
    if judged is not None:
        known = {name: value for name, value in judged.items() if name in JUDGED}
        log = replace(log, summary={**log.summary, **known})
    return write_flight(log, folder)
