"""k1 to k8 and the delay from a flight: by output error, or as the paper did by (15).

Each axis of eq. (2) is dv/dt = k_u u(t - delay) - k_v v with inputs held between commands. `identify`
compares the measured velocities with those that this equation gives, solved exactly from command to command,
and moves the parameters by Levenberg and Marquardt with exact sensitivities; the delay is one of them, and
continuous. `published` is (15): least squares on differentiated velocities, with (8) and (9) corrected (the
velocity stands in (8), the acceleration in (9)). Noise in the regressors biases it badly (0.01 m/s: by most
of the drag), which is why it is not the default.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from noctule.errors import NoctuleError
from noctule.estimation.compiled import compiled
from noctule.estimation.vehicle_model import VehicleModel
from noctule.geometry import Array

AXES = ("forward", "left", "up", "yaw")
LONGEST_DELAY = 0.4  # [s], where a search begins last


class IdentificationError(NoctuleError):
    """A flight from which no model can be identified."""


@dataclass(frozen=True, slots=True)
class AxisFlight:
    """One axis of a flight: what was sent and what was measured."""

    command_stamps: Array  # (m,) [s], when each input was sent; it is held until the next
    inputs: Array  # (m,)
    stamps: Array  # (n,) [s], of the measured velocities
    velocities: Array  # (n,) [m/s or rad/s], on the body's axis
    axis: str = "axis"  # for messages

    def __post_init__(self) -> None:
        """Refuse what cannot be identified from."""
        for name in ("command_stamps", "inputs", "stamps", "velocities"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64))
        n, m = self.stamps.size, self.inputs.size
        if self.velocities.size != n or self.command_stamps.size != m or n < 20 or m < 2:
            raise IdentificationError(
                f"identification of {self.axis}: {m} inputs at {self.command_stamps.size} stamps, "
                f"{self.velocities.size} velocities at {n} stamps; expected as many of both, "
                "at least 2 inputs and 20 velocities"
            )
        finite = all(np.isfinite(a).all() for a in (self.inputs, self.velocities))
        if not (finite and (np.diff(self.stamps) > 0.0).all() and (np.diff(self.command_stamps) > 0.0).all()):
            raise IdentificationError(
                f"identification of {self.axis}: expected finite numbers with stamps that increase"
            )
        if np.ptp(self.inputs) <= 0.0:
            raise IdentificationError(
                f"identification of {self.axis}: its input is {self.inputs[0]:g} throughout; "
                "expected one that varies: fly the deformed sinusoid"
            )


@dataclass(frozen=True, slots=True)
class AxisFit:
    """The parameters of one axis with the deviations of their errors."""

    k_u: float  # acceleration per unit of input
    k_v: float  # [1/s]
    k_u_sd: float
    k_v_sd: float
    residual_sd: float  # [m/s or rad/s]


@dataclass(frozen=True, slots=True)
class Identification:
    """What a flight says of the vehicle."""

    axes: tuple[AxisFit, ...]  # forward, left, up, yaw
    delay: float  # [s]
    delay_sd: float  # [s]

    @property
    def k(self) -> Array:
        """k1 to k8, (8,)."""
        return np.array([k for fit in self.axes for k in (fit.k_u, fit.k_v)])

    @property
    def sd(self) -> Array:
        """Deviations of k1 to k8, (8,)."""
        return np.array([k for fit in self.axes for k in (fit.k_u_sd, fit.k_v_sd)])

    def model(self) -> VehicleModel:
        """Return what the filter predicts with."""
        return VehicleModel.identified(self.k, max(0.0, self.delay))


@compiled
def response(
    k_u: float, k_v: float, delay: float, v0: float, command_stamps: Array, inputs: Array, stamps: Array
) -> tuple[Array, Array]:
    """Return the velocities at `stamps` (n,) and their derivatives by k_u, k_v, delay and v0, (n, 4).

    `v0` is the velocity at the first stamp. Before the first command the input is 0. Exact: between two
    commands the equation is solved in closed form, and a later start of a step of the input takes what the
    step had done so far away from the velocity.
    """
    n, m = stamps.size, inputs.size
    v, J = np.empty(n), np.empty((n, 4))
    now, u, j = stamps[0], 0.0, 0
    while j < m and command_stamps[j] + delay <= now:
        u = inputs[j]
        j += 1
    value, by_u, by_v, by_delay, by_v0 = v0, 0.0, 0.0, 0.0, 1.0
    for i in range(n):
        while True:
            change = command_stamps[j] + delay if j < m else np.inf
            until = min(change, stamps[i])
            dt = until - now
            z = k_v * dt
            e = math.exp(-z)
            if abs(z) < 1e-4:  # below, the closed forms cancel
                g = dt * (1.0 - z / 2.0 + z * z / 6.0)
                g_v = -dt * dt * (0.5 - z / 3.0 + z * z / 8.0)
            else:
                g = -math.expm1(-z) / k_v
                g_v = (dt * e - g) / k_v
            by_v = e * by_v - dt * e * value + g_v * k_u * u
            by_u = e * by_u + g * u
            by_delay *= e
            by_v0 *= e
            value = e * value + g * k_u * u
            now = until
            if change > stamps[i]:
                break
            by_delay -= k_u * (inputs[j] - u)
            u = inputs[j]
            j += 1
        v[i] = value
        J[i, 0], J[i, 1], J[i, 2], J[i, 3] = by_u, by_v, by_delay, by_v0
    return v, J


def _stacked(parameters: Array, flights: Sequence[AxisFlight]) -> tuple[Array, Array]:
    """Return residuals (all,) and their Jacobian (all, 1 + 4 axes).

    The parameters are the delay, then of each axis k_u, k_v, v0 and bias.
    """
    residuals, rows = [], []
    for a, flight in enumerate(flights):
        k_u, k_v, v0, bias = parameters[1 + 4 * a : 5 + 4 * a]
        v, J = response(k_u, k_v, parameters[0], v0, flight.command_stamps, flight.inputs, flight.stamps)
        block = np.zeros((v.size, parameters.size))
        block[:, 0] = J[:, 2]
        block[:, 1 + 4 * a : 4 + 4 * a] = J[:, [0, 1, 3]]
        block[:, 4 + 4 * a] = 1.0
        residuals.append(v + bias - flight.velocities)
        rows.append(block)
    return np.concatenate(residuals), np.concatenate(rows)


def _least_squares(
    start: Array, flights: Sequence[AxisFlight], weights: Array, iterations: int = 200
) -> tuple[Array, float]:
    """Return the parameters of least weighted squares near `start`, and the sum, by Levenberg-Marquardt."""
    p, damping = start, 1e-3
    r, J = _stacked(p, flights)
    cost = float(np.sum((weights * r) ** 2))
    for _ in range(iterations):
        W = J * weights[:, None]
        A, b = W.T @ W, W.T @ (weights * r)
        step = np.linalg.solve(A + damping * np.diag(np.diag(A) + 1e-12), -b)
        tried = p + step
        valid = abs(tried[0]) < 1.0 and bool((tried[2::4] > -0.5).all())
        r1, J1 = _stacked(tried, flights) if valid else (r, J)
        cost1 = float(np.sum((weights * r1) ** 2)) if valid else math.inf
        if cost1 < cost:
            small = bool(np.all(np.abs(step) <= 1e-12 * (1e-3 + np.abs(p))))
            p, r, J, cost, damping = tried, r1, J1, cost1, max(1e-12, damping / 10.0)
            if small:
                break
        else:
            damping *= 10.0
            if damping > 1e12:
                break
    return p, cost


def identify(flights: Sequence[AxisFlight]) -> Identification:
    """Identify axes that were flown one by one, with the delay common to all. Raises IdentificationError.

    Beside k_u, k_v and the delay each axis has the velocity at its beginning and a constant bias of the
    sensor as unknowns, so neither ends up in the drag. Deviations are those of the estimate's covariance
    s^2 (J' J)^-1, which for white noise is the Cramer-Rao bound at the estimate.
    """
    if not flights:
        raise IdentificationError("identification: no axis was flown; expected at least one")
    alone = [_best_alone(flight) for flight in flights]
    # Each axis is weighed by its own noise, which its residuals say.
    sds = [_noise(p, flight) for p, flight in zip(alone, flights, strict=True)]
    weights = np.concatenate([np.full(f.stamps.size, 1.0 / sd) for f, sd in zip(flights, sds, strict=True)])
    delay = float(np.median([p[0] for p in alone]))
    start = np.concatenate([[delay], *(p[1:] for p in alone)])
    best, least = _least_squares(start, flights, weights)
    r, J = _stacked(best, flights)
    W = J * weights[:, None]
    freedom = r.size - best.size
    covariance = np.linalg.pinv(W.T @ W, hermitian=True) * (least / freedom)
    sd = np.sqrt(np.diag(covariance))
    fits, begin = [], 0
    for a, flight in enumerate(flights):
        here = r[begin : begin + flight.stamps.size]
        begin += flight.stamps.size
        c = 1 + 4 * a
        noise = float(np.sqrt(np.mean(here**2)))
        fits.append(AxisFit(float(best[c]), float(best[c + 1]), float(sd[c]), float(sd[c + 1]), noise))
    return Identification(tuple(fits), float(best[0]), float(sd[0]))


def _best_alone(flight: AxisFlight) -> Array:
    """Return delay, k_u, k_v, v0, bias of one axis: the best of searches that begin at several delays."""
    weights = np.ones(flight.stamps.size)
    best, least = None, math.inf
    for delay in (0.0, 0.5 * LONGEST_DELAY, LONGEST_DELAY):
        start = np.array([delay, 1.0, 1.0, flight.velocities[0], 0.0])
        p, cost = _least_squares(start, [flight], weights, 60)
        if cost < least:
            best, least = p, cost
    if best is None:
        raise IdentificationError(
            f"identification of {flight.axis}: no model fits; are inputs and velocities of the same flight?"
        )
    return best


def _noise(parameters: Array, flight: AxisFlight) -> float:
    r, _ = _stacked(parameters, [flight])
    # Noise-free data leave nothing but rounding: then all axes weigh the same.
    return max(float(np.sqrt(np.mean(r**2))), 1e-9 * float(np.abs(flight.velocities).max()))


def cramer_rao(
    model: VehicleModel, flights: Sequence[AxisFlight], noise: float, axes: Sequence[int] = (0, 1, 2, 3)
) -> tuple[Array, float]:
    """Return the least deviations that an unbiased estimate can have: of each axis' k_u, k_v; of the delay.

    `model` is the truth, `noise` the deviation of each velocity [m/s, rad/s], white, `axes` which axis of the
    model each flight is of; velocities at the beginning and biases are unknown too.
    """
    p = np.zeros(1 + 4 * len(flights))
    p[0] = model.delay
    for a, (axis, flight) in enumerate(zip(axes, flights, strict=False)):
        p[1 + 4 * a : 4 + 4 * a] = model.input_gains[axis], model.drags[axis], flight.velocities[0]
    _, J = _stacked(p, flights)
    sd = noise * np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    return np.array([s for a in range(len(flights)) for s in sd[1 + 4 * a : 3 + 4 * a]]), float(sd[0])


def published(flight: AxisFlight) -> AxisFit:
    """Return the least squares (15) of one axis: u = acceleration / k_u + velocity k_v / k_u.

    It knows no delay. Eq. (6) to (10) reduce to this on the axes of a vehicle that does not turn while it
    is identified.
    """
    a = np.gradient(flight.velocities, flight.stamps)
    G = np.column_stack([a, flight.velocities])
    held = np.searchsorted(flight.command_stamps, flight.stamps, side="right") - 1
    u = np.where(held >= 0, flight.inputs[np.maximum(held, 0)], 0.0)
    inverse = np.linalg.pinv(G.T @ G, hermitian=True)
    theta = inverse @ (G.T @ u)
    residual = u - G @ theta
    covariance = inverse * float(residual @ residual) / (u.size - 2)
    k_u, k_v = 1.0 / theta[0], theta[1] / theta[0]
    D = np.array([[-(k_u**2), 0.0], [-k_u * k_v, k_u]])
    sd = np.sqrt(np.diag(D @ covariance @ D.T))
    return AxisFit(float(k_u), float(k_v), float(sd[0]), float(sd[1]), float(np.std(residual)))


def fit_of(fit: AxisFit, delay: float, flight: AxisFlight) -> float:
    """Return how well parameters explain another flight: 1 - |error| / |velocity - mean|; 1 is perfect."""
    p = np.array([delay, fit.k_u, fit.k_v, flight.velocities[0], 0.0])
    for _ in range(2):  # v0 and bias are the flight's own and enter linearly
        r, J = _stacked(p, [flight])
        p[3:] -= np.linalg.lstsq(J[:, 3:], r, rcond=None)[0]
    r, _ = _stacked(p, [flight])
    spread = flight.velocities - flight.velocities.mean()
    return 1.0 - float(np.linalg.norm(r) / np.linalg.norm(spread))
