"""A node as the network sees it: what it says, what it makes of what it hears, and how it joins.

Whenever two nodes meet, each asks the other for all that it knows, and takes it over if that is more than it
knows itself. So a node that was started again, that hung, or that was cut off is told what it missed, and
nobody has to decide who is right. Of its own, what the other has not heard of yet is put in again; ids keep
anything from counting twice. A node that has just begun, or that hung, measures nothing until it was told or
JOINING is over: what it would linearise about a bad guess would mislead the others. Nor does it before it is
known that no other node has its name.
"""

from __future__ import annotations

import math
import struct
from collections import Counter, deque

import numpy as np

from noctule.errors import NoctuleError
from noctule.estimation.contributions import Contribution, from_bytes, to_bytes
from noctule.estimation.delayed import DEFAULTS, DelayedFilter, FilterSettings
from noctule.estimation.events import Input, Key, Snapshot
from noctule.estimation.filter_state import StateEstimate
from noctule.estimation.framing import MessageError
from noctule.estimation.measurements import Measurement
from noctule.estimation.network import Node
from noctule.estimation.node_messages import (
    inputs_from_bytes,
    inputs_to_bytes,
    snapshot_from_bytes,
    snapshot_to_bytes,
)
from noctule.estimation.vehicle_model import VehicleModel
from noctule.flight.network.roll_call import Beat, RollCall, beat_from_bytes
from noctule.flight.network.wire import Kind
from noctule.localization.tracker import Prediction

JOINING = 1.0  # [s], at most
HUNG = 0.5  # [s] between two turns of the loop, and the node has missed too much
_REPEATED = 1.0  # [s] of commands in each message
_COMMANDS_HEARD = 256
_LOOKED_FOR = np.array([0.5, 0.5, 0.5, 0.6])  # [m], [rad], deviations of a prediction at most
_KNOWS_MORE = 0.1  # of log det P, between estimates of the same time
_NO_MESSAGE = (NoctuleError, ValueError, ArithmeticError, struct.error, np.linalg.LinAlgError)


