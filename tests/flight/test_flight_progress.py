"""The progress line."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from noctule.flight import progress


@pytest.fixture
def terminal(monkeypatch):
    """A terminal to draw on and a clock to set."""
    text, now = io.StringIO(), [0.0]
    console = Console(file=text, force_terminal=True, width=100)
    monkeypatch.setattr(progress, "Console", lambda stderr: console)
    monkeypatch.setattr(progress.time, "perf_counter", lambda: now[0])
    return text, now


def test_a_flight_of_less_than_two_seconds_shows_nothing(terminal):
    text, now = terminal
    with progress.flight_progress(True, 60.0) as show:
        for tick in range(19):
            now[0] = 0.1 * tick
            show(tick / 30.0, "flying")
    assert text.getvalue() == ""


def test_a_longer_flight_shows_its_phase_its_time_and_how_fast_it_runs(terminal):
    text, now = terminal
    with progress.flight_progress(True, 60.0) as show:
        now[0] = 3.0
        show(12.0, "searching")
    shown = text.getvalue()
    assert "searching" in shown
    assert "12.0 s of flight, 4.0 x real time" in shown


def test_it_is_drawn_no_more_than_five_times_a_second(terminal):
    text, now = terminal
    with progress.flight_progress(True, 60.0) as show:
        for tick in range(30):
            now[0] = 3.0 + tick / 30.0
            show(float(tick), "flying")
    assert 4 <= text.getvalue().count("s of flight") <= 7  # once more when it is taken away


@pytest.mark.parametrize("enabled", [True, False])
def test_without_a_terminal_or_when_not_wanted_nothing_is_written(enabled, monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(progress.time, "perf_counter", lambda: now[0])
    with progress.flight_progress(enabled, 60.0) as show:
        now[0] = 9.0
        show(9.0, "flying")
    assert capsys.readouterr() == ("", "")
