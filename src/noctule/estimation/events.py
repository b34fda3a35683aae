"""What a filter can be told, and where each belongs in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from noctule.estimation.contributions import Contribution
from noctule.estimation.filter_state import FilterError
from noctule.estimation.gating import Streak
from noctule.estimation.measurements import Measurement
from noctule.geometry import Array


@dataclass(frozen=True, slots=True)
class Input:
    """A command that was sent: normalised for an identified vehicle, velocities for one that follows them."""

    stamp: float  # [s], when it was sent; it takes effect after the model's delay
    u: Array | None  # (4,) forward, left, up, yaw; None when nobody knows what the vehicle is told
    source: str = "commands"
    sequence: int = 0

    def __post_init__(self) -> None:
        """Refuse what would make every later state undefined."""
        if self.u is not None and not (self.u.shape == (4,) and np.isfinite(self.u).all()):
            raise FilterError(
                f"input of {self.source!r} at {self.stamp:g} s: {self.u.tolist()}; expected 4 finite numbers"
            )


Event = Measurement | Contribution | Input


class Key(NamedTuple):
    """Where an event belongs in time, and its id: the same key, the same event."""

    stamp: float  # [s], when it takes effect
    rank: int  # inputs before measurements of the same time
    source: str
    sequence: int


@dataclass(frozen=True, slots=True)
class Snapshot:
    """What a filter knows: a state, and the events since. Made of it, another counts none of them twice."""

    key: Key  # of the last event within the state
    at: float  # [s], stamp of the state
    x: Array  # (n,)
    P: Array  # (n, n)
    input: Input | None  # in force
    since: Mapping[str, Streak]  # of the gates
    events: tuple[Event, ...]
