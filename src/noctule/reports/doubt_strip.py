"""How far the pilot trusted its estimate, when the camera saw the drone, and why not, in plain words."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from noctule.messages import Doubt
from noctule.reports.flight_log import FlightLog
from noctule.reports.located_log import LocatedLog, spans
from noctule.reports.located_marks import mark_stops_and_pushes
from noctule.reports.style import FORWARD, INK, MUTED, UP, WIDTH_IN, new_figure

_COLOURS = {
    "": "#d1d5db", Doubt.SURE: UP, Doubt.FLY_ON: "#56B4E9", Doubt.SLOW: "#F0C419", Doubt.HOVER: "#E07B00",
    Doubt.LAND: "#C1121F",
}  # fmt: skip
_WORDS = {
    "": "not located yet", Doubt.SURE: "sure", Doubt.FLY_ON: "flies on by what remains",
    Doubt.SLOW: "flies slowly", Doubt.HOVER: "hovers", Doubt.LAND: "lands",
}  # fmt: skip
_UNSEEN = "#374151"
_MOST = 8  # reasons told


def doubt_figure(log: FlightLog) -> Figure | None:
    """Return the strip of doubt, the strip of what the camera saw, and the reasons in words."""
    located = log.located
    if located is None:
        return None
    told = doubts_in_words(located) + unseen_in_words(located)
    lines = [line for text in told for line in textwrap.wrap(text, 112, subsequent_indent="   ")]
    words_in = 0.19 * max(len(lines), 1) + 0.1
    figure = new_figure(WIDTH_IN, 2.2 + words_in)
    doubt, camera, words = figure.subplots(3, 1, height_ratios=(0.75, 0.55, words_in))
    camera.sharex(doubt)
    _draw_doubt(doubt, located)
    _draw_camera(camera, located)
    end = log.span[1] if log.span[1] > log.span[0] else log.span[0] + 1.0
    doubt.set_xlim(log.span[0], end)
    doubt.tick_params(labelbottom=False)
    camera.set_xlabel("time [s]")
    mark_stops_and_pushes([doubt, camera], located)
    handles, labels = doubt.get_legend_handles_labels()
    more, named = camera.get_legend_handles_labels()
    figure.legend(handles + more, labels + named, loc="outside upper center", ncols=5, handletextpad=0.6)
    words.set_axis_off()
    text = "\n".join(lines) if lines else "It was sure of its estimate all the time."
    words.text(0.0, 1.0, text, transform=words.transAxes, va="top", fontsize=9.0, color=INK, linespacing=1.4)
    return figure


def _draw_doubt(axis: Axes, located: LocatedLog) -> None:
    doubts = np.array(located.doubts, dtype=object)
    for doubt, colour in _COLOURS.items():
        stretches = spans(located.times, doubts == str(doubt))
        _draw_spans(axis, located, stretches, colour, _WORDS[doubt])
    axis.set_ylabel("the pilot", rotation=0, ha="right", va="center")
    _bare(axis)


def _draw_camera(axis: Axes, located: LocatedLog) -> None:
    # Between two frames what the first one showed holds.
    last = np.maximum.accumulate(np.where(located.framed, np.arange(len(located.times)), -1))
    shown = located.seen[last] & (last >= 0)
    _draw_spans(axis, located, spans(located.times, shown), FORWARD, "seen by the camera")
    _draw_spans(axis, located, spans(located.times, ~shown & (last >= 0)), _UNSEEN, "not seen")
    axis.set_ylabel("the camera", rotation=0, ha="right", va="center")
    _bare(axis)


def _draw_spans(
    axis: Axes, located: LocatedLog, stretches: list[tuple[float, float]], colour: str, words: str
) -> None:
    tick = float(np.median(np.diff(located.times))) if len(located.times) > 1 else 0.0
    for a, b in stretches:
        axis.axvspan(a, b + tick, color=colour, lw=0, alpha=0.85)
    if stretches:
        axis.plot([], [], "s", color=colour, ms=7, ls="", label=words)


def _bare(axis: Axes) -> None:
    axis.set_ylim(0.0, 1.0)
    axis.set_yticks([])
    axis.grid(visible=False)
    axis.spines["left"].set_visible(False)
    axis.tick_params(colors=MUTED)


def doubts_in_words(located: LocatedLog) -> list[str]:
    """Return a line for every stretch of doubt: when, what the pilot did, and the last reason it gave."""
    doubts = np.array(located.doubts, dtype=object)
    found: list[tuple[float, str]] = []
    for doubt in Doubt:
        for a, b in spans(located.times, doubts == str(doubt)) if doubt is not Doubt.SURE else []:
            inside = np.flatnonzero((located.times >= a) & (located.times <= b))
            reasons = [located.doubt_reasons[i] for i in inside if located.doubt_reasons[i]]
            because = f": {reasons[-1]}" if reasons else ""
            found.append((a, f"{a:.1f} to {b:.1f} s, {_WORDS[doubt]}{because}"))
    lines = [text for _, text in sorted(found)]
    if len(lines) > _MOST:
        lines = [*lines[: _MOST - 1], f"and {len(lines) - _MOST + 1} more stretches of doubt"]
    return lines


def unseen_in_words(located: LocatedLog) -> list[str]:
    """Return a line that says how many frames showed no drone, by reason, the commonest first."""
    blind = np.flatnonzero(located.framed & ~located.seen)
    if not blind.size:
        return []
    counts: dict[str, int] = {}
    for i in blind.tolist():
        name = located.unseen_reasons[i].split(":", 1)[0] or "not found yet"
        counts[name] = counts.get(name, 0) + 1
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    told = ", ".join(f"{name} {n}" for name, n in ordered)
    return [f"not seen in {len(blind)} of {int(located.framed.sum())} frames: {told}"]
