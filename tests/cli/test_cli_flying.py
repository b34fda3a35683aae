"""What `fly` and `experiment` hand to the flight, what they print, and their exit codes."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from cli_pretended import pretended_summary

from noctule.flight import Aborted, RecordingError, load_mission


def test_reached_is_0_and_tells_metres_and_paths(noctule, flown):
    said = noctule("fly", "--out", "here")
    assert said.code == 0
    assert said.err == ""
    assert said.out.startswith("outcome: reached\n")
    assert "0.013 m" in said.out or "0.012 m" in said.out
    assert said.out.endswith("recording: here/flight.mcap\nreport: here/report.html\n")


@pytest.mark.parametrize("outcome", ["collided", "stuck", "lost", "aborted"])
def test_any_other_outcome_is_1_and_tells_the_reason(noctule, flown, outcome):
    flown.outcome = outcome
    said = noctule("fly", "--out", "here")
    assert said.code == 1
    assert said.out.startswith(f"outcome: {outcome}\n")
    assert "the time limit of 5 s has passed" in said.out


def test_the_default_is_the_two_column_path_and_its_own_seed(noctule, flown):
    noctule("fly")
    assert flown.missions == [load_mission("two-columns")]
    assert flown.seeds == [load_mission("two-columns").flight.seed]


def test_left_out_the_folder_is_a_new_one_under_flights(noctule, flown, tmp_path):
    noctule("fly", "one-column")
    (folder,) = (tmp_path / "flights").iterdir()
    assert folder.name.startswith("one-column-")
    assert [file.name for file in folder.iterdir()] == ["flight.mcap"]


def test_json_is_the_contract_on_the_last_line_with_null_for_what_is_no_number(noctule, flown):
    said = noctule("fly", "--json", "--seed", "7", "--out", "here")
    assert said.last_json == {
        "outcome": "reached",
        "reason": "",
        "duration_s": 12.5,
        "position_error_m": 0.0125,
        "yaw_error_deg": 0.25,
        "epsilon_px": 1.5,
        "min_clearance_m": None,
        "max_command_step": {"linear": 0.03, "angular": 0.06},
        "tick_ms": {"median": 2.0, "p95": 4.0},
        "realtime_factor": 3.5,
        "recording": "here/flight.mcap",
        "report": "here/report.html",
    }
    assert flown.seeds == [7]


def test_no_report_writes_none(noctule, flown, monkeypatch):
    def never(recording):
        raise AssertionError("a report was written")

    monkeypatch.setattr("noctule.reports.write_report", never)
    assert noctule("fly", "--no-report", "--json").last_json["report"] is None


def test_a_report_that_fails_does_not_cost_the_figures(noctule, flown, monkeypatch):
    def fails(recording, judged):
        raise RecordingError("report: the disk is full")

    monkeypatch.setattr("noctule.reports.write_report", fails)
    said = noctule("fly", "--json")
    assert said.code == 0
    assert said.err == "noctule: report: the disk is full\n"
    assert said.last_json["outcome"] == "reached"
    assert said.last_json["report"] is None


def test_the_law_and_the_time_limit_go_into_the_mission(noctule, flown):
    noctule("fly", "--law", "published", "--time-limit", "9")
    (mission,) = flown.missions
    assert mission.pilot.law == "published"
    assert mission.flight.time_limit_s == 9.0
    assert mission.text == load_mission("two-columns").text


def test_an_attitude_sd_takes_the_camera_off_its_gimbal_and_tells_the_pilot(noctule, flown):
    noctule("fly", "--attitude-sd", "0.5")
    (mission,) = flown.missions
    assert mission.camera.stabilised is False
    assert mission.vehicle.attitude_sd == pytest.approx(math.radians(0.5))
    assert mission.pilot.attitude_sd_deg == 0.5


def test_an_attitude_sd_of_0_is_a_stabilised_camera(noctule, flown):
    noctule("fly", "--attitude-sd", "0")
    (mission,) = flown.missions
    assert mission.camera.stabilised is True
    assert mission.pilot.attitude_sd_deg == 0.0


def test_an_experiment_is_flown_as_the_paper_has_it_with_the_options_asked(noctule, flown):
    from noctule.experiments import EXPERIMENTS

    noctule("experiment", "servo-5.1", "--seed", "4", "--law", "published", "--attitude-sd", "0.5")
    assert flown.missions == [EXPERIMENTS["servo-5.1"].mission(4, "published", 0.5)]
    assert flown.seeds == [4]


def test_each_seed_of_an_experiment_draws_its_own_mission(noctule, monkeypatch):
    from noctule.experiments import EXPERIMENTS

    asked = campaign(monkeypatch, ["reached", "reached"])
    noctule("experiment", "servo-5.2", "--seeds", "2:4", "--no-report", "--time-limit", "30")
    for seed, mission in zip((2, 3), asked["missions"], strict=True):
        plain = EXPERIMENTS["servo-5.2"].mission(seed, "noctule", 0.0)
        assert mission.room == plain.room
        assert mission.path == plain.path
        assert mission.flight.time_limit_s == 30.0
    assert asked["missions"][0].room != asked["missions"][1].room


def test_the_oval_is_flown_with_the_options_asked(noctule, flown):
    from noctule.experiments import OvalOptions
    from noctule.experiments.oval import OVALS

    noctule("experiment", "servo-5.3", "--laps", "3", "--latency", "0.2", "--columns", "--seed", "4")
    noctule("experiment", "servo-5.3-ff", "--law", "published", "--seed", "4")
    asked = OvalOptions(laps=3, latency_s=0.2, columns=True)
    assert flown.missions == [
        OVALS["servo-5.3"].mission(4, options=asked),
        OVALS["servo-5.3-ff"].mission(4, "published"),
    ]


def test_ctrl_c_in_flight_is_130_and_keeps_what_was_written(noctule, flown):
    flown.error = Aborted("flight: ended by Ctrl-C after 3.0 s")
    said = noctule("fly", "--json", "--out", "here")
    assert said.code == 130
    assert said.err == "noctule: flight: ended by Ctrl-C after 3.0 s (in here)\n"
    assert said.last_json["outcome"] == "aborted"
    assert said.last_json["recording"] == "here/flight.mcap"
    assert said.last_json["error"] == "flight: ended by Ctrl-C after 3.0 s"


def test_a_full_disk_in_flight_is_1_and_one_line(noctule, flown):
    flown.error = RecordingError("recording here/flight.mcap: the disk is full")
    said = noctule("fly", "--out", "here")
    assert said.code == 1
    assert said.err == "noctule: recording here/flight.mcap: the disk is full (in here)\n"


def campaign(monkeypatch, outcomes):
    """Pretend to fly a campaign; returns what it was asked."""
    asked = {}

    def fly_seeds(make_mission, seeds, out, progress, finish, together, good):
        asked.update(missions=[make_mission(seed) for seed in seeds], seeds=seeds, out=out, finish=finish)
        runs = [
            {"seed": seed, **pretended_summary(outcome, out / f"seed-{seed}" / "flight.mcap")}
            for seed, outcome in zip(seeds, outcomes, strict=True)
        ]
        return {"runs": runs, "summary": {**pretended_summary("reached", out), "outcome": {"reached": 0.5}}}

    monkeypatch.setattr("noctule.campaign.fly_seeds", fly_seeds)
    return asked


def test_many_seeds_are_0_when_all_reached_and_leave_their_results(noctule, monkeypatch):
    asked = campaign(monkeypatch, ["reached", "reached"])
    said = noctule("fly", "--seeds", "3:5", "--out", "here", "--no-report", "--json")
    assert said.code == 0
    assert list(asked["seeds"]) == [3, 4]
    assert asked["out"] == Path("here")
    assert asked["finish"]({"outcome": "reached"}) == {"outcome": "reached", "report": None}
    assert [run["seed"] for run in said.last_json["runs"]] == [3, 4]
    assert said.last_json["summary"]["outcome"] == {"reached": 0.5}
    assert json.loads(Path("here/campaign.json").read_text())["noctule"]["runs"] == said.last_json["runs"]


def test_many_seeds_are_1_when_one_did_not_reach_and_name_it(noctule, monkeypatch):
    campaign(monkeypatch, ["reached", "stuck"])
    said = noctule("fly", "--seeds", "0:2", "--out", "here", "--no-report")
    assert said.code == 1
    assert "outcome: 1 of 2 reached\n" in said.out
    assert "seed 1: stuck: the time limit of 5 s has passed\n" in said.out


def test_a_campaign_writes_one_report_over_all_flights(noctule, monkeypatch):
    campaign(monkeypatch, ["reached", "reached"])
    said = noctule("fly", "--seeds", "0:2", "--out", "here", "--json")
    assert said.last_json["summary"]["report"] == "here/report/campaign.html"
    assert Path("here/report/campaign.html").is_file()


def test_a_campaigns_report_that_fails_does_not_cost_the_figures(noctule, monkeypatch):
    def fails(laws, out):
        raise RecordingError("report: the disk is full")

    campaign(monkeypatch, ["reached", "reached"])
    monkeypatch.setattr("noctule.reports.write_campaign_report", fails)
    said = noctule("fly", "--seeds", "0:2", "--json")
    assert said.code == 0
    assert said.err == "noctule: report: the disk is full\n"
    assert said.last_json["summary"]["report"] is None


def test_a_short_flight_from_the_command_line_to_its_report(noctule):
    said = noctule("fly", "one-column", "--time-limit", "0.3", "--seed", "2", "--json", "--out", "here")
    assert said.code == 1
    assert said.last_json["outcome"] == "stuck"
    assert said.last_json["reason"] == "the time limit of 0.3 s has passed"
    assert said.last_json["max_command_step"]["linear"] <= 1.0 / 30.0 + 1e-9
    assert Path(said.last_json["recording"]).stat().st_size > 0
    assert Path(said.last_json["report"]).is_file()
    assert json.loads(Path("here/summary.json").read_text())["report"] == said.last_json["report"]
