"""What a person reads after a command, and what a program reads with --json."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from noctule.reports.summary import find, flight_rows, in_words, in_words_located, number

_COLUMNS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    ("duration", ("duration_s",), "s"),
    ("position error", ("position_error_m",), "m"),
    ("heading error", ("yaw_error_deg",), "°"),
    ("clearance", ("min_clearance_m",), "m"),
)


def as_json(value: Any) -> str:
    """Return one line of JSON; what is not a number (no truth, nothing measured) is null."""
    return json.dumps(_plain(value), allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int) else str(value)


def flight_text(summary: Mapping[str, Any]) -> str:
    """Return the outcome of one flight, its figures, and where its recording and report are."""
    # Only a pilot that knows where it is can be lost for some time.
    words = in_words_located if "lost_s" in summary else in_words
    lines = [f"outcome: {summary['outcome']}", words(summary, 0.0), ""]
    rows = flight_rows(summary)
    width = max(len(row.label) for row in rows)
    lines += [f"  {row.label:<{width}}  {row.value}" for row in rows]
    lines.append("")
    lines += [f"{key}: {summary[key]}" for key in ("recording", "report") if summary.get(key)]
    return "\n".join(lines)


def campaign_text(results: Mapping[str, Any]) -> str:
    """Return a line per seed, the pooled figures, and the reasons of the flights that did not reach."""
    head = f"{'seed':>6}  {'outcome':<9}" + "".join(f"  {title:>14}" for title, _, _ in _COLUMNS)
    lines = [head]
    for run in results["runs"]:
        figures = "".join(f"  {number(find(run, path), unit):>14}" for _, path, unit in _COLUMNS)
        lines.append(f"{run['seed']:>6}  {run['outcome']:<9}{figures}")
    pooled = results["summary"]
    figures = "".join(f"  {number(find(pooled, path), unit):>14}" for _, path, unit in _COLUMNS)
    lines.append(f"{'all':>6}  {'median':<9}{figures}")
    reached = sum(run["outcome"] == "reached" for run in results["runs"])
    lines += ["", f"outcome: {reached} of {len(results['runs'])} reached"]
    lines += [
        f"seed {run['seed']}: {run['outcome']}: {run.get('reason') or 'no reason given'}"
        for run in results["runs"]
        if run["outcome"] != "reached"
    ]
    if results.get("report"):
        lines.append(f"report: {results['report']}")
    return "\n".join(lines)
