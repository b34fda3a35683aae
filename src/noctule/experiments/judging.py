"""How far sensors and filters are off the truth, and whether they know it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from noctule.estimation.filter_state import StateEstimate
from noctule.estimation.measurements import NavdataNoise
from noctule.geometry import Array, wrap_angle
from noctule.messages import HeadingMeasurement, PoseMeasurement, VehicleState

KINEMATIC = 8  # numbers of a state that tell where the vehicle is and how it moves


@dataclass(slots=True)
class Errors:
    """What a source was off by; position errors are rows of NaN where it measures none."""

    position: list[Array] = field(default_factory=list)  # (3,) [m]
    yaw: list[float] = field(default_factory=list)  # [rad]
    nees: list[float] = field(default_factory=list)  # per number

    def add(self, position: Array | None, yaw: float, nees: float) -> None:
        """Add an error."""
        self.position.append(np.full(3, np.nan) if position is None else position)
        self.yaw.append(wrap_angle(yaw))
        self.nees.append(nees)

    def figures(self) -> dict[str, float | None]:
        """Return the figures; None where nothing was measured."""
        if not self.yaw:
            names = ("position_rms_m", "position_p95_m", "yaw_mean_deg", "yaw_sd_deg", "yaw_worst_deg")
            return {**dict.fromkeys(names), "nees_per_state": None, "measured": 0.0}
        away = np.linalg.norm(np.array(self.position), axis=1)
        yaw = np.degrees(np.array(self.yaw))
        placed = bool(np.isfinite(away).all())
        return {
            "position_rms_m": float(np.sqrt(np.mean(away**2))) if placed else None,
            "position_p95_m": float(np.percentile(away, 95.0)) if placed else None,
            "yaw_mean_deg": float(yaw.mean()),
            "yaw_sd_deg": float(yaw.std()),
            "yaw_worst_deg": float(np.abs(yaw).max()),
            "nees_per_state": float(np.mean(self.nees)),
            "measured": float(yaw.size),
        }


def judge_report(errors: Errors, true: Array, state: VehicleState) -> None:
    """Judge a report as it came, with the noise that is believed of a vehicle never calibrated.

    `true` is a row of `HandFlight.truth`, here and below.
    """
    noise = NavdataNoise()
    assert state.yaw is not None
    assert state.v_body is not None
    assert state.height is not None
    off = wrap_angle(state.yaw - float(true[3]))
    c, s = np.cos(true[3]), np.sin(true[3])
    v = state.v_body - np.array([c * true[4] + s * true[5], c * true[5] - s * true[4], true[6]])
    sd = np.array([noise.velocity_sd, noise.velocity_sd, noise.climb_sd, noise.height_sd, noise.heading_sd])
    numbers = np.array([*v, state.height - true[2], off]) / sd
    errors.add(None, off, float(np.mean(numbers**2)))


def judge_heading(errors: Errors, true: Array, heading: HeadingMeasurement) -> None:
    """Judge the heading that markers have."""
    off = wrap_angle(heading.yaw - float(true[3]))
    errors.add(None, off, off**2 / heading.variance)


def judge_pose(errors: Errors, true: Array, pose: PoseMeasurement) -> None:
    """Judge where the depth camera saw the vehicle."""
    off = np.append(pose.position - true[:3], wrap_angle(pose.yaw - float(true[3])))
    errors.add(off[:3], float(off[3]), float(off @ np.linalg.solve(pose.covariance, off)) / 4.0)


def judge_estimate(errors: Errors, true: Array, known: StateEstimate) -> None:
    """Judge an estimate by its kinematic numbers; the biases are its own affair."""
    off = known.x[:KINEMATIC] - true[:KINEMATIC]
    off[3] = wrap_angle(float(off[3]))
    P = known.P[:KINEMATIC, :KINEMATIC]
    errors.add(off[:3], float(off[3]), float(off @ np.linalg.solve(P, off)) / KINEMATIC)
