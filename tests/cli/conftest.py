"""A pretended flight, so that the commands are tested without flying."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import pytest
from cli_pretended import pretended_summary

from noctule.cli.app import run
from noctule.flight import FlightResult


@dataclass
class Said:
    """What a command answered."""

    code: int
    out: str
    err: str

    @property
    def last_json(self) -> Any:
        """The last line of standard output, read as JSON."""
        return json.loads(self.out.rstrip("\n").splitlines()[-1])


@pytest.fixture
def noctule(capsys, monkeypatch, tmp_path):
    """Run a command line in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def call(*tokens: str) -> Said:
        code = run(tokens)
        captured = capsys.readouterr()
        return Said(code, captured.out, captured.err)

    return call


@pytest.fixture
def flown(monkeypatch):
    """Pretend to fly and to write reports; holds the missions flown and what the next flights end with."""

    class Flown:
        outcome = "reached"
        error: Exception | None = None

        def __init__(self) -> None:
            self.missions: list[Any] = []
            self.seeds: list[int] = []

    flights = Flown()

    def fly_mission(mission, seed, out, law=None, progress=True):
        flights.missions.append(mission)
        flights.seeds.append(seed)
        recording = out / "flight.mcap"
        recording.write_bytes(b"")
        summary = pretended_summary(flights.outcome, recording)
        if flights.error is not None:
            (out / "summary.json").write_text(json.dumps({**summary, "outcome": "aborted"}))
            raise flights.error
        return FlightResult(summary, recording, out)

    monkeypatch.setattr("noctule.flight.fly_mission", fly_mission)
    monkeypatch.setattr("noctule.reports.write_report", lambda file, judged: file.with_name("report.html"))
    return flights
