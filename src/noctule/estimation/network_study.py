"""Made-up flights that show what the network is worth: is it the central filter, does it know its errors.

The truth is drawn from the very model that the filters use, so what is seen is the filters' own doing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from noctule.estimation.chi_square import nees, nees_band
from noctule.estimation.delayed import FilterSettings
from noctule.estimation.events import Input
from noctule.estimation.filter_state import YAW, Prior, StateEstimate, start_at
from noctule.estimation.kalman_filter import correct, predict
from noctule.estimation.matrices import cholesky
from noctule.estimation.measurements import Component, Measurement, linearise
from noctule.estimation.network import LinkSettings, Network, Node
from noctule.estimation.vehicle_model import ProcessNoise, VehicleModel, process_covariance, transition
from noctule.geometry import Array, wrap_angle

NODES = ("onboard", "depth", "markers", "fusion")
_C = Component
_PARTS = {
    "onboard": np.array([_C.FORWARD, _C.LEFT, _C.UP, _C.Z, _C.HEADING], dtype=np.int64),
    "depth": np.array([_C.X, _C.Y, _C.Z, _C.YAW], dtype=np.int64),
    "markers": np.array([_C.YAW], dtype=np.int64),
}
_SD = {
    "onboard": np.array([0.06, 0.06, 0.06, 0.025, 0.05]),
    "depth": np.array([0.006, 0.006, 0.008, 0.03]),
    "markers": np.array([0.04]),
}
_PERIOD = {"onboard": (0.015, 0.036), "depth": (0.033, 0.034), "markers": (0.05, 0.09)}  # [s]
_LATE = {"onboard": (0.042, 0.09), "depth": (0.04, 0.04), "markers": (0.04, 0.06)}  # [s]
_COMMAND_PERIOD = 0.1  # [s]
PRIOR = Prior(position=0.5, yaw=0.2, velocity=0.1, yaw_rate=0.1, heading_bias=0.2, velocity_bias=0.03)


@dataclass(frozen=True, slots=True)
class Flight:
    """What happened and what was measured."""

    start: StateEstimate  # what is known at first
    inputs: tuple[Input, ...]
    measurements: tuple[Measurement, ...]  # by their stamps
    arrivals: Array  # (len(measurements),) [s]
    truths: Array  # (len(measurements), n) the state at each


def made_up_flight(
    steps: int, seed: int | Sequence[int], model: VehicleModel, noise: ProcessNoise, size: int = 11
) -> Flight:
    """Draw a flight with `steps` measurements of three sensors that keep no common time."""
    rng = np.random.default_rng(seed)
    start = start_at(0.0, np.zeros(3), 0.0, PRIOR, size)
    truth = start.sd * rng.standard_normal(size)
    stamps = {name: rng.uniform(0.0, period[1]) for name, period in _PERIOD.items()}
    inputs, measurements, arrivals, truths = [Input(0.0, np.zeros(4))], [], [], []
    now, u, next_command = 0.0, np.zeros(4), _COMMAND_PERIOD
    for k in range(steps):
        name = min(stamps, key=stamps.__getitem__)
        while next_command < stamps[name]:
            truth = _drawn(truth, next_command - now, u, model, noise, rng)
            now, u = next_command, np.clip(0.8 * u + 0.06 * rng.standard_normal(4), -1.0, 1.0)
            inputs.append(Input(now - model.delay, u, sequence=len(inputs)))
            next_command += _COMMAND_PERIOD
        truth = _drawn(truth, stamps[name] - now, u, model, noise, rng)
        now = stamps[name]
        measurements.append(_measured(name, k, now, truth, rng))
        truths.append(truth)
        arrivals.append(now + rng.uniform(*_LATE[name]))
        stamps[name] += rng.uniform(*_PERIOD[name])
    return Flight(start, tuple(inputs), tuple(measurements), np.array(arrivals), np.array(truths))


def _drawn(
    x: Array, dt: float, u: Array, model: VehicleModel, noise: ProcessNoise, rng: np.random.Generator
) -> Array:
    if dt <= 0.0:
        return x
    x1, _ = transition(x, dt, u, model.input_gains, model.drags)
    Q = process_covariance(0.5 * (x[YAW] + x1[YAW]), dt, model.drags, noise.densities, x.size)
    drawn: Array = x1 + cholesky(Q) @ rng.standard_normal(x.size)
    return drawn


def _measured(name: str, k: int, now: float, truth: Array, rng: np.random.Generator) -> Measurement:
    parts, sd = _PARTS[name], _SD[name]
    expected, _ = linearise(truth, parts, np.zeros(parts.size))
    z = sd * rng.standard_normal(parts.size) - expected
    for a in np.flatnonzero((parts == _C.YAW) | (parts == _C.HEADING)):
        z[a] = wrap_angle(float(z[a]))
    return Measurement(now, parts, z, np.diag(sd**2), name, k)


def difference_to_central(steps: int, seed: int = 0, size: int = 11) -> float:
    """Return the largest difference in any number between any node and the central Kalman filter.

    Complete communication, asynchronous measurements in order, no gates; means and covariances over all
    `steps`.
    """
    model, settings = VehicleModel.identified(), FilterSettings(gate=None)
    flight = made_up_flight(steps, seed, model, settings.noise, size)
    network = Network([Node(name, flight.start, model, settings) for name in NODES])
    x, P, now, u = flight.start.x, flight.start.P, 0.0, np.zeros(4)
    gains, drags, densities = model.input_gains, model.drags, settings.noise.densities
    commands, worst = list(reversed(flight.inputs)), 0.0
    for z in flight.measurements:
        while commands and commands[-1].stamp <= z.stamp:
            command = commands.pop()
            network.command(command, z.stamp)
            if command.stamp > now:
                x, P = predict(x, P, command.stamp - now, u, gains, drags, densities)
            now, u = command.stamp, np.zeros(4) if command.u is None else command.u
        x, P = predict(x, P, z.stamp - now, u, gains, drags, densities)
        now = z.stamp
        x, P = correct(x, P, *linearise(x, z.components, z.z), z.R)
        network.deliver(now)
        network.measure(z.source, z, now)
        network.deliver(now)
        for node in network.nodes.values():
            here = node.estimate(now)
            worst = max(worst, float(np.abs(here.x - x).max()), float(np.abs(here.P - P).max()))
    return worst


@dataclass(frozen=True, slots=True)
class Consistency:
    """Whether the nodes know how wrong they are."""

    nees_per_state: dict[str, float]  # node -> mean over the flights, 1 when it does
    band: tuple[float, float]  # where the mean lies in 95 of 100 such studies


def consistency(loss: float, flights: int, steps: int, seed: int = 0, size: int = 11) -> Consistency:
    """Fly `flights` times with a share of messages lost, the others late or doubled; judge the last estimate.

    One estimate of each flight and node: within a flight the errors are not independent.
    """
    model, settings = VehicleModel.identified(delay=0.02), FilterSettings()
    links = LinkSettings(loss=loss, duplicates=0.1, delay=0.001, jitter=0.01)
    found: dict[str, list[float]] = {name: [] for name in NODES}
    for k in range(flights):
        flight = made_up_flight(steps, (seed, k), model, settings.noise, size)
        network = Network([Node(name, flight.start, model, settings) for name in NODES], links, (seed, k))
        commands = list(reversed(flight.inputs))
        for m in np.argsort(flight.arrivals, kind="stable"):
            now, z = float(flight.arrivals[m]), flight.measurements[m]
            while commands and commands[-1].stamp <= now:
                network.command(commands.pop(), now)
            network.deliver(now)
            network.measure(z.source, z, now)
        network.deliver(math.inf)
        for name, node in network.nodes.items():
            end = flight.measurements[-1].stamp
            found[name].append(nees(node.estimate(end), flight.truths[-1]) / size)
    means = {name: float(np.mean(values)) for name, values in found.items()}
    return Consistency(means, nees_band(flights, size))
