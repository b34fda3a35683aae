"""Reports of how a flight came down after its pilot was done, and of the two clocks."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_flight import make_log
from synthetic_located import make_located_log

from noctule.flight.reader import read_recording
from noctule.flight.recording import FlightRecorder, sent_message
from noctule.geometry import Pose
from noctule.messages import Command, Decision, Doubt, FlightState, Outcome, Truth, VehicleState, Whereabouts
from noctule.reports.flight_log import Landing
from noctule.reports.flight_report import flight_page
from noctule.reports.landing import landing_end, landing_in_words
from noctule.reports.loading import flight_log
from noctule.reports.located_series import pose_figure
from noctule.reports.located_views import path_figure
from noctule.reports.page import escape
from noctule.reports.style import house_style

TICK = 1.0 / 30.0
START = 3.0  # [s], on the flight's clock
FLOWN, DOWN = 4, 6  # ticks with and without the pilot


def write_flight(path, truth=True, down=DOWN, height=True, simulated=True, touched=()):
    """A flight along x that gives up at x 0.3, y 0.4, z 1.2 m and comes down at x 0, y 0."""
    with FlightRecorder(path) as recorder:
        recorder.note("flight", {"simulated": "true" if simulated else "false"})
        for i in range(FLOWN + down):
            stamp, k = START + i * TICK, max(i - FLOWN + 1, 0)
            share = k / max(down, 1)
            place = np.array([0.3 * (1 - share), 0.4 * (1 - share), 1.2 - 1.14 * share])
            place[0] += 0.1 * max(FLOWN - 1 - i, 0)
            landed = down and k == down
            known = Whereabouts(
                stamp, place, 0.0, np.zeros(4), 0.01, 0.01, np.append(place, 0.0), 0.1 * i, 0.1 * i, False,
                Doubt.SURE, "", None, "occluded: 3 % of it",
            )  # fmt: skip
            outcome = Outcome.LOST if i == FLOWN - 1 else None
            contacts = (*(touched if k == 2 else ()), *(("floor",) if landed else ()))
            recorder.tick(
                stamp,
                VehicleState(
                    stamp,
                    FlightState.LANDED if landed else FlightState.FLYING,
                    height=float(place[2]) if height else None,
                ),
                None,
                (),
                Truth(stamp, Pose(place, 0.1 * i), np.zeros(3), 0.5, contacts) if truth else None,
                sent_message(stamp, Command(), Command(), "flying", "pass", ""),
                Decision(Command(), "follow", outcome=outcome, reason="hidden", whereabouts=known)
                if i < FLOWN
                else None,
                1.0,
            )
    return read_recording(path)


def lines_called(figure, label):
    return [line for axis in figure.axes for line in axis.get_lines() if line.get_label() == label]


def test_the_landing_begins_with_the_pilot_s_last_tick_and_ends_with_the_recording(tmp_path):
    log = flight_log(write_flight(tmp_path / "a.mcap"))
    landing = log.landing
    assert landing is not None
    assert landing.times == pytest.approx(TICK * np.arange(FLOWN - 1, FLOWN + DOWN))
    assert landing.times[0] == log.span[1]
    assert landing_end(log) == landing.times[-1]
    assert landing.pose[0] == pytest.approx([0.3, 0.4, 1.2, 0.1 * (FLOWN - 1)])
    assert landing.pose[-1] == pytest.approx([0.0, 0.0, 0.06, 0.1 * (FLOWN + DOWN - 1)])
    assert (landing.true, landing.said_landed, landing.touching, landing.touched) == (
        True, True, ("floor",), (),
    )  # fmt: skip


def test_what_is_measured_of_the_flight_does_not_reach_into_the_landing(tmp_path):
    with_landing = flight_log(write_flight(tmp_path / "a.mcap"))
    without = flight_log(write_flight(tmp_path / "b.mcap", down=0))
    assert with_landing.span == without.span
    np.testing.assert_array_equal(with_landing.truth.position, without.truth.position)
    np.testing.assert_array_equal(with_landing.located.true, without.located.true)


def test_the_page_says_where_it_landed_and_how_far_that_is_from_where_the_pilot_gave_up(tmp_path):
    page = flight_page(flight_log(write_flight(tmp_path / "a.mcap")), [])
    assert (
        "landed after 0.1 s: hidden. It landed at x 0.00, y 0.00 m, 0.50 m from where the pilot gave up.</p>"
        in page
    )


def test_a_pilot_that_reached_its_end_did_not_give_up(tmp_path):
    log = flight_log(write_flight(tmp_path / "a.mcap"))
    reached = replace(log, summary={**log.summary, "outcome": "reached"})
    assert landing_in_words(reached) == (
        "It landed at x 0.00, y 0.00 m, 0.50 m from where the pilot's flight ended."
    )


def test_what_it_touched_on_the_way_down_is_said(tmp_path):
    log = flight_log(write_flight(tmp_path / "a.mcap", touched=("table_1", "person")))
    assert landing_in_words(log).endswith("gave up, and touched table_1, person on the way.")


def test_a_recording_that_ends_in_the_air_says_how_high_that_is(tmp_path):
    # 1.2 m up, less half of the hull.
    for down in (0, 1):
        log = flight_log(write_flight(tmp_path / f"{down}.mcap", down=down))
        if down:
            high = log.landing.pose.copy()
            high[-1, 2] = 1.2
            log = replace(log, landing=replace(log.landing, pose=high, touching=()))
        assert landing_in_words(log) == "The recording ends with the drone 1.14 m above the floor."


def test_a_real_drone_is_taken_at_its_word(tmp_path):
    log = flight_log(write_flight(tmp_path / "a.mcap", truth=False))
    assert landing_in_words(log) == "The vehicle says that it landed, 0.2 s later."
    assert np.isnan(log.landing.pose[:, [0, 1, 3]]).all()
    assert log.landing.pose[-1, 2] == pytest.approx(0.06, abs=1e-6)
    flying = flight_log(write_flight(tmp_path / "b.mcap", truth=False, down=0))
    assert landing_in_words(flying) == "The recording ends with the drone 1.14 m above the floor, it says."


def test_of_a_landing_that_nobody_knows_nothing_is_said(tmp_path):
    log = flight_log(write_flight(tmp_path / "a.mcap", truth=False, height=False, down=0))
    assert log.landing is None
    assert landing_in_words(log) == ""
    assert landing_end(log) == log.span[1]
    page = flight_page(log, [])
    assert "hidden.</p>" in page


def test_the_landing_is_drawn_from_where_the_true_line_ends_to_the_floor(tmp_path):
    log = flight_log(write_flight(tmp_path / "a.mcap"))
    with house_style():
        pose, path = pose_figure(log), path_figure(log)
    drawn = lines_called(pose, "landing")
    assert len(drawn) == 4
    np.testing.assert_allclose(drawn[2].get_ydata(), log.landing.pose[:, 2])
    assert pose.axes[3].get_xlim() == (0.0, pytest.approx(log.landing.times[-1]))
    in_space, above = lines_called(path, "landing")
    assert in_space.get_data_3d()[2][-1] == pytest.approx(0.06)
    assert above.get_xydata()[[0, -1]] == pytest.approx(np.array([[0.3, 0.4], [0.0, 0.0]]))
    assert len(lines_called(path, "landed")) == 2
    # The end lies inside of what is shown.
    assert path.axes[1].get_xlim()[0] < 0.0


def test_a_real_drone_s_landing_is_its_height_alone(tmp_path):
    log = flight_log(write_flight(tmp_path / "a.mcap", truth=False))
    with house_style():
        pose, path = pose_figure(log), path_figure(log)
    known = [np.isfinite(line.get_ydata()).any() for line in lines_called(pose, "landing")]
    assert known == [False, False, True, False]
    assert "landing" in [text.get_text() for text in pose.axes[0].get_legend().get_texts()]
    assert lines_called(path, "landing") == []


def test_one_that_never_landed_has_no_landing_drawn():
    log = make_located_log(5.0)
    still = Landing(log.times[-1:], log.located.true[-1:], true=True)
    for one in (log, replace(log, landing=still)):
        with house_style():
            assert lines_called(pose_figure(one), "landing") == []
            assert lines_called(path_figure(one), "landing") == []


def test_a_simulated_flight_says_once_how_its_times_stand_to_the_mission_s(tmp_path):
    log = flight_log(write_flight(tmp_path / "a.mcap"))
    assert log.clock_start == START
    said = (
        "Times count from the pilot's first tick, 3.00 s on the flight's clock, which missions use: "
        "take 3.00 s off the times of faults and pushes in the mission."
    )
    assert flight_page(log, []).count(f'<p class="remark">{escape(said)}</p>') == 1


def test_a_real_flight_whose_clock_means_nothing_to_a_reader_says_nothing_of_it(tmp_path):
    log = flight_log(write_flight(tmp_path / "a.mcap", simulated=False))
    assert log.clock_start is None
    assert 'class="remark"' not in flight_page(log, [])


def test_a_flight_by_pictures_tells_its_landing_too():
    log = make_log(30)
    rows = np.array([[1.0, 2.0, 1.0, 0.0], [1.0, 2.3, 0.06, 0.0]])
    log = replace(log, landing=Landing(np.array([1.0, 3.0]), rows, true=True, touching=("floor",)))
    assert "It landed at x 1.00, y 2.30 m, 0.30 m from where the pilot" in flight_page(log, [])
