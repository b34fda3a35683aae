"""The terminal as a keyboard: what is read, what is drawn, and that it is left as it was found."""

from __future__ import annotations

import io
import os
import pty
import re
import select
import signal
import subprocess
import sys
import termios
import threading
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.cli.keyboard import Keyboard, KeyReader, NoTerminalError, open_keyboard
from noctule.cli.preview import HELP, half_blocks, one_line, status_line, warning
from noctule.flight.hand_chooser import Shared
from noctule.flight.key_script import INTERRUPT, KEYS
from noctule.flight.teach_by_hand import Ending, Status
from noctule.flight.teach_video import Taken, TeachInputError
from noctule.geometry import Pose
from noctule.messages import Picture
from noctule.vision.links import LinkQuality

GOOD = LinkQuality(shared=187, cells=20, displacement=9.0, share=0.9, baseline=0.1, conditioned=True)
FEW = LinkQuality(shared=30, cells=20, displacement=9.0, share=0.9, baseline=0.1, conditioned=True)
NONE = LinkQuality(shared=0, cells=0, displacement=9.0)


def status(link=GOOD, news="image 1 taken", stopped_by=(), stamp=1.0, images=2, picture=None) -> Status:
    pose = Pose(np.array([1.204, -0.031, 0.98]), np.radians(-12.3))
    return Status(stamp, pose, Shared(images, link, news), stopped_by, picture)


def until(person: int, what: str) -> str:
    """Read until something was written, for a minute at most."""
    text = ""
    for _ in range(12):
        text += seen(person)
        if what in text:
            break
    return text


# Keys


def test_keys_are_read_in_their_order_and_others_are_left_out():
    assert KeyReader().feed(b"wW zu9 x\r\n") == ["w", "w", " ", "u", " ", "x", "\n", "\n"]


@pytest.mark.parametrize("sequence", [b"\x1b[A", b"\x1bOA", b"\x1b[1;5D", b"\x1b[3~", b"\x1bw", b"\xc3\xa9"])
def test_arrows_and_other_sequences_are_no_keys_however_they_are_cut(sequence):
    for cut in range(len(sequence) + 1):
        reader = KeyReader()
        assert reader.feed(sequence[:cut]) + reader.feed(sequence[cut:] + b"q") == ["q"]
        assert reader.lone_escape() == []


def test_an_escape_is_the_esc_key_when_nothing_follows_or_it_comes_twice():
    reader = KeyReader()
    assert (reader.feed(b"\x1b"), reader.lone_escape(), reader.lone_escape()) == ([], ["\x1b"], [])
    assert reader.feed(b"w") == ["w"]
    assert reader.feed(b"\x1b\x1b") == ["\x1b"]


@given(st.binary(max_size=40), st.integers(0, 40))
def test_whatever_comes_only_keys_come_out_and_cuts_do_not_matter(data, cut):
    whole, parts = KeyReader(), KeyReader()
    keys = whole.feed(data)
    assert parts.feed(data[:cut]) + parts.feed(data[cut:]) == keys
    assert set(keys) <= KEYS


# What is seen


