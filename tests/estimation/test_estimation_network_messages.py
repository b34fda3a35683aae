"""The bytes of a contribution: there and back, and nothing else passes."""

import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.estimation.contributions import (
    check,
    contribution_of,
    from_bytes,
    message_length,
    to_bytes,
)
from noctule.estimation.delayed import DelayedFilter
from noctule.estimation.events import Input
from noctule.estimation.filter_state import Prior, start_at
from noctule.estimation.framing import MessageError, seal
from noctule.estimation.measurements import Measurement
from noctule.estimation.network import Node
from noctule.estimation.network_study import PRIOR, made_up_flight
from noctule.estimation.node_messages import (
    inputs_from_bytes,
    inputs_to_bytes,
    snapshot_from_bytes,
    snapshot_to_bytes,
)
from noctule.estimation.vehicle_model import VehicleModel

SIZES = (8, 9, 10, 11)


def part(n=11, seed=0, jump=None):
    rng = np.random.default_rng(seed)
    state = start_at(0.0, rng.normal(size=3), float(rng.normal()), Prior(), n)
    x = state.x + rng.normal(size=n)
    z = Measurement(
        1.5, np.arange(8), rng.normal(size=8), np.diag(10.0 ** rng.uniform(-5, 0, 8)), "depth", 77
    )
    return contribution_of(x, z.part(rng.random(8) < 0.6), jump)


def sealed(body):
    return body + struct.pack("<I", zlib.crc32(body))


def refusal(data, read=from_bytes):
    with pytest.raises(MessageError) as told:
        read(data)
    return str(told.value)


@settings(deadline=None)
@given(st.sampled_from(SIZES), st.integers(0, 10_000), st.booleans())
def test_a_contribution_comes_back_to_the_bit(n, seed, jumps):
    sent = part(n, seed, np.arange(n) * 0.1 if jumps else None)
    data = to_bytes(sent)
    back = from_bytes(data)
    assert len(data) == message_length(n)
    for name in ("stamp", "source", "sequence", "yaw", "heading_bias"):
        assert getattr(back, name) == getattr(sent, name)
    assert np.array_equal(back.i, sent.i)
    assert np.array_equal(back.I, sent.I)
    assert (back.jump is None) == (not jumps)
    assert not jumps or np.array_equal(back.jump, sent.jump)


def test_the_layout_stays_what_it_is():
    data = to_bytes(part())
    assert len(data) == 56 + 8 * (11 + 11 + 66) + 4
    assert data[:8] == b"NOCI" + bytes([1, 0, 11, 0])
    assert data[8:24] == b"depth".ljust(16, b"\0")
    assert struct.unpack_from("<Qd", data, 24) == (77, 1.5)


def test_a_read_contribution_can_be_compiled_with():
    back = from_bytes(to_bytes(part()))
    assert back.i.flags.c_contiguous
    assert back.I.flags.c_contiguous
    assert back.i.flags.writeable


@settings(deadline=None)
@given(st.binary(max_size=1000))
def test_any_bytes_are_refused_in_one_line(data):
    assert "\n" not in refusal(data)


@settings(deadline=None)
@given(st.integers(0, 700), st.integers(1, 255))
def test_a_flipped_byte_is_noticed(place, flip):
    data = bytearray(to_bytes(part()))
    data[place % len(data)] ^= flip
    refusal(bytes(data))


def test_too_few_bytes_are_no_contribution():
    assert refusal(b"hello") == "contribution: 5 bytes; expected at least 60: is the peer a node?"


def test_another_protocol_is_told():
    assert refusal(b"X" * 100) == (
        "contribution: begins with b'XXXX' version 22616; expected b'NOCI' version 1: "
        "run the same version of noctule on every node"
    )


def test_a_cut_message_is_told():
    assert refusal(seal(b"NOCI", to_bytes(part())[6:-12])) == (
        "contribution: 756 bytes for a state of 11 numbers; "
        "expected 8 to 11 numbers in 476, 564, 660, 764 bytes"
    )


