"""The wire between nodes, with real sessions in one process; who is there, and the addresses."""

from __future__ import annotations

import queue
import socket
import sys
import threading
import time

import numpy as np
import pytest
from flight_drill import PATIENCE, free_ports

from noctule.estimation.filter_state import start_at
from noctule.estimation.framing import MessageError, seal
from noctule.flight.network.endpoints import (
    PORTS,
    EndpointError,
    Endpoints,
    NodeNameError,
    checked_name,
    endpoints,
    is_name,
)
from noctule.flight.network.member import Member
from noctule.flight.network.process import run_node
from noctule.flight.network.roll_call import FORGOTTEN, SILENT, Beat, RollCall, beat_from_bytes, beat_to_bytes
from noctule.flight.network.wire import (
    SHARED,
    Kind,
    NameTakenError,
    NoNetworkError,
    PortTakenError,
    Received,
    Wire,
    WireError,
)


def pair() -> tuple[Endpoints, Endpoints]:
    """Return the addresses of two nodes that know each other."""
    a, b = (f"tcp/127.0.0.1:{port}" for port in free_ports(2))
    return Endpoints((a,), (b,)), Endpoints((b,), (a,))


def heard(wire: Wire, kind: Kind) -> Received:
    """Wait for a message of a kind."""
    give_up = time.monotonic() + PATIENCE
    while time.monotonic() < give_up:
        try:
            received = wire.inbox.get(timeout=0.5)
        except queue.Empty:
            continue
        if received.kind is kind:
            return received
    raise AssertionError(f"no {kind} came")


@pytest.fixture
def joined():
    """Two wires that have met."""
    first, second = pair()
    with Wire("depth", first) as a, Wire("fusion", second) as b:
        assert heard(a, Kind.ALIVE).peer == "fusion"
        assert heard(b, Kind.ALIVE).peer == "depth"
        yield a, b


@pytest.mark.parametrize("kind", [Kind.CONTRIBUTION, Kind.COMMANDS, Kind.BEAT])
def test_what_one_shares_the_other_hears_and_not_itself(joined, kind):
    a, b = joined
    a.share(kind, b"bytes")
    assert heard(b, kind) == Received(kind, "depth", b"bytes")
    b.share(Kind.BEAT, b"back")
    assert heard(a, Kind.BEAT).peer == "fusion"  # and nothing of its own before
    assert a.inbox.empty()


def test_who_asks_is_answered_with_a_snapshot(joined):
    a, b = joined
    a.ask()
    asked = heard(b, Kind.ASKED)
    b.answer(asked, b"all that I know")
    assert heard(a, Kind.SNAPSHOT) == Received(Kind.SNAPSHOT, "fusion", b"all that I know")


def test_a_node_that_leaves_is_known_to_be_gone():
    first, second = pair()
    with Wire("depth", first) as a:
        with Wire("fusion", second):
            heard(a, Kind.ALIVE)
        assert heard(a, Kind.GONE).peer == "fusion"


def wait_until(reached) -> None:
    """Wait for something to become true."""
    give_up = time.monotonic() + PATIENCE
    while not reached() and time.monotonic() < give_up:
        time.sleep(0.02)
    assert reached()


def test_the_younger_of_two_nodes_of_one_name_is_told_while_the_elder_is_there():
    first, second = pair()
    elder = Wire("depth", first)
    with elder, Wire("depth", second) as younger:
        wait_until(lambda: younger.namesakes)
        with pytest.raises(NameTakenError) as told:
            younger.require_own_name()
        elder.require_own_name()
        wait_until(lambda: elder.younger)
        assert elder.inbox.empty()  # nobody came as far as it is concerned
        elder.__exit__(None, None, None)
        wait_until(lambda: not younger.namesakes)
        younger.require_own_name()
    assert str(told.value) == (
        "node 'depth': another node of this name is there; stop it, or give this one another with --name"
    )


def test_a_node_that_comes_back_at_its_address_is_met_again():
    first, second = pair()
    with Wire("depth", first) as a:
        for _ in range(2):
            with Wire("fusion", second) as b:
                assert heard(a, Kind.ALIVE).peer == "fusion"
                assert heard(b, Kind.ALIVE).peer == "depth"
            heard(a, Kind.GONE)


