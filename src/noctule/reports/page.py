"""The page: one HTML file that needs nothing else, no script, no font, no network."""

from __future__ import annotations

import base64
import html
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import resources
from string import Template

from noctule.reports.summary import Row


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure of a report: its file, its words and its PNG; without PNG, why it is left out."""

    name: str  # of the file, without ".png"
    title: str
    caption: str
    png: bytes | None
    missing: str = ""  # why there is no PNG
    photograph: bool = False  # keeps its colours on a dark page


def escape(text: object) -> str:
    """Return the text with everything that HTML would read as markup made harmless."""
    return html.escape(str(text), quote=True)


def note(text: str) -> str:
    """Return a highlighted line."""
    return f'<p class="note" role="note">{escape(text)}</p>'


def remark(text: str) -> str:
    """Return a quiet line between the sections."""
    return f'<p class="remark">{escape(text)}</p>'


def badge(outcome: str) -> str:
    """Return the outcome as a coloured word."""
    mood = "good" if outcome in ("reached", "completed") else "bad" if outcome else ""
    return f'<span class="badge {mood}">{escape(outcome.replace("_", " ") or "no outcome")}</span>'


def tiles(figures: Iterable[tuple[str, str]]) -> str:
    """Return the few figures that matter most, large: (value, what it is)."""
    inside = "\n".join(
        f'<div class="tile"><b>{escape(value)}</b><span>{escape(words)}</span></div>'
        for value, words in figures
    )
    return f'<div class="tiles">\n{inside}\n</div>'


def rows_table(rows: Sequence[Row]) -> str:
    """Return a two-column table: what it is, what was found."""
    cells = [(escape(row.label), escape(row.value)) for row in rows]
    lines = "\n".join(f'<tr><th scope="row">{a}</th><td class="number">{b}</td></tr>' for a, b in cells)
    return f"<table>\n{lines}\n</table>"


def section(title: str, inside: str, caption: str = "") -> str:
    """Return a card; `inside` is HTML already."""
    words = f"<p>{escape(caption)}</p>\n" if caption else ""
    return f"<section>\n<h2>{escape(title)}</h2>\n{words}{inside}\n</section>"


def drawing(figure: Drawing) -> str:
    """Return a card with the figure inside the page itself, or with the reason why it is left out."""
    if figure.png is None:
        return section(figure.title, f"<p>{escape(figure.missing)}</p>")
    width, height = png_size(figure.png)
    data = base64.b64encode(figure.png).decode("ascii")
    kind = "photo" if figure.photograph else "plot"
    image = (
        f'<img class="{kind}" width="{width}" height="{height}" alt="{escape(figure.title)}. '
        f'{escape(figure.caption)}" src="data:image/png;base64,{data}">'
    )
    return section(figure.title, image, figure.caption)


def png_size(png: bytes) -> tuple[int, int]:
    """Return width and height [px] as a PNG's header says."""
    width, height = struct.unpack(">II", png[16:24])
    return width, height


def page(title: str, eyebrow: str, heading: str, words: str, body: Iterable[str], footer: str) -> str:
    """Return the whole page; `heading` and `body` are HTML already, the rest is escaped here."""
    template = Template(resources.files("noctule.reports").joinpath("page.html").read_text(encoding="utf-8"))
    return template.substitute(
        title=escape(title),
        eyebrow=escape(eyebrow),
        heading=heading,
        words=escape(words),
        body="\n".join(body),
        footer=escape(footer),
    )
