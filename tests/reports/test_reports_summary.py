import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_flight import make_log

from noctule.reports.summary import find, flight_rows, in_words, number

SUMMARY = make_log(30).summary


def values(summary):
    return {row.label: row.value for row in flight_rows(summary)}


def test_every_figure_of_the_table_comes_from_the_summary():
    assert values(SUMMARY) == {
        "Duration, from the first tick in hover": "21.4 s",
        "Position error at the end": "0.012 m",
        "Heading error at the end": "0.22°",
        "Mean distance of the points at the end": "1.8 px",
        "Least clearance, surface to surface": "0.146 m",
        "Largest command step per tick, linear": "0.033 m/s",
        "Largest command step per tick, angular": "0.064 rad/s",
        "Time of a tick, median": "2.31 ms",
        "Time of a tick, 95th percentile": "4.87 ms",
        "Flight time per wall time": "3.7 x",
    }


@given(st.floats(0.0, 100.0))
def test_the_table_follows_the_summary_to_the_last_printed_digit(error):
    shown = values({**SUMMARY, "position_error_m": error})["Position error at the end"]
    assert shown.endswith(" m")
    assert float(shown.removesuffix(" m")) == pytest.approx(error, abs=0.5001e-3)


def test_figures_that_only_some_flights_have_are_added_at_the_end():
    rows = flight_rows({**SUMMARY, "cross_track_m": {"mean": 0.01234, "max": 0.0567}, "rounds": 2})
    assert [(row.label, row.value) for row in rows[-2:]] == [
        ("cross track m", "mean 0.01234, max 0.0567"),
        ("rounds", "2"),
    ]


def test_the_distance_from_the_path_and_the_laps_are_told_where_they_are_known():
    lap = {"cross_track_max_m": 0.05, "cross_track_mean_m": 0.01, "duration_s": 25.04}
    known = {"cross_track_max_m": 0.06, "cross_track_mean_m": 0.012}
    told = values({**SUMMARY, **known, "laps": [lap, {**lap, "cross_track_max_m": 0.06}]})
    assert told["Largest distance from the path"] == "0.060 m"
    assert told["Mean distance from the path"] == "0.012 m"
    assert told["Lap 1"] == "25.0 s, 0.010 m from the path on average, 0.050 m at most"
    assert told["Lap 2"].endswith("0.060 m at most")
    # A single lap is the flight, and without the truth there is nothing to tell.
    assert "Lap 1" not in values({**SUMMARY, **known, "laps": [lap]})
    assert values({**SUMMARY, "cross_track_max_m": None, "laps": None}) == values(SUMMARY)


@pytest.mark.parametrize("value", [None, math.nan, math.inf])
def test_what_was_not_measured_reads_not_available(value):
    assert number(value, "m") == "not available"
    assert values({**SUMMARY, "position_error_m": value})["Position error at the end"] == "not available"


def test_an_entry_that_is_no_mapping_has_no_entries_below_it():
    assert find({"tick_ms": 3.0}, ("tick_ms", "p95")) is None


def test_a_reached_flight_says_how_near_it_came_to_its_end_and_to_things():
    assert in_words(SUMMARY, 99.0) == (
        "The drone reached the last image after 21.4 s, 1.2 cm from where that was taken, "
        "and never came nearer than 0.146 m to anything."
    )


def test_a_reached_flight_without_truth_says_only_that_it_reached():
    assert in_words({"outcome": "reached", "duration_s": 8.0}, 99.0) == (
        "The drone reached the last image after 8.0 s."
    )


@pytest.mark.parametrize(
    ("outcome", "words"),
    [
        ("collided", "The drone touched something after 4.2 s: touched column_0."),
        ("stuck", "The drone did not get to the last image and gave up after 4.2 s: touched column_0."),
        ("lost", "The drone no longer recognised its surroundings after 4.2 s: touched column_0."),
        ("aborted", "The flight was ended early, after 4.2 s: touched column_0."),
    ],
)
def test_every_other_outcome_has_words_of_its_own_and_gives_the_reason(outcome, words):
    summary = {"outcome": outcome, "duration_s": 4.2, "reason": "touched column_0"}
    assert in_words(summary, 99.0) == words


def test_a_recording_without_an_outcome_says_where_it_ends():
    assert in_words({}, 12.34) == "The recording ends after 12.3 s, and no outcome was written to it."
