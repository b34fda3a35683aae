"""The guard of a located pilot, as the table that it is."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from noctule.messages import Doubt
from noctule.pilots.doubt import ORDER, RANK, Facts, Guard, asked, judge
from noctule.pilots.doubt_reasons import in_words, not_found
from noctule.pilots.doubt_settings import Ages, DoubtSettings

S = DoubtSettings()
DT = 1.0 / 30.0
WELL = Facts(0.0)
OCCLUDED = "occluded: 3 % of the drone can be seen, expected at least 35 %"

TABLE = [
    (WELL, Doubt.SURE, ""),
    (Facts(0.0, unseen=0.1, silent=0.2, position_sd=0.02), Doubt.SURE, ""),
    (
        Facts(0.0, unseen=0.2, why_unseen=OCCLUDED),
        Doubt.FLY_ON,
        "the ceiling camera has not seen the drone for 0.2 s (too little of it is seen)",
    ),
    (
        Facts(0.0, unseen=0.7, why_unseen="low score: 10 %"),
        Doubt.SLOW,
        "the ceiling camera has not seen the drone for 0.7 s (what is there does not look like it)",
    ),
    (
        Facts(0.0, unseen=5.0, why_unseen="moved camera: 12 % of the background"),
        Doubt.HOVER,
        "the ceiling camera has not seen the drone for 5.0 s (the camera is no longer where "
        "it was calibrated)",
    ),
    (
        Facts(0.0, unseen=10.1, why_unseen=OCCLUDED),
        Doubt.LAND,
        "the ceiling camera has not seen the drone for 10.1 s (too little of it is seen)",
    ),
    (Facts(0.0, silent=0.3), Doubt.FLY_ON, "the vehicle has reported nothing for 0.3 s"),
    (Facts(0.0, silent=5.0), Doubt.SLOW, "the vehicle has reported nothing for 5.0 s"),
    (Facts(0.0, silent=7.0), Doubt.HOVER, "the vehicle has reported nothing for 7.0 s"),
    (Facts(0.0, silent=9.0), Doubt.LAND, "the vehicle has reported nothing for 9.0 s"),
    (
        Facts(0.0, unseen=2.5, silent=3.0),
        Doubt.LAND,
        "neither the ceiling camera nor the vehicle has told anything for 2.5 s",
    ),
    (Facts(0.0, position_sd=0.1), Doubt.SLOW, "the estimate may be off by 10 cm"),
    (
        Facts(0.0, position_sd=0.2, unseen=0.6, why_unseen=OCCLUDED),
        Doubt.HOVER,
        "the estimate may be off by 20 cm; the ceiling camera has not seen the drone for 0.6 s "
        "(too little of it is seen)",
    ),
    (Facts(0.0, position_sd=1.0), Doubt.LAND, "the estimate may be off by 100 cm"),
    (Facts(0.0, yaw_sd=math.radians(25.0)), Doubt.HOVER, "the estimate may be off by 25 deg"),
    (Facts(0.0, jump=0.7), Doubt.HOVER, "the drone was found 0.70 m from where it must have been"),
    (
        Facts(0.0, turned=True, position_sd=math.inf, yaw_sd=math.inf),
        Doubt.HOVER,
        "the drone's heading was held half a turn wrong; its estimate begins anew",
    ),
    (
        Facts(0.0, turned=True, unseen=11.0, position_sd=math.inf, why_unseen="nothing in view: no"),
        Doubt.LAND,
        "the ceiling camera has not seen the drone for 11.0 s (nothing is in view)",
    ),
]


@pytest.mark.parametrize(("facts", "doubt", "reason"), TABLE)
def test_every_cause_asks_for_a_doubt_and_says_why(facts, doubt, reason):
    assert asked(facts, S) == (doubt, reason)


def run(facts_at, seconds, guard=None, settings=S):
    """Return the guard of every tick; `facts_at` says the facts of a time."""
    guard, guards = guard or Guard(), []
    for k in range(round(seconds / DT)):
        guard = judge(guard, replace(facts_at(k * DT), stamp=k * DT), settings)
        guards.append(guard)
    return guards


def hidden(a, b, late=0.06):
    return lambda t: Facts(t, unseen=(t - a + late if a <= t < b else late), why_unseen=OCCLUDED)


def order(guards):
    return [g.doubt for k, g in enumerate(guards) if k == 0 or g.doubt is not guards[k - 1].doubt]


def test_five_seconds_hidden_end_in_a_hover_and_then_it_is_sure_again_after_a_while():
    guards = run(hidden(1.0, 6.0), 10.0)
    assert order(guards) == [Doubt.SURE, Doubt.FLY_ON, Doubt.SLOW, Doubt.HOVER, Doubt.SURE]
    back = next(k for k, g in enumerate(guards) if k * DT > 6.0 and g.doubt is Doubt.SURE)
    assert back * DT == pytest.approx(6.0 + S.well_s, abs=2 * DT)
    assert guards[back].pace < 0.05  # no dash
    assert guards[-1].pace == 1.0
    assert guards[-1].reason == ""


def test_hidden_for_ever_it_goes_through_the_whole_sequence_and_says_why_it_landed():
    guards = run(hidden(1.0, math.inf), 15.0)
    assert order(guards) == list(ORDER)
    assert guards[-1].reason == (
        "the ceiling camera has not seen the drone for 10.0 s (too little of it is seen); "
        "landed on what the vehicle measures itself"
    )


def test_a_vehicle_that_no_longer_reports_is_not_said_to_measure_anything():
    guards = run(lambda t: Facts(t, silent=t), 10.0)
    assert guards[-1].reason == "the vehicle has reported nothing for 8.0 s; landed"


def test_it_comes_to_rest_before_it_lands_however_bad_it_is():
    guards = run(lambda t: Facts(t, position_sd=5.0), 3.0)
    assert order(guards) == [Doubt.HOVER, Doubt.LAND]
    assert sum(g.doubt is Doubt.HOVER for g in guards) * DT == pytest.approx(S.rest_s, abs=2 * DT)


def test_what_flickers_does_not_end_the_hover():
    guards = run(lambda t: Facts(t, unseen=1.5 if int(t / 0.2) % 2 == 0 else 0.05), 6.0)
    assert order(guards) == [Doubt.HOVER]


times = st.one_of(st.floats(0.0, 20.0), st.just(math.inf))
facts = st.builds(
    Facts,
    stamp=st.just(0.0),
    unseen=times,
    silent=times,
    position_sd=st.one_of(st.floats(0.0, 2.0), st.just(math.inf)),
    yaw_sd=st.one_of(st.floats(0.0, 3.0), st.just(math.inf)),
    why_unseen=st.sampled_from(["", OCCLUDED, "moved camera: x", "a reason: of nobody"]),
    jump=st.floats(0.0, 2.0),
    turned=st.booleans(),
)
spans = st.lists(st.tuples(facts, st.floats(0.0, 2.0)), min_size=1, max_size=12)


@given(spans)
def test_whatever_happens_the_sequence_holds(spans):
    guard, t = Guard(), 0.0
    for found, seconds in spans:
        for _ in range(1 + round(seconds / 0.1)):
            t += 0.1
            before, guard = guard, judge(guard, replace(found, stamp=t), S)
            wanted = asked(found, S)[0]
            if before.doubt is Doubt.LAND:
                assert guard.doubt is Doubt.LAND
                assert guard.reason == before.reason
            elif guard.doubt is Doubt.LAND:
                assert before.doubt is Doubt.HOVER
                assert t - before.since >= S.rest_s - 1e-9
            elif wanted is not Doubt.LAND:
                assert RANK[guard.doubt] >= RANK[wanted]
            assert (guard.reason == "") == (guard.doubt is Doubt.SURE)
            assert 0.0 <= guard.pace <= 1.0
            assert 0.0 <= guard.trust <= 1.0
            if guard.doubt in (Doubt.HOVER, Doubt.LAND):
                assert guard.pace == 0.0
            elif not math.isnan(before.stamp):
                assert (
                    before.pace - 0.1 / S.brake_s - 1e-9 <= guard.pace <= before.pace + 0.1 / S.rise_s + 1e-9
                )


@given(facts, facts)
def test_more_to_doubt_is_never_less_doubt(a, b):
    worse = Facts(
        0.0,
        max(a.unseen, b.unseen),
        max(a.silent, b.silent),
        max(a.position_sd, b.position_sd),
        max(a.yaw_sd, b.yaw_sd),
        "",
        max(a.jump, b.jump),
    )
    for one in (a, b):
        if not one.turned:
            assert RANK[asked(worse, S)[0]] >= RANK[asked(one, S)[0]]


def test_a_position_that_is_not_known_is_not_flown_back_to():
    assert judge(Guard(), Facts(0.0, position_sd=0.1), S).trust == 1.0
    assert judge(Guard(), Facts(0.0, position_sd=0.35), S).trust == pytest.approx(0.5)
    assert judge(Guard(), Facts(0.0, position_sd=0.6), S).trust == 0.0
    assert judge(Guard(), Facts(0.0, position_sd=math.inf), S).trust == 0.0


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (
            lambda: Ages(fly_on_s=1.0, slow_s=0.5, hover_s=2.0, land_s=3.0),
            "fly_on_s, slow_s, hover_s and land_s must not fall from one to the next",
        ),
        (lambda: DoubtSettings(slow_m=0.5), "slow_m, hover_m, land_m must not fall from one to the next"),
        (lambda: DoubtSettings(distrust_m=0.1), "distrust_m must be above trust_m"),
    ],
)
def test_limits_out_of_order_are_refused(made, said):
    with pytest.raises(ValidationError) as caught:
        made()
    assert said in str(caught.value)


def test_reasons_that_nobody_wrote_words_for_are_told_as_they_are():
    assert in_words("a reason: of nobody") == "a reason: of nobody"
    assert in_words("") == "what it saw was not believed"
    assert not_found(20.0, "nothing in view: no foreground is as large as a drone") == (
        "the drone was not found within 20 s (nothing is in view); is it in view of the ceiling camera?"
    )
