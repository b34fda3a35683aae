"""The least deviations that any unbiased estimate can have: the Cramer-Rao bound."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from noctule.estimation.identification.covariance import inverse
from noctule.estimation.identification.flights import AxisFlight, Flight, axes_of
from noctule.estimation.identification.noise import Noise, whitened
from noctule.estimation.identification.output_error import SHARED, active, own_parameters, residuals
from noctule.estimation.vehicle_model import VehicleModel
from noctule.geometry import Array


def cramer_rao(
    model: VehicleModel,
    flights: Sequence[Flight],
    noise: float,
    *,
    own_known: bool = False,
    heading: float | None = None,
) -> tuple[Array, float]:
    """Return the bounds of k1 to k8 (8,), NaN of an axis that was not moved, and of the delay [s].

    `model` is the truth, `noise` the deviation of each velocity [m/s, rad/s], white. Velocities at the
    beginning and biases are unknown too, unless `own_known`. With `heading` [rad], the deviation of the white
    noise of headings, that is the noise of means between them instead of `noise`, which then is above 0.
    """
    p = np.zeros(SHARED + sum(own_parameters(flight) for flight in flights))
    p[0] = model.delay
    p[1:SHARED:2], p[2:SHARED:2] = model.input_gains, model.drags
    chosen = active(flights)
    if own_known:
        chosen = chosen[chosen < SHARED]
    _, J = residuals(p, flights)
    sd = np.full(p.size, np.nan)
    # In units of `noise`, so that there is a bound of 0 without noise.
    noises = [
        Noise.of_heading(heading / noise, flight)
        if heading is not None and isinstance(flight, AxisFlight) and flight.means
        else Noise(1.0)
        for flight in flights
        for _ in axes_of(flight)
    ]
    W = whitened(flights, noises, J[:, chosen])
    sd[chosen] = noise * np.sqrt(np.diag(inverse(W.T @ W)))
    return sd[1:SHARED], float(sd[0])
