"""Flies one seed or many, writes the reports, tells the figures: what `fly` and `experiment` share."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from noctule.cli.options import out_folder, read_seeds
from noctule.cli.show import as_json, campaign_text, flight_text
from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.flight.mission import Mission

RESULTS = "campaign.json"
"""What a campaign leaves in its folder, for `noctule report` to lay beside another's."""


class SeedAndSeedsError(NoctuleError):
    """Both one seed and a range of seeds."""


def _as_it_is(summary: Mapping[str, Any]) -> dict[str, Any]:
    return dict(summary)


@dataclass(frozen=True, slots=True)
class Judging:
    """How the flights of a kind are judged and told; as it is, those of visual paths."""

    judged: Callable[[Mapping[str, Any]], dict[str, Any]] = _as_it_is  # of a summary; goes to other processes
    good: str = "reached"  # the outcome of a flight that did what it was to do
    pooled: Callable[[Sequence[dict[str, Any]]], dict[str, Any]] | None = None
    flight_text: Callable[[Mapping[str, Any]], str] = flight_text
    campaign_text: Callable[[Mapping[str, Any]], str] = campaign_text
    by_law: bool = True  # campaigns stand side by side by their law, else by their name


@dataclass(frozen=True, slots=True)
class Asked:
    """What the command line says about the flights."""

    name: str  # of the mission or experiment
    make_mission: Callable[[int], Mission]  # by seed; goes to other processes
    seed: int
    seeds: str | None
    out: Path | None
    report: bool
    json: bool
    judging: Judging = field(default_factory=Judging)


def fly_asked(asked: Asked) -> int:
    """Fly, tell, and return the exit code: 0 if and only if every flight had the good outcome."""
    return _fly_one(asked) if asked.seeds is None else _fly_many(asked, read_seeds(asked.seeds))


def _fly_one(asked: Asked) -> int:
    mission = asked.make_mission(asked.seed)
    folder = out_folder(asked.out, asked.name)

    from noctule.flight import Aborted, RecordingError, fly_mission

    try:
        summary: dict[str, Any] = dict(fly_mission(mission, asked.seed, folder).summary)
    except (Aborted, RecordingError) as error:  # something was flown, so this is no bad input
        print(f"noctule: {error} (in {folder})", file=sys.stderr)
        if asked.json:
            print(as_json({"outcome": "aborted", **_what_was_written(folder), "error": str(error)}))
        return 130 if isinstance(error, Aborted) else 1
    judging = asked.judging
    summary = finished(judging.judged, asked.report, summary)
    print(as_json(summary) if asked.json else judging.flight_text(summary))
    return 0 if summary["outcome"] == judging.good else 1


def _what_was_written(folder: Path) -> dict[str, Any]:
    from noctule.flight.mission_flight import SUMMARY

    try:
        written: dict[str, Any] = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError):  # a full disk may have taken it
        return {}
    return written


def _fly_many(asked: Asked, seeds: range) -> int:
    first = asked.make_mission(seeds[0])  # so that a mistake in it is told once, before anything flies
    folder = out_folder(asked.out, asked.name)

    from noctule.campaign import fly_seeds

    judging = asked.judging
    results = fly_seeds(
        asked.make_mission,
        seeds,
        folder,
        progress=sys.stderr.isatty(),
        finish=partial(finished, judging.judged, asked.report),
        together=judging.pooled,
        good=judging.good,
    )
    kind = first.law if judging.by_law else asked.name
    (folder / RESULTS).write_text(as_json({kind: results}) + "\n", encoding="utf-8")
    if asked.report:
        from noctule.reports import write_campaign_report

        laws: dict[str, Any] = {kind: results}
        results["summary"]["report"] = _or_say_why(lambda: write_campaign_report(laws, folder / "report"))
    print(as_json(results) if asked.json else judging.campaign_text(results))
    return 0 if all(run["outcome"] == judging.good for run in results["runs"]) else 1


def finished(
    judged: Callable[[Mapping[str, Any]], dict[str, Any]], report: bool, summary: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the summary judged, with the report of the flight written if it is wanted."""
    told = judged(summary)
    return with_report(told) if report else {**told, "report": None}


def with_report(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Write the report of a flight's recording and return the summary with its path.

    A report that cannot be written costs the report, not the flight's figures.
    """
    from noctule.flight.mission_flight import note_report
    from noctule.reports import write_report

    recording = Path(summary["recording"])
    report = _or_say_why(lambda: write_report(recording, judged=summary))
    note_report(recording.parent, report)
    return {**summary, "report": report}


def _or_say_why(write: Callable[[], Path]) -> str | None:
    try:
        return str(write())
    except NoctuleError as error:
        print(f"noctule: {error}", file=sys.stderr)
        return None


def one_seed(seed: int | None, seeds: str | None, otherwise: int) -> int:
    """Return the seed of a single flight; raises SeedAndSeedsError when a range is given as well."""
    if seed is not None and seeds is not None:
        raise SeedAndSeedsError(
            f"--seed {seed} and --seeds {seeds} are both given, expected one; leave one out"
        )
    return otherwise if seed is None else seed
