"""The judge of flights below the ceiling camera, on tracks made by hand along a line."""

import math
from dataclasses import replace

import numpy as np
import pytest

from noctule.control.paths import eight, line
from noctule.experiments.loc_flight_judge import (
    DOUBTS,
    Course,
    Track,
    cross_track,
    figures_of,
    runs,
)
from noctule.experiments.loc_flight_outcome import OUTCOMES, outcome_of
from noctule.messages import Doubt, Outcome

DT = 1.0 / 30.0
BEGUN = 2.0  # [s], the flight's clock at which the path begins
SECONDS = 40.0
STOP = (20.0, 32.0)
PUSH = BEGUN + 26.0


def course(**changes):
    path = line((0.0, 0.0, 1.0), (20.0, 0.0, 1.0))
    low, high = np.array([-5.0, -2.0, 0.15]), np.array([25.0, 2.0, 2.5])
    return replace(Course(path, (STOP,), (PUSH,), SECONDS, low, high), **changes)


def track(**changes):
    """Return a perfect flight at 0.3 m/s with a stop; every tick is measured."""
    stamps = DT * np.arange(round((BEGUN + SECONDS + 0.5) / DT))
    path_time = np.where(stamps < BEGUN, np.nan, stamps - BEGUN)
    flown = 0.3 * np.minimum(np.nan_to_num(path_time), STOP[0])
    flown += 0.3 * np.maximum(np.nan_to_num(path_time) - STOP[1], 0.0)
    true = np.zeros((stamps.size, 4))
    true[:, 0], true[:, 2] = flown, 1.0
    holding = (path_time >= STOP[0]) & (path_time < STOP[1])
    many = np.ones(stamps.size)
    perfect = Track(
        stamps, true, stamps.copy(), true.copy(), 0.01 * many, true.copy(), path_time, holding,
        np.zeros(stamps.size, dtype=np.int_), many > 0.0, many < 0.0,
    )  # fmt: skip
    return replace(perfect, **changes)


def between(one, begin, end):
    """Return which ticks lie between two of the path's times."""
    return (one.path_time >= begin) & (one.path_time < end)


def moved(mask, offset):
    """Return a perfect flight that is off by `offset` (4,) where `mask` says so, and knows it."""
    one = track()
    true = one.true + np.where(mask, 1.0, 0.0)[:, None] * np.asarray(offset)
    return replace(one, true=true, held=true.copy())


def rank(doubt):
    return DOUBTS.index(doubt)


def test_a_perfect_flight_has_no_errors_and_is_complete():
    found = figures_of(track(), course())
    for name in ("cross_track_mean_m", "cross_track_p95_m", "cross_track_max_m", "hover_rms_m"):
        assert found[name] == pytest.approx(0.0, abs=1e-12), name
    for name in ("heading_p95_deg", "position_rms_m", "position_p95_m", "yaw_mean_deg", "yaw_sd_deg"):
        assert found[name] == pytest.approx(0.0, abs=1e-12), name
    assert found["recovery_s"] == {"mean": 0.0, "max": 0.0}
    assert found["lost_s"] == 0.0
    assert found["slips"] == 0
    assert set(found["doubt_s"].values()) == {0.0}
    assert outcome_of(track(), course(), "reached") == "completed"


def test_cross_track_is_the_distance_in_space_on_the_way():
    on_the_way = between(track(), 0.0, STOP[0]) | between(track(), STOP[1], SECONDS + 1.0)
    found = figures_of(moved(on_the_way, [0.0, 0.03, 0.04, 0.0]), course())
    assert found["cross_track_mean_m"] == pytest.approx(0.05)
    assert found["cross_track_p95_m"] == pytest.approx(0.05)
    assert found["hover_rms_m"] == pytest.approx(0.0, abs=1e-12)


def test_being_ahead_of_the_wanted_point_is_no_cross_track():
    assert figures_of(moved(between(track(), 0.0, 10.0), [0.2, 0.0, 0.0, 0.0]), course())[
        "cross_track_max_m"
    ] == pytest.approx(0.0, abs=1e-9)


def test_its_95th_percentile_is_of_ticks():
    tenth = between(track(), 0.0, 4.0)  # of the 28 s that count: more than 5 in 100
    assert figures_of(moved(tenth, [0.0, 0.1, 0.0, 0.0]), course())["cross_track_p95_m"] == pytest.approx(0.1)
    little = between(track(), 0.0, 1.0)
    found = figures_of(moved(little, [0.0, 0.1, 0.0, 0.0]), course())
    assert found["cross_track_p95_m"] == pytest.approx(0.0, abs=1e-12)
    assert found["cross_track_max_m"] == pytest.approx(0.1)
    assert found["cross_track_mean_m"] == pytest.approx(0.1 / 28.0, rel=0.02)


