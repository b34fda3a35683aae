"""The report of many flights: a table over seeds, law beside law, and how the figures spread."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from noctule.errors import NoctuleError
from noctule.reports import page as html
from noctule.reports.campaign_columns import GOOD, LOCATED, Column, Kind, kind_of
from noctule.reports.flight_report import write_files
from noctule.reports.page import Drawing
from noctule.reports.style import FORWARD, LEFT, UP, WARN, WIDTH_IN, YAW, encode_png, house_style, new_figure

PAGE = "campaign.html"
_LAW_LOOK = ((FORWARD, "o"), (LEFT, "s"), (UP, "^"), (YAW, "D"))


class CampaignResultsError(NoctuleError):
    """The results of a campaign are not in the form that the commands write."""


def by_law(results: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return {law: {"runs": [...], "summary": {...}}} of one campaign or of several, `noctule` first.

    Takes `{"runs": ..., "summary": ...}` as `--seeds --json` prints it, or such results by law.

    Raises
    ------
    CampaignResultsError
        When there is neither.
    """
    if "runs" in results:
        runs = results["runs"] or [{}]
        laws: dict[str, Any] = {str(runs[0].get("law") or results.get("law") or "noctule"): results}
    else:
        laws = {str(k): v for k, v in results.items() if isinstance(v, Mapping) and "runs" in v}
    if not any(part["runs"] for part in laws.values()):
        found = ", ".join(sorted(map(str, results))) or "nothing"
        raise CampaignResultsError(
            f"campaign results: no runs, found {found}; expected 'runs' and 'summary', or these by law, as "
            "`--seeds 0:10 --json` prints them"
        )
    return dict(sorted(laws.items(), key=lambda item: (item[0] != "noctule", item[0])))


def write_campaign_report(results: Mapping[str, Any], out: Path) -> Path:
    """Write the report of many flights into the folder `out` and return the path of its page.

    `results` is what `by_law` takes. Raises CampaignResultsError, ReportWriteError.
    """
    laws = by_law(results)
    kind = _kind(laws)
    asked = ", dashed is what is asked for" if any(c.asked is not None for c in kind.panels) else ""
    with house_style():
        spread = encode_png(spread_figure(laws))
    figure = Drawing(
        "spread", "Spread over the seeds",
        f"Every mark is one flight, filled where it {kind.marked} and hollow where it did not. The bar is "
        f"the median of all flights that measured it{asked}.", spread,
    )  # fmt: skip
    text = campaign_page(laws, figure, Path(out), str(results.get("title") or ""))
    return write_files({"spread.png": spread, PAGE: text.encode("utf-8")}, Path(out), PAGE)


def campaign_page(laws: Mapping[str, Mapping[str, Any]], figure: Drawing, out: Path, title: str = "") -> str:
    """Return the HTML page; links to the reports of single flights are relative to the folder `out`."""
    first = next(iter(laws.values()))["runs"]
    mission = title or str((first[0] if first else {}).get("mission") or "Campaign")
    parts = [html.section("Pooled over all seeds", _pooled_table(laws), _kind(laws).pooled)]
    parts.append(html.drawing(figure))
    for law, part in laws.items():
        parts.append(html.section(f"{_named(law, part)}: every flight", _runs_table(part["runs"], out)))
    flights = sum(len(part["runs"]) for part in laws.values())
    return html.page(
        title=f"{mission}: {flights} flights - Noctule",
        eyebrow="Noctule campaign",
        heading=html.escape(mission),
        words=" ".join(_in_words(law, part["runs"]) for law, part in laws.items()),
        body=parts,
        footer="Made by Noctule from the summaries of the flights.",
    )


def _in_words(law: str, runs: Sequence[Mapping[str, Any]]) -> str:
    reached = sum(run.get("outcome") in GOOD for run in runs)
    others = sorted({str(run.get("outcome")) for run in runs} - set(GOOD))
    counts = [
        f"{sum(str(run.get('outcome')) == other for run in runs)} {other.replace('_', ' ')}"
        for other in others
    ]
    told = f"{_named(law, {'runs': runs})}: {reached} of {len(runs)} flights {kind_of(runs).done}"
    return ", ".join([told, *counts]) + "."


def _kind(laws: Mapping[str, Mapping[str, Any]]) -> Kind:
    return kind_of(run for part in laws.values() for run in part["runs"])


def _named(law: str, part: Mapping[str, Any]) -> str:
    # Of located flights it is the experiment's name.
    return law if kind_of(part["runs"]) is LOCATED else f"Law {law}"