def test_damage_is_told():
    data = bytearray(to_bytes(part()))
    data[100] ^= 1
    assert (
        refusal(bytes(data)) == "contribution: its checksum does not match; it was damaged or cut on the way"
    )


def test_a_source_that_is_no_text_is_told():
    body = bytearray(to_bytes(part())[:-4])
    body[8:24] = b"\xff" * 16
    assert refusal(sealed(bytes(body))) == (
        f"contribution: names its source {bytes([255] * 16)!r}; expected text"
    )


WHO = "contribution 77 of 'depth'"
ELSEWHERE = "i speaks of a state beyond 1000 m or m/s, or of another yaw than it names; it is refused"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"i": np.full(11, np.nan)}, f"{WHO}: holds numbers that are not finite; it is refused"),
        ({"stamp": np.inf}, f"{WHO}: holds numbers that are not finite; it is refused"),
        ({"jump": np.full(11, np.inf)}, f"{WHO}: holds numbers that are not finite; it is refused"),
        ({"jump": np.full(11, 1e200)}, f"{WHO}: holds numbers beyond what any sensor says; it is refused"),
        ({"i": np.full(11, 1e300)}, f"{WHO}: holds numbers beyond what any sensor says; it is refused"),
        ({"yaw": 1e4}, f"{WHO}: holds numbers beyond what any sensor says; it is refused"),
        ({"jump": np.full(11, 1e4)}, f"{WHO}: holds numbers beyond what any sensor says; it is refused"),
        (
            {"I": np.eye(11) * 1e9},
            f"{WHO}: I reaches 1e+09; expected at most 1e+08, a deviation of 0.1 mm",
        ),
        (
            {"I": np.eye(11), "i": 1100.0 * np.eye(11)[0]},
            f"{WHO}: {ELSEWHERE}",
        ),
        (
            {"I": np.eye(11), "i": np.zeros(11), "yaw": 6.0},
            f"{WHO}: {ELSEWHERE}",
        ),
        (
            {"i": np.zeros(11, dtype=int)},
            f"{WHO}: its numbers are int64, float64 and float64; expected float64",
        ),
        (
            {"I": -np.eye(11)},
            f"{WHO}: I has an eigenvalue of -1; expected none below 0: no measurement makes this",
        ),
        ({"I": np.triu(np.ones((11, 11)))}, f"{WHO}: I is not symmetric; it is refused"),
        (
            {"I": np.zeros((11, 11)), "i": np.ones(11)},
            f"{WHO}: i speaks of directions in which I holds nothing; it is refused",
        ),
        (
            {"i": np.ones(7)},
            f"{WHO}: i (7,), I (11, 11), jump (7,); expected (n,), (n, n) and (n,) with n from 8 to 11",
        ),
        (
            {"sequence": -1},
            "contribution -1 of 'depth': its sequence is out of range; expected 0 to 2^64 - 1",
        ),
        (
            {"source": "a name of too many bytes"},
            "contribution of 'a name of too many bytes': its name has 24 bytes; expected 1 to 16 and no zero "
            "among them: give the sensor a shorter name",
        ),
    ],
)
def test_what_no_measurement_makes_is_not_sent(change, message):
    with pytest.raises(MessageError) as told:
        to_bytes(replace(part(), **change))
    assert str(told.value) == message


@settings(deadline=None)
@given(
    st.sampled_from(SIZES),
    st.integers(0, 10_000),
    st.integers(-500, 500),
    st.floats(-900.0, 900.0),
    st.lists(st.booleans(), min_size=8, max_size=8).filter(any),
)
def test_every_measurement_within_a_kilometre_can_be_sent_however_often_the_vehicle_has_turned(
    n, seed, turns, far, measured
):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=n)
    x[:3] += far
    x[3] += turns * 2.0 * np.pi
    z = np.concatenate([x[:3] + rng.normal(size=3), rng.uniform(-3.1, 3.1, 1), rng.normal(0, 10.0, 4)])
    sd = 10.0 ** rng.uniform(-3.9, 1.0, 8)
    turn = np.linalg.qr(rng.normal(size=(8, 8)))[0]
    R = turn @ np.diag(sd**2) @ turn.T if seed % 2 else np.diag(sd**2)
    whole = Measurement(1.5, np.arange(8), z, 0.5 * (R + R.T), "depth", 77)
    if n in (8, 10):  # without its bias an onboard heading is the yaw once more
        measured[7] = measured[7] and not measured[3]
    keep = np.array(measured) if any(measured) else np.arange(8) == 0
    sent = contribution_of(x, whole.part(keep))
    check(sent)
    assert abs(sent.yaw) <= 700.0


