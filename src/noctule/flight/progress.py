"""A progress line on standard error, for flights that last."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.live import Live
from rich.progress import BarColumn, Progress, TaskID, TextColumn

_WAIT = 2.0  # [s] of wall time before anything is shown
_EVERY = 0.2  # [s]


class Show(Protocol):
    """Shows where a flight is."""

    def __call__(self, elapsed: float, text: str) -> None:
        """Tell that `elapsed` [s] of flight have passed, and what goes on."""
        ...


def _silent(elapsed: float, text: str) -> None:
    pass


@contextmanager
def teaching_progress(enabled: bool) -> Iterator[Callable[[float, str], None]]:
    """Give a function that shows how much is taught, 0 to 1, and what comes now; on a terminal only."""
    console = Console(stderr=True)
    if not (enabled and console.is_terminal):
        yield _silent
        return
    columns = (TextColumn("teaching the camera: {task.description}"), BarColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda done, text: bar.update(task, completed=done, description=text)


@contextmanager
def flight_progress(enabled: bool, limit: float) -> Iterator[Show]:
    """Give a function that shows the flight's progress to its time `limit` [s].

    Nothing is shown in the first two seconds, nor when standard error is no terminal.
    """
    console = Console(stderr=True)
    if not (enabled and console.is_terminal):
        yield _silent
        return
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.1f} s of flight, {task.fields[factor]:.1f} x real time"),
        auto_refresh=False,
    )
    task: TaskID = bar.add_task("", total=limit, factor=0.0)
    live = Live(bar, console=console, auto_refresh=False, transient=True)
    begin = shown = time.perf_counter()
    started = False

    def show(elapsed: float, text: str) -> None:
        nonlocal shown, started
        now = time.perf_counter()
        if now - begin < _WAIT or now - shown < _EVERY:
            return
        if not started:
            live.start()
            started = True
        shown = now
        bar.update(task, completed=elapsed, description=text, factor=elapsed / (now - begin))
        live.refresh()

    try:
        yield show
    finally:
        if started:
            live.stop()
