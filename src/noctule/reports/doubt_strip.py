"""How far the pilot trusted its estimate, when the camera saw the drone, and why not, in plain words."""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Sequence

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
_MOST = 8  # lines told
_ORDER = tuple(Doubt)  # the mildest first
_NUMBER = re.compile(r"\d+(\.\d+)?")


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
    """Return a line for every stretch of doubt in the order of time: when, what the pilot did, and why.

    Why is the reason that held longest in the stretch. Of too many stretches the mildest and, of those, the
    shortest are left out and counted, never a landing nor the last hover.
    """
    doubts = np.array(located.doubts, dtype=object)
    found = [
        (doubt, a, b)
        for doubt in Doubt if doubt is not Doubt.SURE
        for a, b in spans(located.times, doubts == str(doubt))
    ]  # fmt: skip
    told = found
    if len(found) > _MOST:
        last_hover = max((a for doubt, a, _ in found if doubt is Doubt.HOVER), default=None)

        def weight(stretch: tuple[Doubt, float, float]) -> tuple[bool, bool, int, float]:
            doubt, a, b = stretch
            is_last = doubt is Doubt.HOVER and a == last_hover
            return doubt is Doubt.LAND, is_last, _ORDER.index(doubt), b - a

        told = sorted(found, key=weight, reverse=True)[: _MOST - 1]
    lines = [_in_words(located, *stretch) for stretch in sorted(told, key=lambda stretch: stretch[1])]
    if len(told) < len(found):
        n = len(found) - len(told)
        lines.append(f"left out: the {n} mildest and shortest of {len(found)} stretches of doubt")
    return lines


def _in_words(located: LocatedLog, doubt: Doubt, a: float, b: float) -> str:
    inside = np.flatnonzero((located.times >= a) & (located.times <= b))
    reason = main_reason([located.doubt_reasons[i] for i in inside])
    begin, end = f"{a:.1f}", f"{b:.1f}"
    when = f"at {begin} s" if begin == end else f"{begin} to {end} s"
    return f"{when}, {_WORDS[doubt]}" + (f": {reason}" if reason else "")


def main_reason(reasons: Sequence[str]) -> str:
    """Return the reason that was given most often, in its last wording, the first of equals; or empty.

    Reasons that differ in their numbers only ("for 1.2 s", "for 1.3 s") are one.
    """
    given = [(_NUMBER.sub("#", reason), reason) for reason in reasons if reason]
    most = Counter(kind for kind, _ in given).most_common(1)
    return [reason for kind, reason in given if kind == most[0][0]][-1] if most else ""


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