def test_a_yaw_of_a_thousand_turns_is_counted_anew_and_says_the_same():
    few, many = part_at(0.3), part_at(0.3 + 1000 * 2.0 * np.pi)
    assert many.yaw == pytest.approx(0.3, abs=1e-9)
    assert np.allclose(many.i, few.i, rtol=1e-9, atol=1e-6)


def part_at(yaw):
    x = start_at(0.0, np.ones(3), yaw).x
    return contribution_of(x, Measurement(1.5, np.array([3]), np.array([0.5]), np.eye(1) * 1e-4, "markers"))


@pytest.mark.parametrize(("place", "value"), [(0, np.nan), (22, -1e6), (11, np.inf)])
def test_what_no_measurement_makes_is_not_read_even_with_a_right_checksum(place, value):
    body = bytearray(to_bytes(part())[:-4])
    struct.pack_into("<d", body, 56 + 8 * place, value)
    assert refusal(sealed(bytes(body))).startswith(WHO)


def attempt(read, data):
    """Return what was read and no message, or nothing and the message."""
    try:
        return read(data), ""
    except MessageError as told:
        return None, str(told)


INPUTS = (
    Input(1.0, np.array([0.1, -0.2, 0.3, -0.4]), sequence=3),
    Input(1.1, None, "supervisor", 2**64 - 1),
)


def node(steps=80, window_input=True):
    model = VehicleModel.identified(delay=0.02)
    made = Node("fusion", start_at(0.0, np.zeros(3), 0.0, PRIOR), model)
    flight = made_up_flight(steps, 0, model, made.filter.settings.noise)
    for sent in flight.inputs if window_input else ():
        made.receive(sent)
    for z in flight.measurements:
        made.measure(z)
    return made


def same(a, b):
    return (a.stamp, a.source, a.sequence) == (b.stamp, b.source, b.sequence) and (
        a.u is b.u is None or np.array_equal(a.u, b.u)
    )


def test_commands_come_back_to_the_bit():
    back = inputs_from_bytes(inputs_to_bytes(INPUTS))
    assert all(same(a, b) for a, b in zip(INPUTS, back, strict=True))
    assert inputs_from_bytes(inputs_to_bytes([])) == ()


@pytest.mark.parametrize(("steps", "commanded"), [(0, False), (80, False), (80, True), (300, True)])
def test_a_node_that_read_a_snapshot_knows_what_the_sender_knows(steps, commanded):
    sender = node(steps, commanded).filter
    read = snapshot_from_bytes(snapshot_to_bytes(sender.snapshot()))
    receiver = DelayedFilter.of_snapshot(read, sender.model, sender.settings)
    here, there = receiver.estimate(), sender.estimate()
    assert here.stamp == there.stamp
    assert np.array_equal(here.x, there.x)
    assert np.array_equal(here.P, there.P)
    for event in read.events:
        assert not receiver.insert(event)


@settings(deadline=None)
@given(st.binary(max_size=400), st.sampled_from([b"NOCU", b"NOCS", b"NOCI"]))
def test_any_bytes_in_a_right_frame_are_refused_in_one_line(body, magic):
    for read in (from_bytes, inputs_from_bytes, snapshot_from_bytes):
        value, message = attempt(read, seal(magic, body))
        assert "\n" not in message
        # The only such bytes that say something: no commands, or whole ones.
        assert value is None or (magic == b"NOCU" and body[:2] == struct.pack("<H", len(value)))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 3000), st.binary(min_size=1, max_size=8))
