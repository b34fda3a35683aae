"""The paper's own identification, (15): least squares on velocities that were differentiated.

(6) to (10) with (8) and (9) corrected: the velocity stands in (8), the acceleration in (9). It knows no
delay, and noise in its regressors biases it badly (errors in variables): it is kept to be compared with.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from noctule.estimation.identification.covariance import correlation
from noctule.estimation.identification.flights import (
    AXES,
    NOTHING_FLOWN,
    AxisFlight,
    Flight,
    IdentificationError,
    PlaneFlight,
    axes_of,
    channels,
    moved_axes,
)
from noctule.estimation.identification.result import AxisFit, Identification
from noctule.geometry import Array


def published(flights: Sequence[Flight]) -> Identification:
    """Return the least squares (15) of all axes that were moved; the delay is taken for 0."""
    if not flights:
        raise IdentificationError(NOTHING_FLOWN)
    rows: dict[int, list[tuple[Array, Array]]] = {}
    for flight in flights:
        for axis, G, u in _equations(flight):
            rows.setdefault(axis, []).append((G, u))
    fits = [
        _solve(axis, np.concatenate([G for G, _ in rows[axis]]), np.concatenate([u for _, u in rows[axis]]))
        for axis in sorted(rows)
    ]
    return Identification(tuple(fits), 0.0, 0.0)


def _equations(flight: Flight) -> list[tuple[int, Array, Array]]:
    """Return of each axis that was moved its rows of G and u: u = acceleration / k_u + velocity k_v / k_u."""
    stamps, v = flight.stamps, channels(flight)
    if isinstance(flight, AxisFlight) and flight.means:
        stamps = 0.5 * (stamps[1:] + stamps[:-1])
    a = np.gradient(v, stamps, axis=1)
    if isinstance(flight, PlaneFlight):
        # On body axes, what (7) and (9) are: the world's acceleration resolved there.
        turn = np.gradient(flight.yaw, stamps)
        a = a + turn * np.array([-v[1], v[0]])
    held = np.searchsorted(flight.command_stamps, stamps, side="right") - 1
    inputs = flight.inputs.reshape(flight.inputs.shape[0], -1)
    u = np.where(held >= 0, inputs[np.maximum(held, 0)].T, 0.0)
    moved = moved_axes(flight)
    return [
        (axis, np.column_stack([a[i], v[i]]), u[i]) for i, axis in enumerate(axes_of(flight)) if axis in moved
    ]


def _solve(axis: int, G: Array, u: Array) -> AxisFit:
    inverse = np.linalg.pinv(G.T @ G, hermitian=True)
    theta = inverse @ (G.T @ u)
    residual = u - G @ theta
    covariance = inverse * float(residual @ residual) / (u.size - 2)
    k_u, k_v = 1.0 / theta[0], theta[1] / theta[0]
    D = np.array([[-(k_u**2), 0.0], [-k_u * k_v, k_u]])
    sd = np.sqrt(np.diag(D @ covariance @ D.T))
    noise = math.sqrt(float(residual @ residual) / u.size)
    correlated = correlation(residual)
    return AxisFit(AXES[axis], float(k_u), float(k_v), float(sd[0]), float(sd[1]), noise, correlated)
