"""The report of one flight: a page and its figures, made from the recording alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from noctule.errors import NoctuleError
from noctule.reports import page as html
from noctule.reports.flight_log import FlightLog
from noctule.reports.loading import load_flight_log
from noctule.reports.page import Drawing
from noctule.reports.progress import with_progress
from noctule.reports.series import (
    clearance_figure,
    errors_figure,
    tasks_figure,
    ticks_figure,
    velocities_figure,
)
from noctule.reports.strip import strip_figure
from noctule.reports.style import encode_png, house_style
from noctule.reports.summary import Row, flight_rows, in_words, number
from noctule.reports.views import views_figure

PAGE = "report.html"
_NO_TRUTH = "There is no truth in this recording (a real drone has none), so this is left out."


class ReportWriteError(NoctuleError):
    """The folder of the report cannot be written."""


@dataclass(frozen=True, slots=True)
class _Plan:
    name: str
    title: str
    caption: str
    draw: Callable[[FlightLog], Figure | None]
    missing: str = ""
    photograph: bool = False


_PLANS = (
    _Plan(
        "camera", "What the camera saw",
        "Pictures over the flight. Red crosses are the tracked points, green circles where the key image has "
        "them; at the target they meet. Yellow boxes are columns that were seen.",
        strip_figure, "There are no pictures in this recording.", photograph=True,
    ),
    _Plan(
        "views", "Where it flew",
        "The room to scale, from above and from the side, with the true trajectory coloured by speed. Arrows "
        "are the key images, grey is furniture (in the side view it stands beside the path), columns have "
        "their own colour.",
        views_figure, _NO_TRUTH,
    ),
    _Plan(
        "errors", "Errors",
        "The mean distance of the tracked points to their references, and the servoing error, whose descent "
        "the law asks for. Each new target image starts both afresh.",
        errors_figure,
    ),
    _Plan(
        "velocities", "Velocities and activations",
        "What was sent to the drone (solid) and what the pilot asked (dashed, seen only where the supervisor "
        "bounded it), how far each task of the hierarchy was switched on, and the step of the command from "
        "tick to tick as a share of what the acceleration limit allows.",
        velocities_figure,
    ),
    _Plan(
        "tasks", "Errors of the tasks", "The norm of the error of each task of the hierarchy.",
        tasks_figure, "This recording holds no errors of tasks.",
    ),
    _Plan(
        "clearance", "Clearance",
        "From the surface of the hull to the nearest surface of a column, furniture or person, by a "
        "collision check on the true pose.",
        clearance_figure, _NO_TRUTH,
    ),
    _Plan(
        "ticks", "Time of a tick", "How long the pilot took from a picture to a command.",
        ticks_figure, "This recording holds no times of ticks.",
    ),
)  # fmt: skip


def draw_figures(log: FlightLog) -> list[Drawing]:
    """Return every figure of a flight as PNG, in the order of the page; what cannot be drawn says why."""
    drawings = []
    for plan in with_progress(_PLANS, "drawing"):
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
    words = in_words(summary, log.span[1] - log.span[0])
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


def _tiles(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the figures that a reader looks for first; what was not measured gets no tile."""
    asked = (
        ("duration_s", "s", "duration"),
        ("position_error_m", "m", "position error"),
        ("yaw_error_deg", "°", "heading error"),
        ("min_clearance_m", "m", "least clearance"),
        ("epsilon_px", "px", "points at the end"),
    )
    return [(number(summary[k], unit), words) for k, unit, words in asked if summary.get(k) is not None]


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


def write_report(recording: Path, out: Path | None = None) -> Path:
    """Write the report of a recording into the folder `out` and return the path of its page.

    Without `out` the folder stands beside the recording: `flight.mcap` gives `flight-report`. A recording
    cut short by a crash gives a report of what is there, with a note.

    Raises
    ------
    NoctuleError
        When the recording is missing, empty or not a recording (see `load_flight_log`), or ReportWriteError.
    """
    recording = Path(recording)
    folder = recording.with_name(f"{recording.stem}-report") if out is None else Path(out)
    return write_flight(load_flight_log(recording), folder)
