"""Which measurements are believed: position, yaw and velocity each by a gate of its own.

A gate compares the innovation with what the filter expects, d^2 = r' (H P H' + R)^-1 r, with the chi-square
quantile of its numbers. While a source's gate refuses, it widens: the limit doubles with every
`widening_time` since the first refusal, so a filter that went astray is found again within seconds while one
wild reading after a silence stays out. It does not widen while another source measures the same numbers and
is believed: a height above a table stays out as long as the room's camera knows the height.

What comes in through a widened gate says that the vehicle is elsewhere than the covariance allows, so the
state may jump before the measurement is used: P + j j', with j along the innovation and just so long that
d^2 falls to the limit. (Scaling all of P would throw the innovation on the rates as well: seen, a turn of
15 rad/s.)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from noctule.compiled import compiled
from noctule.estimation.chi_square import chi_square_quantile
from noctule.estimation.filter_state import YAW, heading_bias_index
from noctule.estimation.matrices import inverse_spd, times
from noctule.estimation.measurements import Component, Measurement, linearise
from noctule.geometry import Array
from noctule.settings import Settings


class Group(StrEnum):
    """What is gated together."""

    POSITION = "position"
    YAW = "yaw"
    VELOCITY = "velocity"


_GROUPS = {
    Group.POSITION: (Component.X, Component.Y, Component.Z),
    Group.YAW: (Component.YAW, Component.HEADING),
    Group.VELOCITY: (Component.FORWARD, Component.LEFT, Component.UP),
}
_GROUP_OF = np.array([i for c in Component for i, g in enumerate(_GROUPS.values()) if c in g])
_NAMES = tuple(_GROUPS)
_MOST_DOUBLINGS = 60.0


class GateSettings(Settings):
    """How surprising a measurement may be."""

    confidence: float = Field(0.999, gt=0.5, lt=1.0, description="share of good measurements let in")
    widening_time: float = Field(
        0.1, gt=0.0, le=60.0, description="the limit doubles with each such time of refusals [s]"
    )
    yaw_known: float = Field(
        0.6, gt=0.0, le=3.0, description="body velocities wait until the yaw is known this well, sd [rad]"
    )


class Streak(NamedTuple):
    """Refusals in a row by one gate of one source."""

    begun: float  # [s], stamp of the first
    group: int  # which of the gates
    components: frozenset[int]  # what was refused


class Verdict(NamedTuple):
    """What a gate says of one measurement."""

    kept: Measurement | None  # what may be used of it
    jump: Array | None  # (n,) j of the covariance j j' to be added before, None inside of the gates
    refused: tuple[str, ...]  # reasons: "position gate", "yaw gate", "velocity gate", "yaw unknown"
    since: Mapping[str, Streak]  # "source/gate" -> what it has refused since


@compiled
def surprises(
    x: Array, P: Array, components: NDArray[np.int64], z: Array, R: Array
) -> tuple[tuple[float, float, float], tuple[int, int, int]]:
    """Return d^2 = r' (H P H' + R)^-1 r of every group, and how many numbers each has."""
    residual, H = linearise(x, components, z)
    m, n = H.shape
    S = R.copy()
    for a in range(m):
        for i in range(n):
            if H[a, i] != 0.0:
                for j in range(n):
                    for b in range(m):
                        S[a, b] += H[a, i] * P[i, j] * H[b, j]
    d2 = np.zeros(3)
    counts = np.zeros(3, dtype=np.int64)
    rows = np.empty(m, dtype=np.int64)
    for g in range(3):
        k = 0
        for a in range(m):
            if _GROUP_OF[components[a]] == g:
                rows[k] = a
                k += 1
        if k == 0:
            continue
        block = np.empty((k, k))
        r = np.empty(k)
        for a in range(k):
            r[a] = residual[rows[a]]
            for b in range(k):
                block[a, b] = S[rows[a], rows[b]]
        weighed = times(inverse_spd(block), r)
        for a in range(k):
            d2[g] += r[a] * weighed[a]
        counts[g] = k
    # Numbers get out of compiled code in a third of the time that arrays take.
    return (d2[0], d2[1], d2[2]), (counts[0], counts[1], counts[2])


def judge(
    x: Array, P: Array, measurement: Measurement, since: Mapping[str, Streak], settings: GateSettings
) -> Verdict:
    """Judge a measurement against the prediction x (n,), P (n, n) for its stamp.

    `since` is that of the verdict before; it is not changed.
    """
    d2, counts = surprises(x, P, measurement.components, measurement.z, measurement.R)
    limits = _limits(settings.confidence, counts)
    yaw_known = bool(P[YAW, YAW] <= settings.yaw_known**2)
    if yaw_known and not since and d2[0] <= limits[0] and d2[1] <= limits[1] and d2[2] <= limits[2]:
        return Verdict(measurement, None, (), since)  # as good as always
    refused, after, dropped, jump = [], since, [], None
    for g, (name, surprise, limit) in enumerate(zip(_NAMES, d2, limits, strict=True)):
        if not counts[g]:
            continue
        if name is Group.VELOCITY and not yaw_known:
            refused.append("yaw unknown")
            dropped.append(g)
            continue
        key = f"{measurement.source}/{name}"
        rows = _GROUP_OF[measurement.components] == g
        numbers = frozenset(measurement.components[rows].tolist())
        elapsed = max(0.0, measurement.stamp - after[key].begun) if key in after else 0.0
        if surprise <= limit * 2.0 ** min(_MOST_DOUBLINGS, elapsed / settings.widening_time):
            if surprise > limit:
                share = math.sqrt(1.0 / limit - 1.0 / surprise)
                part = share * _absorbed(x, measurement, rows)
                jump = part if jump is None else jump + part
            # Who measures no more than what is believed here begins to be refused anew.
            after = {
                k: v for k, v in after.items() if k != key and not (v.group == g and v.components <= numbers)
            }
        else:
            refused.append(f"{name} gate")
            dropped.append(g)
            if key not in after:
                after = {**after, key: Streak(measurement.stamp, g, numbers)}
    if not dropped:
        return Verdict(measurement, jump, (), after)
    keep = ~np.isin(_GROUP_OF[measurement.components], dropped)
    return Verdict(measurement.part(keep) if keep.any() else None, jump, tuple(refused), after)


@lru_cache(maxsize=256)
def _limits(confidence: float, counts: tuple[int, int, int]) -> tuple[float, ...]:
    return tuple(chi_square_quantile(confidence, count) if count else 0.0 for count in counts)


def _absorbed(x: Array, measurement: Measurement, rows: NDArray[np.bool_]) -> Array:
    """Return the change of state (n,) that takes up the innovations of `rows`.

    Positions and yaw move themselves, velocities turn into the world, an onboard heading moves its bias.
    """
    residual, _ = linearise(x, measurement.components, measurement.z)
    change = np.zeros(x.size)
    bias = heading_bias_index(x.size)
    c, s = math.cos(x[YAW]), math.sin(x[YAW])
    for component, r in zip(measurement.components[rows], residual[rows], strict=True):
        if component <= Component.YAW:
            change[component] = r
        elif component == Component.FORWARD:
            change[4:6] += r * c, r * s
        elif component == Component.LEFT:
            change[4:6] += -r * s, r * c
        elif component == Component.UP:
            change[6] = r
        else:
            change[bias if bias >= 0 else YAW] = r
    return change
