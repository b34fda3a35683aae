"""A terminal as a keyboard to fly by: raw input in real time, and what the person sees.

Linux and macOS (termios). However it is left, the terminal is as it was before.
"""

from __future__ import annotations

import os
import select
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING

from noctule.cli.preview import WIDEST, below_picture, half_blocks, one_line
from noctule.errors import NoctuleError
from noctule.flight.interrupt import interruptible
from noctule.flight.key_script import FINISH, INTERRUPT, KEYS, LEAVE

if TYPE_CHECKING:
    from noctule.flight.teach_by_hand import Status

_EVERY = 0.1  # [s] of flight between two previews
_TOO_LATE = 0.5  # [s]: a flight that is behind by more does not catch up in a rush
_BELOW = 4  # lines that are not the picture's
_OPEN, _SHUT = "\x1b[?1049h\x1b[?25l\x1b[2J\x1b[H", "\x1b[?25h\x1b[?1049l"
_ENDS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


class NoTerminalError(NoctuleError):
    """No terminal to read keys from."""


class KeyReader:
    """Bytes of a terminal as keys. The escape that begins a sequence, as an arrow sends it, is no esc key."""

    def __init__(self) -> None:
        self._sequence = ""  # what has come of one

    def feed(self, data: bytes) -> list[str]:
        """Return the keys in what was read; sequences and what stands for no key are left out."""
        return [key for byte in data if (key := self._key(byte)) in KEYS]

    def lone_escape(self) -> list[str]:
        """Return the esc key where nothing followed an escape; call it when nothing came for a while."""
        held, self._sequence = self._sequence, ""
        return [LEAVE] if held == "\x1b" else []

    def _key(self, byte: int) -> str:
        char = chr(byte)
        if not self._sequence:
            if char == "\x1b":
                self._sequence = char
                return ""
            return FINISH if char == "\r" else char.lower()
        if self._sequence == "\x1b":
            self._sequence = char if char in "[O" else ""
            return LEAVE if char == "\x1b" else ""  # two escapes: the person means it
        if self._sequence == "O" or 0x40 <= byte <= 0x7E:
            self._sequence = ""
        return ""


class Keyboard:
    """Keys from a terminal in real time, and the status onto one. `stop` set is as good as Ctrl-C."""

    def __init__(
        self,
        keys: int,
        screen: int | None,
        preview: bool,
        stop: threading.Event,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._keys, self._screen, self._preview, self._stop, self._now = keys, screen, preview, stop, now
        self._reader = KeyReader()
        self._origin: float | None = None  # [s] of the clock at flight time 0
        self._next = 0.0  # [s] of flight, of the next preview
        self._size = (0, 0)
        self._gone = False  # the terminal was closed

    def pressed(self, stamp: float) -> list[str]:
        """Wait until `stamp` [s] of flight and return the keys that came meanwhile."""
        now = self._now()
        if self._origin is None or now - self._origin - stamp > _TOO_LATE:
            self._origin = now - stamp
        keys: list[str] = []
        came = False
        while not self._gone:
            ready, _, _ = select.select([self._keys], [], [], max(0.0, self._origin + stamp - self._now()))
            if not ready:
                break
            try:
                data = os.read(self._keys, 1024)
            except OSError:
                data = b""
            came, self._gone = True, not data
            keys += self._reader.feed(data)
        if not came:
            keys += self._reader.lone_escape()
        if self._stop.is_set() or self._gone:
            keys.append(INTERRUPT)
        return keys

    def show(self, status: Status) -> None:
        """Draw the status, ten times a second."""
        if self._screen is None or status.stamp < self._next:
            return
        self._next = status.stamp + _EVERY - 0.01
        columns, lines = _size(self._screen)
        if not self._preview:
            self.write(f"\r\x1b[K{one_line(status, columns - 1)}")
            return
        clear, self._size = "\x1b[2J" if self._size != (columns, lines) else "", (columns, lines)
        picture: list[str] = []
        if status.picture is not None and lines > _BELOW:
            picture = half_blocks(status.picture.pixels, min(columns, WIDEST), lines - _BELOW)
        text = "\x1b[K\n".join([*picture, *below_picture(status, columns - 1)])
        self.write(f"{clear}\x1b[H{text}\x1b[J")

    def write(self, text: str) -> None:
        """Write to the screen; one that was closed is no error, but ends the flight."""
        data = text.encode("utf-8")
        while data and self._screen is not None and not self._gone:
            try:
                data = data[os.write(self._screen, data) :]
            except OSError:
                self._gone = True


def _size(screen: int) -> tuple[int, int]:
    try:
        columns, lines = os.get_terminal_size(screen)
    except OSError:
        columns, lines = 0, 0
    # Some terminals do not tell theirs; then COLUMNS and LINES hold, or 80 x 24.
    fallback = shutil.get_terminal_size()
    return columns or fallback.columns, lines or fallback.lines


@contextmanager
def open_keyboard(preview: bool) -> Iterator[Keyboard]:
    """Give the terminal on standard input as a keyboard, drawing on standard error or output.

    Ctrl-C, and a terminal that is closed, leave the flight instead of tearing it apart.

    Raises NoTerminalError.
    """
    keys = _terminal()
    screen = next((s.fileno() for s in (sys.stderr, sys.stdout) if s.isatty()), None)
    preview = preview and os.environ.get("TERM", "dumb") != "dumb"
    with interruptible() as stop, _ended_by(_ENDS, stop), _raw(keys):
        keyboard = Keyboard(keys, screen, preview, stop)
        keyboard.write((_OPEN if preview else "") + "the room is being built, this takes some seconds ...")
        try:
            yield keyboard
        finally:
            keyboard.write(_SHUT if preview else "\n")


def _terminal() -> int:
    """Return the file descriptor of the terminal on standard input; raises NoTerminalError."""
    instead = "use --waypoints FILE or --keys FILE"
    if find_spec("termios") is None:
        raise NoTerminalError(
            f"teach: --keyboard needs a Linux or macOS terminal, this is neither; {instead}"
        )
    with suppress(OSError, ValueError, AttributeError):  # closed, or replaced
        if os.isatty(number := sys.stdin.fileno()):
            return number
    raise NoTerminalError(
        f"teach: --keyboard needs a terminal to read keys from, standard input is none; {instead}"
    )


@contextmanager
def _raw(keys: int) -> Iterator[None]:
    """Have keys come one by one and unseen; signals stay, but nothing stops the process or its output."""
    import termios

    before = termios.tcgetattr(keys)
    mode = termios.tcgetattr(keys)
    mode[0] &= ~termios.IXON
    mode[3] &= ~(termios.ICANON | termios.ECHO)
    off = bytes([os.fpathconf(keys, "PC_VDISABLE") & 0xFF])
    for name in ("VSUSP", "VQUIT", "VDSUSP"):
        if hasattr(termios, name):
            mode[6][getattr(termios, name)] = off
    mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
    # At once: a terminal that shows nothing any more would be waited for.
    termios.tcsetattr(keys, termios.TCSANOW, mode)
    try:
        yield
    finally:
        with suppress(termios.error):
            termios.tcflush(keys, termios.TCIFLUSH)  # what is still held down is not for the shell
            termios.tcsetattr(keys, termios.TCSANOW, before)


@contextmanager
def _ended_by(signals: tuple[signal.Signals, ...], stop: threading.Event) -> Iterator[None]:
    """Set `stop` when one of the signals comes."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in signals}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
