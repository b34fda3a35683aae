"""Measurements at their own time: a filter that remembers about a second and goes back when it has to.

Everything that happened is an event with a stamp: a measurement, a contribution of another node, an input
taking effect. Events are kept in order of their stamps, each with the state after it; one that comes late is
put in its place and what follows is worked out again, gates included. So the estimate depends on which events
came, not on the order in which they did: it is that of a filter that was told everything in time.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from noctule.estimation.contributions import Contribution
from noctule.estimation.events import Event, Input, Key, Snapshot
from noctule.estimation.filter_state import FilterError, StateEstimate
from noctule.estimation.gating import GateSettings, Streak, judge
from noctule.estimation.information_filter import assimilate_turned, predict_and_assimilate
from noctule.estimation.kalman_filter import correct, predict
from noctule.estimation.measurements import Measurement, linearise
from noctule.estimation.vehicle_model import ProcessNoise, VehicleModel
from noctule.geometry import Array
from noctule.settings import Settings

_NOTHING = np.zeros(4)
_Leg = tuple[Array, Array, float, Array, Array, Array, Array]
"""The arguments of `predict`."""


class FilterSettings(Settings):
    """The fusion's filter."""

    window: float = Field(1.0, gt=0.0, le=10.0, description="how late a measurement may come [s]")
    most_events: int = Field(1024, ge=16, le=100_000, description="events remembered within the window")
    input_timeout: float = Field(0.5, gt=0.0, le=10.0, description="a command is believed this long [s]")
    ahead: float = Field(0.1, ge=0.0, le=10.0, description="how far a stamp may lie in the future [s]")
    noise: ProcessNoise = ProcessNoise()
    noise_without_commands: ProcessNoise = ProcessNoise(horizontal=0.6, vertical=0.4, turn=0.6)
    gate: GateSettings | None = Field(GateSettings(), description="none lets everything in")


DEFAULTS = FilterSettings()


@dataclass(slots=True)
class _Slot:
    """An event and what the filter knew after it."""

    key: Key
    event: Event | None
    at: float  # [s], of the state: that of the last event that was used
    x: Array
    P: Array
    input: Input | None  # in force after it
    since: Mapping[str, Streak]  # of the gates, see gating.Verdict
    refused: tuple[str, ...] = ()


