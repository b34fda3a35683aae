"""Measurements in any order, doubled, late and lost: still definite, still no worse than the best sensor.

The best single sensor at a moment is the one that was off least of those whose measurement of that moment,
or newest before it, was used. The estimate's own bound are five of the deviations that it tells.
"""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.estimation.delayed import DelayedFilter, FilterSettings
from noctule.estimation.measurements import Component, Measurement
from noctule.estimation.network import LinkSettings, Network, Node
from noctule.estimation.network_study import NODES, made_up_flight
from noctule.estimation.vehicle_model import VehicleModel
from noctule.geometry import wrap_angle

MODEL, SETTINGS = VehicleModel.identified(delay=0.02), FilterSettings()
STEPS, BOUND = 120, 5.0
MEASURED = {
    "depth": (Component.X, Component.Y, Component.Z, Component.YAW),
    "markers": (Component.YAW,),
    "onboard": (Component.Z,),
}
"""What each sensor measures directly."""


def off(z: Measurement, truth, component: Component) -> float:
    """Return how far a measurement is off in one number."""
    error = float(z.z[z.components == component][0] - truth[component])
    return abs(wrap_angle(error)) if component is Component.YAW else abs(error)


def require_definite(known) -> None:
    assert np.isfinite(known.x).all()
    assert np.array_equal(known.P, known.P.T)
    assert np.linalg.eigvalsh(known.P)[0] > 0.0


def require_no_worse(known, truth, flight, used: dict[str, int]) -> None:
    """Compare an estimate with the newest measurement of every sensor, `used` source -> number."""
    for component in MEASURED["depth"]:
        errors = [
            off(flight.measurements[k], flight.truths[k], component)
            for source, k in used.items()
            if component in MEASURED[source]
        ]
        error = float(known.x[component] - truth[component])
        error = abs(wrap_angle(error)) if component is Component.YAW else abs(error)
        if errors:
            assert error <= min(errors) + BOUND * known.sd[component]


def require_as_certain(known, z: Measurement) -> None:
    """Information only adds up: at its stamp nobody knows less than the sensor that was used."""
    for component in MEASURED[z.source]:
        row = int(np.flatnonzero(z.components == component)[0])
        assert known.P[component, component] <= z.R[row, row] * (1.0 + 1e-9)


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10_000),
    st.floats(0.0, 0.9),
    st.floats(0.0, 1.5),
    st.floats(0.0, 0.5),
    st.randoms(use_true_random=False),
)
def test_a_filter_stays_definite_and_no_worse_than_the_best_sensor(seed, loss, lateness, doubled, chance):
    flight = made_up_flight(STEPS, seed, MODEL, SETTINGS.noise)
    filter_ = DelayedFilter(flight.start, MODEL, SETTINGS)
    arriving = [(c.stamp, k, c) for k, c in enumerate(flight.inputs)]
    for k, z in enumerate(flight.measurements):
        for _ in range(int(chance.random() >= loss) * (1 + int(chance.random() < doubled))):
            arriving.append((z.stamp + lateness * chance.random(), len(arriving) + k, z))
    used: dict[str, int] = {}
    for _, _, event in sorted(arriving, key=lambda entry: entry[:2]):
        before = sum(filter_.refusals.values())
        if not filter_.insert(event):
            continue
        require_definite(filter_.estimate())
        if not isinstance(event, Measurement):
            continue
        here = filter_.estimate(event.stamp)
        require_definite(here)
        if sum(filter_.refusals.values()) == before:
            require_as_certain(here, event)
            used[event.source] = max(used.get(event.source, -1), event.sequence)
            newest = max(used.values())
            if flight.measurements[newest].stamp >= filter_.oldest:
                known = filter_.estimate(flight.measurements[newest].stamp)
                require_no_worse(known, flight.truths[newest], flight, used)


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10_000),
    st.floats(0.0, 0.9),
    st.floats(0.0, 1.0),
    st.floats(0.0, 0.3),
    st.floats(0.0, 0.5),
)
def test_every_node_stays_definite_and_no_worse_than_its_own_sensor(seed, loss, doubled, delay, jitter):
    flight = made_up_flight(STEPS, seed, MODEL, SETTINGS.noise)
    links = LinkSettings(loss=loss, duplicates=doubled, delay=delay, jitter=jitter)
    network = Network([Node(name, flight.start, MODEL, SETTINGS) for name in NODES], links, seed)
    commands = list(reversed(flight.inputs))
    newest: dict[str, int] = {}
    for m in np.argsort(flight.arrivals, kind="stable"):
        now, z = float(flight.arrivals[m]), flight.measurements[m]
        while commands and commands[-1].stamp <= now:
            network.command(commands.pop(), now)
        network.deliver(now)
        node = network.nodes[z.source]
        refused = sum(node.refusals.values())
        shared = network.measure(z.source, z, now)
        for one in network.nodes.values():
            require_definite(one.estimate(now))
        if shared is not None and sum(node.refusals.values()) == refused:
            newest[z.source] = int(m)
            require_as_certain(node.estimate(z.stamp), z)
            own = {z.source: newest[z.source]}
            require_no_worse(node.estimate(z.stamp), flight.truths[m], flight, own)
    network.deliver(math.inf)
    end = flight.measurements[-1].stamp
    for one in network.nodes.values():
        require_definite(one.estimate(end))
