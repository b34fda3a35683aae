"""Options that several commands share, and how their values are read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, Token

from noctule.errors import NoctuleError

MOST_SEEDS = 10_000


class SeedsError(NoctuleError):
    """A range of seeds that cannot be read."""


class OutFolderError(NoctuleError):
    """A folder that cannot be written into."""


def _whole_number(_type: Any, tokens: Sequence[Token]) -> int:
    # cyclopts on its own reads 1.5 as 2.
    text = tokens[0].value
    if re.fullmatch(r"[0-9]{1,9}", text) is None:
        raise ValueError(f"{text!r} is not a seed, expected a whole number from 0 to 999999999")
    return int(text)


Seed = Annotated[int | None, Parameter(converter=_whole_number)]
Flag = Annotated[bool, Parameter(negative="")]


def read_seeds(text: str) -> range:
    """Read `A:B`, half open, as Python does: 0:10 is ten seeds, 0 to 9.

    Raises
    ------
    SeedsError
        When it is something else, empty, or longer than MOST_SEEDS.
    """
    found = re.fullmatch(r"([0-9]{1,9}):([0-9]{1,9})", text)
    if found is None:
        raise SeedsError(f"--seeds is {text!r}, expected A:B with whole numbers; 0:10 is the seeds 0 to 9")
    seeds = range(int(found[1]), int(found[2]))
    if not 1 <= len(seeds) <= MOST_SEEDS:
        raise SeedsError(
            f"--seeds is {text!r}, which is {len(seeds)} seeds, expected 1 to {MOST_SEEDS}; "
            "0:10 is the seeds 0 to 9"
        )
    return seeds


def out_folder(out: Path | None, name: str) -> Path:
    """Make the folder to write into and return it: `out`, or a new one under flights/ named after now.

    Raises
    ------
    OutFolderError
        When it cannot be made or written into.
    """
    folder = out if out is not None else Path("flights") / f"{name}-{datetime.now():%Y%m%d-%H%M%S}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OutFolderError(
            f"folder {folder}: cannot be written ({error.strerror}), expected a folder for recordings; "
            "give another with --out"
        ) from None
    return folder
