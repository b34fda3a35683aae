"""`noctule experiment loc-1` to `loc-3`: what is flown, told and kept, on pretended flights."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from noctule.cli.loc_flying import loc_campaign_text, loc_text


def run_of(seed=4, outcome="completed", recording="here/flight.mcap"):
    return {
        "seed": seed,
        "outcome": outcome,
        "reason": "the path is flown" if outcome == "completed" else "unseen for 10 s",
        "min_clearance_m": 0.14,
        "recording": recording,
        "cross_track_mean_m": 0.0071 + 0.001 * seed,
        "cross_track_p95_m": 0.0142,
        "hover_rms_m": None,
        "heading_p95_deg": 1.5,
        "recovery_s": {"mean": 0.5, "max": 0.6},
        "position_rms_m": 0.0055,
        "position_p95_m": 0.009,
        "yaw_mean_deg": 0.1,
        "yaw_sd_deg": 0.45,
        "slips": 0,
        "lost_s": 5.2,
        "doubt_s": {"fly on": 0.25, "slow": 0.0, "hover": 4.0, "land": 0.0},
    }


@pytest.fixture
def judged(monkeypatch):
    """Pretend to judge; the outcome of the next flights can be set."""

    class Judge:
        outcome = "completed"

    judge = Judge()

    def pretended(summary):
        return run_of(outcome=judge.outcome, recording=summary["recording"])

    monkeypatch.setattr("noctule.experiments.loc_flight_run.judged", pretended)
    return judge


def test_a_flight_is_told_by_its_figures(noctule, flown, judged):
    said = noctule("experiment", "loc-1", "--seed", "4", "--out", "here")
    assert said.code == 0
    assert said.err == ""
    lines = said.out.splitlines()
    assert lines[:2] == ["outcome: completed", "reason: the path is flown"]
    told = dict(line.strip().rsplit("  ", 1) for line in lines if line.startswith("  "))
    figures = {label.strip(): value for label, value in told.items()}
    assert figures["From the path, mean"] == "11.10 mm"
    assert figures["From the held point, root mean square"] == "-"
    assert figures["Back within 8 cm of a push after, at most"] == "0.60 s"
    assert figures["Times that the estimate was half a turn off"] == "0"
    assert figures["In doubt"] == "fly on 0.2 s, hover 4.0 s"
    assert lines[-2:] == ["recording: here/flight.mcap", "report: here/report.html"]


def test_the_flight_is_the_experiments_with_the_options_asked(noctule, flown, judged):
    from noctule.experiments.loc_flight import LOC_FLIGHTS, LocFlightOptions

    tokens = ["--hull", "--alone", "--hide", "5", "--model", "first_order", "--wrong-model", "0.3"]
    tokens += ["--command-delay", "0.4", "--beyond", "--seconds", "20"]
    noctule("experiment", "loc-3", "--seed", "7", *tokens)
    options = LocFlightOptions(
        hull=True,
        alone=True,
        hide=5.0,
        model="first_order",
        wrong_model=0.3,
        command_delay=0.4,
        beyond=True,
        seconds=20.0,
    )
    assert flown.missions == [LOC_FLIGHTS["loc-3"].mission(7, options)]
    assert flown.seeds == [7]


def test_json_holds_the_judges_figures(noctule, flown, judged):
    said = noctule("experiment", "loc-2", "--seed", "4", "--json", "--no-report", "--out", "here")
    assert said.last_json == {**run_of(), "report": None}


@pytest.mark.parametrize("outcome", ["landed_lost", "fence", "contact", "diverged", "aborted"])
def test_whatever_is_not_completed_is_1(noctule, flown, judged, outcome):
    judged.outcome = outcome
    said = noctule("experiment", "loc-1", "--seed", "4")
    assert said.code == 1
    assert said.out.startswith(f"outcome: {outcome}\nreason: unseen for 10 s\n")


def test_a_campaign_tells_a_row_for_each_seed_and_keeps_all(noctule, monkeypatch):
    asked = {}

    def fly_seeds(make_mission, seeds, out, progress, finish, together, good):
        asked.update(seeds=list(seeds), finish=finish, good=good)
        runs = [run_of(4), run_of(5, "landed_lost")]
        return {"runs": runs, **together(runs)}

    monkeypatch.setattr("noctule.campaign.fly_seeds", fly_seeds)
    said = noctule("experiment", "loc-1", "--seeds", "4:6", "--out", "here")
    assert said.code == 1
    assert asked["seeds"] == [4, 5]
    assert asked["good"] == "completed"
    rows = [line.split() for line in said.out.splitlines()]
    assert rows[0][:2] == ["seed", "outcome"]
    assert rows[1][:4] == ["4", "completed", "11.10", "mm"]
    assert rows[2][:4] == ["5", "landed_lost", "12.10", "mm"]
    assert rows[3][:3] == ["mean", "11.60", "mm"]
    assert rows[4][:3] == ["most", "12.10", "mm"]
    assert "outcome: 1 of 2 completed" in said.out
    assert said.out.endswith("seed 5: landed_lost: unseen for 10 s\n")
    kept = json.loads(Path("here/campaign.json").read_text("utf-8"))
    assert [run["seed"] for run in kept["loc-1"]["runs"]] == [4, 5]


def test_a_campaigns_flights_can_be_judged_by_other_processes(noctule, monkeypatch):
    import pickle

    def fly_seeds(make_mission, seeds, out, progress, finish, together, good):
        make, end = (pickle.loads(pickle.dumps(f)) for f in (make_mission, finish))
        assert make(4).flight.seed == 4
        assert callable(end)
        return {"runs": [run_of(4)], **together([run_of(4)])}

    monkeypatch.setattr("noctule.campaign.fly_seeds", fly_seeds)
    assert noctule("experiment", "loc-2", "--seeds", "4:5", "--json").code == 0


def test_a_flight_that_failed_has_dashes():
    failed = {"seed": 9, "outcome": "aborted", "reason": "the worker died"}
    assert "  From the path, mean" in loc_text(failed)
    results = {"runs": [failed], "summary": {"outcome": {"aborted": 1.0}}, "most": {}, "least": {}}
    (row,) = [line.split() for line in loc_campaign_text(results).splitlines() if line.startswith("     9")]
    assert row == ["9", "aborted", *"--------"]