def _pooled_table(laws: Mapping[str, Mapping[str, Any]]) -> str:
    head = "".join(f'<th scope="col" class="number">{html.escape(law)}</th>' for law in laws)
    lines = [f'<thead><tr><th scope="col"></th>{head}</tr></thead>', "<tbody>"]
    summaries = [part.get("summary") or {} for part in laws.values()]
    lines.append(_line("flights", [str(len(part["runs"])) for part in laws.values()]))
    lines.append(_line("outcomes", [_rates(s.get("outcome")) for s in summaries], "words"))
    lines += [_line(c.label, [c.told(s) for s in summaries]) for c in _kind(laws).columns]
    return f'<div class="scroll"><table class="pooled">\n{"".join(lines)}</tbody></table></div>'


def _rates(outcome: Any) -> str:
    if isinstance(outcome, Mapping):
        return ", ".join(
            f"{name.replace('_', ' ')} {100.0 * float(rate):.0f} %" for name, rate in outcome.items() if rate
        )
    return "not available" if outcome is None else str(outcome)


def _line(label: str, cells: Sequence[str], kind: str = "number") -> str:
    inside = "".join(f'<td class="{kind}">{html.escape(cell)}</td>' for cell in cells)
    return f'<tr><th scope="row">{html.escape(label)}</th>{inside}</tr>\n'


def _runs_table(runs: Sequence[Mapping[str, Any]], out: Path) -> str:
    columns = kind_of(runs).columns
    head = "".join(
        f'<th scope="col" class="number">{html.escape(label)}</th>' for label in (c.label for c in columns)
    )
    lines = [f'<thead><tr><th scope="col">seed</th><th scope="col">outcome</th>{head}</tr></thead>\n<tbody>']
    for run in runs:
        values = [c.told(run, missing="\u2013") for c in columns]
        cells = "".join(f'<td class="number">{html.escape(value)}</td>' for value in values)
        outcome = html.badge(str(run.get("outcome") or ""))
        lines.append(f'<tr><th scope="row">{_link(run, out)}</th><td>{outcome}</td>{cells}</tr>\n')
    return f'<div class="scroll"><table class="runs">\n{"".join(lines)}</tbody></table></div>'


def _link(run: Mapping[str, Any], out: Path) -> str:
    """Return the seed, linked to the flight's own report when that lies in the campaign's folder."""
    seed = html.escape(run.get("seed", "?"))
    report = run.get("report")
    around = out.resolve().parent
    if not report or not Path(str(report)).resolve().is_relative_to(around):
        return seed
    relative = Path(os.path.relpath(Path(str(report)).resolve(), out.resolve()))
    return f'<a href="{html.escape(relative.as_posix())}">{seed}</a>'


def spread_figure(laws: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Return one panel per figure of merit, one column of marks per law."""
    panels = _kind(laws).panels
    rows = -(-len(panels) // 4)
    figure = new_figure(WIDTH_IN, 3.2 * rows)
    axes = figure.subplots(rows, len(panels) // rows, squeeze=False).ravel()
    for axis, column in zip(axes, panels, strict=True):
        for i, part in enumerate(laws.values()):
            _marks(axis, i, part["runs"], column)
        if column.asked is not None:
            axis.axhline(column.asked, color=WARN, lw=1.1, ls="--")
        axis.set_xticks(range(len(laws)), list(laws))
        axis.set_xlim(-0.6, len(laws) - 0.4)
        low, high = axis.get_ylim()
        axis.set_ylim(min(0.0, low), high + 0.06 * (high - min(0.0, low)))
        unit = "deg" if column.unit == "°" else column.unit
        axis.set(ylabel=f"[{unit}]", title=column.label.capitalize())
        axis.grid(visible=False, axis="x")
        if column.path == ("min_clearance_m",):
            axis.axhline(0.0, color=WARN, lw=1.2)
    return figure


def _marks(axis: Axes, i: int, runs: Sequence[Mapping[str, Any]], column: Column) -> None:
    colour, marker = _LAW_LOOK[i % len(_LAW_LOOK)]
    values = [(column.value(run), run.get("outcome") in GOOD) for run in runs]
    measured = [(v, ok) for v, ok in values if v is not None and math.isfinite(v)]
    if not measured:
        return
    x = i + np.linspace(-0.22, 0.22, len(measured)) if len(measured) > 1 else np.array([float(i)])
    for place, (value, ok) in zip(x, measured, strict=True):
        axis.plot(place, value, marker, ms=6, mfc=colour if ok else "white", mec=colour, mew=1.3, alpha=0.9)
    median = float(np.median([v for v, _ in measured]))
    axis.plot([i - 0.34, i + 0.34], [median, median], color=colour, lw=2.2, alpha=0.6, zorder=1)