def test_a_taken_port_is_told_with_what_to_do(joined):
    taken = joined[0].endpoints
    with pytest.raises(PortTakenError) as told, Wire("depth", taken):
        pass
    assert str(told.value) == (
        f"node 'depth': {taken.listen[0]} is taken; does this node already run? stop it, or name another "
        "address with --listen, and tell the others with --connect"
    )


def test_an_address_of_another_machine_is_told():
    with pytest.raises(WireError) as told, Wire("depth", Endpoints(("tcp/192.0.2.1:17448",), ())):
        pass
    assert str(told.value) == (
        "node 'depth': cannot listen at tcp/192.0.2.1:17448 (192.0.2.1:17448: Cannot assign requested "
        "address (os error 99)); name an address of this machine"
    )


def test_without_the_optional_package_the_message_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "zenoh", None)
    with pytest.raises(NoNetworkError) as told, Wire("depth", Endpoints((), ())):
        pass
    assert str(told.value) == (
        'node: the package eclipse-zenoh is not installed; install it: pip install "noctule[network]"'
    )


def test_a_full_inbox_loses_messages_and_counts_them(joined):
    a, b = joined
    b.inbox.maxsize = 1
    give_up = time.monotonic() + PATIENCE
    while b.overruns == 0 and time.monotonic() < give_up:
        a.share(Kind.BEAT, b"1")
        time.sleep(0.001)
    assert b.overruns > 0


def test_a_foreign_program_that_sends_nonsense_does_no_harm(joined):
    foreign, wire = joined
    one = Member("fusion", start_at(time.time(), np.zeros(3), 0.0))
    stop = threading.Event()

    def enough(now: float, member: Member) -> None:
        if len(member.malformed) == len(SHARED):
            stop.set()
        for kind in SHARED:
            foreign.share(kind, b"\x80\x04nonsense")

    run_node(one, wire, None, [enough], stop, time.time() + PATIENCE)
    assert set(one.malformed) == {"contribution", "commands", "beat"}
    assert one.why_malformed["contribution"] == (
        "depth: contribution: 10 bytes; expected at least 60: is the peer a node?"
    )
    assert np.isfinite(one.node.estimate(time.time()).x).all()
    assert one.assimilated == 0


def test_addresses_are_those_of_this_machine_unless_told_otherwise():
    found = endpoints("depth")
    assert found.listen == ("tcp/127.0.0.1:17448",)
    assert found.connect == tuple(f"tcp/127.0.0.1:{PORTS[role]}" for role in ("onboard", "markers", "fusion"))


def test_addresses_that_are_named_replace_them():
    found = endpoints("depth", ["192.168.1.5:1000"], ["tcp/drone.local:2000", "[fe80::1]:3000"])
    assert found == Endpoints(("tcp/192.168.1.5:1000",), ("tcp/drone.local:2000", "tcp/[fe80::1]:3000"))


def test_a_node_does_not_connect_to_itself():
    assert endpoints("depth", ["127.0.0.1:5"], ["127.0.0.1:5", "127.0.0.1:6"]).connect == ("tcp/127.0.0.1:6",)


@pytest.mark.parametrize(
    "text", ["17450", "udp/127.0.0.1:17450", "host:0", "host:65536", "a b:1", "host:1;x", "[::::]:1"]
)
def test_what_is_no_address_is_told(text):
    with pytest.raises(EndpointError) as told:
        endpoints("depth", [], [text])
    assert str(told.value) == (
        f"node: --connect is {text!r}, expected HOST:PORT, for example 192.168.1.7:17450"
    )


EVERYWHERE = (
    "0.0.0.0", "[::]", "0", "0.0", "000.0.0.0", "0x0", "[::0]", "[0:0:0:0:0:0:0:0]", "[::ffff:0.0.0.0]",
)  # fmt: skip


@pytest.mark.parametrize("host", EVERYWHERE)
def test_every_interface_is_no_address_however_it_is_written(host):
    text = f"{host}:17450"
    with pytest.raises(EndpointError) as told:
        endpoints("depth", [text])
    assert str(told.value) == (
        f"node: --listen is {text!r}, which is every interface; name the address of one, for example "
        "192.168.1.7:17450"
    )


