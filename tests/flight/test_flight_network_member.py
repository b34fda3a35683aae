"""A node as the network sees it: what it takes, what it drops, how it joins; without wire and clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.estimation.chi_square import nees, nees_band
from noctule.estimation.contributions import Contribution, from_bytes, to_bytes
from noctule.estimation.events import Input
from noctule.estimation.filter_state import start_at
from noctule.estimation.framing import seal
from noctule.estimation.measurements import Component, Measurement
from noctule.estimation.node_messages import INPUTS, SNAPSHOT, inputs_from_bytes
from noctule.flight.network.drill import made_up
from noctule.flight.network.member import JOINING, Member
from noctule.flight.network.roll_call import Beat, beat_to_bytes
from noctule.flight.network.wire import SHARED, Kind
from noctule.geometry import Array

FROM_PEERS = (*SHARED, Kind.SNAPSHOT)
BEGIN = 1000.0


def member(name: str = "depth", size: int = 11) -> Member:
    return Member(name, start_at(BEGIN, np.zeros(3), 0.0, size=size))


def seen(stamp: float, x: float = 0.1, sequence: int = 0) -> Measurement:
    parts = np.array([Component.X, Component.Y, Component.Z, Component.YAW], dtype=np.int64)
    return Measurement(stamp, parts, np.array([x, 0.0, 0.0, 0.0]), 1e-4 * np.eye(4), "depth", sequence)


def command(stamp: float, forward: float = 0.1, sequence: int = 0) -> Input:
    return Input(stamp, np.array([forward, 0.0, 0.0, 0.0]), "onboard", sequence)


def shared(one: Member, stamp: float, x: float = 0.1, sequence: int = 0) -> bytes:
    """Return what a member shares of a measurement that it took at once."""
    message = one.measure(seen(stamp, x, sequence), stamp)
    assert message is not None
    return message


def same(a: Member, b: Member, stamp: float) -> bool:
    known, other = a.node.estimate(stamp), b.node.estimate(stamp)
    return np.allclose(known.x, other.x, atol=1e-9) and np.allclose(known.P, other.P, rtol=1e-9, atol=1e-12)


def test_two_members_that_hear_each_other_know_the_same():
    a, b = member("depth"), member("fusion")
    for k in range(20):
        stamp = BEGIN + 0.03 * (k + 1)
        assert b.take(Kind.CONTRIBUTION, "depth", shared(a, stamp, 0.01 * k, k), stamp)
    assert same(a, b, BEGIN + 1.0)
    assert (a.measured, a.shared, b.assimilated) == (20, 20, 20)


def test_a_contribution_that_comes_twice_counts_once():
    a, b = member("depth"), member("fusion")
    message = shared(a, BEGIN + 0.1)
    assert b.take(Kind.CONTRIBUTION, "depth", message, BEGIN + 0.2)
    assert not b.take(Kind.CONTRIBUTION, "depth", message, BEGIN + 0.2)
    assert same(a, b, BEGIN + 0.3)
    assert b.summary()["dropped"] == {"duplicate": 1}


def test_a_message_of_commands_repeats_those_of_the_last_second():
    a = member("onboard")
    for k in range(30):
        message = a.command(command(BEGIN + 0.1 * k, sequence=k), BEGIN + 0.1 * k)
    assert [sent.sequence for sent in inputs_from_bytes(message)] == list(range(19, 30))


def test_a_repeated_command_is_no_duplicate_to_complain_of():
    a, b = member("onboard"), member("fusion")
    for k in range(3):
        message = a.command(command(BEGIN + 0.1 * (k + 1), sequence=k), BEGIN + 0.1 * (k + 1))
        assert b.take(Kind.COMMANDS, "onboard", message, BEGIN + 0.1 * (k + 1))
    assert not b.take(Kind.COMMANDS, "onboard", message, BEGIN + 0.4)
    assert b.summary()["dropped"] == {}
    assert b.assimilated == 3


@pytest.mark.parametrize("kind", FROM_PEERS)
def test_bytes_that_are_no_message_are_counted_with_a_reason_and_change_nothing(kind):
    one = member("fusion")
    before = one.node.estimate(BEGIN + 1.0)
    assert not one.take(kind, "depth", b"what is this", BEGIN)
    assert one.summary()["malformed"] == {str(kind): 1}
    assert one.why_malformed[str(kind)].startswith("depth: ")
    assert "expected" in one.why_malformed[str(kind)]
    after = one.node.estimate(BEGIN + 1.0)
    assert np.array_equal(before.x, after.x)


def test_the_reason_of_a_cut_contribution_is_told_in_full():
    one = member("fusion")
    one.take(Kind.CONTRIBUTION, "depth", shared(member(), BEGIN + 0.1)[:-1], BEGIN + 0.2)
    assert one.why_malformed == {
        "contribution": "depth: contribution: its checksum does not match; it was damaged or cut on the way"
    }


@settings(max_examples=30, deadline=None)
@given(
    st.sampled_from(FROM_PEERS),
    st.binary(max_size=900),
    st.sampled_from([b"NOCI", b"NOCB", INPUTS, SNAPSHOT]),
)
def test_no_bytes_raise_whatever_they_are(kind, body, magic):
    one = member("fusion")
    for data in (body, seal(magic, body)):
        one.take(kind, "depth", data, BEGIN)
    assert np.isfinite(one.node.estimate(BEGIN + 1.0).x).all()


@settings(max_examples=30, deadline=None)
@given(st.data())
def test_no_damage_to_a_true_message_raises_even_when_its_checksum_is_right(data):
    a, one = member("depth"), member("fusion")
    messages = {
        Kind.CONTRIBUTION: shared(a, BEGIN + 0.1),
        Kind.COMMANDS: a.command(command(BEGIN + 0.1), BEGIN + 0.1),
        Kind.BEAT: beat_to_bytes(a.beat(BEGIN)),
        Kind.SNAPSHOT: a.snapshot(),
    }
    kind = data.draw(st.sampled_from(FROM_PEERS))
    body = bytearray(messages[kind][6:-4])
    places = st.tuples(st.integers(0, len(body) - 1), st.integers(0, 255))
    for place, value in data.draw(st.lists(places, min_size=1, max_size=12)):
        body[place] = value
    one.take(kind, "depth", seal(messages[kind][:4], bytes(body)), BEGIN + 0.2)
    known = one.node.estimate(BEGIN + 0.3)
    assert np.isfinite(known.x).all()
    assert np.linalg.eigvalsh(known.P)[0] > 0.0


def test_who_joins_measures_nothing_until_the_time_is_over():
    one = member()
    one.join(BEGIN)
    assert one.measure(seen(BEGIN + 0.1), BEGIN + 0.1) is None
    assert one.beat(BEGIN + 0.1).reason == "it joins"
    later = BEGIN + JOINING
    assert one.measure(seen(later, sequence=1), later) is not None
    assert one.beat(later) == Beat(later, 1, "")


def test_a_restarted_member_takes_over_what_another_knows_and_measures_at_once():
    a = member("depth")
    for k in range(60):
        shared(a, BEGIN + 0.05 * (k + 1), 0.1, k)
    now = BEGIN + 3.2
    again = Member("onboard", start_at(now, np.zeros(3), 0.0))
    again.join(now)
    assert again.take(Kind.SNAPSHOT, "depth", a.snapshot(), now + 0.01)
    assert same(a, again, now)
    assert again.rejoined == 1
    assert again.told_after == pytest.approx(0.01)
    assert not again.joining(now + 0.01)


def test_what_was_told_in_a_snapshot_does_not_count_again_when_it_comes_late():
    a, again = member("depth"), member("fusion")
    messages = [shared(a, BEGIN + 0.05 * (k + 1), 0.1, k) for k in range(30)]
    again.take(Kind.SNAPSHOT, "depth", a.snapshot(), BEGIN + 1.6)
    assert not any(again.take(Kind.CONTRIBUTION, "depth", one, BEGIN + 1.6) for one in messages)
    assert same(a, again, BEGIN + 2.0)


def test_of_its_own_a_member_keeps_what_the_other_has_not_heard_of():
    a, b, everything = member("depth"), member("onboard"), member("fusion")
    for k in range(30):
        stamp = BEGIN + 0.05 * (k + 1)
        everything.take(Kind.CONTRIBUTION, "depth", shared(a, stamp, 0.1, k), stamp)
    alone = seen(BEGIN + 1.52, 0.12)
    message = b.measure(replace(alone, source="onboard"), alone.stamp)
    assert message is not None
    everything.take(Kind.CONTRIBUTION, "onboard", message, alone.stamp)
    assert b.take(Kind.SNAPSHOT, "depth", a.snapshot(), BEGIN + 1.6)
    assert same(b, everything, BEGIN + 2.0)


def test_who_knows_more_keeps_what_it_knows():
    a, b = member("depth"), member("fusion")
    for k in range(10):
        shared(a, BEGIN + 0.05 * (k + 1), 0.1, k)
    before = a.node.estimate(BEGIN + 1.0)
    assert not a.take(Kind.SNAPSHOT, "fusion", b.snapshot(), BEGIN + 0.6)
    assert np.array_equal(before.x, a.node.estimate(BEGIN + 1.0).x)
    assert a.rejoined == 0


@pytest.mark.parametrize(("size", "ahead"), [(8, 0.0), (11, 60.0)])
def test_a_snapshot_of_another_state_or_from_the_future_is_refused(size, ahead):
    a, b = member("depth", size), member("fusion")
    shared(a, BEGIN + 0.1 + ahead)
    assert not b.take(Kind.SNAPSHOT, "depth", a.snapshot(), BEGIN + 0.2)
    assert b.malformed == {"snapshot": 1}
    assert b.why_malformed["snapshot"] == (
        f"depth: snapshot: {size} numbers until {ahead - 0.1:+.3f} s from now; expected 11 and none from "
        "the future: do the clocks of all machines agree?"
    )


def test_what_was_dropped_is_still_counted_after_it_joined_again():
    a, b = member("depth"), member("fusion")
    message = shared(a, BEGIN + 0.1)
    for _ in range(3):
        b.take(Kind.CONTRIBUTION, "depth", message, BEGIN + 0.1)
    for k in range(20):
        shared(a, BEGIN + 0.15 + 0.05 * k, 0.1, k + 1)
    assert b.take(Kind.SNAPSHOT, "depth", a.snapshot(), BEGIN + 1.2)
    assert b.summary()["dropped"] == {"duplicate": 2}


def test_a_member_with_a_broken_clock_does_not_make_the_others_deaf():
    broken, sound, one = member("depth"), member("onboard"), member("fusion")
    one.take(Kind.CONTRIBUTION, "depth", shared(broken, BEGIN + 500.0), BEGIN + 0.1)
    assert one.take(Kind.CONTRIBUTION, "onboard", shared(sound, BEGIN + 0.1), BEGIN + 0.2)
    assert one.summary()["dropped"] == {"from the future": 1}


@pytest.mark.parametrize("hole", [(2.0, 4.0), (2.0, 2.6)])
def test_a_member_that_slept_through_a_part_of_a_flight_knows_its_errors_again(hole):
    drill = made_up(1, 8.0, BEGIN)
    names = ("onboard", "depth", "markers")
    members = {name: Member(name, drill.start, drill.model, drill.settings) for name in names}
    commands = list(drill.flight.inputs)
    surprises: dict[str, list[float]] = {name: [] for name in names}
    asleep = False
    for k in np.argsort(drill.flight.arrivals):
        z, at = drill.flight.measurements[k], float(drill.flight.arrivals[k])
        now = BEGIN + at
        woke = asleep and at >= hole[1]
        asleep = hole[0] <= at < hole[1]
        awake = {name: one for name, one in members.items() if not (asleep and name == "depth")}
        if woke:
            members["depth"].join(now)
            members["depth"].take(Kind.SNAPSHOT, "markers", members["markers"].snapshot(), now)
        while commands and commands[0].stamp <= at:
            sent = commands.pop(0)
            message = members["onboard"].command(replace(sent, stamp=sent.stamp + BEGIN), now)
            for name, one in awake.items():
                if name != "onboard":
                    one.take(Kind.COMMANDS, "onboard", message, now)
        if z.source in awake:
            shared_now = awake[z.source].measure(replace(z, stamp=z.stamp + BEGIN), now)
            for name, one in awake.items():
                if name != z.source and shared_now is not None:
                    assert one.take(Kind.CONTRIBUTION, z.source, shared_now, now)
        if k % 5 == 0:
            for name, one in awake.items():
                known = one.node.estimate(BEGIN + z.stamp)
                surprises[name].append(nees(known, drill.flight.truths[k]) / 11)
    # Within a flight the errors are not independent: the band is that of a single estimate.
    low, high = nees_band(1, 11)
    assert all(low < np.mean(values) < high for values in surprises.values())
    assert members["depth"].rejoined == 1
    assert same(members["depth"], members["markers"], BEGIN + 8.2)


def test_a_message_of_a_full_state_is_small():
    a = member()
    assert len(shared(a, BEGIN + 0.1)) == 764
    assert from_bytes(shared(a, BEGIN + 0.2, sequence=1)).source == "depth"


def lie(stamp: float, kind: str, sequence: int) -> bytes:
    """Return a contribution of a broken sensor, in a sound frame."""
    i, I, yaw = np.zeros(11), np.zeros((11, 11)), 0.0  # noqa: E741
    if kind == "another turn":
        I[:], yaw = 1e-3, 1e14
    elif kind == "a yaw that i does not know":
        I[3, 3], yaw = 1.0, 500.0
    elif kind == "far away":
        i[0], I[0, 0] = 1e9, 1e3
    elif kind == "too sure":
        i[0], I[0, 0] = 9e14, 1e14
    elif kind == "at the end of the street":
        i[0], I[0, 0] = 100.0 * 1e6, 1e6
    return bytes_of(Contribution(stamp, "broken", sequence, i, I, yaw, 0.0))


def bytes_of(part: Contribution) -> bytes:
    """Return the message of a contribution that need not be sound."""
    sound = Contribution(part.stamp, part.source, part.sequence, np.zeros(11), np.zeros((11, 11)), 0.0, 0.0)
    body = bytearray(to_bytes(sound)[6:-4])
    numbers: Array = np.concatenate([[part.yaw, 0.0], part.i, np.zeros(11), part.I[np.triu_indices(11)]])
    body[-8 * numbers.size :] = numbers.tobytes()
    return seal(b"NOCI", bytes(body))


LIES = ("another turn", "a yaw that i does not know", "far away", "too sure", "at the end of the street")


@pytest.mark.parametrize("kind", LIES)
def test_a_broken_peer_neither_ends_the_others_nor_moves_them(kind):
    drill = made_up(4, 3.0, BEGIN)
    names = ("onboard", "depth", "markers")
    members = {name: Member(name, drill.start, drill.model, drill.settings) for name in names}
    errors = []
    for k, (measured, truth) in enumerate(zip(drill.flight.measurements, drill.flight.truths, strict=True)):
        z = replace(measured, stamp=measured.stamp + BEGIN)
        now = z.stamp + 0.05
        message = members[z.source].measure(z, now)
        for name, one in members.items():
            if message is not None and name != z.source:
                one.take(Kind.CONTRIBUTION, z.source, message, now)
            if k > 100:
                one.take(Kind.CONTRIBUTION, "broken", lie(z.stamp, kind, k), now)
        errors += [np.abs((one.known(now).x - truth)[:3]).max() for one in members.values() if k > 100]
    assert max(errors) < 0.1
    for one in members.values():
        told = one.summary()
        counted = told["malformed"].get("contribution", 0) + told["refused"].get("broken: unusable", 0)
        assert counted >= len(drill.flight.measurements) - 101
        assert one.shared > 0.9 * one.measured  # what they measure themselves is not refused for it


def test_what_was_left_out_is_still_counted_after_it_joined_again():
    a, b = member("depth"), member("fusion")
    for k in range(30):
        b.take(Kind.CONTRIBUTION, "depth", shared(a, BEGIN + 0.02 * (k + 1), 0.1, k), BEGIN + 0.02 * (k + 1))
    b.take(Kind.CONTRIBUTION, "broken", lie(BEGIN + 0.65, LIES[-1], 0), BEGIN + 0.65)
    for k in range(30, 70):
        shared(a, BEGIN + 0.02 * (k + 1), 0.1, k)
    assert b.take(Kind.SNAPSHOT, "depth", a.snapshot(), BEGIN + 1.5)
    assert b.summary()["refused"] == {"broken: unusable": 1}


def test_a_measurement_that_nobody_would_take_is_counted_and_not_shared():
    one = member()
    sure = replace(seen(BEGIN + 0.1), R=1e-12 * np.eye(4))
    assert one.measure(sure, BEGIN + 0.1) is None
    assert one.summary()["refused"] == {"depth: beyond what any sensor says": 1}
    assert one.measure(seen(BEGIN + 0.2, sequence=1), BEGIN + 0.2) is not None


@pytest.mark.parametrize("kind", FROM_PEERS)
def test_what_another_node_of_its_own_name_says_is_counted_and_not_listened_to(kind):
    one, other = member("depth"), member("depth")
    messages = {
        Kind.CONTRIBUTION: shared(other, BEGIN + 0.1),
        Kind.COMMANDS: other.command(command(BEGIN + 0.1), BEGIN + 0.1),
        Kind.BEAT: beat_to_bytes(other.beat(BEGIN)),
        Kind.SNAPSHOT: other.snapshot(),
    }
    assert not one.take(kind, "depth", messages[kind], BEGIN + 0.2)
    assert one.roll.peers == {}
    assert one.summary()["namesakes"] == 1
    assert one.summary()["malformed"] == {}


def test_who_does_not_know_whether_its_name_is_free_measures_nothing():
    one = member()
    one.named = False
    assert one.measure(seen(BEGIN + 0.1), BEGIN + 0.1) is None
    one.named = True
    assert one.measure(seen(BEGIN + 0.2, sequence=1), BEGIN + 0.2) is not None