def test_a_changed_snapshot_is_refused_or_still_a_state(place, change):
    body = bytearray(snapshot_to_bytes(node().filter.snapshot())[6:-4])
    place %= len(body)
    body[place : place + len(change)] = change
    read, message = attempt(snapshot_from_bytes, seal(b"NOCS", bytes(body)))
    assert "\n" not in message
    assert read is None or (np.linalg.eigvalsh(read.P)[0] > 0.0 and np.isfinite(read.x).all())


def test_a_snapshot_that_is_cut_is_told():
    body = snapshot_to_bytes(node().filter.snapshot())[6:-4]
    assert refusal(seal(b"NOCS", body[:100]), snapshot_from_bytes) == (
        "snapshot: 110 bytes for a state of 11 numbers; expected more, or 8 to 11"
    )
    assert refusal(seal(b"NOCS", body + b"c"), snapshot_from_bytes) == (
        "snapshot: ends in the middle of an event"
    )
    strange = body + struct.pack("<cI", b"x", 0)
    assert refusal(seal(b"NOCS", strange), snapshot_from_bytes) == (
        "snapshot: holds an event of kind b'x'; expected b'c' or b'u'"
    )
    two = inputs_to_bytes(INPUTS)
    crowded = body + struct.pack("<cI", b"u", len(two)) + two
    assert refusal(seal(b"NOCS", crowded), snapshot_from_bytes) == (
        "snapshot: holds an event of 2 commands; expected 1"
    )


def test_a_snapshot_without_a_covariance_is_told():
    body = bytearray(snapshot_to_bytes(node().filter.snapshot())[6:-4])
    begin = struct.calcsize("<Hdi16sQdB") + 8 * 11
    for value in (-1.0, 1e300, np.nan):
        body[begin : begin + 8] = struct.pack("<d", value)
        assert refusal(seal(b"NOCS", bytes(body)), snapshot_from_bytes) == (
            "snapshot: its covariance is not positive definite, or holds no numbers; refused"
        )


def test_a_snapshot_of_a_state_that_no_vehicle_is_in_is_told():
    known = node().filter.snapshot()
    far, sure = known.x.copy(), known.P.copy()
    far[0] = 2e4
    sure[:, 4] = sure[4, :] = 0.0
    sure[4, 4] = 1e-12
    for change in ({"x": far}, {"P": sure}):
        message = refusal(snapshot_to_bytes(replace(known, **change)), snapshot_from_bytes)
        assert message.endswith("expected at most 1000 and at least 1e-05: refused")


def test_commands_that_are_no_numbers_or_too_few_are_told():
    body = bytearray(inputs_to_bytes(INPUTS[:1])[6:-4])
    assert refusal(seal(b"NOCU", bytes(body[:-1])), inputs_from_bytes) == (
        "commands: 66 bytes for 1 of them; expected 67"
    )
    for value, said in ((np.nan, "nan"), (1e200, "1e+200")):
        body[-8:] = struct.pack("<d", value)
        assert refusal(seal(b"NOCU", bytes(body)), inputs_from_bytes) == (
            f"command at 1.0 s: [0.1, -0.2, 0.3, {said}]; expected finite numbers, of the inputs up to 1000"
        )


def test_a_command_without_a_count_is_not_sent():
    with pytest.raises(MessageError) as told:
        inputs_to_bytes([Input(0.0, None, sequence=-1)])
    assert str(told.value) == "command -1 of 'commands': expected a sequence of 0 to 2^64 - 1"


def test_raw_measurements_are_not_sent():
    central = DelayedFilter(start_at(0.0, np.zeros(3), 0.0, PRIOR))
    central.insert(Measurement(0.1, np.array([3]), np.zeros(1), np.eye(1), "markers"))
    with pytest.raises(MessageError) as told:
        snapshot_to_bytes(central.snapshot())
    assert str(told.value) == (
        "snapshot: holds a measurement of 'markers'; expected contributions: send that of a node"
    )
