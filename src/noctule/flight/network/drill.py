"""A drill: a made-up flight whose truth every node knows how to draw, to try the network without a drone.

Each node measures its own part of the same flight, in real time; nodes may be killed, frozen and started
again, and each tells at the end whether it knew how wrong it was.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from noctule.estimation.chi_square import nees
from noctule.estimation.delayed import FilterSettings
from noctule.estimation.filter_state import StateEstimate
from noctule.estimation.network_study import Flight, made_up_flight
from noctule.estimation.vehicle_model import VehicleModel
from noctule.flight.network.member import Member
from noctule.flight.network.pacing import paced
from noctule.flight.network.process import Reading

COMMANDER = "onboard"  # the node that tells the others the commands
_RATE = 84.0  # measurements a second, of all three sensors
_SETTLED = 0.25  # [s] after which the measurements of a moment have arrived
_EVERY = 4  # of the moments whose truth is known are judged
_STALE = 0.75  # [s], older moments are judged no more: the process hung meanwhile


@dataclass(frozen=True, slots=True)
class Drill:
    """A flight with its truth, its stamps on the shared clock."""

    flight: Flight
    begin: float  # [s], shared clock
    model: VehicleModel
    settings: FilterSettings

    @property
    def start(self) -> StateEstimate:
        """What every node knows at first."""
        return replace(self.flight.start, stamp=self.begin)

    def readings(self, role: str, stop: threading.Event) -> Iterator[Reading]:
        """Yield what the sensor of a role measures, when it would arrive, and the commands."""
        entries: list[tuple[float, Reading]] = []
        for measurement, arrival in zip(self.flight.measurements, self.flight.arrivals, strict=True):
            if measurement.source == role:
                own = replace(measurement, stamp=measurement.stamp + self.begin)
                entries.append((self.begin + float(arrival), own))
        if role == COMMANDER:
            # Those of before the first moment are told with it.
            told = [replace(sent, stamp=sent.stamp + self.begin) for sent in self.flight.inputs]
            entries += [(max(sent.stamp, self.begin), sent) for sent in told]
        entries.sort(key=lambda entry: entry[0])
        return paced(((at, (reading,)) for at, reading in entries), stop)


def made_up(seed: int, seconds: float, begin: float) -> Drill:
    """Return the drill of a seed; the same in every process, to the last bit."""
    model, settings = VehicleModel.identified(delay=0.02), FilterSettings()
    flight = made_up_flight(math.ceil(_RATE * seconds), seed, model, settings.noise)
    return Drill(flight, begin, model, settings)


@dataclass(slots=True)
class Judge:
    """Compares a member with the truth: a watcher of its process."""

    drill: Drill
    stamps: list[float] = field(default_factory=list)  # [s] since the beginning
    nees: list[float] = field(default_factory=list)  # per state, 1 when the member knows its errors
    _next: int = 0

    def __call__(self, now: float, member: Member) -> None:
        """Judge the moments that are settled by `now` [s]."""
        flight, begin = self.drill.flight, self.drill.begin
        while self._next < len(flight.measurements):
            stamp = begin + flight.measurements[self._next].stamp
            if stamp > now - _SETTLED:
                return
            if stamp > max(now - _STALE, member.node.filter.oldest) and not member.joining(now):
                known, truth = member.node.estimate(stamp), flight.truths[self._next]
                self.stamps.append(stamp - begin)
                self.nees.append(nees(known, truth) / truth.size)
            self._next += _EVERY

    def summary(self) -> dict[str, object]:
        """Return the mean over the flight and over each second of it."""
        seconds = np.floor(self.stamps).astype(int) if self.stamps else np.empty(0, dtype=int)
        values = np.array(self.nees)
        by_second = {int(s): round(float(values[seconds == s].mean()), 3) for s in np.unique(seconds)}
        return {
            "judged": len(self.nees),
            "nees_per_state": round(float(values.mean()), 3) if self.nees else None,
            "nees_by_second": by_second,
        }
