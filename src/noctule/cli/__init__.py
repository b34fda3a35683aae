"""The commands a person types. Everything heavy is imported inside the commands, so that help is quick."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import NoReturn


def main(tokens: Sequence[str] | None = None) -> NoReturn:
    """Run the command line `tokens` (those of the process when None) and exit with its code."""
    from noctule.cli.app import run

    sys.exit(run(sys.argv[1:] if tokens is None else tokens))
