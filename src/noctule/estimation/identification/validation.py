"""How well a model foretells a flight that it was not identified from: all axes, from commands alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from noctule.estimation.identification.flights import AXES, Flight, IdentificationError, WholeFlight, channels
from noctule.estimation.identification.noise import noises_of, unit_noises, whitened
from noctule.estimation.identification.output_error import SHARED, own_parameters, predict
from noctule.estimation.identification.response import response
from noctule.estimation.identification.result import Identification
from noctule.geometry import Array

SPAN = 0.5  # [s]
_STEPS = 4  # of Gauss and Newton; nearly all of it is linear


@dataclass(frozen=True, slots=True)
class Validation:
    """A flight as it was measured and as the model has it; the drawing of Figs. 14 and 15.

    The yaw rate is a mean over SPAN: vehicles report their heading, and its noise alone is larger than the
    rate between two reports.
    """

    command_stamps: Array  # (m,) [s]
    inputs: Array  # (m, 4)
    stamps: Array  # (n,) [s]
    measured: Array  # (n, 4) [m/s, rad/s], forward, left, up, yaw rate; NaN where there is none
    simulated: Array  # (n, 4)
    moved: tuple[bool, ...]  # which axes had inputs that varied

    @property
    def fit(self) -> Array:
        """Of each axis 1 - |measured - simulated| / |measured - mean|, (4,); 1 is perfect, NaN: not moved.

        Only the time between the first and the last change of the axis' own input counts.
        """
        found = np.full(4, np.nan)
        for a in range(4):
            changes = self.command_stamps[1:][np.diff(self.inputs[:, a]) != 0.0]
            if changes.size:
                during = (self.stamps >= changes[0]) & (self.stamps <= changes[-1])
                seen = during & np.isfinite(self.measured[:, a])
                spread = self.measured[seen, a] - self.measured[seen, a].mean()
                off = self.measured[seen, a] - self.simulated[seen, a]
                found[a] = 1.0 - float(np.linalg.norm(off) / np.linalg.norm(spread))
        return found


def validate(found: Identification, flight: WholeFlight) -> Validation:
    """Simulate a flight with an identified model: eq. (2) on the axes of a vehicle that turns.

    The heading that turns the horizontal axes is simulated too. Of the measurements nothing is used but the
    velocity at the beginning, the sensors' constant biases and how much later the yaw is than the
    velocities, which are the flight's own. Raises
    IdentificationError when an axis was moved that was not identified.
    """
    shared = np.zeros(SHARED)
    shared[0] = found.delay
    for fit in found.axes:
        a = AXES.index(fit.axis)
        shared[1 + 2 * a : 3 + 2 * a] = fit.k_u, fit.k_v
    unknown = [name for name, moved in zip(AXES, flight.moved, strict=True) if moved]
    unknown = [name for name in unknown if name not in [fit.axis for fit in found.axes]]
    if unknown:
        raise IdentificationError(
            f"validation: the flight moves {' and '.join(unknown)}, which was not identified; "
            "expected a model of that axis too"
        )
    n = flight.stamps.size
    measured = np.column_stack([flight.velocities, np.full(n, np.nan)])
    simulated = np.zeros((n, 4))
    simulated[:, :3] = flight.velocities.mean(axis=0)
    yaw = flight.yaw
    if flight.moved[3]:
        turning = flight.yaw_flight()
        own, v = _simulate(turning, shared)
        measured[:, 3], simulated[:, 3] = (
            _means(flight.stamps, rates) for rates in (turning.velocities, v[0])
        )
        _, _, x, _ = response(
            shared[7], shared[8], shared[0], own[0], flight.command_stamps, flight.inputs[:, 3], flight.stamps
        )
        yaw = flight.yaw[0] + x
    if flight.moved[0] or flight.moved[1]:
        _, v = _simulate(replace(flight.plane_flight(), yaw=yaw), shared)
        simulated[:, :2] = v.T
    if flight.moved[2]:
        simulated[:, 2] = _simulate(flight.up_flight(), shared)[1][0]
    return Validation(flight.command_stamps, flight.inputs, flight.stamps, measured, simulated, flight.moved)


def _means(stamps: Array, rates: Array) -> Array:
    """Return mean rates (n,) over SPAN about each stamp of those in between (n - 1,); NaN at the ends."""
    way = np.concatenate([[0.0], np.cumsum(rates * np.diff(stamps))])
    found = (np.interp(stamps + 0.5 * SPAN, stamps, way) - np.interp(stamps - 0.5 * SPAN, stamps, way)) / SPAN
    found[(stamps - 0.5 * SPAN < stamps[0]) | (stamps + 0.5 * SPAN > stamps[-1])] = np.nan
    return np.asarray(found)


def _simulate(flight: Flight, shared: Array) -> tuple[Array, Array]:
    """Return the flight's own parameters and the velocities (axes, n) with them."""
    own = np.zeros(own_parameters(flight))
    noises = unit_noises(flight)
    for _ in range(_STEPS):
        v, J = predict(flight, shared, own)
        r = channels(flight) - v
        left = whitened([flight], noises, np.column_stack([r.ravel(), J[..., SHARED:].reshape(r.size, -1)]))
        own = own + np.linalg.lstsq(left[:, 1:], left[:, 0], rcond=None)[0]
        noises = noises_of(flight, channels(flight) - predict(flight, shared, own)[0], own.size)
    return own, predict(flight, shared, own)[0]
