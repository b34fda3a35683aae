"""The figures of a flight along a path in space, on flights that can be worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from noctule.control.paths import line, plan
from noctule.flight.located_summary import FIGURES, final_goal, located_figures
from noctule.flight.samples import Samples
from noctule.flight.summary import pool, summarise
from noctule.geometry import Pose
from noctule.messages import Doubt, PoseMeasurement, Truth, Whereabouts

DT = 0.1
ALONG_X = plan(line((0.0, 0.0, 1.0), (2.0, 0.0, 1.0)))
SEEN = PoseMeasurement(0.0, np.zeros(3), 0.0, np.eye(4), "registration")


class Flown:
    """Samples that are filled tick by tick."""

    def __init__(self) -> None:
        self.samples = Samples()
        self.begun: float | None = None

    def tick(self, phase, true=(0.0, 0.0, 1.0), yaw=0.0, held=None, wanted=None, doubt=Doubt.SURE, seen=True):
        stamp = DT * len(self.samples.times)
        held = np.array(true if held is None else held, dtype=float)
        wanted = np.array([*(true if wanted is None else wanted), 0.0], dtype=float)
        if phase in ("follow", "stop") and self.begun is None:
            self.begun = stamp
        known = Whereabouts(
            stamp, held, 0.0, np.zeros(4), 0.01, 0.01, wanted, doubt=doubt, measured=SEEN if seen else None,
            path_time=math.nan if self.begun is None else stamp - self.begun, holding=phase == "stop",
        )  # fmt: skip
        self.samples.times.append(stamp)
        self.samples.phases.append(phase)
        self.samples.whereabouts.append(known)
        self.samples.truths.append(Truth(stamp, Pose(np.array(true, dtype=float), yaw), np.zeros(3), 1.0))


def test_cross_track_counts_on_the_way_and_neither_before_nor_in_stops():
    flown = Flown()
    flown.tick("to start", (0.0, 5.0, 1.0))
    for y in (0.01, 0.02, 0.03):
        flown.tick("follow", (1.0, y, 1.0))
    flown.tick("stop", (1.0, 0.5, 1.0))
    flown.tick("return", (1.0, 5.0, 1.0))
    found = located_figures(ALONG_X, flown.samples)
    assert found["cross_track_mean_m"] == pytest.approx(0.02)
    assert found["cross_track_max_m"] == pytest.approx(0.03)
    assert found["cross_track_p95_m"] == pytest.approx(0.029)


def test_hovering_counts_from_the_fourth_second_of_a_stop_against_the_held_point():
    flown = Flown()
    flown.tick("follow")
    for k in range(60):
        off = 1.0 if k * DT < 4.0 else 0.02
        flown.tick("stop", (1.0, off, 1.0), wanted=(1.0, 0.0, 1.0))
    assert located_figures(ALONG_X, flown.samples)["hover_rms_m"] == pytest.approx(0.02)


def test_a_push_and_hovering_in_doubt_are_no_following_as_in_the_experiments():
    flown = Flown()
    for k in range(80):
        # Pushed away at the 20th tick (2 s) for as long as a recovery is given; later in doubt.
        pushed, doubtful = 20 <= k < 50, k >= 70
        flown.tick(
            "follow",
            (1.0, 0.4 if pushed else 0.3 if doubtful else 0.01, 1.0),
            yaw=1.0 if pushed or doubtful else 0.02,
            doubt=Doubt.HOVER if doubtful else Doubt.FLY_ON,
        )
    push = flown.samples.times[20]
    found = located_figures(ALONG_X, flown.samples, (push,))
    assert found["cross_track_max_m"] == pytest.approx(0.01)
    assert found["heading_p95_deg"] == pytest.approx(math.degrees(0.02))
    assert located_figures(ALONG_X, flown.samples)["cross_track_max_m"] == pytest.approx(0.4)


def test_a_push_has_a_recovery_and_many_flights_the_longest_of_them():
    flown = Flown()
    for k in range(60):
        flown.tick("follow", (1.0, 0.2 if 20 <= k < 26 else 0.0, 1.0))
    pushed = summarise(flown.samples, None, "reached", "", None, plan=ALONG_X, pushes=(2.0,))
    assert pushed["recovery_s"] == {"mean": pytest.approx(0.5), "max": pytest.approx(0.5)}
    spared = summarise(flown.samples, None, "reached", "", None, plan=ALONG_X)
    assert spared["recovery_s"] == {"mean": None, "max": None}
    quick = {**pushed, "recovery_s": {"mean": 0.1, "max": 0.3}}
    assert pool([pushed, spared, quick])["recovery_s"] == {
        "mean": pytest.approx(0.3),
        "max": pytest.approx(0.5),
    }


def test_a_stop_ends_with_the_tick_that_goes_on():
    flown = Flown()
    for phase, off in (("follow", 0.01), ("stop", 0.5), ("stop", 0.5), ("follow", 0.03), ("hold", 0.7)):
        flown.tick(phase, (1.0, off, 1.0))
    found = located_figures(ALONG_X, flown.samples)
    assert found["cross_track_mean_m"] == pytest.approx(0.02)
    assert found["cross_track_max_m"] == pytest.approx(0.03)


def test_what_the_pilot_held_is_compared_with_the_truth_and_headings_the_short_way_round():
    flown = Flown()
    flown.tick("follow", (1.0, 0.0, 1.0), yaw=math.radians(2.0), held=(1.0, 0.003, 1.004))
    flown.tick("follow", (1.0, 0.0, 1.0), yaw=math.radians(4.0), held=(1.0, 0.003, 1.004))
    found = located_figures(ALONG_X, flown.samples)
    assert found["position_rms_m"] == pytest.approx(0.005)
    assert found["yaw_mean_deg"] == pytest.approx(-3.0)
    assert found["yaw_sd_deg"] == pytest.approx(1.0)
    assert found["heading_p95_deg"] == pytest.approx(3.9)


def test_it_is_lost_while_it_doubts_more_than_flying_on_or_was_not_seen_for_a_quarter_second():
    flown = Flown()
    flown.tick("searching", seen=False)  # it never knew yet: that is searching, not being lost
    flown.tick("follow")
    for doubt in (Doubt.SURE, Doubt.FLY_ON, Doubt.SLOW, Doubt.HOVER):
        flown.tick("follow", doubt=doubt)
    for _ in range(4):
        flown.tick("follow", seen=False)  # of these, two come after a quarter second
    assert located_figures(ALONG_X, flown.samples)["lost_s"] == pytest.approx(0.4)


def test_a_flight_that_never_got_to_its_path_has_no_figures():
    flown = Flown()
    flown.tick("searching")
    assert located_figures(ALONG_X, flown.samples) == dict.fromkeys(FIGURES)
    flown.tick("follow")
    flown.samples.truths.pop()
    assert located_figures(ALONG_X, flown.samples) == dict.fromkeys(FIGURES)
    assert final_goal(Samples()) is None


def test_the_summary_has_these_figures_and_the_pilots_own_goal_but_only_for_a_path_in_space():
    flown = Flown()
    flown.tick("follow", (1.9, 0.0, 1.0), wanted=(2.0, 0.0, 1.0))
    found = summarise(flown.samples, None, "reached", "", None, plan=ALONG_X)
    assert found["position_error_m"] == pytest.approx(0.1)
    assert found["cross_track_mean_m"] == pytest.approx(0.0, abs=1e-12)
    assert set(FIGURES) <= set(found)
    plain = summarise(flown.samples, None, "reached", "", None)
    assert plain["position_error_m"] is None
    assert "lost_s" not in plain
    together = pool([found, found])
    assert together["lost_s"] == 0.0
    assert "lost_s" not in pool([plain, plain])
