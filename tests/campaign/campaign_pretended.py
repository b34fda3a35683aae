"""Flights that are not flown, as workers call them; a module of its own so that workers can import it."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from types import SimpleNamespace

from noctule.campaign.worker import ONE_THREAD, failed_run
from noctule.errors import NoctuleError


def reached(make_mission, seed, out, finish):
    """Reach, and say which mission, folder, process and thread limits there were."""
    run = {
        **failed_run(seed, ""),
        "outcome": "reached",
        "position_error_m": seed / 100,
        "mission": make_mission(seed),
        "out": str(out),
        "pid": os.getpid(),
        "threads": {name: os.environ.get(name) for name in ONE_THREAD},
    }
    return finish(run) if finish is not None else run


def dies_on_3(make_mission, seed, out, finish):
    """Take the whole process down on seed 3, every time."""
    if seed == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return reached(make_mission, seed, out, finish)


def dies_once_on_2(make_mission, seed, out, finish):
    """Take the whole process down on seed 2, the first time only."""
    mark = out.parent / "died"
    if seed == 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return reached(make_mission, seed, out, finish)


def named(seed):
    """Make something in the place of a mission."""
    return f"mission {seed}"


def with_page(run):
    """Complete a run, as the writer of reports does."""
    return {**run, "report": f"page {run['seed']}"}


class RoomTooSmallError(NoctuleError):
    """A mistake of the person's in one seed's mission."""


def too_small(seed):
    """Refuse to make a mission."""
    raise RoomTooSmallError(f"room of seed {seed}: too small")


def has_a_bug(seed):
    """Raise what nobody foresaw."""
    raise ZeroDivisionError("a bug")


def fly_mission(mission, seed, out, progress):
    """In the place of the real one."""
    return SimpleNamespace(
        summary={**failed_run(seed, ""), "outcome": "reached", "recording": str(Path(out))}
    )
