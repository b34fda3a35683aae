"""Key scripts: which key was pressed when, so that a flight by hand can be played again.

One press a line: `time [s]  key  [for how long it is held, s]`; `#` begins a comment. Keys are the letters of
`STICKS`, and space, x, u, enter, esc.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

from noctule.errors import NoctuleError

STICKS = {
    "w": (0, 1.0),  # forward
    "s": (0, -1.0),
    "a": (1, 1.0),  # left
    "d": (1, -1.0),
    "r": (2, 1.0),  # up
    "f": (2, -1.0),
    "q": (3, 1.0),  # turn left
    "e": (3, -1.0),
}
"""Key -> axis of the command and sign."""
TAKE, HOVER, UNDO, FINISH, LEAVE, INTERRUPT = " ", "x", "u", "\n", "\x1b", "\x03"
_NAMES = {"space": TAKE, "enter": FINISH, "esc": LEAVE}
_WORDS = {**{key: key for key in (*STICKS, HOVER, UNDO)}, **_NAMES}
KEYS = frozenset({*_WORDS.values(), INTERRUPT})
"""All that a flight by hand understands."""
REPEAT = 1.0 / 30.0  # [s], as terminals repeat a key that is held
_AFTER = 1.0  # [s] after the last press a script that does not end, ends
_LONGEST = 3600.0  # [s]
_ROUNDING = 1e-5  # [s], times are written with six digits


class KeyScriptError(NoctuleError):
    """A key script that cannot be played."""


class KeyScript:
    """Presses by flight time; at its end it presses enter, and esc where that is not enough."""

    def __init__(self, presses: Iterable[tuple[float, str]]) -> None:
        self._presses = sorted(presses, key=lambda press: press[0])
        self._next = 0
        self._end = (self._presses[-1][0] if self._presses else 0.0) + _AFTER

    def __call__(self, stamp: float) -> list[str]:
        """Return what is pressed until `stamp` [s] of flight and was not returned before."""
        begin = self._next
        while self._next < len(self._presses) and self._presses[self._next][0] <= stamp + _ROUNDING:
            self._next += 1
        if self._next == len(self._presses) and stamp + _ROUNDING >= self._end:
            return [key for _, key in self._presses[begin:]] + [FINISH, LEAVE]
        return [key for _, key in self._presses[begin : self._next]]


def read_key_script(path: Path) -> list[tuple[float, str]]:
    """Return (time [s], key) of every press in a file, in its order; raises KeyScriptError."""
    try:
        lines = path.read_text("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise KeyScriptError(
            f"key script {path}: cannot be read ({why}); expected lines of a time [s] and a key, as 1.5 w"
        ) from None
    presses: list[tuple[float, str]] = []
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].split()
        if words:
            presses += _line(words, f"key script {path}:{number}")
    if not presses:
        raise KeyScriptError(f"key script {path}: it holds no key; expected lines as 1.5 w")
    return presses


def _line(words: list[str], where: str) -> list[tuple[float, str]]:
    key = _WORDS.get(words[1]) if len(words) in (2, 3) else None
    if key is None:
        raise KeyScriptError(
            f"{where}: {' '.join(words)!r}, expected a time [s], a key ({' '.join(_WORDS)}) and perhaps for "
            "how long it is held [s]"
        )
    times = [_seconds(word, where) for word in (words[0], *words[2:])]
    held = times[1] if len(times) == 2 else 0.0
    if held and key not in STICKS:
        raise KeyScriptError(f"{where}: {words[1]} cannot be held; leave the {words[2]} out")
    return [(times[0] + i * REPEAT, key) for i in range(math.floor(held / REPEAT + _ROUNDING) + 1)]


def _seconds(word: str, where: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= _LONGEST:
        raise KeyScriptError(f"{where}: {word!r} is no time, expected 0 to {_LONGEST:g} s")
    return value


def write_key_script(path: Path, presses: Iterable[tuple[float, str]]) -> None:
    """Write presses so that `read_key_script` reads them; raises OSError."""
    names = {key: name for name, key in _NAMES.items()}
    lines = [f"{time:.6f} {names.get(key, key)}\n" for time, key in presses if key != INTERRUPT]
    path.write_text("".join(lines), "utf-8")