@pytest.mark.parametrize("span", [(-1.0, 0.0), STOP, (SECONDS + 0.1, SECONDS + 9.0)])
def test_before_in_stops_and_after_the_path_nothing_counts_as_cross_track(span):
    found = figures_of(moved(between(track(), *span), [0.0, 0.5, 0.0, 0.0]), course(pushes=()))
    assert found["cross_track_max_m"] == pytest.approx(0.0, abs=1e-12)


def test_three_seconds_after_a_push_nothing_counts_but_the_recovery():
    shoved = course(pushes=(BEGUN + 10.0,))
    one = moved(between(track(), 10.0, 12.9), [0.0, 0.5, 0.0, 1.0])
    found = figures_of(one, shoved)
    assert found["cross_track_max_m"] == pytest.approx(0.0, abs=1e-12)
    assert found["heading_p95_deg"] == pytest.approx(0.0, abs=1e-12)
    assert found["recovery_s"]["max"] == pytest.approx(2.87, abs=0.02)
    assert figures_of(one, course(pushes=()))["cross_track_max_m"] == pytest.approx(0.5)


def test_hovering_is_judged_by_the_wanted_point_without_its_first_4_s_and_pushes():
    settled = between(track(), STOP[0] + 4.0, STOP[1])
    assert figures_of(moved(settled, [0.03, 0.0, 0.0, 0.0]), course())["hover_rms_m"] == pytest.approx(0.03)
    braking = between(track(), STOP[0], STOP[0] + 3.99)
    assert figures_of(moved(braking, [0.5, 0.0, 0.0, 0.0]), course())["hover_rms_m"] == pytest.approx(
        0.0, abs=1e-12
    )
    pushed = between(track(), 26.0, 28.99)
    assert figures_of(moved(pushed, [0.5, 0.0, 0.0, 0.0]), course())["hover_rms_m"] == pytest.approx(
        0.0, abs=1e-12
    )


def test_hovering_is_a_root_mean_square():
    half = between(track(), 24.0, 26.0)  # 2 of the 5 s that count: 24 to 26 and 29 to 32
    found = figures_of(moved(half, [0.1, 0.0, 0.0, 0.0]), course())
    assert found["hover_rms_m"] == pytest.approx(0.1 * math.sqrt(2.0 / 5.0), rel=0.02)


def test_the_heading_is_judged_by_the_wanted_one_across_the_half_turn():
    one = moved(between(track(), 0.0, SECONDS), [0.0, 0.0, 0.0, math.radians(4.0)])
    wanted = one.wanted.copy()
    true = one.true.copy()
    wanted[:, 3] += math.pi - math.radians(2.0)
    true[:, 3] += math.pi - math.radians(2.0)
    true[:, 3] = np.remainder(true[:, 3] + math.pi, math.tau) - math.pi
    turned = replace(one, true=true, held=true.copy(), wanted=wanted)
    assert figures_of(turned, course())["heading_p95_deg"] == pytest.approx(4.0)


@pytest.mark.parametrize(("until", "seconds"), [(0.02, 0.0), (0.5, 0.5), (2.0, 2.0), (9.0, 3.0)])
def test_recovery_is_the_last_time_beyond_8_cm_within_3_s(until, seconds):
    out = between(track(), 26.0, 26.0 + until)
    found = figures_of(moved(out, [0.0, 0.0, 0.09, 0.0]), course())
    assert found["recovery_s"]["max"] == pytest.approx(seconds, abs=0.04)
    near = figures_of(moved(out, [0.0, 0.0, 0.079, 0.0]), course())
    assert near["recovery_s"]["max"] == 0.0


def test_a_vehicle_that_comes_back_and_leaves_again_has_not_recovered():
    out = between(track(), 26.0, 26.5) | between(track(), 27.0, 27.5)
    found = figures_of(moved(out, [0.0, 0.2, 0.0, 0.0]), course())
    assert found["recovery_s"]["max"] == pytest.approx(1.5, abs=0.04)


def test_recoveries_are_averaged_over_the_pushes_that_were_flown():
    pushes = (BEGUN + 5.0, PUSH, BEGUN + 500.0)
    out = between(track(), 26.0, 27.0)
    found = figures_of(moved(out, [0.0, 0.2, 0.0, 0.0]), course(pushes=pushes))
    assert found["recovery_s"]["mean"] == pytest.approx(0.5, abs=0.03)
    assert found["recovery_s"]["max"] == pytest.approx(1.0, abs=0.04)


