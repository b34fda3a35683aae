"""What the vehicle was told lately, and what that does to it: prediction, and the disturbance learnt."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from noctule.control.cascade import (
    CascadeSettings,
    disturbance_after,
    disturbance_at,
    nothing_learnt,
    on_body_axes,
    predict_over_delay,
    remember,
)
from noctule.estimation.vehicle_model import VehicleModel
from noctule.geometry import Array
from noctule.messages import Command

_GAP = 0.3  # [s]; estimates farther apart say nothing of a disturbance
_MEMORY = 64  # commands remembered: 2 s at 30 Hz, and a delay may be 0.5 s


@dataclass(slots=True)
class CommandMemory:
    """The last commands and the model they act by."""

    model: VehicleModel
    settings: CascadeSettings
    # What acts beside the model at the speed that is wanted now, body axes, (4,) [m/s^2, rad/s^2], and the
    # command that would have the same effect, (4,).
    disturbance: Array = field(default_factory=lambda: np.zeros(4))
    push: Array = field(default_factory=lambda: np.zeros(4))
    _learnt: Array = field(init=False)  # (4, 2) constants [m/s^2, rad/s^2], and slopes [1/s], body axes
    _covariance: Array = field(init=False)  # (4, 2, 2) of each axis
    _slope_sd: Array = field(init=False)  # (4,) [1/s], before anything is learnt
    _bounds: Array = field(init=False)  # (4, 2) of what is learnt
    _wanted: Array = field(default_factory=lambda: np.zeros(4))  # (4,) [m/s, rad/s], asked for last, body
    _before: tuple[float, Array] | None = None  # the last estimate: stamp [s], state (8,)
    # Before the first command, nothing was sent since ever.
    _stamps: Array = field(default_factory=lambda: np.full(_MEMORY, -np.inf))  # (n,) [s]
    _sent: Array = field(default_factory=lambda: np.zeros((_MEMORY, 4)))  # (n, 4)

    def __post_init__(self) -> None:
        """Begin with nothing learnt; a slope as large as the drag is where a vehicle would not stop."""
        drags = self.model.drags
        self._slope_sd = self.settings.disturbance_share * drags
        self._bounds = np.column_stack([np.array(self.settings.most_disturbance), drags])
        self._learnt, self._covariance = nothing_learnt(self._slope_sd)

    def told(self, sent: Command | None) -> None:
        """Hear what was really sent at the last tick."""
        if sent is not None:
            self._sent[-1] = sent.as_array()

    def asked(self, velocity: Array, yaw: float) -> None:
        """Hear which velocity (4,) [m/s, rad/s], in the world, is wanted at this tick."""
        self._wanted = on_body_axes(velocity, yaw)
        self._weigh()

    def remember(self, stamp: float, u: Array) -> None:
        """Keep a command (4,) that is sent at `stamp` [s]."""
        remember(self._stamps, self._sent, stamp, u)

    def predict(self, x: Array, stamp: float, until: float) -> Array:
        """Return the state (8,) at `until` [s] of what was `x` (8,) at `stamp` [s]."""
        model = self.model
        return predict_over_delay(
            x, stamp, until, self._stamps, self._sent, self.push, model.input_gains, model.drags, model.delay
        )

    def learn(self, now: Array, stamp: float, learning: bool = True) -> None:
        """Compare the state `now` (8,) with what was predicted of the last one."""
        before, rate = self._before, self.settings.disturbance_rate
        if learning and before is not None and 0.0 < stamp - before[0] < _GAP and rate > 0.0:
            expected = self.predict(before[1], before[0], stamp)
            self._learnt, self._covariance = disturbance_after(
                self._learnt, self._covariance, expected, now, self._wanted, stamp - before[0], rate,
                self._slope_sd, self._bounds,
            )  # fmt: skip
            self._weigh()
        if before is None or stamp > before[0]:
            self._before = (stamp, now)

    def forget(self) -> None:
        """Begin anew with the disturbance: the estimate it was learnt of was wrong."""
        self._learnt, self._covariance = nothing_learnt(self._slope_sd)
        self._before = None
        self._weigh()

    def _weigh(self) -> None:
        """Say what acts, by what is learnt and wanted now."""
        self.disturbance, self.push = disturbance_at(self._learnt, self._wanted, self.model.input_gains)
