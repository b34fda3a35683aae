"""What a low-cost quadcopter's navigation data are like: irregular, late, lossy, and off by its heading.

Reports come over a wireless link. One that a later one overtook is dropped, as their numbers ask. Heading:
Table 3 of "Indoor low-cost localization system" shows a bias that depends on the heading, up to 30 degrees,
under noise of a few; here it goes through the table's means, a straight line from one to the next.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from noctule.geometry import Array, wrap_angle
from noctule.messages import VehicleState
from noctule.settings import Settings

TABLE_3: tuple[tuple[float, float], ...] = (
    (15.0, 19.62), (43.0, 48.29), (76.0, 80.98), (127.0, 137.45), (152.0, 169.48),
    (184.0, 210.86), (229.0, 258.66), (281.0, 305.74), (328.0, 342.47), (352.0, 359.22),
)  # fmt: skip
"""Headings and the means of what the vehicle said they were [deg], as printed."""

_REFERENCE, _REPORTED = np.radians(np.array(TABLE_3)).T
_ERROR = _REPORTED - _REFERENCE


class SilenceSpec(Settings):
    """The link is gone for a while; what is measured then never arrives."""

    begin_s: float = Field(ge=0.0, le=36000.0, description="from, on the flight's clock [s]")
    seconds: float = Field(gt=0.0, le=36000.0, description="for how long [s]")


class NavdataSpec(Settings):
    """The link and the errors of a vehicle's reports; the defaults are those of the paper's vehicle."""

    slowest: float = Field(28.0, ge=1.0, le=300.0, description="reports a second, at least [Hz]")
    fastest: float = Field(67.0, ge=1.0, le=300.0, description="reports a second, at most [Hz]")
    loss: float = Field(0.03, ge=0.0, lt=1.0, description="share that never arrives")
    soonest: float = Field(0.042, ge=0.0, le=2.0, description="from measurement to arrival, at least [s]")
    latest: float = Field(0.09, ge=0.0, le=2.0, description="from measurement to arrival, at most [s]")
    velocity_noise: float = Field(0.06, ge=0.0, le=2.0, description="sd of each report, each axis [m/s]")
    velocity_bias: float = Field(0.03, ge=0.0, le=2.0, description="sd of a bias that wanders [m/s]")
    wander_time: float = Field(20.0, gt=0.0, le=3600.0, description="time constant of its wandering [s]")
    height_noise: float = Field(0.02, ge=0.0, le=2.0, description="sd of each report [m]")
    height_step: float = Field(0.01, gt=0.0, le=1.0, description="reports come in steps of this [m]")
    heading_error: float = Field(1.0, ge=0.0, le=3.0, description="times the bias of Table 3")
    heading_noise: float = Field(math.radians(2.0), ge=0.0, le=1.0, description="sd of each report [rad]")
    heading_drift: float = Field(0.0005, ge=0.0, le=0.1, description="sd of the flight's drift [rad/s]")
    silences: tuple[SilenceSpec, ...] = Field((), max_length=100, description="in which nothing arrives")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.slowest > self.fastest or self.soonest > self.latest:
            raise ValueError("slowest is above fastest, or soonest above latest; give the smaller one first")
        return self

    def silent(self, stamp: float) -> bool:
        """Return whether the link is gone at `stamp` [s]."""
        return any(gap.begin_s <= stamp < gap.begin_s + gap.seconds for gap in self.silences)


def table_3_error(yaw: float) -> float:
    """Return what the paper's vehicle says too much of a heading `yaw` [rad], in [rad]."""
    return float(np.interp(yaw, _REFERENCE, _ERROR, period=2.0 * math.pi))


class Navdata:
    """Measures at irregular times and delivers late; the same seed, the same fate of every report.

    Parameters
    ----------
    spec : the link and the errors
    seed : draws both, each from a stream of its own
    steps_per_second : of the simulation
    """

    def __init__(self, spec: NavdataSpec, seed: np.random.SeedSequence, steps_per_second: int) -> None:
        self._spec = spec
        link, errors = seed.spawn(2)
        self._link, self._errors = np.random.default_rng(link), np.random.default_rng(errors)
        self._steps_per_second = steps_per_second
        self.velocity_bias: Array = spec.velocity_bias * self._errors.standard_normal(3)
        """What reports of the velocity have too much now, (3,) [m/s]; for tests and judges."""
        self._drift = float(spec.heading_drift * self._errors.standard_normal())
        self._wandered = 0.0  # [s], until when the bias did
        self._due = self._next(0.0)  # [s]
        self._count = 0
        self._on_the_way: list[tuple[float, int, VehicleState]] = []
        self._delivered = -1

    def heading_bias(self, yaw: float, stamp: float) -> float:
        """Return what reports of the heading `yaw` [rad] have too much at `stamp` [s], in [rad]."""
        return self._spec.heading_error * table_3_error(yaw) + self._drift * stamp

    def measured(self, true: VehicleState) -> VehicleState:
        """Return a report of what is true, stamped with when it was measured."""
        s, draw = self._spec, self._errors.standard_normal(8)
        assert true.yaw is not None
        assert true.v_body is not None
        assert true.height is not None
        keep = math.exp(-max(0.0, true.stamp - self._wandered) / s.wander_time)
        self._wandered = true.stamp
        self.velocity_bias = keep * self.velocity_bias + s.velocity_bias * math.sqrt(1.0 - keep**2) * draw[:3]
        height = true.height + s.height_noise * draw[6]
        heading = true.yaw + self.heading_bias(true.yaw, true.stamp) + s.heading_noise * draw[7]
        return replace(
            true,
            yaw=wrap_angle(float(heading)),
            v_body=true.v_body + self.velocity_bias + s.velocity_noise * draw[3:6],
            height=float(s.height_step * np.rint(height / s.height_step)),
        )

    def step(self, step: int, true: Callable[[], VehicleState]) -> VehicleState | None:
        """Measure when it is time; return the newest report that arrives at this step, if one does."""
        now = step / self._steps_per_second
        if now >= self._due:
            fate, late = self._link.random(2).tolist()
            arrival = now + self._spec.soonest + (self._spec.latest - self._spec.soonest) * late
            if fate >= self._spec.loss and not self._spec.silent(now):
                heapq.heappush(self._on_the_way, (arrival, self._count, self.measured(true())))
            self._count += 1
            self._due = self._next(self._due)
        newest = None
        while self._on_the_way and self._on_the_way[0][0] <= now:
            _, number, report = heapq.heappop(self._on_the_way)
            if number > self._delivered:
                self._delivered, newest = number, report
        return newest

    def _next(self, stamp: float) -> float:
        return stamp + float(self._link.uniform(1.0 / self._spec.fastest, 1.0 / self._spec.slowest))
