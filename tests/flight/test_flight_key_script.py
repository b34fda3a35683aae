"""Key scripts are read, played and written."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.flight.key_script import (
    FINISH,
    INTERRUPT,
    KEYS,
    LEAVE,
    STICKS,
    TAKE,
    KeyScript,
    KeyScriptError,
    read_key_script,
    write_key_script,
)


def read(tmp_path, text: str):
    file = tmp_path / "keys.txt"
    file.write_text(text)
    return read_key_script(file)


def test_a_line_is_a_time_and_a_key_and_a_comment_is_none(tmp_path):
    text = "# the way in\n0.5 w\n\n1 space  # here\n2.25 u\n3 x\n4 enter\n5 esc\n"
    assert read(tmp_path, text) == [
        (0.5, "w"),
        (1.0, TAKE),
        (2.25, "u"),
        (3.0, "x"),
        (4.0, FINISH),
        (5.0, LEAVE),
    ]


def test_a_key_that_is_held_repeats_as_a_terminal_does(tmp_path):
    presses = read(tmp_path, "1.0 q 0.2\n")
    assert presses == [(pytest.approx(1.0 + i / 30.0), "q") for i in range(7)]


def test_a_script_gives_each_press_once_when_its_time_has_come():
    script = KeyScript([(0.2, "w"), (0.1, "a"), (0.3, "x")])
    assert [script(0.05), script(0.2), script(0.2), script(10.0 / 30.0)] == [[], ["a", "w"], [], ["x"]]


def test_at_its_end_a_script_presses_enter_and_then_leaves():
    script = KeyScript([(0.2, "w")])
    assert script(1.1) == ["w"]
    assert script(1.2) == [FINISH, LEAVE]
    assert KeyScript([])(1.0) == [FINISH, LEAVE]


@given(st.lists(st.tuples(st.integers(0, 3000), st.sampled_from(sorted(KEYS - {INTERRUPT}))), max_size=20))
def test_what_was_pressed_at_ticks_is_played_again_at_the_same_ticks(tmp_path_factory, presses):
    presses = sorted(presses)
    file = tmp_path_factory.getbasetemp() / "again.txt"
    write_key_script(file, [(tick * (1.0 / 30.0), key) for tick, key in presses] + [(1e3, INTERRUPT)])
    if not presses:
        assert file.read_text() == ""
        return
    script = KeyScript(read_key_script(file))
    last = presses[-1][0]
    played = [(tick, key) for tick in range(last + 1) for key in script(tick * (1.0 / 30.0))]
    assert played == presses


def refused(tmp_path, text: str) -> str:
    with pytest.raises(KeyScriptError) as caught:
        read(tmp_path, text)
    return str(caught.value).replace(str(tmp_path / "keys.txt"), "keys.txt")


EXPECTED = (
    "expected a time [s], a key (w s a d r f q e x u space enter esc) and perhaps for how long it is held [s]"
)


@pytest.mark.parametrize("line", ["1.0", "1.0 k", "w 1.0", "1 w 2 3", "1 w w"])
def test_a_line_that_is_no_press_is_named(tmp_path, line):
    expected = f"key script keys.txt:2: {line!r}, {EXPECTED}"
    if line == "1 w w":
        expected = "key script keys.txt:2: 'w' is no time, expected 0 to 3600 s"
    assert refused(tmp_path, f"0 w\n{line}\n") == expected


@pytest.mark.parametrize("time", ["-1", "nan", "inf", "1e9", "one"])
def test_a_time_that_is_none_is_named(tmp_path, time):
    assert refused(tmp_path, f"{time} w\n") == (
        f"key script keys.txt:1: {time!r} is no time, expected 0 to 3600 s"
    )


def test_only_keys_that_fly_can_be_held(tmp_path):
    assert refused(tmp_path, "1 space 2\n") == "key script keys.txt:1: space cannot be held; leave the 2 out"


def test_a_script_without_keys_and_one_that_is_not_there_are_refused(tmp_path):
    assert refused(tmp_path, "# nothing\n") == (
        "key script keys.txt: it holds no key; expected lines as 1.5 w"
    )
    with pytest.raises(KeyScriptError) as caught:
        read_key_script(tmp_path / "none.txt")
    assert str(caught.value) == (
        f"key script {tmp_path / 'none.txt'}: cannot be read (No such file or directory); expected lines of "
        "a time [s] and a key, as 1.5 w"
    )


def test_every_axis_has_two_keys_that_oppose_each_other():
    for axis in range(4):
        assert sorted(sign for a, sign in STICKS.values() if a == axis) == [-1.0, 1.0]
