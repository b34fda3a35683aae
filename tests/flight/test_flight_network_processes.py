"""Nodes as processes: killed, frozen, started again in mid-flight; the others keep knowing their errors."""

from __future__ import annotations

import csv
import signal

import numpy as np
import pytest
from flight_drill import Drilled

from noctule.estimation.chi_square import nees_band

ROLES = ("onboard", "depth", "markers", "fusion")
SECONDS = 10.0
KILLED, RESTARTED, FROZEN, WOKEN = 2.0, 3.5, 5.5, 7.5  # [s]


@pytest.fixture(scope="module")
def drilled(tmp_path_factory):
    """A drill with four processes: what each said at its end, what the fusion showed, and its folder."""
    folder = tmp_path_factory.mktemp("drill")
    with Drilled(folder, 0, SECONDS, ROLES) as drill:
        drill.wait_until(KILLED)
        drill.signal("depth", signal.SIGKILL)
        drill.wait_until(RESTARTED)
        drill.start("depth")
        drill.wait_until(FROZEN)
        drill.signal("onboard", signal.SIGSTOP)
        drill.wait_until(WOKEN)
        drill.signal("onboard", signal.SIGCONT)
        said = {role: drill.said(role) for role in ROLES}
        return said, drill.errors("fusion").splitlines(), folder


def means(said: dict, role: str, first: float, last: float) -> list[float]:
    by_second = said[role]["drill"]["nees_by_second"]
    return [value for second, value in by_second.items() if first <= int(second) < last]


@pytest.mark.parametrize("role", ROLES)
def test_every_node_knows_its_errors_over_the_whole_flight(drilled, role):
    # Within a flight the errors are not independent: the band is that of a single estimate.
    low, high = nees_band(1, 11)
    told = drilled[0][role]["drill"]
    assert told["judged"] > 0
    assert low < told["nees_per_state"] < high


@pytest.mark.parametrize(("first", "last"), [(0, 2), (2, 4), (4, 6), (6, 8), (8, 11)])
def test_the_nodes_that_stay_know_their_errors_before_while_and_after_another_is_missing(
    drilled, first, last
):
    low, high = nees_band(1, 11, 0.999)
    for role in ("markers", "fusion"):
        found = means(drilled[0], role, first, last)
        assert all(low < value < high for value in found), role


def test_a_node_that_was_killed_and_started_again_is_told_what_the_others_know(drilled):
    said = drilled[0]["depth"]
    assert said["rejoined"] >= 1
    assert said["told_after_s"] is not None
    assert said["shared"] > 0


def test_a_node_that_was_frozen_rejoins_when_it_wakes(drilled):
    said = drilled[0]["onboard"]
    assert said["rejoined"] >= 1
    assert said["shared"] > 0
    assert said["losses"] >= 1  # it found the others gone when it woke


def test_the_fusion_says_who_is_missing_and_who_came_back(drilled):
    lines = drilled[1]
    for name in ("depth", "onboard"):
        missing = [k for k, line in enumerate(lines) if f"{name} missing since" in line]
        there = [k for k, line in enumerate(lines) if name in line and f"{name} missing" not in line]
        assert missing, name
        assert min(missing) < max(there), f"{name} did not come back"


def test_nothing_that_arrived_was_malformed(drilled):
    assert all(said["malformed"] == {} and said["overruns"] == 0 for said in drilled[0].values())


def test_the_estimates_are_recorded_as_a_table(drilled):
    with (drilled[2] / "estimates.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    stamps = np.array([float(row["stamp"]) for row in rows])
    assert (np.diff(stamps) > 0.0).all()
    assert any(row["there"] == "depth markers onboard" for row in rows)
    assert any(row["there"] == "markers onboard" for row in rows)  # depth was missing
    assert min(float(row["sd_x"]) for row in rows) < 0.05
    assert (drilled[2] / "estimates.mcap").stat().st_size > 1000