def shown(line: str) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Colours above and below of each character of a line of half blocks."""
    found, colours = [], ((), ())
    for code, block in re.findall(r"\x1b\[([0-9;]*)m|(▀)", line):
        if block:
            found.append(colours)
        elif code != "0":
            numbers = [int(v) for v in code.split(";")]
            colours = (tuple(numbers[2:5]), tuple(numbers[7:10]))
    return found


def test_a_character_shows_two_pixels():
    pixels = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    lines = half_blocks(pixels, 6, 9)
    assert [[tuple(map(tuple, pair)) for pair in shown(line)] for line in lines] == [
        [(tuple(pixels[2 * row, i]), tuple(pixels[2 * row + 1, i])) for i in range(6)] for row in range(2)
    ]
    assert all(line.endswith("\x1b[0m") for line in lines)


@given(st.integers(1, 200), st.integers(1, 60), st.integers(8, 200), st.integers(8, 200))
def test_a_preview_fits_the_terminal_and_keeps_its_shape(columns, rows, width, height):
    lines = half_blocks(np.zeros((height, width, 3), dtype=np.uint8), columns, rows)
    wide = len(shown(lines[0]))
    assert wide <= columns
    assert len(lines) <= rows
    assert wide >= columns - 1 or len(lines) >= rows - 1 or abs(wide / width - 2 * len(lines) / height) < 0.2


def test_the_status_says_where_it_is_and_what_is_shared_with_the_newest_image():
    assert status_line(status()) == (
        "x  1.20  y -0.03  z 0.98 m  heading  -12°  2 images  shares 187 points with image 1"
    )
    assert status_line(status(link=None, images=1)).endswith("heading  -12°  1 image")
    assert one_line(status(), 200).endswith("with image 1  image 1 taken")
    assert one_line(status(FEW), 40) == status_line(status(FEW))[:40]


def test_the_most_urgent_warning_is_the_one_that_is_shown():
    assert warning(status()) == ""
    assert warning(status(FEW)) == "soon too far from image 1: take an image (space) or fly back"
    assert warning(status(NONE)) == "too far: an image here cannot be reached from image 1; fly back"
    assert warning(status(NONE, stopped_by=("sofa_0", "wall_left"))) == (
        "stopped: sofa_0, wall_left in the way; turn or fly back"
    )


# The terminal


@pytest.fixture
def terminal(monkeypatch):
    """A pseudo-terminal as standard input and error; gives the person's end of it and the program's."""
    person, program = pty.openpty()
    stdin, stderr = os.fdopen(os.dup(program), "r"), os.fdopen(os.dup(program), "w")
    # Not in sys itself: the test runner puts its own streams there when the test begins.
    streams = SimpleNamespace(stdin=stdin, stdout=io.StringIO(), stderr=stderr)
    monkeypatch.setattr("noctule.cli.keyboard.sys", streams)
    monkeypatch.setenv("TERM", "xterm-256color")
    termios.tcsetwinsize(program, (20, 60)) if hasattr(termios, "tcsetwinsize") else None
    yield person, program
    stdin.close()
    stderr.close()
    for end in (person, program):
        with suppress(OSError):
            os.close(end)


def seen(person: int) -> str:
    """What was written to the terminal since; waits for it, but not for ever."""
    parts, wait = [b""], 5.0
    while select.select([person], [], [], wait)[0]:
        parts.append(os.read(person, 1 << 16))
        wait = 0.02
    return b"".join(parts).decode("utf-8")


def test_keys_come_raw_and_unseen_and_the_terminal_is_left_as_it_was(terminal):
    person, program = terminal
    before = termios.tcgetattr(program)
    with open_keyboard(preview=True) as keyboard:
        assert not termios.tcgetattr(program)[3] & (termios.ICANON | termios.ECHO)
        assert "the room is being built" in seen(person)
        os.write(person, b"wq\x1b[A \r")
        assert keyboard.pressed(0.1) == ["w", "q", " ", "\n"]
        os.write(person, b"\x1b")
        assert keyboard.pressed(0.2) + keyboard.pressed(0.3) == ["\x1b"]
        os.write(person, b"held down\n")
        assert select.select([program], [], [], 5.0)[0]
    assert termios.tcgetattr(program) == before
    assert seen(person).endswith("\x1b[?25h\x1b[?1049l")
    assert not select.select([program], [], [], 0.0)[0]  # nothing is left for the shell


def test_an_error_leaves_the_terminal_as_it_was_too(terminal):
    _, program = terminal
    before = termios.tcgetattr(program)
    with pytest.raises(RuntimeError, match="it broke"), open_keyboard(preview=False):
        raise RuntimeError("it broke")
    assert termios.tcgetattr(program) == before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_ctrl_c_and_a_process_that_is_told_to_end_leave_the_flight(terminal, number):
    before = signal.getsignal(number)
    with open_keyboard(preview=False) as keyboard:
        assert keyboard.pressed(0.01) == []
        os.kill(os.getpid(), number)
        assert keyboard.pressed(0.02) == [INTERRUPT]
    assert signal.getsignal(number) is before


def test_a_terminal_that_is_closed_leaves_the_flight(terminal):
    person, _ = terminal
    with open_keyboard(preview=True) as keyboard:
        os.close(person)
        assert keyboard.pressed(0.05) == [INTERRUPT]
        keyboard.show(status())


def test_the_preview_is_drawn_ten_times_a_second_above_the_status(terminal):
    person, _ = terminal
    picture = Picture(0.9, np.full((48, 96, 3), 200, dtype=np.uint8))
    with open_keyboard(preview=True) as keyboard:
        seen(person)
        drawn = []
        for tick in range(1, 31):
            keyboard.show(status(FEW, stamp=tick / 30.0, picture=picture))
            keyboard.write("|")
            drawn.append(seen(person) != "|")
        assert sum(drawn) == 10
        keyboard.show(status(FEW, stamp=2.0, picture=picture))
        text = seen(person)
    lines = text.split("\r\n")
    assert all("▀" in line for line in lines[:-3])
    assert [re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", line) for line in lines[-3:]] == [
        line[: len(re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", lines[-3]))]
        for line in (status_line(status(FEW)), warning(status(FEW)), HELP)
    ]


def test_without_a_preview_there_is_one_line_that_is_written_over(terminal):
    person, _ = terminal
    with open_keyboard(preview=False) as keyboard:
        seen(person)
        keyboard.show(status(FEW))
        text = seen(person)
    assert text.startswith("\r\x1b[Kx  1.20")
    assert "▀" not in text
    assert "\n" not in text


def test_a_terminal_that_cannot_draw_gets_no_preview(terminal, monkeypatch):
    person, _ = terminal
    monkeypatch.setenv("TERM", "dumb")
    with open_keyboard(preview=True) as keyboard:
        keyboard.show(status(picture=Picture(0.9, np.zeros((48, 96, 3), dtype=np.uint8))))
    assert "\x1b[?1049h" not in seen(person)


def test_a_flight_that_is_late_does_not_catch_up_in_a_rush():
    clock, (read, write) = [0.0], os.pipe()
    keyboard = Keyboard(read, None, False, threading.Event(), lambda: clock[0])
    keyboard.pressed(0.0)
    clock[0] = 10.0  # the flight stood still for so long
    keyboard.pressed(0.1)
    waited = []
    original = import_module("noctule.cli.keyboard").select.select

    def select(reading, writing, failing, timeout):
        waited.append(timeout)
        return original(reading, writing, failing, 0.0)

    module = import_module("noctule.cli.keyboard")
    try:
        module.select.select = select
        keyboard.pressed(0.2)
    finally:
        module.select.select = original
        os.close(read)
        os.close(write)
    assert waited == [pytest.approx(0.1)]


PROGRAM = """
import os, sys
for end in (0, 1, 2):
    os.dup2(os.open(sys.argv[1], os.O_RDWR), end)