class DelayedFilter:
    """A filter of measurements, contributions and inputs that may come late, twice or out of order."""

    def __init__(
        self,
        start: StateEstimate,
        model: VehicleModel | None = None,
        settings: FilterSettings = DEFAULTS,
    ) -> None:
        self.settings = settings
        self.model = model
        self.dropped: Counter[str] = Counter()  # how many, by reason: see `insert`
        # Looked up for every event; in settings they are slower to find.
        self._window, self._most, self._ahead = settings.window, settings.most_events, settings.ahead
        self._known = (_NOTHING, _NOTHING) if model is None else (model.input_gains, model.drags)
        self._noise = settings.noise.densities
        self._noise_without = settings.noise_without_commands.densities
        self._settled_refusals: Counter[str] = Counter()
        self._slots = [_Slot(Key(start.stamp, -1, "", 0), None, start.stamp, start.x, start.P, None, {})]
        self._keys = [self._slots[0].key]
        self._valid = 1  # slots whose state is worked out
        # The last prediction, asked for twice by a node: before it shares and when it adds its own.
        self._advanced: tuple[Array, Input | None, float, Array, Array]
        self._advanced = (start.x, None, start.stamp, start.x, start.P)

    @property
    def newest(self) -> float:
        """The stamp of the newest event [s]."""
        return self._keys[-1].stamp

    @property
    def oldest(self) -> float:
        """The stamp before which nothing is taken any more [s]."""
        return self._keys[0].stamp

    @property
    def refusals(self) -> Counter[str]:
        """How often each source was refused and why: "depth: yaw gate"."""
        self._settle(len(self._slots))
        counts = Counter(self._settled_refusals)
        for slot in self._slots:
            counts.update(slot.refused)
        return counts

    def key(self, event: Event) -> Key:
        """Return where in time an event belongs."""
        if isinstance(event, Input):
            delay = 0.0 if self.model is None else self.model.delay
            return Key(event.stamp + delay, 0, event.source, event.sequence)
        return Key(event.stamp, 1, event.source, event.sequence)

    def insert(self, event: Event, now: float | None = None) -> bool:
        """Put an event in its place and return whether it was new and in time.

        What is not is counted in `dropped` as "duplicate", "too late", "from the future" or "other state".
        With `now` [s], the caller's time, stamps that lie ahead of it are refused: one broken clock would
        otherwise make everyone else's measurements too late. Nothing is computed before an estimate is asked.
        """
        key = self.key(event)
        if not math.isfinite(key.stamp):
            raise FilterError(f"event of {key.source!r} at {key.stamp} s; expected a finite stamp")
        if isinstance(event, Contribution) and event.i.size != self._slots[0].x.size:
            self.dropped["other state"] += 1
            return False
        if now is not None and event.stamp > now + self._ahead:
            self.dropped["from the future"] += 1
            return False
        if key <= self._keys[0]:
            self.dropped["too late"] += 1
            return False
        i = len(self._keys)
        if key <= self._keys[-1]:  # late, or twice
            i = bisect_left(self._keys, key)
            if self._keys[i] == key:
                self.dropped["duplicate"] += 1
                return False
        first = self._slots[0]
        self._slots.insert(i, _Slot(key, event, first.at, first.x, first.P, None, first.since))
        self._keys.insert(i, key)
        if i < self._valid:
            self._valid = i
        self._forget()
        return True

    def estimate(self, stamp: float | None = None) -> StateEstimate:
        """Return the estimate at `stamp` [s], predicted from the last event before; the newest without one.

        Raises FilterError when the stamp is older than what is remembered.
        """
        keys = self._keys
        at = keys[-1].stamp if stamp is None else stamp
        if at < keys[0].stamp:
            raise FilterError(
                f"estimate at {at:.3f} s asked, the filter remembers from {self.oldest:.3f} s on; "
                "ask earlier or make its window longer"
            )
        i = len(keys) if at >= keys[-1].stamp else bisect_right(keys, Key(at, 2, "", 0))
        return StateEstimate(at, *self._at(i, at))

    def before(self, event: Event) -> StateEstimate:
        """Return what is known at an event's time of all that comes before it."""
        key, keys = self.key(event), self._keys
        if key <= keys[0]:
            return StateEstimate(self._slots[0].at, self._slots[0].x, self._slots[0].P)
        i = len(keys) if key > keys[-1] else bisect_left(keys, key)
        return StateEstimate(key.stamp, *self._at(i, key.stamp))

    def snapshot(self) -> Snapshot:
        """Return the oldest state that is remembered and all events since."""
        first = self._slots[0]
        events = tuple(slot.event for slot in self._slots[1:] if slot.event is not None)
        return Snapshot(first.key, first.at, first.x, first.P, first.input, first.since, events)

    @classmethod
    def of_snapshot(
        cls, snapshot: Snapshot, model: VehicleModel | None = None, settings: FilterSettings = DEFAULTS
    ) -> DelayedFilter:
        """Return a filter that knows what the one of the snapshot knew."""
        made = cls(StateEstimate(snapshot.at, snapshot.x, snapshot.P), model, settings)
        first = made._slots[0]
        first.key, first.input, first.since = snapshot.key, snapshot.input, snapshot.since
        made._keys[0] = snapshot.key
        for event in snapshot.events:
            made.insert(event)
        return made

    def _at(self, i: int, stamp: float) -> tuple[Array, Array]:
        self._settle(i)
        return self._advance(self._slots[i - 1], stamp)

    def _advance(self, slot: _Slot, stamp: float) -> tuple[Array, Array]:
        if not self._is_advanced(slot, stamp):
            x, P = slot.x, slot.P
            if stamp > slot.at:
                x, P = predict(*self._last_leg(slot, stamp))
            self._advanced = (slot.x, slot.input, stamp, x, P)
        return self._advanced[3], self._advanced[4]

    def _is_advanced(self, slot: _Slot, stamp: float) -> bool:
        memory = self._advanced
        return memory[0] is slot.x and memory[1] is slot.input and memory[2] == stamp

    def _last_leg(self, slot: _Slot, stamp: float) -> _Leg:
        """Return what to ask `predict` for the state at `stamp` [s]; what comes before it is predicted."""
        x, P, now, sent = slot.x, slot.P, slot.at, slot.input
        if sent is not None and sent.u is not None and self.model is not None:
            end = sent.stamp + self.model.delay + self.settings.input_timeout
            gains, drags = self._known
            if stamp <= end:
                return x, P, stamp - now, sent.u, gains, drags, self._noise
            if end > now:
                x, P = predict(x, P, end - now, sent.u, gains, drags, self._noise)
                now = end
        return x, P, stamp - now, _NOTHING, _NOTHING, _NOTHING, self._noise_without

    def _settle(self, upto: int) -> None:
        """Work out the states of the first `upto` slots."""
        while self._valid < upto:
            i = self._valid
            before, slot = self._slots[i - 1], self._slots[i]
            slot.input, slot.since, slot.refused = before.input, before.since, ()
            event = slot.event
            after: tuple[Array, Array] | None
            if isinstance(event, Contribution):
                after = self._shared(before, slot, event)
            else:
                after = self._told(slot, *self._advance(before, slot.key.stamp))
            if after is None or math.isnan(after[0][0]):
                # What is refused leaves no trace, not even a prediction in two steps instead of one.
                slot.at, slot.x, slot.P = before.at, before.x, before.P
                if after is not None:
                    slot.refused = (*slot.refused, f"{slot.key.source}: unusable")
            else:
                slot.at = slot.key.stamp
                slot.x, slot.P = after
            self._valid = i + 1

    def _shared(self, before: _Slot, slot: _Slot, part: Contribution) -> tuple[Array, Array]:
        """Return mean and covariance after a contribution; NaN when it cannot be used."""
        at, whose = slot.key.stamp, (part.i, part.I, part.yaw, part.heading_bias)
        if part.jump is None and not self._is_advanced(before, at):
            return predict_and_assimilate(*self._last_leg(before, at), *whose)
        x, P = self._advance(before, at)
        if part.jump is not None:
            P = P + np.outer(part.jump, part.jump)
        return assimilate_turned(x, P, *whose)

    def _told(self, slot: _Slot, x: Array, P: Array) -> tuple[Array, Array] | None:
        """Return mean and covariance after a command or a measurement; None when nothing of it was used."""
        event = slot.event
        if isinstance(event, Input):
            slot.input = event
            return x, P
        assert isinstance(event, Measurement)
        kept: Measurement | None = event
        if self.settings.gate is not None:
            verdict = judge(x, P, event, slot.since, self.settings.gate)
            slot.since, kept = verdict.since, verdict.kept
            slot.refused = tuple(f"{event.source}: {reason}" for reason in verdict.refused)
            if verdict.jump is not None:
                P = P + np.outer(verdict.jump, verdict.jump)
        if kept is None:
            return None
        return correct(x, P, *linearise(x, kept.components, kept.z), kept.R)

    def _forget(self) -> None:
        """Fold what is older than the window into the state at its beginning."""
        keys, begins = self._keys, self._keys[-1].stamp - self._window
        k = max(0, len(keys) - self._most)
        while keys[k + 1].stamp < begins:  # one, mostly
            k += 1
        if k == 0:
            return
        self._settle(k + 1)
        for slot in self._slots[: k + 1]:
            if slot.refused:
                self._settled_refusals.update(slot.refused)
        self._slots[k].refused = ()
        del self._slots[:k], self._keys[:k]
        self._valid -= k