class Member:
    """A node with its counts; it has no clock and no wire."""

    def __init__(
        self,
        name: str,
        start: StateEstimate,
        model: VehicleModel | None = None,
        settings: FilterSettings = DEFAULTS,
    ) -> None:
        self.name = name
        self.node = Node(name, start, model, settings)
        self.roll = RollCall()
        self.joining_until = self._joins = -math.inf
        self.told_after: float | None = None  # [s], from when it last joined until it was told
        self.measured = self.shared = self.assimilated = self.rejoined = 0
        self.reason = ""  # why it measures nothing
        self.named = True  # nobody else has its name, as far as it knows
        self.doubled = False  # another node of its name is there
        self.namesakes = 0  # messages of such a node
        self.malformed: Counter[str] = Counter()  # by kind
        self.why_malformed: dict[str, str] = {}  # the newest reason, by kind
        self._left_out: Counter[str] = Counter()  # by filters that it had before it joined again
        self._sent: deque[Input] = deque()
        self._heard: deque[Key] = deque(maxlen=_COMMANDS_HEARD)

    def joining(self, now: float) -> bool:
        """Return whether it still waits to be told what the others know, or whether its name is free."""
        return now < self.joining_until or not self.named

    def join(self, now: float) -> None:
        """Note that at `now` [s] its process begins, or goes on after it hung."""
        self._joins = now
        self.joining_until = now + JOINING

    def known(self, stamp: float) -> StateEstimate:
        """Return what it knows at `stamp` [s], or at the oldest that it remembers: never raises."""
        return self.node.estimate(max(stamp, self.node.filter.oldest))

    def prediction(self, stamp: float) -> Prediction | None:
        """Return where to look in the frame exposed at `stamp` [s]; None when it may be anywhere."""
        known = self.known(stamp)
        if (known.sd[:4] > _LOOKED_FOR).any():
            return None
        return Prediction(known.pose, known.P[:4, :4])

    def beat(self, now: float) -> Beat:
        """Return its heartbeat."""
        return Beat(now, self.shared, self.reason)

    def measure(self, measurement: Measurement, now: float) -> bytes | None:
        """Use its own measurement and return what to share; None when there is nothing to."""
        self.measured += 1
        self.reason = ""
        if self.joining(now):
            self.reason = "it joins"
            return None
        contribution = self.node.measure(measurement, now)
        return None if contribution is None else self._message(contribution)

    def add(self, own: Contribution, now: float) -> bytes | None:
        """Use a contribution that is no measurement and return what to share; None when it is of no use."""
        return self._message(own) if self.node.insert(own, now) else None

    def _message(self, own: Contribution) -> bytes:
        self.shared += 1
        return to_bytes(own)

    def command(self, sent: Input, now: float) -> bytes:
        """Note a command that was sent to the vehicle; return the message of the last second's."""
        self.node.receive(sent, now)
        self._sent.append(sent)
        while self._sent[0].stamp < sent.stamp - _REPEATED:
            self._sent.popleft()
        return inputs_to_bytes(tuple(self._sent))

    def snapshot(self) -> bytes:
        """Return the message of all that it knows."""
        return snapshot_to_bytes(self.node.filter.snapshot())

    def take(self, kind: Kind, peer: str, data: bytes, now: float) -> bool:
        """Make use of a message; return whether it was of any.

        What is none is counted, and so is what another node of its own name says; it never raises.
        """
        if peer == self.name:
            self.namesakes += 1
            return False
        try:
            return self._take(kind, peer, data, now)
        except _NO_MESSAGE as error:
            self.malformed[str(kind)] += 1
            self.why_malformed[str(kind)] = f"{peer}: {error}"
            return False

    def _take(self, kind: Kind, peer: str, data: bytes, now: float) -> bool:
        used = False
        if kind is Kind.CONTRIBUTION:
            used = self.node.receive(from_bytes(data), now)
        elif kind is Kind.COMMANDS:
            used = sum(self._told(sent, now) for sent in inputs_from_bytes(data)) > 0
        elif kind is Kind.BEAT:
            self.roll.beat(peer, beat_from_bytes(data), now)
        elif kind is Kind.SNAPSHOT:
            return self._learn(snapshot_from_bytes(data), now)
        self.assimilated += used
        return used

    def _told(self, sent: Input, now: float) -> bool:
        """Note a command that another node sent; each comes many times."""
        key = self.node.filter.key(sent)
        if key in self._heard:
            return False
        self._heard.append(key)
        return self.node.receive(sent, now)

    def _learn(self, snapshot: Snapshot, now: float) -> bool:
        """Take over what another node knows, if that is more."""
        own = self.node.filter
        stamps = [snapshot.at, snapshot.key.stamp, *(event.stamp for event in snapshot.events)]
        latest = max(now, own.newest) + own.settings.ahead  # its own beginning may still be to come
        if snapshot.x.size != own.estimate().x.size or max(stamps) > latest:
            raise MessageError(
                f"snapshot: {snapshot.x.size} numbers until {max(stamps) - now:+.3f} s from now; expected "
                f"{own.estimate().x.size} and none from the future: do the clocks of all machines agree?"
            )
        theirs = DelayedFilter.of_snapshot(snapshot, own.model, own.settings)
        at = max(now, own.newest, theirs.newest)
        before, after = own.estimate(at), theirs.estimate(at)
        if not np.isfinite(after.x).all() or _spread(after) > _spread(before) - _KNOWS_MORE:
            return False
        other = Node(self.name, after, own.model, own.settings)
        other.filter = theirs
        self.node.rejoin(other)
        for event in own.snapshot().events:
            self.node.filter.insert(event, now)
        self.node.filter.dropped = Counter(own.dropped)  # what was put in again does not count
        self._left_out += own.refusals - self.node.filter.refusals
        if self.joining(now):
            self.joining_until, self.told_after = now, now - self._joins
        self.rejoined += 1
        return True

    def summary(self) -> dict[str, object]:
        """Return its counts."""
        return {
            "node": self.name,
            "measured": self.measured,
            "measures_nothing": self.reason,
            "shared": self.shared,
            "assimilated": self.assimilated,
            "rejoined": self.rejoined,
            "told_after_s": self.told_after,
            "refused": dict(self.node.refusals + self.node.filter.refusals + self._left_out),
            "dropped": dict(self.node.filter.dropped),
            "malformed": dict(self.malformed),
            "why_malformed": dict(self.why_malformed),
            "namesakes": self.namesakes,
            "there": list(self.roll.there),
            "losses": self.roll.losses,
        }


def _spread(estimate: StateEstimate) -> float:
    sign, logarithm = np.linalg.slogdet(estimate.P)
    return float(logarithm) if sign > 0.0 else np.inf
