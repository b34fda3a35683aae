"""What the simulated vehicle reports of itself, with its errors."""

from __future__ import annotations

import math

import numpy as np

from noctule.geometry import wrap_angle
from noctule.messages import FlightState, VehicleState
from noctule.simulation.dynamics import Motion
from noctule.simulation.spec import VehicleSpec

BATTERY_LIFE = 900.0  # [s]


class StateSensors:
    """Turns the true motion into reports.

    Errors: roll and pitch each carry a bias of the flight and a Gauss-Markov process, which share the
    variance `attitude_sd`^2 in halves; velocity a bias and white noise; height white noise; yaw a constant
    drift. Every report draws the same number of values, so the errors do not depend on what is flown.
    """

    def __init__(self, spec: VehicleSpec, seed: np.random.SeedSequence) -> None:
        self._spec = spec
        self._rng = np.random.default_rng(seed)
        half = spec.attitude_sd / math.sqrt(2.0)
        self._attitude_bias = half * self._rng.standard_normal(2)
        self._attitude_slow = half * self._rng.standard_normal(2)
        self._keep = math.exp(-1.0 / (spec.report_rate * spec.attitude_drift_time))
        self._renew = half * math.sqrt(1.0 - self._keep**2)
        self._velocity_bias = spec.velocity_bias * self._rng.standard_normal(3)
        self._yaw_drift = float(spec.yaw_drift * self._rng.standard_normal())

    def report(self, motion: Motion, stamp: float, flight_state: FlightState) -> VehicleState:
        """Return the next report; call it once per report period."""
        draw = self._rng.standard_normal(6)
        self._attitude_slow = self._keep * self._attitude_slow + self._renew * draw[:2]
        attitude = np.array([motion.roll, motion.pitch]) + self._attitude_bias + self._attitude_slow
        velocity = np.array(motion.heading_velocity()[:3])
        return VehicleState(
            stamp=stamp,
            flight_state=flight_state,
            roll=float(attitude[0]),
            pitch=float(attitude[1]),
            yaw=wrap_angle(motion.yaw + self._yaw_drift * stamp),
            v_body=velocity + self._velocity_bias + self._spec.velocity_noise * draw[2:5],
            height=float(motion.z + self._spec.height_noise * draw[5]),
            battery=max(0.0, 1.0 - stamp / BATTERY_LIFE),
            link_quality=1.0,
        )
