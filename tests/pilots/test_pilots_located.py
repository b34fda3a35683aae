"""The located pilot in closed loop: what it reaches, and what it does when it knows less."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from pilots_located_flight import LIMITS, fly, loop_model, off_by
from pydantic import ValidationError

from noctule.control.cascade import CascadeSettings
from noctule.control.limiter import limit_command
from noctule.control.paths import FixedHeading, SpeedSettings, Stop, line, loc_2, plan
from noctule.geometry import wrap_angle
from noctule.messages import Doubt, Limits, Outcome
from noctule.pilots.following import FollowerSettings
from noctule.pilots.located_settings import LocatedSettings

SETTINGS = LocatedSettings(begin_at_s=4.0, end_after_s=24.0)
STOP = (14.0, 24.0)
PUSHES = (4.0 + 9.0, 4.0 + 19.0)
START = (0.1, 0.1, 1.25, 0.1)
# Both gains of the forward axis are off the one way, those of the left axis the other way.
TWISTED = loop_model().model_copy(
    update={"k": tuple((np.array([1.3, 0.7, 0.7, 1.3, 1, 1, 1, 1]) / 0.3).tolist())}
)
OCCLUDED = "too little of it is seen"


def short_eight():
    base = loc_2()
    return plan(base.path, base.speed, FixedHeading(0.0), (Stop(10.0, time=14.0),), laps=None)


@cache
def flown(kind="identified", seed=0, pushes=PUSHES, wrong=None, rate=2.0, **spans):
    cascade = CascadeSettings(disturbance_rate=rate)
    settings = SETTINGS.model_copy(update={"follower": FollowerSettings(cascade=cascade)})
    model = None if wrong is None else off_by(loop_model(), 0.3, wrong)
    return fly(
        short_eight(), kind, 40.0, model=model, pushes=pushes, seed=seed, start=START, settings=settings,
        **spans,
    )  # fmt: skip


def order(values):
    return [v for k, v in enumerate(values) if k == 0 or v != values[k - 1]]


@pytest.mark.parametrize("kind", ["identified", "first_order"])
def test_it_reaches_the_figures_of_the_experiments_on_both_vehicles(kind):
    flight = flown(kind)
    mean, p95, hover, recoveries = flight.figures(short_eight(), (STOP,))
    assert mean < 0.010
    assert p95 < 0.020
    assert hover < 0.012
    assert 0.0 < max(recoveries) < 0.8
    assert flight.position_rms() < 0.008
    assert flight.pilot.senses.fusion.turns == 0
    assert flight.decisions[-1].outcome is Outcome.REACHED
    assert flight.decisions[-1].reason == "the path is flown"
    assert flight.path_time[-1] == pytest.approx(24.0, abs=0.04)


def test_the_phases_follow_each_other_and_the_path_begins_when_it_was_asked_to():
    flight = flown(pushes=())
    assert order(flight.phases) == ["searching", "to start", "settle", "follow", "stop", "hold"]
    assert flight.t[flight.phases.index("follow")] == pytest.approx(4.0, abs=0.034)
    assert order([d for d in flight.doubts if d is not None]) == [Doubt.SURE]


def test_a_learnt_disturbance_takes_out_what_the_onboard_velocity_is_biased_by():
    before, after = (
        [flown(pushes=(), rate=rate, seed=seed).figures(short_eight(), (STOP,))[0] for seed in range(3)]
        for rate in (0.0, 2.0)
    )
    assert np.mean(before) > 0.006
    assert all(a < b for a, b in zip(after, before, strict=True))
    assert np.mean(after) < 0.75 * np.mean(before)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_wrong_model_at_most_doubles_the_cross_track(seed):
    right = flown(seed=seed).figures(short_eight(), (STOP,))
    wrong = flown(seed=seed, wrong=seed).figures(short_eight(), (STOP,))
    assert wrong[0] < 2.0 * right[0]
    assert max(wrong[3]) < 0.85


def test_what_goes_with_the_wanted_speed_is_learnt_of_a_wrong_model_and_flown():
    means = []
    for share in (0.0, 0.3):
        cascade = CascadeSettings(disturbance_share=share)
        settings = SETTINGS.model_copy(update={"follower": FollowerSettings(cascade=cascade)})
        flight = fly(
            short_eight(), "identified", 40.0, model=TWISTED, start=START, settings=settings, gust=0.3
        )
        means.append(flight.figures(short_eight(), (STOP,))[0])
    assert means[0] > 0.008
    assert means[1] < 0.7 * means[0]


@pytest.mark.parametrize("at", [9.0, 20.0])
def test_hidden_whole_for_five_seconds_it_hovers_where_it_was_and_goes_on(at):
    flight = flown(pushes=(), seed=2, hidden=((at, at + 5.0),))
    doubts = [d for d in flight.doubts if d is not None]
    D = Doubt
    assert order(doubts) == [D.SURE, D.FLY_ON, D.SLOW, D.HOVER, D.SURE]
    after = flight.t > 5.0
    assert flight.off_path(short_eight().path)[after].max() < 0.3
    assert np.linalg.norm(flight.state[after, 4:7], axis=1).max() < 0.45  # it neither chases nor dashes
    assert flight.decisions[-1].outcome is Outcome.REACHED
    hovering = np.array([d is Doubt.HOVER for d in flight.doubts])
    settled = hovering & (flight.t > at + 2.5)
    assert np.abs(flight.commands[settled, :3]).max() <= FollowerSettings().hover_speed
    # Path time goes on: the stop ends when it was to end.
    assert flight.path_time[-1] == pytest.approx(24.0, abs=0.04)


def test_hidden_for_ever_it_lands_and_says_why():
    flight = flown(pushes=(), seed=3, hidden=((10.0, 99.0),))
    last = flight.decisions[-1]
    assert last.outcome is Outcome.LOST
    assert last.reason == (
        f"the ceiling camera has not seen the drone for 10.0 s ({OCCLUDED}); "
        "landed on what the vehicle measures itself"
    )
    assert flight.t[-1] == pytest.approx(20.0, abs=0.1)
    assert np.linalg.norm(flight.state[-1, 4:7]) < 0.1
    assert flight.off_path(short_eight().path)[flight.t > 5.0].max() < 0.5


def test_a_camera_that_sends_nothing_is_named():
    flight = flown(pushes=(), seed=3, no_frames=((10.0, 99.0),))
    assert "(no picture of it comes)" in flight.decisions[-1].reason


def test_a_vehicle_that_falls_silent_is_flown_slowly_by_the_camera_and_then_landed():
    flight = flown(pushes=(), seed=4, silent=((6.0, 99.0),))
    D = Doubt
    assert order([d for d in flight.doubts if d is not None]) == [D.SURE, D.FLY_ON, D.SLOW, D.HOVER, D.LAND]
    assert flight.decisions[-1].reason == "the vehicle has reported nothing for 8.0 s; landed"
    assert flight.off_path(short_eight().path)[flight.t > 5.0].max() < 0.08
    slow = np.array([d is Doubt.SLOW for d in flight.doubts]) & (flight.t > 8.0)
    assert np.linalg.norm(flight.state[slow, 4:7], axis=1).mean() < 0.15


def test_a_drone_that_is_never_seen_ends_the_flight_with_the_locators_words():
    flight = fly(short_eight(), seconds=12.0, hidden=((0.0, 99.0),), why="nothing in view: no foreground")
    last = flight.decisions[-1]
    assert last.phase == "searching"
    assert last.outcome is Outcome.LOST
    assert last.reason == (
        "the drone was not found within 10 s (nothing is in view); is it in view of the ceiling camera?"
    )
    np.testing.assert_array_equal(flight.commands, 0.0)
    assert last.whereabouts is None


def test_commands_never_step_by_more_than_the_limits_allow():
    flight = flown(hidden=((20.0, 22.0),))
    limits = Limits(**LIMITS.model_dump())
    for before, after, dt in zip(flight.commands, flight.commands[1:], np.diff(flight.t), strict=False):
        np.testing.assert_allclose(limit_command(after, before, limits, dt + 1e-9), after, atol=1e-9)


def test_the_same_flight_gives_the_same_decisions_bit_for_bit():
    one, other = (fly(short_eight(), seconds=6.0, seed=5, start=START) for _ in range(2))
    np.testing.assert_array_equal(one.commands, other.commands)
    assert [d.phase for d in one.decisions] == [d.phase for d in other.decisions]


def test_a_half_turn_that_slipped_is_mended_in_a_hover_and_the_flight_goes_on():
    made = plan(line((0, 0, 1), (3, 0, 1)), SpeedSettings(cruise=0.4), FixedHeading(0.0))

    def turned_compass(observation):
        # The compass says the opposite from the beginning: the fusion begins half a turn wrong.
        yaw = wrap_angle(observation.state.yaw + np.pi)
        return replace(observation, state=replace(observation.state, yaw=yaw))

    flight = fly(made, seconds=30.0, seed=1, start=(0.0, 1.0, 1.0, 0.0), on_tick=turned_compass)
    assert Doubt.HOVER in flight.doubts
    reasons = {d.whereabouts.doubt_reason for d in flight.decisions if d.whereabouts is not None}
    assert "the drone's heading was held half a turn wrong; its estimate begins anew" in reasons
    assert flight.decisions[-1].outcome is Outcome.REACHED
    assert flight.pilot.senses.fusion.turns == 1
    # It has hardly gone the wrong way, and then it is on its path.
    assert flight.state[:, 1].max() < 1.3
    assert np.abs(flight.off_path(made.path)[flight.t > 8.0]).max() < 0.05


def test_waiting_at_a_start_that_is_not_flown_to_is_refused():
    with pytest.raises(ValidationError) as caught:
        LocatedSettings(begin_at_s=4.0, follower=FollowerSettings(go_to_start=False))
    assert "begin_at_s waits at the path's start; follower.go_to_start must be true" in str(caught.value)
