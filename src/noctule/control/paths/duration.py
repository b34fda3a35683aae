"""How long a plan takes where all goes well."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from noctule.control.paths.plan import PathPlan
from noctule.control.paths.speed import CAPTURE, approach_speed, braking_distance
from noctule.geometry import Array

_PARTS = 128  # of the way on which a vehicle gets under way or brakes


def duration(plan: PathPlan) -> float:
    """Return when [s] the end is reached, all stops before it included; infinite without an end.

    As flown by a vehicle that does what is wanted of it, and is never in doubt.
    """
    if math.isinf(plan.total):
        return math.inf
    clock = _Clock.of(plan)
    t, s, k = 0.0, 0.0, 0
    places: dict[float, float] = {}  # [m]: [s]
    for stop in plan.placed:
        places[stop.s or 0.0] = places.get(stop.s or 0.0, 0.0) + stop.seconds
    places.setdefault(plan.total, 0.0)
    for gate, seconds in places.items():
        way = _Way.of(plan, clock, s, gate)
        while k < len(plan.timed) and (time := plan.timed[k].time or 0.0) < t + way.seconds:
            at, v = way.at(time - t)
            held = at + braking_distance(v, plan.speed)
            if held >= gate:  # it stops there anyway
                break
            t = max(t + _Way.of(plan, clock, s, held).seconds, time)
            s, (t, k) = held, _held_until(plan, t, k)
            way = _Way.of(plan, clock, s, gate)
        t, k = _held_until(plan, t + way.seconds + seconds, k)
        s = gate
    return t


def _held_until(plan: PathPlan, t: float, k: int) -> tuple[float, int]:
    """Return until when a stop that would last until `t` [s] is held, and the first stop that is later."""
    while k < len(plan.timed) and (plan.timed[k].time or 0.0) <= t:
        t, k = max(t, (plan.timed[k].time or 0.0) + plan.timed[k].seconds), k + 1
    return t, k


@dataclass(frozen=True, slots=True)
class _Clock:
    """When each place is passed without any stop, counted on over the laps."""

    s: Array  # (n,) [m]
    t: Array  # (n,) [s]

    @classmethod
    def of(cls, plan: PathPlan) -> _Clock:
        v = plan.profile.v
        steps = 2.0 * np.diff(plan.profile.s) / (v[:-1] + v[1:])
        return cls(plan.profile.s, np.concatenate([[0.0], np.cumsum(steps)]))

    def time(self, s: float) -> float:
        """Return when [s] it is at `s` [m]."""
        return _counted_on(s, self.s, self.t)

    def place(self, t: float) -> float:
        """Return where [m] it is at `t` [s]."""
        return _counted_on(t, self.t, self.s)


def _counted_on(value: float, given: Array, wanted: Array) -> float:
    laps = math.floor(value / float(given[-1]))
    return laps * float(wanted[-1]) + float(np.interp(value - laps * float(given[-1]), given, wanted))


@dataclass(frozen=True, slots=True)
class _Way:
    """From one stop to the next, or to where that is held as a point."""

    clock: _Clock
    s: Array  # (m,) [m]
    t: Array  # (m,) [s] since it was begun
    v: Array  # (m,) [m/s]
    middle: int | None  # behind this node it is flown as without stops, up to the next one

    @classmethod
    def of(cls, plan: PathPlan, clock: _Clock, begin: float, end: float) -> _Way:
        last = end - CAPTURE
        if last <= begin:
            return cls(clock, np.array([begin]), np.zeros(1), np.zeros(1), None)
        length, a = plan.path.length, plan.speed.acceleration
        fastest = float(plan.profile.v.max())
        first = begin + fastest**2 / (2.0 * a)
        second = min(last, end - braking_distance(fastest, plan.speed))
        if apart := first < second:
            s = np.concatenate([np.linspace(begin, first, _PARTS), np.linspace(second, last, _PARTS)])
        else:
            s = np.linspace(begin, last, 2 * _PARTS)
        v = np.interp(s % length if plan.path.closed else s, plan.profile.s, plan.profile.v)
        v = np.minimum(v, np.sqrt(2.0 * a * (s - begin)))
        v = np.minimum(v, [approach_speed(left, plan.speed) for left in (end - s).tolist()])
        steps = 2.0 * np.diff(s) / np.maximum(v[:-1] + v[1:], 1e-9)
        if apart:
            steps[_PARTS - 1] = clock.time(float(s[_PARTS])) - clock.time(float(s[_PARTS - 1]))
        return cls(clock, s, np.concatenate([[0.0], np.cumsum(steps)]), v, _PARTS - 1 if apart else None)

    @property
    def seconds(self) -> float:
        """How long it takes [s]."""
        return float(self.t[-1])

    def at(self, t: float) -> tuple[float, float]:
        """Return where [m] it is at `t` [s], and how fast [m/s]."""
        v = float(np.interp(t, self.t, self.v))
        k = self.middle
        if k is not None and self.t[k] < t < self.t[k + 1]:
            return self.clock.place(self.clock.time(float(self.s[k])) + t - float(self.t[k])), v
        return float(np.interp(t, self.t, self.s)), v