def test_along_the_path_a_push_is_none_while_moving_but_one_in_a_stop():
    ahead = moved(between(track(), 26.0, 27.0), [0.3, 0.0, 0.0, 0.0])
    assert figures_of(ahead, course())["recovery_s"]["max"] > 0.9
    moving = moved(between(track(), 10.0, 11.0), [0.3, 0.0, 0.0, 0.0])
    assert figures_of(moving, course(pushes=(BEGUN + 10.0,)))["recovery_s"]["max"] == 0.0


def test_the_estimate_is_judged_against_the_truth_of_its_own_time():
    one = track()
    late = one.stamps - 0.05
    held = np.column_stack([np.interp(late, one.stamps, column) for column in one.true.T])
    found = figures_of(replace(one, held_at=late, held=held), course())
    assert found["position_rms_m"] == pytest.approx(0.0, abs=1e-9)
    unaware = figures_of(replace(one, held=held), course())
    assert unaware["position_rms_m"] == pytest.approx(0.3 * 0.05 * math.sqrt(28.0 / 40.0), rel=0.02)


def test_the_estimates_errors_have_mean_deviation_and_consistency():
    one = track()
    held = one.held.copy()
    held[:, 1] += 0.01
    held[::2, 3] += math.radians(3.0)
    held[1::2, 3] += math.radians(1.0)
    found = figures_of(replace(one, held=held), course())
    assert found["position_rms_m"] == pytest.approx(0.01)
    assert found["position_p95_m"] == pytest.approx(0.01)
    assert found["position_nees"] == pytest.approx(1.0)
    assert found["yaw_mean_deg"] == pytest.approx(2.0, abs=0.01)
    assert found["yaw_sd_deg"] == pytest.approx(1.0, abs=0.01)


def test_a_slip_is_the_other_half_turn_held_for_more_than_a_tenth_of_a_second():
    one = track()
    held = one.held.copy()
    held[between(one, 5.0, 5.3), 3] += math.pi
    held[between(one, 9.0, 9.07), 3] -= math.pi
    held[between(one, 15.0, 16.0), 3] += math.radians(80.0)
    assert figures_of(replace(one, held=held), course())["slips"] == 1


def test_a_vehicle_that_no_camera_measures_is_lost_after_a_quarter_of_a_second():
    one = track()
    found = figures_of(replace(one, measured=~between(one, 10.0, 13.0)), course())
    assert found["lost_s"] == pytest.approx(2.75, abs=0.05)
    short = figures_of(replace(one, measured=~between(one, 10.0, 10.2)), course())
    assert short["lost_s"] == 0.0


def test_doubt_is_told_by_its_kind_and_flying_on_is_not_lost():
    one = track()
    doubt = one.doubt.copy()
    doubt[between(one, 5.0, 6.0)] = rank(Doubt.FLY_ON)
    doubt[between(one, 6.0, 8.0)] = rank(Doubt.SLOW)
    doubt[between(one, 8.0, 11.0)] = rank(Doubt.HOVER)
    found = figures_of(replace(one, doubt=doubt), course())
    told = {"fly on": 1.0, "slow": 2.0, "hover": 3.0, "land": 0.0}
    assert found["doubt_s"] == {name: pytest.approx(s, abs=0.04) for name, s in told.items()}
    assert found["lost_s"] == pytest.approx(5.0, abs=0.04)


def test_hovering_in_doubt_is_neither_following_nor_a_stop():
    away = between(track(), 8.0, 11.0) | between(track(), 29.5, 31.0)
    one = moved(away, [0.0, 0.2, 0.0, 0.0])
    doubt = np.where(away, rank(Doubt.HOVER), rank(Doubt.SURE))
    found = figures_of(replace(one, doubt=doubt), course())
    assert found["cross_track_max_m"] == pytest.approx(0.0, abs=1e-12)
    assert found["hover_rms_m"] == pytest.approx(0.0, abs=1e-12)


def test_a_flight_that_never_began_its_path_has_no_figures():
    one = track()
    nothing = np.full(one.stamps.size, np.nan)
    held = np.full((one.stamps.size, 4), np.nan)
    found = figures_of(replace(one, path_time=nothing, held=held, held_at=nothing), course())
    assert found["cross_track_mean_m"] is None
    assert found["position_rms_m"] is None
    assert found["recovery_s"] == {"mean": None, "max": None}
    assert found["lost_s"] == 0.0


