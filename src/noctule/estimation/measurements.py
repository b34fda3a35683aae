"""What the sensors say, as linearised models of the state.

A measurement is a list of components, each a number the state predicts, with one covariance. Position and
altitude, heading and onboard body velocities are all there is; what the vehicle dead-reckons of its own
x and y (metres off after a minute) is never used.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from noctule.compiled import compiled, wrap
from noctule.estimation.filter_state import FilterError, heading_bias_index, velocity_bias_index
from noctule.geometry import Array
from noctule.messages import HeadingMeasurement, PoseMeasurement, VehicleState
from noctule.settings import Settings


class Component(IntEnum):
    """What one number of a measurement measures."""

    X = 0
    Y = 1
    Z = 2
    YAW = 3
    FORWARD = 4  # onboard velocities, levelled heading frame, with their biases
    LEFT = 5
    UP = 6
    HEADING = 7  # onboard, with its bias


class NavdataNoise(Settings):
    """How far what the vehicle reports of itself is to be believed, beside the biases in the state."""

    velocity_sd: float = Field(0.06, gt=0.0, le=5.0, description="forward and left velocity [m/s]")
    # The bias of the climb is no state: position and height tell it well enough, so it counts as noise, and
    # as it does not average out it counts for more than it is.
    climb_sd: float = Field(0.2, gt=0.0, le=5.0, description="upward velocity with its bias [m/s]")
    height_sd: float = Field(0.025, gt=0.0, le=5.0, description="height above the floor [m]")
    heading_sd: float = Field(0.05, gt=0.0, le=3.0, description="heading, without its slow drift [rad]")


@dataclass(frozen=True, slots=True)
class Measurement:
    """Numbers that were measured together."""

    stamp: float  # [s], exposure or measurement
    components: NDArray[np.int64]  # (m,) of Component
    z: Array  # (m,) [m, rad, m/s]
    R: Array  # (m, m) covariance
    source: str  # what measured it
    sequence: int = 0  # counts the source's measurements, so that none is used twice

    def part(self, keep: NDArray[np.bool_]) -> Measurement:
        """Return the measurement of the kept numbers alone."""
        R = np.ascontiguousarray(self.R[np.ix_(keep, keep)])
        return Measurement(self.stamp, self.components[keep], self.z[keep], R, self.source, self.sequence)


def _made(
    stamp: float, components: list[Component], z: Array, R: Array, source: str, sequence: int
) -> Measurement:
    m = len(components)
    if z.shape != (m,) or R.shape != (m, m):
        raise FilterError(
            f"measurement of {source!r}: {z.shape} numbers with a covariance {R.shape}; "
            f"expected ({m},) and ({m}, {m})"
        )
    finite = np.isfinite(z).all() and np.isfinite(R).all() and np.isfinite(stamp)
    if not (finite and np.allclose(R, R.T, rtol=1e-6, atol=0.0) and np.linalg.eigvalsh(R)[0] > 0.0):
        raise FilterError(
            f"measurement of {source!r} at {stamp:g} s: {z.tolist()} with variances {np.diag(R).tolist()}; "
            "expected finite numbers and a positive definite covariance"
        )
    # Symmetric to the last bit: what reads one triangle and what reads both agree.
    return Measurement(
        float(stamp), np.array(components, dtype=np.int64), z, 0.5 * (R + R.T), source, sequence
    )


def of_pose(pose: PoseMeasurement, sequence: int = 0) -> Measurement:
    """Return the measurement of x, y, z, yaw by a sensor in the room. Raises FilterError."""
    z = np.append(np.asarray(pose.position, dtype=np.float64), pose.yaw)
    R = np.asarray(pose.covariance, dtype=np.float64)
    parts = [Component.X, Component.Y, Component.Z, Component.YAW]
    return _made(pose.stamp, parts, z, R, pose.source, sequence)


def of_heading(heading: HeadingMeasurement, sequence: int = 0) -> Measurement:
    """Return the measurement of the yaw alone, of markers for example. Raises FilterError."""
    z, R = np.array([heading.yaw]), np.array([[heading.variance]])
    return _made(heading.stamp, [Component.YAW], z, R, heading.source, sequence)


def of_vehicle_state(
    state: VehicleState, noise: NavdataNoise, sequence: int = 0, source: str = "onboard"
) -> Measurement | None:
    """Return what the vehicle reports of velocities, height and heading; None when it reports none of them.

    Raises FilterError.
    """
    parts: list[Component] = []
    z: list[float] = []
    sd: list[float] = []
    if state.v_body is not None:
        parts += [Component.FORWARD, Component.LEFT, Component.UP]
        z += [float(v) for v in state.v_body]
        sd += [noise.velocity_sd, noise.velocity_sd, noise.climb_sd]
    if state.height is not None:
        parts.append(Component.Z)
        z.append(state.height)
        sd.append(noise.height_sd)
    if state.yaw is not None:
        parts.append(Component.HEADING)
        z.append(state.yaw)
        sd.append(noise.heading_sd)
    if not parts:
        return None
    return _made(state.stamp, parts, np.array(z), np.diag(np.square(sd)), source, sequence)


@compiled
def linearise(x: Array, components: NDArray[np.int64], z: Array) -> tuple[Array, Array]:
    """Return the residual z - h(x) (m,), its angles wrapped, and the Jacobian H of h at x, (m, n)."""
    m, n = z.size, x.size
    residual = np.empty(m)
    H = np.zeros((m, n))
    c, s = np.cos(x[3]), np.sin(x[3])
    bias = velocity_bias_index(n)
    for a in range(m):
        kind = components[a]
        if kind <= 2:
            H[a, kind] = 1.0
            residual[a] = z[a] - x[kind]
        elif kind == 3:
            H[a, 3] = 1.0
            residual[a] = wrap(z[a] - x[3])
        elif kind == 6:
            H[a, 6] = 1.0
            residual[a] = z[a] - x[6]
        elif kind == 7:
            H[a, 3] = 1.0
            expected = x[3]
            b = heading_bias_index(n)
            if b >= 0:
                H[a, b] = 1.0
                expected += x[b]
            residual[a] = wrap(z[a] - expected)
        else:
            forward, left = c * x[4] + s * x[5], c * x[5] - s * x[4]
            if kind == 4:
                H[a, 3], H[a, 4], H[a, 5] = left, c, s
                residual[a] = z[a] - forward
            else:
                H[a, 3], H[a, 4], H[a, 5] = -forward, -s, c
                residual[a] = z[a] - left
            if bias >= 0:
                H[a, bias + kind - 4] = 1.0
                residual[a] -= x[bias + kind - 4]
    return residual, H