def test_a_name_of_every_interface_is_no_address_to_listen_at(monkeypatch):
    told = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", ("0.0.0.0", 0))]
    monkeypatch.setattr("socket.getaddrinfo", lambda *_: told)
    with pytest.raises(EndpointError, match="every interface"):
        endpoints("depth", ["anywhere.local:17450"])


def test_an_address_in_numbers_is_written_as_usual():
    found = endpoints("depth", ["127.1:5"], ["[0:0::1]:6", "127.000.0.01:5"])
    assert found == Endpoints(("tcp/127.0.0.1:5",), ("tcp/[::1]:6",))


def test_a_name_that_does_not_fit_is_told():
    assert is_name("depth-2")
    with pytest.raises(NodeNameError) as told:
        checked_name("depth/2")
    assert str(told.value) == (
        "node: its name is 'depth/2', expected 1 to 16 of a to z, 0 to 9, - and _; give another with --name"
    )


def test_a_heartbeat_comes_back_from_its_bytes():
    beat = Beat(12.5, 77, "occluded: 10 % of the drone can be seen")
    assert beat_from_bytes(beat_to_bytes(beat)) == beat


def test_a_long_reason_is_cut_and_still_text():
    told = beat_from_bytes(beat_to_bytes(Beat(0.0, 1, "é" * 200)))
    assert told.reason == "é" * 80


@pytest.mark.parametrize("text", [b"\x1b[2J", b"line\nline", b"x" * 161])
def test_a_heartbeat_cannot_draw_on_a_terminal(text):
    body = beat_to_bytes(Beat(1.0, 2))[6:-4] + text
    with pytest.raises(MessageError) as told:
        beat_from_bytes(seal(b"NOCB", body))
    assert str(told.value) == (
        f"heartbeat: {26 + len(text)} bytes at 1.0 s; expected a finite stamp and at most 160 bytes of text"
    )


def test_a_node_without_a_heartbeat_is_missing_though_its_process_answers():
    roll = RollCall()
    roll.alive("depth", 10.0)
    roll.beat("depth", Beat(10.2, 1), 10.2)
    roll.check(10.2 + SILENT)
    assert roll.there == ("depth",)
    roll.check(10.3 + SILENT)
    assert roll.there == ()
    peer = roll.peers["depth"]
    assert (peer.since, peer.why, roll.losses) == (10.2, "it hangs", 1)


def test_a_node_that_comes_back_is_there_again_since_then():
    roll = RollCall()
    roll.alive("depth", 10.0)
    roll.beat("depth", Beat(10.2, 1), 10.2)
    roll.gone("depth", 10.8)
    assert roll.peers["depth"].since == 10.2  # nothing was heard of it later
    assert roll.peers["depth"].why == "its connection ended"
    roll.beat("depth", Beat(12.0, 1), 12.0)
    assert roll.there == ("depth",)
    assert roll.peers["depth"].since == 12.0


def test_who_was_never_there_is_not_missed_and_names_do_not_pile_up():
    roll = RollCall()
    roll.gone("depth", 1.0)
    assert roll.peers == {}
    for k in range(100):
        roll.beat(f"n{k}", Beat(1.0, 0), 1.0)
    assert len(roll.peers) == 64
    roll.check(1.1 + SILENT)
    roll.beat("depth", Beat(2.2, 1), 2.2)  # a real one takes the place of one that is gone
    assert "depth" in roll.there
    assert len(roll.peers) == 64


def test_who_is_gone_for_long_is_forgotten():
    roll = RollCall()
    for name in ("depth", "old"):
        roll.beat(name, Beat(1.0, 0), 1.0)
    for k in range(1, 100):
        roll.beat("depth", Beat(1.0 + 0.9 * k, 0), 1.0 + 0.9 * k)
        roll.check(1.0 + 0.9 * k)
        assert ("old" in roll.peers) == (0.9 * k <= FORGOTTEN)
    assert roll.there == ("depth",)
