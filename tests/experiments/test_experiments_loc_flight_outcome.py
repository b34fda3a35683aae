"""How flights below the ceiling camera ended, on tracks made by hand along a line."""

from dataclasses import replace

import numpy as np
import pytest
from flight_judged import BEGUN, between, course, moved, rank, track

from noctule.experiments.loc_flight_outcome import OUTCOMES, outcome_of
from noctule.flight.fence import Fence
from noctule.messages import Doubt, Outcome

FENCE = Fence((-5.0, -2.0, 0.15), (25.0, 2.0, 2.5))


def outcome(one, ended):
    return outcome_of(one, course(), FENCE, ended)


@pytest.mark.parametrize(
    ("ended", "told"),
    [
        (Outcome.REACHED, "completed"),
        (Outcome.LOST, "landed_lost"),
        (Outcome.COLLIDED, "contact"),
        (Outcome.STUCK, "stuck"),
        (Outcome.ABORTED, "aborted"),
    ],
)
def test_a_flight_in_which_nothing_went_wrong_ends_as_the_pilot_ended_it(ended, told):
    assert outcome(track(), str(ended)) == told
    assert told in OUTCOMES


def test_a_touch_is_a_contact():
    one = track()
    assert outcome(replace(one, touched=between(one, 9.0, 9.1)), "reached") == "contact"


@pytest.mark.parametrize("offset", [[0.0, 2.1, 0.0, 0.0], [0.0, 0.0, -0.9, 0.0], [0.0, 0.0, 1.6, 0.0]])
def test_a_vehicle_that_is_truly_out_of_the_box_left_the_fence(offset):
    before = track().stamps < 0.5
    assert outcome(moved(before, offset), "reached") == "fence"


def test_who_lands_may_go_below_the_fence_but_not_through_its_walls():
    landing = track().path_time > 39.0
    doubt = np.where(landing, rank(Doubt.LAND), rank(Doubt.SURE))
    down = replace(moved(landing, [0.0, 0.0, -0.9, 0.0]), doubt=doubt)
    assert outcome(down, "lost") == "landed_lost"
    aside = replace(moved(landing, [0.0, 2.1, 0.0, 0.0]), doubt=doubt)
    assert outcome(aside, "lost") == "fence"


@pytest.mark.parametrize(
    ("off", "seconds", "told"), [(0.6, 1.2, "diverged"), (0.6, 0.9, "completed"), (0.4, 9.0, "completed")]
)
def test_an_estimate_held_for_sure_that_is_half_a_metre_off_for_a_second_has_diverged(off, seconds, told):
    one = track()
    held = one.held.copy()
    held[between(one, 8.0, 8.0 + seconds), 1] += off
    assert outcome(replace(one, held=held), "reached") == told


def test_an_estimate_that_is_doubted_may_be_wrong():
    one = track()
    held, doubt = one.held.copy(), one.doubt.copy()
    held[between(one, 8.0, 12.0), 1] += 0.6
    doubt[between(one, 8.0, 12.0)] = rank(Doubt.SLOW)
    assert outcome(replace(one, held=held, doubt=doubt), "reached") == "completed"


def test_an_estimate_that_is_wrong_from_the_first_tick_has_diverged():
    one = track()
    held = one.held.copy()
    held[:, 0] += 0.6
    assert outcome(replace(one, held=held), "reached") == "diverged"


def test_a_metre_from_the_path_is_astray_but_not_before_it():
    assert outcome(moved(between(track(), 8.0, 8.1), [0, 1.1, 0, 0]), "reached") == "diverged"
    before = track().stamps < BEGUN - 0.1
    assert outcome(moved(before, [0, 1.1, 0, 0]), "reached") == "completed"


def test_what_happened_first_names_the_outcome():
    one = moved(between(track(), 8.0, 9.0), [0.0, 1.1, 0.0, 0.0])
    later = replace(one, touched=between(one, 8.5, 9.0))
    assert outcome(later, "collided") == "diverged"
    sooner = replace(one, touched=between(one, 7.0, 7.1))
    assert outcome(sooner, "collided") == "contact"
