"""A progress bar for work that may take long: silent unless it does."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sized
from typing import TypeVar

from rich.console import Console
from rich.progress import Progress

T = TypeVar("T")
PATIENCE = 2.0  # [s]


def with_progress(
    items: Iterable[T], label: str, patience: float = PATIENCE, total: int | None = None
) -> Iterator[T]:
    """Yield the items; after `patience` [s] show a bar, if standard error is a terminal.

    `total` is how many there will be, where they do not tell; None moves the bar to and fro.
    """
    if total is None and isinstance(items, Sized):
        total = len(items)
    start = time.monotonic()
    console = Console(stderr=True)
    bar: Progress | None = None
    task = None
    try:
        for i, item in enumerate(items):
            if bar is None and console.is_terminal and time.monotonic() - start > patience:
                bar = Progress(console=console, transient=True)
                bar.start()
                task = bar.add_task(label, total=total)
            if bar is not None and task is not None:
                bar.update(task, completed=i)
            yield item
    finally:
        if bar is not None:
            bar.stop()
