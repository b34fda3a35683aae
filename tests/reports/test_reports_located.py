"""Reports of flights whose pilot knows where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_located import BEGIN, BLIND, PUSHES, STOP, make_located, make_located_log, wrap

from noctule.flight.reader import read_recording
from noctule.flight.recording import FlightRecorder, sent_message
from noctule.geometry import Pose
from noctule.messages import (
    Command,
    Decision,
    DepthFrame,
    Doubt,
    FlightState,
    PoseMeasurement,
    Truth,
    VehicleState,
    Whereabouts,
)
from noctule.reports import write_report
from noctule.reports.doubt_strip import doubts_in_words, main_reason, unseen_in_words
from noctule.reports.figure_plans import LOCATED, VISUAL, plans_of
from noctule.reports.flight_report import draw_figures, flight_page
from noctule.reports.headings import turning
from noctule.reports.loading import flight_log
from noctule.reports.located_loading import located_log
from noctule.reports.located_log import between, spans
from noctule.reports.located_scene import LocatedScene
from noctule.reports.located_series import control_figure, estimate_figure, pose_figure, speed_figure
from noctule.reports.located_views import hover_figure, path_figure
from noctule.reports.page import png_size
from noctule.reports.style import house_style
from noctule.reports.summary import flight_rows, in_words_located

TICK = 1.0 / 30.0


@pytest.fixture(scope="module")
def log():
    return make_located_log()


@pytest.fixture(scope="module")
def real():
    return make_located_log(truth=False)


def labels(figure) -> list[str]:
    return [line.get_label() for axis in figure.axes for line in axis.get_lines()]


# What is worked out of a flight.


def test_a_stop_is_where_the_follower_says_so_and_nothing_before_the_path_is_one(log):
    ((a, b),) = log.located.stops
    assert (a, b) == pytest.approx(STOP, abs=1.1 * TICK)
    assert not log.located.on_path[log.located.times < BEGIN - TICK].any()


def test_hovering_in_doubt_and_landing_are_no_part_of_the_path(log):
    located = log.located
    doubts = np.array(located.doubts)
    assert not located.on_path[doubts == "hover"].any()
    assert located.on_path[doubts == "slow"].all()
    landing = replace(located, doubts=("land",) * len(doubts))
    assert not landing.on_path.any()
    assert landing.stops == []


def test_three_seconds_after_a_push_and_four_of_a_stop_are_not_hovering(log):
    located = log.located
    times = located.times[located.hovering]
    # The stop begins at 12 s: 4 s to settle, a push at 15 s, one at 20 s.
    assert times.min() == pytest.approx(PUSHES[0] + 3.0, abs=1.1 * TICK)
    assert times[times < PUSHES[1]].max() == pytest.approx(PUSHES[1], abs=1.1 * TICK)
    assert times[times > PUSHES[1]].min() == pytest.approx(PUSHES[1] + 3.0, abs=1.1 * TICK)
    assert times.max() == pytest.approx(STOP[1], abs=1.1 * TICK)
    assert not (located.following & located.stopped).any()


def test_distance_from_the_path_is_known_once_it_is_begun_and_peaks_after_a_push(log):
    cross = log.located.cross_track()
    assert np.isfinite(cross).tolist() == log.located.on_path.tolist()
    assert np.nanmean(cross[log.located.following]) < 0.01
    assert PUSHES[0] < log.located.times[np.nanargmax(cross)] < PUSHES[1] + 1.0


def test_without_a_path_there_is_no_distance_from_it(log):
    located = replace(log.located, path=None)
    assert np.isnan(located.cross_track()).all()
    with house_style():
        assert len(control_figure(replace(log, located=located)).axes) == 2


def test_heading_errors_are_the_short_way_round():
    located = make_located(5.0)
    turned = replace(
        located,
        fused=np.column_stack([located.fused[:, :3], np.full(len(located.times), 3.1)]),
        true=np.column_stack([located.true[:, :3], np.full(len(located.times), -3.1)]),
    )
    assert turned.estimate_off[-1, 3] == pytest.approx(6.2 - 2 * np.pi)


def test_what_is_measured_is_held_against_what_the_pilot_held_at_the_exposure(log):
    off = log.located.camera_off
    assert off.shape == log.located.measured.shape
    seen = np.isfinite(off[:, 0])
    assert seen.mean() > 0.95
    assert np.sqrt(np.mean(off[seen, :3] ** 2)) < 0.02


def test_a_flight_without_truth_is_judged_by_what_was_fused(log, real):
    assert log.located.has_truth
    assert not real.located.has_truth
    np.testing.assert_array_equal(real.located.flown, real.located.fused)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.booleans(), min_size=1, max_size=30))
def test_spans_hold_exactly_the_ticks_of_their_mask(mask):
    times = np.arange(len(mask), dtype=float)
    inside = np.zeros(len(mask), dtype=bool)
    for a, b in spans(times, np.array(mask)):
        assert not inside[(times >= a) & (times <= b)].any()
        inside |= (times >= a) & (times <= b)
    assert inside.tolist() == mask


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-10.0, 10.0), min_size=2, max_size=30))
def test_poses_between_their_own_times_are_themselves_whatever_they_turn(angles):
    yaw = wrap(np.array(angles))
    times = np.arange(len(yaw), dtype=float)
    rows = np.column_stack([times, -times, 0.5 * times, yaw])
    found = between(times, rows, times)
    np.testing.assert_allclose(found[:, :3], rows[:, :3])
    np.testing.assert_allclose(np.cos(found[:, 3] - yaw), 1.0)


def test_poses_outside_of_what_is_known_are_unknown():
    rows = np.zeros((3, 4))
    rows[0] = np.nan
    found = between(np.arange(3.0), rows, np.array([0.5, 1.5, 2.5]))
    assert np.isfinite(found).all(axis=1).tolist() == [False, True, False]
    assert np.isnan(between(np.arange(3.0), np.full((3, 4), np.nan), np.array([1.0]))).all()


def test_headings_stay_within_a_turn_and_break_where_they_start_anew():
    stamps, said = turning(np.arange(4.0), np.radians([200.0, 260.0, 280.0, 300.0]), -90.0)
    assert np.isnan(stamps[2])
    assert said[[0, 1, 3, 4]] == pytest.approx([200.0, 260.0, -80.0, -60.0])


# What is told in words.


def test_every_stretch_of_doubt_is_told_with_what_was_done_and_why(log):
    lines = doubts_in_words(log.located)
    assert len(lines) == 3
    assert lines[0].startswith("30.3 to 31.0 s, flies on by what remains: the ceiling camera has not seen")
    assert [line.split(", ")[1].split(":")[0] for line in lines] == [
        "flies on by what remains",
        "flies slowly",
        "hovers",
    ]


def test_many_stretches_of_doubt_are_counted_not_listed(log):
    n = len(log.located.times)
    flicker = tuple("slow" if i % 20 < 10 else "sure" for i in range(n))
    lines = doubts_in_words(replace(log.located, doubts=flicker))
    assert len(lines) == 8
    assert lines[-1] == f"left out: the {n // 20 - 7} mildest and shortest of {n // 20} stretches of doubt"


def doubting(log, *stretches):
    """The flight with nothing but these stretches of doubt: what was done, from, to [s]."""
    doubts = np.full(len(log.located.times), "sure", dtype=object)
    for doubt, a, b in stretches:
        doubts[(log.located.times >= a - TICK / 2) & (log.located.times < b - TICK / 2)] = doubt
    return replace(log.located, doubts=tuple(doubts.tolist()))


def test_what_ended_the_flight_is_told_however_often_it_doubted_before(log):
    slow = [("slow", 2.0 * k, 2.0 * k + 0.5 + 0.1 * k) for k in range(1, 9)]
    lines = doubts_in_words(doubting(log, *slow, ("hover", 39.0, 39.9), ("land", 39.9, 41.0)))
    assert [line.split(":")[0] for line in lines[-3:]] == [
        "39.0 to 39.9 s, hovers",
        "39.9 to 40.0 s, lands",
        "left out",
    ]
    assert lines[-1] == "left out: the 3 mildest and shortest of 10 stretches of doubt"
    begun = [float(line.split()[0]) for line in lines[:-1]]
    assert begun == [8.0, 10.0, 12.0, 14.0, 16.0, 39.0, 39.9]


def test_the_last_hover_is_told_even_if_longer_ones_came_before(log):
    long = [("hover", 3.0 * k, 3.0 * k + 2.0) for k in range(1, 10)]
    lines = doubts_in_words(doubting(log, *long, ("fly on", 32.0, 36.0), ("hover", 39.0, 39.2)))
    assert lines[-2].startswith("39.0 to 39.2 s, hovers")
    assert "flies on" not in "".join(lines)
    assert lines[-1] == "left out: the 4 mildest and shortest of 11 stretches of doubt"


def test_as_many_stretches_as_there_is_room_for_are_all_told(log):
    lines = doubts_in_words(doubting(log, *(("fly on", 2.0 * k, 2.0 * k + 0.5) for k in range(1, 9))))
    assert len(lines) == 8
    assert "left out" not in "".join(lines)


def test_a_stretch_of_one_tick_is_at_a_time(log):
    lines = doubts_in_words(doubting(log, ("land", 39.9, 39.9 + TICK)))
    assert lines == ["at 39.9 s, lands"]


def test_the_reason_told_is_the_one_that_held_longest_in_its_last_wording():
    held = [f"not seen for {0.1 * k:.1f} s (something is held before it)" for k in range(10)]
    again = [f"not seen for {1.0 + 0.1 * k:.1f} s (it has just come into view again)" for k in range(3)]
    assert main_reason([*held, "", *again]) == "not seen for 0.9 s (something is held before it)"
    assert main_reason(["silent", "hidden"]) == "silent"
    assert main_reason(["", ""]) == ""
    assert main_reason([]) == ""


def test_frames_without_the_drone_are_counted_by_their_reason(log):
    (line,) = unseen_in_words(log.located)
    blind = int((~log.located.seen).sum())
    assert line.startswith(f"not seen in {blind} of 1200 frames: occluded ")
    assert line.endswith(", not found yet 15")
    assert unseen_in_words(replace(log.located, seen=np.ones(1200, dtype=bool))) == []


@pytest.mark.parametrize(
    ("outcome", "said"),
    [
        ("reached", "The drone flew its path to the end in 40.0 s, 4.7 mm from it on average."),
        ("completed", "The drone flew its path to the end in 40.0 s, 4.7 mm from it on average."),
        ("lost", "The drone did not know where it was and landed after 40.0 s: hidden."),
        ("landed_lost", "The drone did not know where it was and landed after 40.0 s: hidden."),
        ("contact", "The drone touched something after 40.0 s: hidden."),
        ("fence", "The drone left its fence within 40.0 s: hidden."),
        ("diverged", "The drone went astray within 40.0 s: hidden."),
        ("stuck", "The drone had not flown its path to the end after 40.0 s: hidden."),
        ("aborted", "The flight was ended early, after 40.0 s: hidden."),
    ],
)
def test_the_end_is_told_in_one_sentence(outcome, said):
    summary = {"outcome": outcome, "duration_s": 40.0, "reason": "hidden.", "cross_track_mean_m": 0.0047}
    assert in_words_located(summary, 41.0) == said


def test_a_flight_that_was_handed_over_has_both_of_its_paths_told():
    summary = {"outcome": "reached", "duration_s": 12.4, "epsilon_px": 0.8, "cross_track_mean_m": 0.0026}
    assert in_words_located(summary, 13.0) == (
        "The drone reached the last image after 12.4 s. "
        "Before that it followed its path in space, 2.6 mm from it on average."
    )
    lost = {"outcome": "lost", "duration_s": 12.4, "epsilon_px": 0.8, "reason": "no image"}
    assert in_words_located(lost, 13.0) == (
        "The drone no longer recognised its surroundings after 12.4 s: no image."
    )


def test_a_reason_that_ends_in_a_question_is_left_so():
    summary = {"outcome": "lost", "duration_s": 20.0, "reason": "not found; is it in view?"}
    assert in_words_located(summary, 20.0).endswith("after 20.0 s: not found; is it in view?")


def test_the_table_names_the_figures_of_located_flights_in_their_units(log):
    rows = {row.label: row.value for row in flight_rows(log.summary)}
    assert rows["Distance from the path, 95th percentile"] == "8.5 mm"
    assert rows["Distance from the held point, root mean square"] == "6.4 mm"
    assert rows["Time to come back after a push, most"] == "0.6 s"
    assert rows["Error of the fused heading, standard deviation"] == "0.71°"
    assert "Mean distance of the points at the end" not in rows


# What is drawn.


def test_a_located_flight_has_its_own_figures_and_one_by_pictures_keeps_its_own(log):
    names = [plan.name for plan in plans_of(log)]
    assert names == [plan.name for plan in LOCATED] + ["clearance", "ticks"]
    assert plans_of(replace(log, located=None)) == VISUAL
    handed_over = replace(log, epsilon=np.ones(len(log.times)))
    both = [plan.name for plan in plans_of(handed_over)]
    assert both[: len(LOCATED)] == names[: len(LOCATED)]
    assert {"camera", "errors"} <= set(both)
    assert len(both) == len(set(both))


def test_every_figure_is_drawn_with_truth_and_what_needs_it_says_so_without(log, real):
    assert all(d.png is not None and png_size(d.png)[0] > 1000 for d in draw_figures(make_located_log(16.0)))
    missing = {d.name: d.missing for d in draw_figures(make_located_log(16.0, truth=False)) if d.png is None}
    assert missing == {
        "clearance": "There is no truth in this recording (a real drone has none), so this is left out."
    }


@pytest.mark.parametrize("draw", [path_figure, pose_figure, speed_figure])
def test_without_a_referee_no_line_is_called_true(log, real, draw):
    with house_style():
        assert "true" in labels(draw(log))
        assert "true" not in labels(draw(real))


def test_pushes_are_stars_on_every_panel_and_named_once(log):
    with house_style():
        figure = pose_figure(log)
    for axis in figure.axes:
        stars = [ln for ln in axis.get_lines() if ln.get_marker() == "*" and len(ln.get_xdata())]
        assert [float(ln.get_xdata()[0]) for ln in stars] == list(PUSHES)
    assert labels(figure).count("pushed") == 1


def test_the_band_is_three_of_the_pilot_s_own_deviations(log):
    with house_style():
        figure = estimate_figure(log)
    top = max(v[1] for v in figure.axes[0].collections[0].get_paths()[0].vertices)
    assert top == pytest.approx(3e3 * np.nanmax(log.located.position_sd))


def test_a_first_guess_metres_wide_does_not_hide_the_errors_of_the_flight():
    located = make_located(20.0)
    wide = located.position_sd.copy()
    wide[15:30] = 5.0
    with house_style():
        figure = estimate_figure(replace(make_located_log(20.0), located=replace(located, position_sd=wide)))
    assert figure.axes[0].get_ylim()[1] < 200.0


def test_a_flight_without_a_stop_has_no_figure_of_hovering(log):
    phases = tuple("follow" for _ in log.located.phases)
    with house_style():
        assert hover_figure(replace(log, located=replace(log.located, phases=phases))) is None
        assert hover_figure(log) is not None


def test_the_page_says_how_it_ended_and_shows_its_figures_in_millimetres(log):
    page = flight_page(log, [])
    assert "The drone flew its path to the end in 40.0 s, 4.7 mm from it on average." in page
    assert "<b>6.4 mm</b><span>from the held point, rms</span>" in page
    assert '<span class="badge good">reached</span>' in page


# From a recording.


def phase_of(tick: int, handed_over: int) -> str:
    """Return the phase of a flight that stops at tick 6, and hands over in the tick before `handed_over`."""
    if tick >= handed_over:
        return "flying"
    return "hand over" if tick == handed_over - 1 else "stop" if tick > 5 else "follow"


def write_flight(path, ticks: int = 8, truth: bool = True, handed_over: int = 99):
    with FlightRecorder(path) as recorder:
        for i in range(ticks):
            stamp = 3.0 + i * TICK
            place, yaw = np.array([0.1 * i, 0.0, 1.2]), 3.0 + 0.1 * i
            seen = PoseMeasurement(stamp - 0.04, place, yaw, np.eye(4), "registration")
            known = Whereabouts(
                stamp, place + 0.01, yaw + 0.02, np.full(4, 0.3), 0.008, 0.01, np.append(place, yaw), 0.1 * i,
                0.03 * i, i > 5, Doubt.SURE if i else Doubt.SLOW, "" if i else "just begun",
                seen if i % 2 else None, "" if i % 2 else "occluded: 3 % of it",
            )  # fmt: skip
            recorder.tick(
                stamp,
                VehicleState(stamp, FlightState.FLYING, yaw=0.5 if i else None),
                None,
                (),
                Truth(stamp, Pose(place, yaw), np.array([0.3, 0.0, 0.0]), 0.5) if truth else None,
                sent_message(stamp, Command(), Command(), "flying", "pass", ""),
                Decision(Command(), phase_of(i, handed_over), whereabouts=known)
                if i > 1
                else Decision(Command(), "searching", reason=f"confirming: {i}"),
                1.0,
                depth=DepthFrame(stamp - 0.04, np.zeros((4, 4), np.uint16)) if i != 3 else None,
            )
    return read_recording(path)


def test_what_the_pilot_held_is_read_from_the_recording(tmp_path):
    log = flight_log(write_flight(tmp_path / "a.mcap"))
    located = log.located
    assert located is not None
    assert np.isfinite(located.fused[:, 0]).tolist() == [False, False] + [True] * 6
    assert located.fused[4] == pytest.approx([0.41, 0.01, 1.21, 3.42])
    assert located.at[2:] == pytest.approx(located.times[2:])
    assert located.measured[:, 0] == pytest.approx([0.3, 0.5, 0.7])
    assert located.measured_times == pytest.approx(located.times[[3, 5, 7]] - 0.04)
    assert located.framed.tolist() == [True] * 3 + [False] + [True] * 4
    assert located.unseen_reasons[4] == "occluded: 3 % of it"
    assert located.unseen_reasons[1] == "confirming: 1"  # while it searched
    assert np.isnan(located.reported_yaw[0])
    assert located.reported_yaw[1] == 0.5
    assert located.estimate_off[4] == pytest.approx([0.01, 0.01, 0.01, 0.02])
    assert (located.pushes, located.path, located.walks) == ((), None, ())
    assert log.truth is not None
    assert log.truth.velocity[0].tolist() == [0.3, 0.0, 0.0]


def test_after_a_hand_over_nothing_is_wanted_of_the_path_any_more(tmp_path):
    log = flight_log(write_flight(tmp_path / "a.mcap", handed_over=6))
    located = log.located
    assert located is not None
    assert located.handed_over == pytest.approx(located.times[6])
    assert np.isfinite(located.wanted[:, 0]).tolist() == [False, False] + [True] * 4 + [False] * 2
    assert np.isfinite(located.fused[6:, 0]).all()
    figure = pose_figure(log)
    assert figure is not None
    assert labels(figure).count("handed over") == 1
    never = flight_log(write_flight(tmp_path / "b.mcap", handed_over=8)).located
    assert never is not None
    assert np.isnan(never.handed_over)


def test_a_real_flight_has_no_truth_in_its_log(tmp_path):
    log = flight_log(write_flight(tmp_path / "a.mcap", truth=False))
    assert log.located is not None
    assert not log.located.has_truth
    assert np.isnan(log.located.estimate_off).all()


def test_a_pilot_that_never_says_where_it_is_has_no_such_log(tmp_path):
    assert flight_log(write_flight(tmp_path / "a.mcap", ticks=2)).located is None


def test_one_that_was_to_and_never_found_itself_has_what_kept_it_and_no_empty_figures(log, tmp_path):
    flown = write_flight(tmp_path / "a.mcap", ticks=2).flown
    located = located_log(flown, flown[0].stamp, LocatedScene(path=make_located(1.0).path))
    assert located is not None
    assert located.doubts == ("", "")
    assert unseen_in_words(located) == ["not seen in 2 of 2 frames: confirming 2"]
    page = flight_page(never := replace(log, located=located), draw_figures(never))
    names = [plan.name for plan in plans_of(never)]
    assert names == ["path", "doubt", "heading", "speed", "velocities", "clearance", "ticks"]
    assert "The pilot never knew where it was." in page
    assert "What the camera saw" not in page


def test_a_flight_that_lasts_a_few_ticks_is_drawn_all_the_same(tmp_path):
    log = flight_log(write_flight(tmp_path / "a.mcap", ticks=3))
    drawn = {d.name: d.png for d in draw_figures(log)}
    assert all(
        drawn[name] is not None for name in ("path", "pose", "control", "estimate", "doubt", "heading")
    )
    assert drawn["hover"] is None


def test_the_blind_seconds_of_the_synthetic_flight_are_where_they_were_put(log):
    unseen = log.located.times[~log.located.seen & (log.located.times > 1.0)]
    assert ((unseen >= BLIND[0]) & (unseen < BLIND[1])).sum() == round((BLIND[1] - BLIND[0]) / TICK)


def test_what_a_judge_says_stands_on_the_page_in_place_of_what_the_flight_says(tmp_path):
    path = tmp_path / "flight.mcap"
    write_flight(path, ticks=3)
    judged = {"outcome": "diverged", "reason": "off by 1 m", "cross_track_p95_m": 0.0123, "verdict": "no"}
    text = write_report(path, judged=judged).read_text(encoding="utf-8")
    assert '<span class="badge bad">diverged</span>' in text
    assert "12.3 mm" in text
    assert "verdict" not in text