from noctule.cli.keyboard import open_keyboard
with open_keyboard(preview=False) as keyboard:
    stamp, keys = 0.0, []
    while not keys or keys[-1] != "\\x03":
        stamp += 0.05
        keys += keyboard.pressed(stamp)
        keyboard.write(f"<{keys!r}>")
"""


def test_in_a_terminal_of_its_own_ctrl_c_leaves_and_ctrl_z_does_nothing():
    """The controlling terminal of another process: what a person types goes through the line discipline."""
    person, program = pty.openpty()
    before = termios.tcgetattr(program)
    child = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, os.ttyname(program)], start_new_session=True, close_fds=True
    )
    try:
        text = until(person, "<[]>")
        os.write(person, b"w\x1a\x1b[C")
        text = until(person, "<['w']>")
        os.write(person, b"\x03")
        assert child.wait(20.0) == 0
        text += seen(person)
        assert "<['w', '\\x03']>" in text
        assert termios.tcgetattr(program) == before
    finally:
        child.kill()
        child.wait()
        os.close(person)
        os.close(program)


# The command


def test_without_a_terminal_the_error_says_what_to_do_instead(noctule, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("w"))
    said = noctule("teach", "--keyboard", "--out", "p")
    assert (said.code, said.err) == (
        2,
        "noctule: teach: --keyboard needs a terminal to read keys from, standard input is none; use "
        "--waypoints FILE or --keys FILE\n",
    )
    assert not Path("p").exists()


def test_on_a_platform_without_termios_the_error_says_so(monkeypatch):
    monkeypatch.setattr("noctule.cli.keyboard.find_spec", lambda name: None)
    with pytest.raises(NoTerminalError) as caught, open_keyboard(preview=True):
        pass
    assert str(caught.value) == (
        "teach: --keyboard needs a Linux or macOS terminal, this is neither; use --waypoints FILE or "
        "--keys FILE"
    )


class Pretended:
    """Stands for the flight; writes a path of one picture twice."""

    def __init__(self) -> None:
        self.asked = []
        self.ending, self.error = Ending.FINISHED, None

    def __call__(self, mission, seed, folder, pressed, show, automatic):
        from noctule.flight.path_folder import Shot, save_path

        if self.error is not None:
            raise self.error
        self.asked.append((mission.name, seed, automatic, pressed(0.5)))
        show(status())
        rng = np.random.default_rng(1)
        pixels = np.kron(rng.integers(0, 255, (24, 32, 3)), np.ones((10, 10, 1))).astype(np.uint8)
        from noctule.camera import PinholeCamera

        save_path(folder, [Shot(pixels)], PinholeCamera.centred(320, 240, 200.0), mission.camera.mount)
        return (Taken(0.4, "asked for by key"),), self.ending


@pytest.fixture
def pretended(monkeypatch):
    """A flight by hand that is not flown."""
    flight = Pretended()
    monkeypatch.setattr(import_module("noctule.flight.teach_by_hand"), "teach_by_hand", flight)
    return flight


def test_a_key_script_teaches_a_path_without_a_terminal(noctule, pretended):
    Path("keys.txt").write_text("0.5 w\n")
    said = noctule("teach", "--keys", "keys.txt", "--seed", "4", "--out", "p")
    assert (said.code, said.err) == (0, "")
    assert pretended.asked == [("two-columns", 4, True, ["w"])]
    assert said.out.splitlines() == [
        "path p: 1 key images of 320x240 px",
        "image 0 at 0.40 s: asked for by key",
        "sheet: p/contact-sheet.png",
        "path: p",
    ]


def test_the_person_may_say_where_the_images_are(noctule, pretended):
    Path("keys.txt").write_text("0.5 space\n")
    told = noctule("teach", "--keys", "keys.txt", "--at", "keys", "--out", "p", "--json").last_json
    assert pretended.asked == [("two-columns", 0, False, [" "])]
    assert told["taken"] == [{"stamp_s": 0.4, "reason": "asked for by key"}]


def test_the_keyboard_teaches_a_path_and_ctrl_c_keeps_it(noctule, pretended, terminal):
    person, _ = terminal
    pretended.ending = Ending.INTERRUPTED
    os.write(person, b"")
    said = noctule("teach", "--keyboard", "--no-preview", "--mission", "two-columns", "--out", "p")
    assert said.code == 130
    assert said.out.endswith("path: p\n")
    assert noctule("path", "check", "p").code == 0


def test_where_nothing_was_taken_no_folder_is_left(noctule, pretended):
    Path("keys.txt").write_text("0.5 esc\n")
    pretended.error = TeachInputError("teaching: nothing")
    said = noctule("teach", "--keys", "keys.txt", "--out", "p")
    assert (said.code, said.err) == (2, "noctule: teaching: nothing\n")
    assert not Path("p").exists()


def test_a_folder_that_cannot_be_written_is_told_before_the_flight(noctule, pretended):
    Path("keys.txt").write_text("0.5 w\n")
    Path("file").touch()
    said = noctule("teach", "--keys", "keys.txt", "--out", "file/p")
    assert (said.code, said.err) == (
        2,
        "noctule: folder file/p: cannot be written (Not a directory), expected a folder for recordings; give "
        "another with --out\n",
    )
    assert pretended.asked == []
