"""Many flights: all come home in order, one thread each, and a worker that dies takes no other with it."""

from __future__ import annotations

import os

import campaign_pretended as pretended
import pytest

from noctule.campaign import CampaignError, fly_seeds
from noctule.campaign.worker import ONE_THREAD, fly_one, one_thread_for_children


def fly(seeds, out, fly, **options):
    return fly_seeds(pretended.named, seeds, out, jobs=2, progress=False, fly=fly, **options)


def outcomes(results):
    return {run["seed"]: run["outcome"] for run in results["runs"]}


def test_every_seed_flies_its_own_mission_into_its_own_folder_in_order(tmp_path):
    results = fly([4, 2, 7], tmp_path, pretended.reached)
    assert [run["seed"] for run in results["runs"]] == [4, 2, 7]
    assert [run["mission"] for run in results["runs"]] == ["mission 4", "mission 2", "mission 7"]
    assert [run["out"] for run in results["runs"]] == [str(tmp_path / f"seed-{s}") for s in (4, 2, 7)]


def test_the_summary_is_pooled_over_the_runs(tmp_path):
    summary = fly([1, 2, 6], tmp_path, pretended.reached)["summary"]
    assert summary["outcome"]["reached"] == 1.0
    assert summary["position_error_m"] == 0.02


def test_each_flight_has_one_thread_in_a_process_of_its_own(tmp_path):
    before = dict(os.environ)
    (run,) = fly([5], tmp_path, pretended.reached)["runs"]
    assert run["pid"] != os.getpid()
    assert set(run["threads"].values()) == {"1"}
    assert dict(os.environ) == before


def test_finish_completes_each_run_where_it_was_flown(tmp_path):
    results = fly([1, 2], tmp_path, pretended.reached, finish=pretended.with_page)
    assert [run["report"] for run in results["runs"]] == ["page 1", "page 2"]


def test_flights_of_another_kind_are_pooled_in_their_own_way(tmp_path):
    results = fly([1, 2], tmp_path, pretended.reached, together=lambda runs: {"flights": len(runs)})
    assert set(results) == {"runs", "flights"}
    assert results["flights"] == 2


def test_the_bar_counts_the_outcome_that_is_good_for_them(tmp_path, capsys):
    fly_seeds(pretended.named, [1], tmp_path, jobs=1, fly=pretended.reached, good="completed")
    assert "flights (0 completed)" in capsys.readouterr().err


def test_a_worker_that_dies_twice_is_named_and_the_others_come_home(tmp_path):
    results = fly(range(6), tmp_path, pretended.dies_on_3)
    assert outcomes(results) == {seed: "aborted" if seed == 3 else "reached" for seed in range(6)}
    assert results["runs"][3]["reason"] == ("the worker that flew seed 3 died twice; is there memory enough?")
    assert results["summary"]["outcome"]["aborted"] == pytest.approx(1 / 6)


def test_a_worker_that_dies_once_is_tried_again(tmp_path):
    results = fly(range(4), tmp_path, pretended.dies_once_on_2)
    assert outcomes(results) == dict.fromkeys(range(4), "reached")


def test_a_bug_in_one_flight_is_shown_and_does_not_lose_the_others(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("noctule.flight.fly_mission", pretended.fly_mission)
    run = fly_one(pretended.has_a_bug, 1, tmp_path, None)
    assert (run["outcome"], run["reason"]) == ("aborted", "ZeroDivisionError: a bug")
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("seeds", "jobs", "line"),
    [
        ([], 2, "a campaign has no seeds, expected at least one; give a range such as 0:10"),
        ([1, 4, 1], 2, "seed 1 is given more than once, expected each seed once; leave one out"),
        ([1], 0, "a campaign has 0 jobs, expected 1 or more; leave it out for one per core"),
    ],
)
def test_a_campaign_that_makes_no_sense_is_refused(tmp_path, seeds, jobs, line):
    with pytest.raises(CampaignError) as caught:
        fly_seeds(pretended.named, seeds, tmp_path, jobs=jobs, progress=False)
    assert str(caught.value) == line


def test_a_mistake_in_one_seeds_mission_aborts_that_seed_only(tmp_path, monkeypatch):
    monkeypatch.setattr("noctule.flight.fly_mission", pretended.fly_mission)
    run = fly_one(pretended.too_small, 8, tmp_path, None)
    assert (run["seed"], run["outcome"], run["reason"]) == (8, "aborted", "room of seed 8: too small")
    assert run["max_command_step"] == {"linear": None, "angular": None}


def test_a_flight_gives_its_summary_with_its_seed(tmp_path, monkeypatch):
    monkeypatch.setattr("noctule.flight.fly_mission", pretended.fly_mission)
    run = fly_one(pretended.named, 8, tmp_path, pretended.with_page)
    assert (run["seed"], run["outcome"], run["report"]) == (8, "reached", "page 8")
    assert run["recording"] == str(tmp_path)


def test_the_environment_is_put_back_after_a_campaign(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("LP_NUM_THREADS", raising=False)
    with one_thread_for_children():
        assert {os.environ[name] for name in ONE_THREAD} == {"1"}
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "LP_NUM_THREADS" not in os.environ


def test_the_bar_counts_flights_and_those_that_reached(tmp_path, capsys):
    fly_seeds(pretended.named, [0, 3], tmp_path, jobs=2, progress=True, fly=pretended.dies_on_3)
    said = capsys.readouterr()
    assert said.out == ""
    assert "flights (1 reached)" in said.err
    assert "2/2" in said.err
