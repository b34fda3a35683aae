"""The guard of a located pilot: how far it trusts its estimate, and what it does about it.

A pure state machine. Every tick the worst of all causes asks for a `Doubt`. What is asked for is done at
once, but for landing: the drone first comes to rest. Less doubt is believed only after a while, so that what
flickers does not make it dash and brake; from landing nothing leads back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from noctule.messages import Doubt
from noctule.pilots.doubt_reasons import (
    REPORTS_REMAIN,
    because_blind,
    because_jumped,
    because_silent,
    because_turned,
    because_unseen,
    because_unsure,
)
from noctule.pilots.doubt_settings import Ages, DoubtSettings

ORDER = (Doubt.SURE, Doubt.FLY_ON, Doubt.SLOW, Doubt.HOVER, Doubt.LAND)
RANK = {doubt: rank for rank, doubt in enumerate(ORDER)}


@dataclass(frozen=True, slots=True)
class Facts:
    """What is known at a tick of how good the estimate is."""

    stamp: float  # [s], the tick
    unseen: float = 0.0  # [s] since the exposure of the last pose that the fusion took
    silent: float = 0.0  # [s] since the vehicle's last report was measured
    position_sd: float = 0.0  # [m]; infinite while nothing is known
    yaw_sd: float = 0.0  # [rad]
    why_unseen: str = ""  # the locator's own words, empty when it sees the drone
    jump: float = 0.0  # [m], by which a pose moved the estimate at this tick
    turned: bool = False  # the half turn was found wrong and the fusion has not begun anew yet


@dataclass(frozen=True, slots=True)
class Guard:
    """What the pilot does about its doubt."""

    doubt: Doubt = Doubt.SURE
    reason: str = ""  # in plain words, empty when sure
    pace: float = 1.0  # times the wanted speed
    trust: float = 1.0  # share of a position error that hovering flies back
    stamp: float = math.nan  # [s], of the last tick
    since: float = math.nan  # [s], of this doubt
    well_since: float = math.nan  # [s], since when less doubt is asked for


def asked(facts: Facts, settings: DoubtSettings) -> tuple[Doubt, str]:
    """Return the gravest doubt that the facts ask for, and why; of two alike the first."""
    sd, turn = facts.position_sd, math.degrees(facts.yaw_sd)
    blind = min(facts.unseen, facts.silent)
    found = [
        (_by_age(blind, settings.blind), because_blind(blind)),
        (_by_age(facts.unseen, settings.unseen), because_unseen(facts.unseen, facts.why_unseen)),
        (_by_age(facts.silent, settings.silent), because_silent(facts.silent)),
    ]
    if facts.turned:
        return max((Doubt.HOVER, because_turned()), found[1], key=lambda pair: RANK[pair[0]])
    found += [
        (
            _by_size(sd, settings.slow_m, settings.hover_m, settings.land_m),
            because_unsure(f"{100.0 * sd:.0f} cm", facts.unseen, facts.why_unseen),
        ),
        (
            _by_size(turn, settings.slow_deg, settings.hover_deg, settings.land_deg),
            because_unsure(f"{turn:.0f} deg", facts.unseen, facts.why_unseen),
        ),
        (Doubt.HOVER if facts.jump > settings.jump_m else Doubt.SURE, because_jumped(facts.jump)),
    ]
    doubt, reason = max(found, key=lambda pair: RANK[pair[0]])
    return doubt, "" if doubt is Doubt.SURE else reason


def judge(guard: Guard, facts: Facts, settings: DoubtSettings) -> Guard:
    """Return what is done about the facts of the next tick."""
    wanted, reason = asked(facts, settings)
    stamp, doubt = facts.stamp, guard.doubt
    dt = 0.0 if math.isnan(guard.stamp) else max(0.0, stamp - guard.stamp)
    since = stamp if math.isnan(guard.since) else guard.since
    well = math.nan
    if doubt is Doubt.LAND:
        wanted, reason = doubt, guard.reason
    elif wanted is Doubt.LAND and not (doubt is Doubt.HOVER and stamp - since >= settings.rest_s):
        wanted = Doubt.HOVER
    if wanted is Doubt.LAND and doubt is not Doubt.LAND:
        reason = f"{reason}; landed{REPORTS_REMAIN if facts.silent <= settings.silent.slow_s else ''}"
    if RANK[wanted] < RANK[doubt]:
        well = stamp if math.isnan(guard.well_since) else guard.well_since
        wait = 0.0 if doubt is Doubt.FLY_ON else settings.well_s
        if stamp - well < wait:
            wanted, reason = doubt, guard.reason
    if wanted is not doubt:
        since, well = stamp, math.nan
    return Guard(
        doubt=wanted,
        reason=reason,
        pace=_pace(guard.pace, wanted, dt, settings),
        trust=_trust(facts, settings),
        stamp=stamp,
        since=since,
        well_since=well,
    )


def _by_age(age: float, limits: Ages) -> Doubt:
    bounds = (limits.fly_on_s, limits.slow_s, limits.hover_s, limits.land_s)
    return ORDER[sum(age > bound for bound in bounds)]


def _by_size(size: float, slow: float, hover: float, land: float) -> Doubt:
    if size > land:
        return Doubt.LAND
    if size > hover:
        return Doubt.HOVER
    return Doubt.SLOW if size > slow else Doubt.SURE


def _pace(pace: float, doubt: Doubt, dt: float, settings: DoubtSettings) -> float:
    """Return the pace after a tick: it falls and rises smoothly, and standing it is 0."""
    if doubt in (Doubt.HOVER, Doubt.LAND):
        return 0.0
    target = settings.slow_pace if doubt is Doubt.SLOW else 1.0
    return min(max(target, pace - dt / settings.brake_s), pace + dt / settings.rise_s)


def _trust(facts: Facts, settings: DoubtSettings) -> float:
    known = (settings.distrust_m - facts.position_sd) / (settings.distrust_m - settings.trust_m)
    return min(max(known, 0.0), 1.0)
