"""The loop of a node's process: one thread measures, one owns the node and does everything else."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from noctule.estimation.events import Input
from noctule.estimation.measurements import Measurement
from noctule.flight.network.endpoints import is_name
from noctule.flight.network.member import HUNG, Member
from noctule.flight.network.roll_call import BEAT_EVERY, beat_to_bytes
from noctule.flight.network.wire import Kind, Received, Wire

TICK = 1.0 / 30.0  # [s]
_BEHIND = 64  # messages in a row before the loop looks at the time again


@dataclass(frozen=True, slots=True)
class Nothing:
    """A sensor looked and measured nothing."""

    reason: str


Reading = Measurement | Input | Nothing
Watcher = Callable[[float, Member], None]
"""Looks at a member every TICK, at a time [s]: shows it, records it, judges it."""


@dataclass(frozen=True, slots=True)
class _Ended:
    """The sensor's thread is at its end, or failed."""

    error: BaseException | None = None


def run_node(
    member: Member,
    wire: Wire,
    readings: Iterable[Reading] | None,
    watchers: Sequence[Watcher],
    stop: threading.Event,
    until: float | None = None,
    clock: Callable[[], float] = time.time,
) -> None:
    """Run a node until `stop`, `until` [s] on its clock, or the end of its readings.

    `wire` is open. Raises what the readings raise; the other nodes go on.
    """
    if readings is not None:
        arguments = (readings, wire.inbox, stop)
        threading.Thread(target=_feed, args=arguments, name="noctule-sensor", daemon=True).start()
    turn = beat_at = tick_at = clock()
    member.join(turn)
    wire.ask()
    while not stop.is_set():
        now = clock()
        if now - turn > HUNG:
            member.join(now)
            wire.ask()
        turn = now
        if until is not None and now >= until:
            return
        if now >= beat_at:
            wire.share(Kind.BEAT, beat_to_bytes(member.beat(now)))
            beat_at = max(beat_at + BEAT_EVERY, now)
        if now >= tick_at:
            member.roll.check(now)
            for watch in watchers:
                watch(now, member)
            tick_at = max(tick_at + TICK, now)
        for _ in range(_BEHIND):
            try:
                item = wire.inbox.get(timeout=max(0.0, min(beat_at, tick_at) - clock()))
            except queue.Empty:
                break
            if isinstance(item, _Ended):
                if item.error is not None:
                    raise item.error
                return
            _handle(item, member, wire, clock())


def _feed(readings: Iterable[Reading], inbox: queue.Queue[object], stop: threading.Event) -> None:
    error: BaseException | None = None
    try:
        for reading in readings:
            if stop.is_set():
                return
            inbox.put(reading)
    except BaseException as raised:
        error = raised
    inbox.put(_Ended(error))


def _handle(item: Reading | Received, member: Member, wire: Wire, now: float) -> None:
    if isinstance(item, Measurement):
        message = member.measure(item, now)
        if message is not None:
            wire.share(Kind.CONTRIBUTION, message)
    elif isinstance(item, Input):
        wire.share(Kind.COMMANDS, member.command(item, now))
    elif isinstance(item, Nothing):
        member.reason = item.reason
    elif item.kind is Kind.ASKED:
        wire.answer(item, member.snapshot())
    elif not is_name(item.peer):
        member.malformed["name"] += 1
    elif item.kind is Kind.ALIVE:
        member.roll.alive(item.peer, now)
        wire.ask()
    elif item.kind is Kind.GONE:
        member.roll.gone(item.peer, now)
    else:
        member.take(item.kind, item.peer, item.data, now)
