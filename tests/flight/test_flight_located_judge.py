"""The judge of flights along a path in space, on tracks made by hand along a line."""

import math
from dataclasses import replace

import numpy as np
import pytest
from flight_judged import BEGUN, PUSH, SECONDS, STOP, between, course, moved, rank, track

from noctule.control.paths import eight
from noctule.flight.located_judge import cross_track, figures_of, runs
from noctule.flight.located_track import Track
from noctule.messages import Doubt


def test_a_perfect_flight_has_no_errors():
    found = figures_of(track(), course())
    for name in ("cross_track_mean_m", "cross_track_p95_m", "cross_track_max_m", "hover_rms_m"):
        assert found[name] == pytest.approx(0.0, abs=1e-12), name
    for name in ("heading_p95_deg", "position_rms_m", "position_p95_m", "yaw_mean_deg", "yaw_sd_deg"):
        assert found[name] == pytest.approx(0.0, abs=1e-12), name
    assert found["recovery_s"] == {"mean": 0.0, "max": 0.0}
    assert found["lost_s"] == 0.0
    assert found["slips"] == 0
    assert set(found["doubt_s"].values()) == {0.0}


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


def test_a_flight_that_ends_before_the_vehicle_came_back_has_not_recovered_sooner():
    one = moved(between(track(), 26.0, SECONDS), [0.0, 0.2, 0.0, 0.0])
    cut = Track(*(getattr(one, name)[one.stamps < PUSH + 0.5] for name in Track.__dataclass_fields__))
    assert figures_of(cut, course())["recovery_s"] == {"mean": 3.0, "max": 3.0}
    landing = replace(one, path_time=np.where(one.stamps < PUSH + 0.5, one.path_time, np.nan))
    assert figures_of(landing, course())["recovery_s"]["max"] == 3.0


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
