"""Where in a TOML text a key stands, since no TOML reader tells."""

from __future__ import annotations

import re
from collections.abc import Sequence

Key = tuple[str | int, ...]

_BARE = r"[A-Za-z0-9_-]+"
_PART = rf"""(?:{_BARE}|"(?:[^"\\]|\\.)*"|'[^']*')"""
_DOTTED = rf"{_PART}(?:\s*\.\s*{_PART})*"
_ARRAY_TABLE = re.compile(rf"^\s*\[\[\s*({_DOTTED})\s*\]\]")
_TABLE = re.compile(rf"^\s*\[\s*({_DOTTED})\s*\]")
_ASSIGNMENT = re.compile(rf"^\s*({_DOTTED})\s*=")
_SILENT = re.compile(r'"""|\'\'\'|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'|#[^\n]*')


def _parts(dotted: str) -> Key:
    return tuple(p.strip("\"'") for p in re.findall(_PART, dotted))


def _blank(text: str, short_strings: bool) -> str:
    """Return the text with comments and long strings blanked, `short_strings` if asked; line breaks stay."""
    result, at = [], 0
    while (found := _SILENT.search(text, at)) is not None:
        end = found.end()
        if found.group() in ('"""', "'''"):
            close = text.find(found.group(), end)
            end = len(text) if close < 0 else close + 3
        inside = text[found.start() : end]
        keep = inside[0] in "\"'" and not short_strings and found.group() not in ('"""', "'''")
        result += [text[at : found.start()], inside if keep else re.sub(r"[^\n]", " ", inside)]
        at = end
    return "".join([*result, text[at:]])


def key_lines(text: str) -> dict[Key, int]:
    """Return the line, from 1, of every table header and assignment of a TOML text.

    Keys are paths such as ("room", "columns", 0, "x"). Inside inline tables and arrays nothing is listed.
    """
    lines: dict[Key, int] = {}
    counts: dict[Key, int] = {}
    table: Key = ()
    depth = 0
    # Keys may be quoted, but brackets inside strings do not count: two texts are walked side by side.
    for number, (line, bare) in enumerate(
        zip(_blank(text, False).split("\n"), _blank(text, True).split("\n"), strict=True), start=1
    ):
        if depth == 0:
            if (found := _ARRAY_TABLE.match(line)) is not None:
                name = _with_indices(_parts(found.group(1)), counts)
                counts[name] = counts.get(name, -1) + 1
                table = (*name, counts[name])
                lines.setdefault(name, number)
                lines[table] = number
                continue
            if (found := _TABLE.match(line)) is not None:
                table = _with_indices(_parts(found.group(1)), counts)
                lines.setdefault(table, number)
                continue
            if (found := _ASSIGNMENT.match(line)) is not None:
                key = (*table, *_parts(found.group(1)))
                for n in range(len(table) + 1, len(key) + 1):
                    lines.setdefault(key[:n], number)
        depth += sum(bare.count(c) for c in "[{") - sum(bare.count(c) for c in "]}")
        depth = max(depth, 0)
    return lines


def _with_indices(name: Key, counts: dict[Key, int]) -> Key:
    """Put the index of the newest element after every array of tables on the way to `name`."""
    path: Key = ()
    for i, part in enumerate(name):
        path = (*path, part)
        if path in counts and i + 1 < len(name):
            path = (*path, counts[path])
    return path


def line_of(lines: dict[Key, int], key: Sequence[str | int]) -> int | None:
    """Return the line of `key` or, where it has none, of the nearest thing around it."""
    for n in range(len(key), 0, -1):
        if (line := lines.get(tuple(key[:n]))) is not None:
            return line
    return None
