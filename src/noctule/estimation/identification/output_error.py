"""k1 to k8 and the delay by output error: the velocities of eq. (2) against those that were measured.

Eq. (2) is solved exactly from command to command (see `response`), and the parameters are moved by
Levenberg and Marquardt with exact sensitivities; the delay is one of them, and continuous. Noise is taken to
be on what is measured, as it is: (15), which differentiates it, is in `published`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from noctule.estimation.identification.covariance import correlation, deviations
from noctule.estimation.identification.flights import (
    AXES,
    NOTHING_FLOWN,
    AxisFlight,
    Flight,
    IdentificationError,
    axes_of,
    channels,
    moved_axes,
)
from noctule.estimation.identification.noise import Noise, noises_of, unit_noises, whitened
from noctule.estimation.identification.response import plane_response, response
from noctule.estimation.identification.result import AxisFit, Identification
from noctule.geometry import Array

SHARED = 9
"""Parameters that flights have in common: the delay, then k1 to k8."""
_DELAYS = (0.0, 0.2, 0.4)  # [s], where searches begin
_LONGEST_DELAY = 1.0  # [s]
_LEAST_DRAG = -0.5  # [1/s], below lies no vehicle
CLOSEST = 1e-5  # of k1 to k8: no vehicle is held to follow eq. (2) better, nor to be known so
CLOSEST_DELAY = 1e-5  # [s]


def own_parameters(flight: Flight) -> int:
    """Return how many parameters are the flight's own.

    Velocity at the first stamp and bias of each axis; of `means`, how much later their sensor is, too.
    """
    return 2 * len(axes_of(flight)) + has_lag(flight)


def has_lag(flight: Flight) -> bool:
    """Whether a flight was measured by a sensor that may be later than others."""
    return isinstance(flight, AxisFlight) and flight.means


def predict(flight: Flight, shared: Array, own: Array) -> tuple[Array, Array]:
    """Return the velocities that are to be measured (axes, n) and their derivatives (axes, n, 9 + own).

    `shared` (9,) is the delay and k1 to k8, `own` what `own_parameters` counts, in that order.
    """
    if isinstance(flight, AxisFlight):
        a = AXES.index(flight.axis)
        k_u, k_v = shared[1 + 2 * a], shared[2 + 2 * a]
        delay = shared[0] + (own[2] if flight.means else 0.0)
        v, by, x, x_by = response(
            k_u, k_v, delay, own[0], flight.command_stamps, flight.inputs, flight.stamps
        )
        if flight.means:
            dt = np.diff(flight.stamps)
            v, by = np.diff(x) / dt, np.diff(x_by, axis=0) / dt[:, None]
        J = np.zeros((1, v.size, SHARED + own.size))
        J[0, :, [1 + 2 * a, 2 + 2 * a, 0, SHARED]] = by.T
        J[0, :, SHARED + 1] = 1.0
        J[0, :, SHARED + 2 :] = by[:, 2:3]
        return v[None] + own[1], J
    v, by = plane_response(
        shared[1:5], shared[0], own[:2], flight.command_stamps, flight.inputs, flight.stamps, flight.yaw
    )
    J = np.zeros((2, v.shape[1], SHARED + own.size))
    J[:, :, [1, 2, 3, 4, 0, SHARED, SHARED + 1]] = by
    J[0, :, SHARED + 2] = 1.0
    J[1, :, SHARED + 3] = 1.0
    return v + own[2:, None], J


def residuals(parameters: Array, flights: Sequence[Flight]) -> tuple[Array, Array]:
    """Return predicted less measured (all,) and its Jacobian (all, parameters).

    The parameters are the shared ones, then each flight's own.
    """
    rows, blocks = [], []
    at = SHARED
    for flight in flights:
        own = own_parameters(flight)
        v, J = predict(flight, parameters[:SHARED], parameters[at : at + own])
        rows.append((v - channels(flight)).ravel())
        block = np.zeros((rows[-1].size, parameters.size))
        block[:, :SHARED] = J[..., :SHARED].reshape(-1, SHARED)
        block[:, at : at + own] = J[..., SHARED:].reshape(-1, own)
        blocks.append(block)
        at += own
    return np.concatenate(rows), np.concatenate(blocks)


def active(flights: Sequence[Flight]) -> Array:
    """Return the indices of the parameters that the flights say something about.

    A sensor is later than others only where there are others.
    """
    axes = sorted({a for flight in flights for a in moved_axes(flight)})
    own = np.cumsum([SHARED, *(own_parameters(flight) for flight in flights)])
    chosen = [0, *(1 + 2 * a + i for a in axes for i in (0, 1)), *range(SHARED, own[-1])]
    lags = [last - 1 for flight, last in zip(flights, own[1:], strict=True) if has_lag(flight)]
    if len(lags) == len(flights):
        chosen = [i for i in chosen if i not in lags]
    return np.array(chosen)


def identify(flights: Sequence[Flight]) -> Identification:
    """Identify all axes that were moved, with the delay common to all. Raises IdentificationError.

    Beside k_u, k_v and the delay each axis of a flight has the velocity at its beginning and a constant bias
    of the sensor as unknowns, so neither ends up in the drag. Deviations are those of the estimate's
    covariance (J' W J)^-1, each axis weighed by its own noise, which its residuals tell (`noise`); for white
    noise, of velocities or of the heading, that is the Cramer-Rao bound at the estimate. For residuals that
    are not white even so see `covariance`. No deviation is less than CLOSEST of its parameter.
    """
    if not flights:
        raise IdentificationError(NOTHING_FLOWN)
    alone = [_best_alone(flight) for flight in flights]
    start = _start(flights, alone)
    noises = [noise for p, flight in zip(alone, flights, strict=True) for noise in _noises(p, [flight])]
    best, chosen = start, active(flights)
    for _ in range(2):  # what one flight alone cannot tell of its noise, all of them can
        best, _least = _least_squares(best, flights, chosen, noises)
        noises = _noises(best, flights)
    r, J = residuals(best, flights)
    left = whitened(flights, noises, r[:, None])[:, 0]
    sizes = [row.size for flight in flights for row in channels(flight)]
    sd = np.full(best.size, math.nan)
    sd[chosen] = deviations(whitened(flights, noises, J[:, chosen]), left, sizes)
    sd[0] = math.hypot(sd[0], CLOSEST_DELAY)
    sd[1:SHARED] = np.hypot(sd[1:SHARED], CLOSEST * best[1:SHARED])
    fits = tuple(_fit(a, best, sd, flights, r, left) for a in range(4) if 1 + 2 * a in chosen)
    return Identification(fits, float(best[0]), float(sd[0]))


def _start(flights: Sequence[Flight], alone: Sequence[Array]) -> Array:
    """Put together what the flights told alone: of each axis the one on which it was moved most."""
    shared = np.ones(SHARED)
    most = np.zeros(4)
    for p, flight in zip(alone, flights, strict=True):
        columns = flight.inputs.reshape(flight.inputs.shape[0], -1)
        for axis, column in zip(axes_of(flight), columns.T, strict=True):
            moved = float(column.var() * column.size)
            if moved > most[axis]:
                most[axis] = moved
                shared[1 + 2 * axis : 3 + 2 * axis] = p[1 + 2 * axis : 3 + 2 * axis]
    shared[0] = np.median([p[0] for p in alone])
    return np.concatenate([shared, *(p[SHARED:] for p in alone)])


def _best_alone(flight: Flight) -> Array:
    """Return the parameters of one flight: the best of searches that begin at several delays."""
    chosen, own = active([flight]), np.zeros(own_parameters(flight))
    first = channels(flight)[:, 0]
    own[: first.size] = first
    best, least = None, math.inf
    for delay in _DELAYS:
        start = np.concatenate([[delay], np.ones(SHARED - 1), own])
        p, cost = _least_squares(start, [flight], chosen, unit_noises(flight), 60)
        if cost < least:
            best, least = p, cost
    if best is None:
        axis = " and ".join(AXES[a] for a in axes_of(flight))
        raise IdentificationError(
            f"identification of {axis}: no model fits; are inputs and velocities of the same flight?"
        )
    return best


def _least_squares(
    start: Array, flights: Sequence[Flight], chosen: Array, noises: Sequence[Noise], iterations: int = 200
) -> tuple[Array, float]:
    """Return the parameters of least weighted squares near `start`, and the sum, by Levenberg-Marquardt."""
    p, damping = start, 1e-3
    products = _products(p, flights, chosen, noises)
    for _ in range(iterations):
        A, b = products[1:, 1:], products[1:, 0]
        step = np.zeros(p.size)
        step[chosen] = np.linalg.solve(A + damping * np.diag(np.diag(A) + 1e-12), -b)
        tried = p + step
        valid = abs(tried[0]) < _LONGEST_DELAY and bool((tried[2:SHARED:2] > _LEAST_DRAG).all())
        small = bool(np.all(np.abs(step) <= 1e-12 * (1e-3 + np.abs(p))))
        found = _products(tried, flights, chosen, noises) if valid else products
        if found[0, 0] < products[0, 0]:
            p, products, damping = tried, found, max(1e-12, damping / 10.0)
        else:
            damping *= 10.0
        if small or damping > 1e12:
            break
    return p, float(products[0, 0])


def _products(p: Array, flights: Sequence[Flight], chosen: Array, noises: Sequence[Noise]) -> Array:
    """Return the products of all columns with each other: residuals first, then derivatives, whitened.

    The first is the sum of squares, the rest of its row the gradient, what is left the normal matrix.
    """
    r, J = residuals(p, flights)
    white = whitened(flights, noises, np.column_stack([r, J[:, chosen]]))
    return np.asarray(white.T @ white)


def _noises(p: Array, flights: Sequence[Flight]) -> list[Noise]:
    """Return the noise of each measured axis of each flight, what was fitted to it taken into account."""
    shared = max(1, active(flights).size - sum(own_parameters(f) for f in flights))
    fitted = 2 + shared / sum(len(axes_of(f)) for f in flights)
    found = []
    for flight, part in zip(flights, _split(p, flights), strict=True):
        r, _ = residuals(part, [flight])
        found += noises_of(flight, r.reshape(channels(flight).shape), fitted)
    return found


def _split(p: Array, flights: Sequence[Flight]) -> list[Array]:
    """Return the parameters of each flight alone."""
    parts, at = [], SHARED
    for flight in flights:
        own = own_parameters(flight)
        parts.append(np.concatenate([p[:SHARED], p[at : at + own]]))
        at += own
    return parts


def _fit(axis: int, p: Array, sd: Array, flights: Sequence[Flight], r: Array, left: Array) -> AxisFit:
    """Return an axis; `r` (all,) are the residuals, `left` the same in units of white noise."""
    rows, white, at = [], [], 0
    for flight in flights:
        for a, row in zip(axes_of(flight), channels(flight), strict=True):
            if a == axis and axis in moved_axes(flight):
                rows.append(r[at : at + row.size])
                white.append(left[at : at + row.size])
            at += row.size
    c = 1 + 2 * axis
    return AxisFit(
        AXES[axis],
        float(p[c]),
        float(p[c + 1]),
        float(sd[c]),
        float(sd[c + 1]),
        math.sqrt(float(np.mean(np.concatenate(rows) ** 2))),
        correlation(np.concatenate(white)),
    )
