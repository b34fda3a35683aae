"""The loop of a node's process: one thread measures, one owns the node and does everything else."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field

from noctule.estimation.events import Input
from noctule.estimation.measurements import Measurement
from noctule.flight.network.endpoints import is_name
from noctule.flight.network.member import HUNG, Member
from noctule.flight.network.roll_call import BEAT_EVERY, beat_to_bytes
from noctule.flight.network.senses import Sensed, Senses
from noctule.flight.network.wire import LEASE_MS, Kind, Received, Wire
from noctule.localization.tracker import Prediction

TICK = 1.0 / 30.0  # [s]
_ANSWERED = 0.05  # [s], a frame does not wait longer for its prediction
_MET = 0.5  # [s], the nodes that are there have been met by then, and one of the same name is known
_NAMED = 2e-3 * LEASE_MS  # [s], what was killed and has the same name is forgotten by then
_BEHIND = 64  # messages in a row before the loop looks at the time again


@dataclass(frozen=True, slots=True)
class Nothing:
    """A sensor looked and measured nothing."""

    reason: str


@dataclass(frozen=True, slots=True)
class Question:
    """A sensor's thread wants to know where the vehicle is expected; the node's own thread answers."""

    stamp: float  # [s], of the frame
    answer: Future[Prediction | None] = field(default_factory=Future)


Reading = Measurement | Sensed | Input | Nothing
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
    senses: Senses | None = None,
) -> None:
    """Run a node until `stop`, `until` [s] on its clock, or the end of its readings.

    It shares nothing before it has met those that are there and none of them has its name. `wire` is open.
    `senses` makes measurements of what sensors say; left out, nothing is taken off. Raises what the readings
    raise; the other nodes go on.
    """
    senses = senses or Senses(member.name)
    if readings is not None:
        arguments = (readings, wire.inbox, stop)
        threading.Thread(target=_feed, args=arguments, name="noctule-sensor", daemon=True).start()
    turn = beat_at = tick_at = begin = clock()
    member.named = False
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
        if not member.named:
            member.named = now - begin >= _MET and not wire.namesakes
        if now >= beat_at:
            if member.named:
                wire.share(Kind.BEAT, beat_to_bytes(member.beat(now)))
            beat_at = max(beat_at + BEAT_EVERY, now)
        if now >= tick_at:
            member.roll.check(now)
            member.doubled = bool(wire.namesakes or wire.younger)
            if now - begin > _NAMED:
                wire.require_own_name()
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
            _handle(item, member, wire, senses, clock())


def expectation(inbox: queue.Queue[object], stamp: float) -> Prediction | None:
    """Ask a node from its sensor's thread where to look in the frame exposed at `stamp` [s]."""
    question = Question(stamp)
    inbox.put(question)
    try:
        return question.answer.result(_ANSWERED)
    except TimeoutError:
        return None  # the node has other things to do, or has ended


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


def _handle(
    item: Reading | Question | Received, member: Member, wire: Wire, senses: Senses, now: float
) -> None:
    if isinstance(item, Measurement):
        message = member.measure(item, now)
        if message is not None:
            wire.share(Kind.CONTRIBUTION, message)
    elif isinstance(item, Sensed):
        for message in senses.take(item, member, now):
            wire.share(Kind.CONTRIBUTION, message)
    elif isinstance(item, Question):
        item.answer.set_result(member.prediction(item.stamp))
    elif isinstance(item, Input):
        message = member.command(item, now)
        if member.named:
            wire.share(Kind.COMMANDS, message)
    elif isinstance(item, Nothing):
        member.reason = item.reason
    elif item.kind is Kind.ASKED:
        if member.named:
            wire.answer(item, member.snapshot())
        else:
            wire.decline(item)
    elif not is_name(item.peer):
        member.malformed["name"] += 1
    elif item.kind is Kind.ALIVE:
        member.roll.alive(item.peer, now)
        wire.ask()
    elif item.kind is Kind.GONE:
        member.roll.gone(item.peer, now)
    else:
        member.take(item.kind, item.peer, item.data, now)
