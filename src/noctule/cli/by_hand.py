"""`noctule teach --keyboard` and `--keys`: a path that a person flies, or flew."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from noctule.flight.teach_by_hand import Pressed, Status
    from noctule.flight.teach_video import Taken


def taught_by_hand(
    out: Path, mission: str, seed: int | None, keys: Path | None, automatic: bool, preview: bool
) -> tuple[tuple[Taken, ...], bool]:
    """Teach by the keys of a script, or of this terminal; return the images, and whether Ctrl-C ended it.

    Raises NoTerminalError, KeyScriptError, PathExistsError, TeachInputError, OutFolderError.
    """
    from noctule.cli.options import out_folder
    from noctule.flight.mission import load_mission
    from noctule.flight.teach_by_hand import Ending, teach_by_hand

    loaded = load_mission(mission)
    number = loaded.flight.seed if seed is None else seed
    with _scripted(keys) if keys is not None else _typed(preview) as (pressed, show):
        out_folder(out, out.name)  # a person who has flown is not to hear that it cannot be written
        try:
            taken, ending = teach_by_hand(loaded, number, out, pressed, show, automatic)
        except BaseException:
            if not any(out.iterdir()):
                out.rmdir()
            raise
    return taken, ending is Ending.INTERRUPTED


@contextmanager
def _typed(preview: bool) -> Iterator[tuple[Pressed, Callable[[Status], None]]]:
    from noctule.cli.keyboard import open_keyboard

    with open_keyboard(preview) as keyboard:
        yield keyboard.pressed, keyboard.show


@contextmanager
def _scripted(keys: Path) -> Iterator[tuple[Pressed, Callable[[Status], None]]]:
    from noctule.flight.interrupt import interruptible
    from noctule.flight.key_script import INTERRUPT, KeyScript, read_key_script

    script = KeyScript(read_key_script(keys))
    told = sys.stderr.isatty()

    def show(status: Status) -> None:
        if told and round(status.stamp * 30) % 15 == 0:
            print(f"\rflying {status.stamp:.1f} s ...", end="", file=sys.stderr, flush=True)

    with interruptible() as stop:
        try:
            yield lambda stamp: [INTERRUPT] if stop.is_set() else script(stamp), show
        finally:
            if told:
                print("\r\x1b[K", end="", file=sys.stderr)
