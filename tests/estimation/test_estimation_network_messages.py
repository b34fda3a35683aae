"""The bytes of a contribution: there and back, and nothing else passes."""

import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.estimation.contributions import (
    ContributionError,
    contribution_of,
    from_bytes,
    message_length,
    to_bytes,
)
from noctule.estimation.filter_state import Prior, start_at
from noctule.estimation.measurements import Measurement

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


def refusal(data):
    with pytest.raises(ContributionError) as told:
        from_bytes(data)
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
    assert refusal(to_bytes(part())[:-8]) == (
        "contribution: 756 bytes for a state of 11 numbers; "
        "expected 8 to 11 numbers in 476, 564, 660, 764 bytes"
    )


def test_damage_is_told():
    data = bytearray(to_bytes(part()))
    data[100] ^= 1
    assert refusal(bytes(data)) == "contribution: its checksum does not match; it was damaged on the way"


def test_a_source_that_is_no_text_is_told():
    body = bytearray(to_bytes(part())[:-4])
    body[8:24] = b"\xff" * 16
    assert refusal(sealed(bytes(body))) == (
        f"contribution: names its source {bytes([255] * 16)!r}; expected text"
    )


WHO = "contribution 77 of 'depth'"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"i": np.full(11, np.nan)}, f"{WHO}: holds numbers that are not finite; it is refused"),
        ({"stamp": np.inf}, f"{WHO}: holds numbers that are not finite; it is refused"),
        ({"jump": np.full(11, np.inf)}, f"{WHO}: holds numbers that are not finite; it is refused"),
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
    with pytest.raises(ContributionError) as told:
        to_bytes(replace(part(), **change))
    assert str(told.value) == message


@pytest.mark.parametrize(("place", "value"), [(0, np.nan), (22, -1e6), (11, np.inf)])
def test_what_no_measurement_makes_is_not_read_even_with_a_right_checksum(place, value):
    body = bytearray(to_bytes(part())[:-4])
    struct.pack_into("<d", body, 56 + 8 * place, value)
    assert refusal(sealed(bytes(body))).startswith(WHO)
