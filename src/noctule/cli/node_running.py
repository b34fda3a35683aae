"""Running a node: what it shows while it runs, what it leaves behind, what it says at the end."""

from __future__ import annotations

import json
import math
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from noctule.cli.node_options import NodeOptionsError, Prepared
from noctule.cli.options import out_folder

if TYPE_CHECKING:
    from noctule.flight.network.drill import Drill
    from noctule.flight.network.member import Member
    from noctule.flight.network.process import Reading, Watcher
    from noctule.flight.network.sensing import Expectation

_SHOW_EVERY, _SAY_EVERY = 0.2, 1.0  # [s], on a terminal and elsewhere
_AFTER = 0.5  # [s], a drill goes on until the last of its messages came

Readings = Callable[[threading.Event, "Expectation"], Iterable["Reading"]]
"""What a sensor says until it is stopped; it may ask where the vehicle is expected."""


def run_prepared(
    node: Prepared,
    readings: Readings | None = None,
    out: Path | None = None,
    record: bool = False,
    seconds: float | None = None,
    as_json: bool = False,
) -> int:
    """Run a node to its end; 0 when it took part at all: it shared or assimilated something."""
    from noctule.flight.interrupt import interruptible
    from noctule.flight.network.drill import Judge
    from noctule.flight.network.estimate_log import EstimateLog
    from noctule.flight.network.process import expectation, run_node
    from noctule.flight.network.wire import Wire

    if seconds is not None and not 0.0 < seconds <= 86_400.0:
        raise NodeOptionsError(f"node: --seconds is {seconds:g}, expected above 0, up to 86400")
    until = None if seconds is None else time.time() + seconds
    judge = None
    if node.drill is not None:
        judge = Judge(node.drill)
        end = node.begin + float(node.drill.flight.arrivals[-1]) + _AFTER
        until = end if until is None else min(until, end)
        readings = _drilled(node.drill, node.role)
    status = Status(node.begin, sys.stderr if as_json else sys.stdout)
    watchers: list[Watcher] = [status.show] if judge is None else [judge, status.show]
    summary: dict[str, Any] = {}
    with ExitStack() as open_, interruptible() as stopped, _ended_by_service(stopped):
        wire = open_.enter_context(Wire(node.name, node.endpoints))
        if record:
            log = open_.enter_context(EstimateLog(out_folder(out, "fusion")))
            watchers.append(log)
            summary = {"table": log.table, "recording": log.recording}
            if log.others:
                status.say(f"table {log.table}: what earlier runs left in this folder is kept")
        try:
            run_node(
                node.member,
                wire,
                None if readings is None else readings(stopped, partial(expectation, wire.inbox)),
                watchers,
                stopped,
                until,
                senses=node.senses,
            )
        finally:
            stopped.set()
            status.end()
    found = {**node.member.summary(), "half_turns": node.senses.turns, "overruns": wire.overruns, **summary}
    if judge is not None:
        found["drill"] = judge.summary()
    print(json.dumps(found, default=str, allow_nan=False) if as_json else in_words(found))
    return 0 if node.member.shared + node.member.assimilated else 1


@contextmanager
def _ended_by_service(stopped: threading.Event) -> Iterator[None]:
    """Let what a service manager sends end a node as Ctrl-C does, with its files and its summary."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, lambda number, frame: stopped.set())
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _drilled(drill: Drill, role: str) -> Readings:
    def readings(stop: threading.Event, expected: Expectation) -> Iterable[Reading]:
        yield from drill.readings(role, stop)
        stop.wait()  # a drill ends for all at the same time, whatever was the last that each measured

    return readings


class Status:
    """The live line: rewritten on a terminal, one a second elsewhere."""

    def __init__(self, begin: float, out: IO[str]) -> None:
        self._out = out
        self._live = self._out.isatty()
        self._begin = begin
        self._shown = -math.inf

    def show(self, now: float, member: Member) -> None:
        """Show what a member knows, if it is time."""
        from noctule.flight.network.estimate_log import status_line

        if now - self._shown < (_SHOW_EVERY if self._live else _SAY_EVERY):
            return
        self._shown = now
        line = status_line(now, member, self._begin)
        if self._live:
            width = shutil.get_terminal_size().columns
            print(f"\r\x1b[K{line[: width - 1]}", end="", file=self._out, flush=True)
        else:
            print(line, file=self._out, flush=True)

    def say(self, line: str) -> None:
        """Show a line that stays."""
        print(line, file=self._out, flush=True)

    def end(self) -> None:
        """Leave the live line."""
        if self._live:
            print(file=self._out)


def in_words(found: dict[str, Any]) -> str:
    """Return the summary as a person reads it."""
    lines = [
        f"node {found['node']}: measured {found['measured']}, shared {found['shared']}, "
        f"assimilated {found['assimilated']}, joined again {found['rejoined']} times"
    ]
    if found["measures_nothing"]:
        lines.append(f"nothing measured at the end: {found['measures_nothing']}")
    for title, key in (("refused", "refused"), ("dropped", "dropped"), ("no message", "malformed")):
        lines += [f"{title}: {count} {reason}" for reason, count in found[key].items()]
    lines += [f"the last of them: {reason}" for reason in found["why_malformed"].values()]
    if found["namesakes"]:
        lines.append(f"another node called itself {found['node']}: {found['namesakes']} messages left out")
    if found["half_turns"]:
        lines.append(f"half turns: the heading was found to be the other one {found['half_turns']} times")
    if found["overruns"]:
        lines.append(f"too many messages: {found['overruns']} were lost; is this machine too slow?")
    if "drill" in found:
        lines.append(f"drill: NEES per state {found['drill']['nees_per_state']}, 1 when it knows its errors")
    lines += [f"{key}: {found[key]}" for key in ("table", "recording") if key in found]
    return "\n".join(lines)
