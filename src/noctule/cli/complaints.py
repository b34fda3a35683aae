"""What is wrong with a command line, in one line that names the nearest right word."""

from __future__ import annotations

import difflib

from cyclopts import CycloptsError, UnknownOptionError, UnusedCliTokensError


def complaint(error: CycloptsError) -> str:
    """Return one line: what was wrong, the nearest name, where to read more."""
    command = " ".join(("noctule", *(error.command_chain or ())))
    return f"{_what(error)}; see `{command} --help`"


def _what(error: CycloptsError) -> str:
    if isinstance(error, UnknownOptionError):
        given = (error.token.keyword or error.token.value).split("=", 1)[0]
        names = sorted({name for argument in error.argument_collection for name in argument.names})
        near = difflib.get_close_matches(given, [*names, "--help"], n=1, cutoff=0.4)
        return f"unknown option {given}" + (f", did you mean {near[0]}?" if near else "")
    if isinstance(error, UnusedCliTokensError):
        return f"unexpected argument {(error.unused_tokens or ['?'])[0]!r}"
    said = " ".join(str(error).split())
    if not said.endswith("..."):  # of a list that was cut short
        said = said.removesuffix(".")
    return said[:1].lower() + said[1:]