def test_the_nearest_point_is_that_of_the_whole_path():
    path = eight((0.0, 0.0, 1.0), (0.45, 0.8), rise=0.1)
    x = path.at(2.0).position + np.array([0.0, 0.0, 0.004])
    true = np.append(x, 0.0)[None]
    one = replace(track(), stamps=np.zeros(1), true=true)
    assert 0.0 < cross_track(one, course(path=path))[0] <= 0.004


def test_stretches_are_as_long_as_from_their_first_tick_to_their_last():
    stamps = np.arange(8.0)
    mask = np.array([True, True, False, False, True, False, True, True])
    assert runs(stamps, mask) == [1.0, 0.0, 1.0]
    assert runs(stamps, np.zeros(8, dtype=bool)) == []


@pytest.mark.parametrize(
    ("ended", "outcome"),
    [
        (Outcome.REACHED, "completed"),
        (Outcome.LOST, "landed_lost"),
        (Outcome.COLLIDED, "contact"),
        (Outcome.STUCK, "stuck"),
        (Outcome.ABORTED, "aborted"),
    ],
)
def test_a_flight_in_which_nothing_went_wrong_ends_as_the_pilot_ended_it(ended, outcome):
    assert outcome_of(track(), course(), str(ended)) == outcome
    assert outcome in OUTCOMES


def test_a_touch_is_a_contact():
    one = track()
    assert outcome_of(replace(one, touched=between(one, 9.0, 9.1)), course(), "reached") == "contact"


@pytest.mark.parametrize("offset", [[0.0, 2.1, 0.0, 0.0], [0.0, 0.0, -0.9, 0.0], [0.0, 0.0, 1.6, 0.0]])
def test_a_vehicle_that_is_truly_out_of_the_box_left_the_fence(offset):
    before = track().stamps < 0.5
    assert outcome_of(moved(before, offset), course(), "reached") == "fence"


def test_who_lands_may_go_below_the_fence_but_not_through_its_walls():
    landing = track().path_time > 39.0
    doubt = np.where(landing, rank(Doubt.LAND), rank(Doubt.SURE))
    down = replace(moved(landing, [0.0, 0.0, -0.9, 0.0]), doubt=doubt)
    assert outcome_of(down, course(), "lost") == "landed_lost"
    aside = replace(moved(landing, [0.0, 2.1, 0.0, 0.0]), doubt=doubt)
    assert outcome_of(aside, course(), "lost") == "fence"


@pytest.mark.parametrize(
    ("off", "seconds", "outcome"), [(0.6, 1.2, "diverged"), (0.6, 0.9, "completed"), (0.4, 9.0, "completed")]
)
def test_an_estimate_held_for_sure_that_is_half_a_metre_off_for_a_second_has_diverged(off, seconds, outcome):
    one = track()
    held = one.held.copy()
    held[between(one, 8.0, 8.0 + seconds), 1] += off
    assert outcome_of(replace(one, held=held), course(), "reached") == outcome


def test_an_estimate_that_is_doubted_may_be_wrong():
    one = track()
    held, doubt = one.held.copy(), one.doubt.copy()
    held[between(one, 8.0, 12.0), 1] += 0.6
    doubt[between(one, 8.0, 12.0)] = rank(Doubt.SLOW)
    assert outcome_of(replace(one, held=held, doubt=doubt), course(), "reached") == "completed"


def test_an_estimate_that_is_wrong_from_the_first_tick_has_diverged():
    one = track()
    held = one.held.copy()
    held[:, 0] += 0.6
    assert outcome_of(replace(one, held=held), course(), "reached") == "diverged"


def test_a_metre_from_the_path_is_astray_but_not_before_it():
    assert outcome_of(moved(between(track(), 8.0, 8.1), [0, 1.1, 0, 0]), course(), "reached") == "diverged"
    before = track().stamps < BEGUN - 0.1
    assert outcome_of(moved(before, [0, 1.1, 0, 0]), course(), "reached") == "completed"


def test_what_happened_first_names_the_outcome():
    one = moved(between(track(), 8.0, 9.0), [0.0, 1.1, 0.0, 0.0])
    later = replace(one, touched=between(one, 8.5, 9.0))
    assert outcome_of(later, course(), "collided") == "diverged"
    sooner = replace(one, touched=between(one, 7.0, 7.1))
    assert outcome_of(sooner, course(), "collided") == "contact"
