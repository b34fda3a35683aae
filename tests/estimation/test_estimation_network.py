"""Nodes agree with the central filter and with each other, and outlive each other's failures."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.estimation.chi_square import nees_band
from noctule.estimation.contributions import Contribution, ContributionError, fault, linear_contribution
from noctule.estimation.delayed import DelayedFilter, FilterSettings
from noctule.estimation.events import Input
from noctule.estimation.filter_state import FilterError, Prior, start_at
from noctule.estimation.gating import surprises
from noctule.estimation.information_filter import assimilate_turned, predict_and_assimilate
from noctule.estimation.kalman_filter import correct, predict
from noctule.estimation.measurements import Component, Measurement
from noctule.estimation.network import Link, LinkSettings, Network, Node, warm_up
from noctule.estimation.network_study import (
    NODES,
    PRIOR,
    consistency,
    difference_to_central,
    made_up_flight,
)
from noctule.estimation.vehicle_model import VehicleModel

MODEL, SETTINGS = VehicleModel.identified(delay=0.02), FilterSettings()
START = start_at(0.0, np.zeros(3), 0.0, PRIOR)


def nodes(start=START, options=SETTINGS):
    return [Node(name, start, MODEL, options) for name in NODES]


def fly(network, flight, frozen=frozenset(), until=np.inf, since=-np.inf):
    """Hand out a flight as it arrives; frozen nodes neither measure nor receive."""
    commands = [c for c in reversed(flight.inputs) if c.stamp > since]
    for m in np.argsort(flight.arrivals, kind="stable"):
        now, z = float(flight.arrivals[m]), flight.measurements[m]
        if not since < now <= until:
            continue
        while commands and commands[-1].stamp <= now:
            network.command(commands.pop(), now)
        network.deliver(now, frozen)
        if z.source not in frozen:
            network.measure(z.source, z, now)


def yaw(z, stamp, sequence=0, source="markers", sd=0.05):
    return Measurement(stamp, np.array([Component.YAW]), np.array([z]), np.array([[sd**2]]), source, sequence)


@pytest.mark.parametrize("size", [8, 11])
def test_every_node_is_the_central_kalman_filter_with_complete_communication(size):
    assert difference_to_central(2000, seed=0, size=size) < 1e-9


def test_with_gates_every_node_is_the_central_filter_with_gates():
    flight = made_up_flight(300, 1, MODEL, SETTINGS.noise)
    network, central = Network(nodes(flight.start)), DelayedFilter(flight.start, MODEL, SETTINGS)
    commands = list(reversed(flight.inputs))
    rng = np.random.default_rng(0)
    for z in flight.measurements:
        while commands and commands[-1].stamp <= z.stamp:
            network.command(commands[-1], z.stamp)
            central.insert(commands.pop())
        if rng.random() < 0.1:  # a wild one
            z = Measurement(z.stamp, z.components, z.z + 2.0, z.R, z.source, z.sequence)
        network.deliver(z.stamp)
        network.measure(z.source, z, z.stamp)
        network.deliver(z.stamp)
        central.insert(z)
    for node in network.nodes.values():
        here, there = node.estimate(), central.estimate()
        assert np.abs(here.x - there.x).max() < 1e-9
        assert np.abs(here.P - there.P).max() < 1e-9
    refused = sum((node.refusals for node in network.nodes.values()), start=type(central.refusals)())
    assert refused == central.refusals
    assert sum(refused.values()) > 20


def test_late_doubled_and_disordered_messages_leave_all_nodes_the_same():
    flight = made_up_flight(300, 2, MODEL, SETTINGS.noise)
    network = Network(nodes(flight.start), LinkSettings(duplicates=0.3, delay=0.002, jitter=0.05), seed=1)
    fly(network, flight)
    network.deliver(np.inf)
    stamp = flight.measurements[-1].stamp
    first, *others = [node.estimate(stamp) for node in network.nodes.values()]
    for other in others:
        assert np.abs(other.x - first.x).max() < 1e-9
        assert np.abs(other.P - first.P).max() < 1e-9
    assert all(node.filter.dropped["duplicate"] > 20 for node in network.nodes.values())


def test_the_same_seed_gives_the_same_estimates_bit_for_bit():
    flight = made_up_flight(200, 3, MODEL, SETTINGS.noise)
    ends = []
    for _ in range(2):
        network = Network(nodes(flight.start), LinkSettings(loss=0.3, duplicates=0.2, jitter=0.02), seed=7)
        fly(network, flight)
        ends.append([node.estimate() for node in network.nodes.values()])
    for a, b in zip(*ends, strict=True):
        assert np.array_equal(a.x, b.x)
        assert np.array_equal(a.P, b.P)


@pytest.mark.parametrize("loss", [0.0, 0.3, 0.6])
def test_nodes_know_how_wrong_they_are_whatever_is_lost(loss):
    flights = 30
    found = consistency(loss, flights, 150)
    # 12 numbers are judged here at once: a band that holds all of them in 99 of 100 studies.
    low, high = nees_band(flights, 11, 0.999)
    assert low < found.band[0] < 1.0 < found.band[1] < high
    for name, value in found.nees_per_state.items():
        assert low < value < high, name


def test_more_loss_means_less_certainty():
    flight = made_up_flight(300, 4, MODEL, SETTINGS.noise)
    sd = []
    for loss in (0.0, 0.6, 1.0):
        network = Network(nodes(flight.start), LinkSettings(loss=loss))
        fly(network, flight)
        network.deliver(np.inf)
        sd.append(network.nodes["onboard"].estimate(flight.measurements[-1].stamp).sd[0])
    assert sd[0] < sd[1] < sd[2]
    assert sd[2] > 0.3  # alone it knows no position at all, and says so


def test_a_frozen_node_harms_nobody_and_is_one_of_them_again_when_it_thaws():
    flight = made_up_flight(500, 5, MODEL, SETTINGS.noise)
    network, alone = Network(nodes(flight.start)), Network(nodes(flight.start))
    fly(network, flight, until=1.5)
    fly(alone, flight, until=1.5)
    fly(network, flight, frozen=frozenset({"markers"}), since=1.5, until=3.0)
    fly(alone, flight, frozen=frozenset({"markers"}), since=1.5, until=3.0)
    left = network.nodes["fusion"].estimate(3.0)
    assert np.array_equal(left.x, alone.nodes["fusion"].estimate(3.0).x)
    network.deliver(3.0)
    fly(network, flight, since=3.0)
    network.deliver(np.inf)
    stamp = flight.measurements[-1].stamp
    back, other = network.nodes["markers"].estimate(stamp), network.nodes["fusion"].estimate(stamp)
    assert np.abs(back.x - other.x).max() < 1e-9
    assert np.abs(back.P - other.P).max() < 1e-9


def test_a_restarted_node_begins_again_from_another_and_counts_nothing_twice():
    flight = made_up_flight(400, 6, MODEL, SETTINGS.noise)
    network = Network(nodes(flight.start), LinkSettings(duplicates=0.3, jitter=0.01), seed=2)
    fly(network, flight, until=2.0)
    network.deliver(2.1)
    network.nodes["depth"] = Node("depth", flight.start, MODEL, SETTINGS)
    network.nodes["depth"].rejoin(network.nodes["fusion"])
    fly(network, flight, since=2.1)
    network.deliver(np.inf)
    stamp = flight.measurements[-1].stamp
    back, other = network.nodes["depth"].estimate(stamp), network.nodes["fusion"].estimate(stamp)
    assert np.abs(back.x - other.x).max() < 1e-9
    assert np.abs(back.P - other.P).max() < 1e-9


def test_a_node_that_begins_with_nothing_finds_the_others():
    flight = made_up_flight(300, 7, MODEL, SETTINGS.noise)
    network = Network(nodes(flight.start))
    vague = start_at(0.0, np.array([2.0, 2.0, 2.0]), 0.0, Prior(position=5.0, yaw=2.0))
    network.nodes["fusion"] = Node("fusion", vague, MODEL, SETTINGS)
    fly(network, flight)
    stamp = flight.measurements[-1].stamp
    late, other = network.nodes["fusion"].estimate(stamp), network.nodes["depth"].estimate(stamp)
    assert np.linalg.norm(late.position - other.position) < 0.02
    assert abs(late.yaw - other.yaw) < 0.05


def test_a_node_that_has_counted_another_turn_agrees_all_the_same():
    turn = start_at(0.0, np.zeros(3), 2 * np.pi, PRIOR)
    network = Network([Node("a", START), Node("b", turn)])
    for k in range(20):
        network.measure("a", yaw(0.3, 0.05 * (k + 1), k), 0.05 * (k + 1))
        network.deliver(0.05 * (k + 1))
    a, b = (node.estimate() for node in network.nodes.values())
    assert b.x[3] - a.x[3] == pytest.approx(2 * np.pi, abs=1e-9)
    assert np.allclose(a.P, b.P, atol=1e-12)


def test_what_a_node_refuses_nobody_hears_of():
    node = Node("markers", start_at(0.0, np.zeros(3), 0.0, Prior(yaw=0.02)))
    assert node.measure(yaw(3.0, 0.1)) is None
    assert node.refusals == {"markers: yaw gate": 1}
    assert node.measure(yaw(0.01, 0.2, 1)) is not None


def test_a_measurement_that_comes_twice_or_too_late_is_not_shared():
    node = Node("markers", START)
    assert node.measure(yaw(0.0, 5.0)) is not None
    assert node.measure(yaw(0.0, 5.0)) is None
    node.measure(yaw(0.0, 7.0, 1))
    assert node.measure(yaw(0.0, 4.0, 2)) is None
    assert node.filter.dropped == {"duplicate": 1, "too late": 1}


def test_an_astray_network_finds_back_together():
    network = Network([Node("a", START), Node("b", START)])
    parts = np.array([0, 1, 2, 3])
    for k in range(120):
        now, at = (k + 1) / 30, 0.0 if k < 30 else 2.0
        z = Measurement(now, parts, np.array([at, 0, 0, 0.5]), np.eye(4) * 1e-4, "depth", k)
        network.measure("a", z, now)
        network.deliver(now)
    a, b = (node.estimate() for node in network.nodes.values())
    assert a.x[0] == pytest.approx(2.0, abs=0.02)
    assert np.abs(a.x - b.x).max() < 1e-9
    assert np.abs(a.P - b.P).max() < 1e-9


def broken(stamp, x, sd=0.001, sequence=0):
    """Return what a broken sensor says of x."""
    i, I = np.zeros(11), np.zeros((11, 11))  # noqa: E741
    I[0, 0] = sd**-2
    i[0] = x * I[0, 0]
    return Contribution(stamp, "broken", sequence, i, I, 0.0, 0.0)


@pytest.mark.parametrize(
    "change",
    [
        {"jump": np.zeros(3)},
        {"I": np.triu(np.ones((11, 11)))},
        {"stamp": np.nan},
        {"i": np.full(11, 1e30)},
        {"yaw": 1e14, "i": np.zeros(11), "I": np.full((11, 11), 1e-3)},
    ],
)
def test_what_no_measurement_makes_is_not_received(change):
    one = Node("fusion", START)
    with pytest.raises(ContributionError, match=r"contribution 0 of 'broken': "):
        one.receive(replace(broken(0.1, 0.0), **change))
    assert np.array_equal(one.estimate(0.2).x, Node("fusion", START).estimate(0.2).x)


def test_what_would_move_all_beyond_reason_is_left_out_by_all_alike_whenever_it_comes():
    flight = made_up_flight(200, 9, MODEL, SETTINGS.noise)
    network, without = Network(nodes(flight.start)), Network(nodes(flight.start))
    fly(network, flight, until=1.5)
    fly(without, flight, until=1.5)
    for k, node in enumerate(network.nodes.values()):
        assert node.receive(broken(1.2 + 0.001 * k, 200.0, sequence=k))  # one late, the others in between
    fly(network, flight, since=1.5)
    fly(without, flight, since=1.5)
    for name, node in network.nodes.items():
        here, there = node.estimate(), without.nodes[name].estimate()
        assert np.array_equal(here.x, there.x)
        assert node.filter.refusals == {"broken: unusable": 1}


def test_a_source_that_was_left_out_is_let_in_when_nobody_else_knows_better():
    one, now = Node("fusion", START), 0.0
    for k in range(30):
        now = (k + 1) / 30
        one.receive(broken(now, 0.0, 0.005, k))
    refused, true = [], 60.0  # all that said that it had been carried there was lost
    for k in range(30, 90):
        now = (k + 1) / 30
        one.receive(broken(now, true, 0.005, k))
        refused.append(abs(one.estimate(now).x[0] - true) > 1.0)
    assert 1 <= sum(refused) < 30  # within a second
    assert not any(refused[30:])
    assert one.estimate(now).x[0] == pytest.approx(true, abs=0.05)


@settings(deadline=None)
@given(
    st.integers(0, 1000), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 0.2), st.floats(0.0, 0.2)
)
def test_a_link_loses_and_doubles_its_share_and_delivers_nothing_early(seed, loss, again, delay, jitter):
    options = LinkSettings(loss=loss, duplicates=again, delay=delay, jitter=jitter)
    link = Link(options, np.random.SeedSequence(seed))
    sent = [Input(0.1 * k, None, sequence=k) for k in range(200)]
    for message in sent:
        link.send(message, message.stamp)
    arrived, now = [], 0.0
    while now < 40.0:
        here = link.due(now)
        assert all(message.stamp + delay <= at <= now for at, message in here)
        arrived += [message for _, message in here]
        now += 0.05
    expected = 200 * (1 - loss) * (1 + again)
    assert abs(len(arrived) - expected) <= 6.0 * np.sqrt(200) + 1e-9
    assert {m.sequence for m in arrived} <= set(range(200))


def test_a_network_of_two_nodes_of_one_name_is_refused():
    with pytest.raises(FilterError) as told:
        Network([Node("a", START), Node("a", START)])
    assert str(told.value) == "network of nodes ['a', 'a']; expected at least one, each name once"


def test_after_a_warm_up_nothing_is_left_to_compile():
    kernels = (
        predict, correct, surprises, linear_contribution, fault, assimilate_turned, predict_and_assimilate,
    )  # fmt: skip
    warm_up()
    versions = [len(kernel.signatures) for kernel in kernels]
    assert all(versions)
    flight = made_up_flight(60, 8, MODEL, SETTINGS.noise)
    fly(Network(nodes(flight.start), LinkSettings(duplicates=0.3, jitter=0.05)), flight)
    assert [len(kernel.signatures) for kernel in kernels] == versions
