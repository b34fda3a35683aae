"""The follower in closed loop on the simulator's dynamics; figures of the experiments are upper bounds."""

import math
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from pilots_space_flight import fly, off_by, vehicle

from noctule.control.cascade import CascadeSettings, DelayTooLongError
from noctule.control.paths import (
    AlongPath,
    FixedHeading,
    SpeedSettings,
    Stop,
    line,
    loc_1,
    loc_2,
    loc_3,
    plan,
    polyline,
)
from noctule.estimation.filter_state import StateEstimate
from noctule.estimation.vehicle_model import VehicleModel
from noctule.geometry import wrap_angle
from noctule.messages import Command
from noctule.pilots.path_follower import Conduct, FollowerError, FollowerSettings, FollowPhase, PathFollower

KINDS = ("tilt", "identified", "first_order")
HERE = FollowerSettings(go_to_start=False)
STOP = (18.0, 30.0)
PUSHES = (12.0, 24.0)


def short_eight():
    """The path of experiment 3 with its stop moved to the front, so that a flight takes half a minute."""
    made = loc_3()
    return plan(made.path, made.speed, FixedHeading(0.0), (Stop(12.0, time=18.0),), laps=None)


@cache
def flown(kind, fused=False, delay=0.02, wrong=None, lag_share=None, known_delay=None, longest=0.3, rate=2.0):
    model = vehicle(kind)[1]
    if wrong is not None:
        model = off_by(model, 0.3, wrong)
    if lag_share is not None:
        model = VehicleModel.velocity_loop(0.3 * lag_share)
    settings = FollowerSettings(
        go_to_start=False, cascade=CascadeSettings(longest_delay_s=longest, disturbance_rate=rate)
    )
    return fly(
        short_eight(), kind, 30.0, model=model, delay=delay, known_delay=known_delay, pushes=PUSHES,
        fused=fused, settings=settings,
    )  # fmt: skip


def figures(flight):
    made = flight.follower.plan
    mean, p95 = flight.cross_track(made, (STOP,))
    return mean, p95, flight.hover_rms((STOP,)), max(flight.recoveries(made.path))


@pytest.mark.parametrize("kind", KINDS)
def test_with_a_perfect_state_it_keeps_to_millimetres_in_gusts(kind):
    mean, p95, hover, recovery = figures(flown(kind))
    assert mean < 0.004
    assert p95 < 0.008
    assert hover < 0.005
    assert recovery < 0.4


@pytest.mark.parametrize("kind", KINDS)
def test_with_late_and_noisy_sensors_it_reaches_the_figures_of_the_experiments(kind):
    mean, p95, hover, recovery = figures(flown(kind, fused=True))
    assert mean < 0.010
    assert p95 < 0.020
    assert hover < 0.012
    assert 0.0 < recovery < 0.8


@pytest.mark.parametrize("make", [loc_1, loc_2, loc_3])
def test_the_experiments_are_flown_to_their_end(make):
    pushes = {loc_1: (43, 48, 53, 58, 63), loc_2: (50, 55, 60, 65), loc_3: (18, 30, 60, 72)}[make]
    stop = (40.0, 52.0 if make is loc_3 else 70.0)
    flight = fly(make(), "tilt", 82.0, pushes=pushes)
    mean, p95 = flight.cross_track(flight.follower.plan, (stop,))
    assert mean < 0.004
    assert p95 < 0.008
    assert flight.hover_rms((stop,)) < 0.006
    assert max(flight.recoveries(flight.follower.plan.path)) < 0.5
    assert flight.reports[-1].s == pytest.approx(0.3 * (82.0 - stop[1] + stop[0]), abs=0.5)
    errors = [wrap_angle(w - y) for w, y in zip(flight.wanted[:, 3], flight.state[:, 3], strict=True)]
    assert np.quantile(np.abs(np.array(errors)[flight.calm()]), 0.95) < math.radians(1.5)
    if make is not loc_1:
        assert abs(wrap_angle(flight.state[-1, 3] - math.pi)) < math.radians(2.0)


@pytest.mark.parametrize("delay", [0.1, 0.2, 0.3])
@pytest.mark.parametrize("kind", ["tilt", "first_order"])
def test_known_delays_up_to_the_limit_are_stable(kind, delay):
    mean, p95, hover, recovery = figures(flown(kind, delay=delay))
    assert mean < 0.012
    assert p95 < 0.025
    assert hover < 0.016
    assert recovery < 1.1


@pytest.mark.parametrize("kind", ["tilt", "first_order"])
def test_at_the_limit_the_delay_need_only_be_known_to_a_fifth(kind):
    mean, _, hover, recovery = figures(flown(kind, delay=0.3, known_delay=0.24, rate=0.0))
    assert mean < 0.015
    assert hover < 0.02
    assert recovery < 1.2


def test_what_learns_a_disturbance_stays_stable_with_such_a_delay():
    mean, p95, hover, recovery = figures(flown("first_order", delay=0.3, known_delay=0.24))
    assert mean < 0.012
    assert p95 < 0.025
    assert hover < 0.016
    assert recovery < 2.0


def test_half_a_second_is_stable_when_it_is_known_and_a_delay_that_nobody_knows_is_not():
    mean, _, hover, _ = figures(flown("first_order", delay=0.5, longest=0.5))
    assert mean < 0.012
    assert hover < 0.016
    mean, _, hover, _ = figures(flown("tilt", delay=0.3, known_delay=0.0))
    assert hover > 0.1


def test_a_delay_beyond_the_limit_is_refused():
    with pytest.raises(DelayTooLongError, match=r"^vehicle: its commands take effect after 0\.40 s, the"):
        flown("tilt", delay=0.4)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_model_off_by_thirty_percent_at_most_doubles_the_cross_track(seed):
    right, wrong = figures(flown("tilt", fused=True)), figures(flown("tilt", fused=True, wrong=seed))
    assert wrong[0] < 2.0 * right[0]
    assert wrong[2] < 2.0 * right[2]
    assert wrong[3] < 0.85


@pytest.mark.parametrize("share", [0.7, 1.3])
def test_a_lag_off_by_thirty_percent_at_most_doubles_it_too(share):
    right = figures(flown("first_order", fused=True))
    wrong = figures(flown("first_order", fused=True, lag_share=share))
    assert wrong[0] < 2.0 * right[0]
    assert wrong[3] < 0.8


def test_a_learnt_disturbance_takes_out_what_a_wrong_gain_leaves():
    published = FollowerSettings(go_to_start=False, cascade=CascadeSettings(disturbance_rate=0.0))
    wrong = off_by(vehicle("first_order")[1], 0.3, 2)
    means = []
    for chosen in (published, HERE):
        flight = fly(short_eight(), "first_order", 18.0, model=wrong, settings=chosen, gust=0.0)
        means.append(flight.cross_track(flight.follower.plan, ((0.0, 3.0),))[0])
    assert means[0] > 0.012
    assert means[1] < 0.4 * means[0]


def test_commands_stay_within_their_limits_and_nothing_winds_up():
    made = plan(line((0, 0, 1), (3, 0, 1)), SpeedSettings(cruise=0.3), FixedHeading(0.0))
    flight = fly(made, "tilt", 16.0, gust=0.0, start=(-2.0, 2.5, 1.8, 3.0))
    assert np.abs(flight.commands).max() <= 1.0
    assert any(r.saturated for r in flight.reports)
    to_start = np.array([r.phase is FollowPhase.TO_START for r in flight.reports])
    speed = np.linalg.norm(flight.state[:, 4:7], axis=1)
    assert speed[to_start].max() < 0.36
    # It arrives without going past.
    away = np.linalg.norm(flight.state[:, :3] - made.path.position[0], axis=1)[to_start]
    assert np.diff(away).max() < 0.002


def test_the_phases_go_to_the_start_along_the_path_with_its_stop_and_back_home():
    made = plan(line((0.5, 0, 1), (1.5, 0, 1)), heading=FixedHeading(0.5), stops=(Stop(2.0, s=0.5),))
    settings = FollowerSettings(return_home=True)
    flight = fly(made, "first_order", 24.0, start=(0.0, -0.4, 1.2, 0.0), settings=settings)
    phases = [r.phase for r in flight.reports]
    order = [p for k, p in enumerate(phases) if k == 0 or p is not phases[k - 1]]
    P = FollowPhase
    assert order[:5] == [P.TO_START, P.SETTLE, P.FOLLOW, P.STOP, P.FOLLOW]
    assert order[-2:] == [P.RETURN, P.HOLD]
    assert set(order[5:-2]) <= {P.STOP}
    np.testing.assert_allclose(flight.state[-1, :4], (0.0, -0.4, 1.2, 0.0), atol=0.02)
    first = phases.index(P.FOLLOW)
    np.testing.assert_allclose(flight.state[first, :3], (0.5, 0, 1), atol=0.06)
    assert abs(flight.state[first, 3] - 0.5) < math.radians(6.0)
    assert flight.follower.finished
    assert math.isnan(flight.reports[0].path_time)
    assert flight.reports[first].path_time == 0.0


def test_without_a_way_home_it_holds_the_end():
    made = plan(polyline([(0, 0, 1), (0.6, 0, 1), (0.6, 0.6, 1)], 0.2), heading=AlongPath())
    flight = fly(made, "tilt", 10.0)
    assert flight.reports[-1].phase is FollowPhase.HOLD
    np.testing.assert_allclose(flight.state[-1, :3], (0.6, 0.6, 1), atol=0.02)
    np.testing.assert_array_equal(flight.reports[-1].wanted[:3], made.path.position[-1])


def test_a_wrong_yaw_of_sixty_degrees_is_tolerated():
    made, model = short_eight(), vehicle("first_order")[1]
    follower = PathFollower(made, model, np.array([2.0, 2.0, 2.0, 3.0]), HERE)
    x = np.zeros(8)
    x[:3], dt = made.path.position[0], 1 / 30
    off = []
    for k in range(450):
        seen = x.copy()
        seen[3] += math.radians(60.0)
        nu, _ = follower.step(StateEstimate(k * dt, seen, np.eye(8)), k * dt)
        c, s = math.cos(x[3]), math.sin(x[3])
        u = nu.as_array()
        wanted = np.array([c * u[0] - s * u[1], s * u[0] + c * u[1], u[2], u[3]])
        x[4:] += (1 - math.exp(-dt / 0.3)) * (wanted - x[4:])
        x[:4] += dt * x[4:]
        off.append(np.linalg.norm(made.path.position - x[:3], axis=1).min())
    assert max(off[150:]) < 0.2


def test_the_same_flight_gives_the_same_commands_bit_for_bit():
    first = fly(short_eight(), "tilt", 3.0, fused=True, seed=4)
    again = fly(short_eight(), "tilt", 3.0, fused=True, seed=4)
    np.testing.assert_array_equal(first.commands, again.commands)


def at(stamp, x):
    return StateEstimate(stamp, np.asarray(x, dtype=float), np.eye(8))


def test_it_predicts_with_what_was_really_sent():
    made = plan(line((0, 0, 1), (3, 0, 1)), heading=FixedHeading())
    model = VehicleModel.velocity_loop(0.3, delay=0.2)
    followers = [PathFollower(made, model, np.full(4, 2.0), HERE) for _ in range(2)]
    x = np.array([0.0, 0.3, 1.0, 0.0, 0, 0, 0, 0])
    for follower in followers:
        follower.step(at(0.0, x), 0.0)
    believed = followers[0].step(at(0.1, x), 0.1)[1]
    overruled = followers[1].step(at(0.1, x), 0.1, sent=Command())[1]
    assert believed.predicted[5] < -0.1  # it was told to go right
    np.testing.assert_array_equal(overruled.predicted[4:7], 0.0)


def test_an_estimate_that_is_late_is_predicted_to_the_tick():
    made = plan(line((0, 0, 1), (3, 0, 1)), heading=FixedHeading())
    follower = PathFollower(made, VehicleModel.velocity_loop(0.3, delay=0.1), np.full(4, 2.0), HERE)
    x = np.array([0.0, 0.0, 1.0, 0.0, 0.3, 0, 0, 0])
    report = follower.step(at(1.0, x), 1.05)[1]
    assert report.predicted[0] == pytest.approx(0.3 * 0.3 * (1.0 - math.exp(-0.15 / 0.3)))


def test_a_pause_makes_neither_speed_nor_heading_jump():
    made = plan(line((0, 0, 1), (3, 0, 1)), heading=FixedHeading(2.0))
    follower = PathFollower(made, VehicleModel.velocity_loop(0.3), np.full(4, 2.0), HERE)
    x = np.array([0.0, 0.0, 1.0, 0.0, 0, 0, 0, 0])
    before = [follower.step(at(k / 30, x), k / 30)[1] for k in range(5)][-1]
    after = follower.step(at(10.0, x), 10.0)[1]
    assert after.speed - before.speed <= 0.5 * 0.2 + 1e-9
    assert abs(after.wanted[3] - before.wanted[3]) < 0.1


def test_an_estimate_that_is_not_finite_is_refused_and_leaves_no_trace():
    followers = [PathFollower(short_eight(), *vehicle("tilt")[1:], HERE) for _ in range(2)]
    x = np.append(short_eight().path.position[0], np.zeros(5))
    for follower in followers:
        follower.step(at(0.0, x), 0.0)
    with pytest.raises(FollowerError) as caught:
        followers[0].step(at(0.03, x * np.nan), 0.03)
    assert str(caught.value) == ("follower: the estimate at 0.03 s is not finite; hover until it is again")
    commands = [follower.step(at(0.06, x), 0.06)[0] for follower in followers]
    assert commands[0] == commands[1]


def flown_straight(conducts, **more):
    """Fly a line with a perfect vehicle, each conduct for a second; return its states and reports."""
    made = plan(line((0, 0, 1), (9, 0, 1)), SpeedSettings(cruise=0.3), FixedHeading(0.0))
    follower = PathFollower(made, VehicleModel.velocity_loop(0.3), np.ones(4), HERE, **more)
    x, states, reports = np.array([0.0, 0, 1, 0, 0, 0, 0, 0]), [], []
    for k in range(30 * len(conducts)):
        nu, report = follower.step(at(k / 30, x), k / 30, conduct=conducts[k // 30])
        x = x.copy()
        x[4:] += (1.0 - math.exp(-1 / 9)) * (nu.as_array() - x[4:])
        x[:4] += x[4:] / 30
        states.append(x)
        reports.append(report)
    return np.array(states), reports


def test_the_pace_scales_the_speed_and_nothing_else():
    states, reports = flown_straight([Conduct()] * 3 + [Conduct(pace=0.4)] * 3)
    assert states[85, 4] == pytest.approx(0.3, abs=0.01)
    assert states[-1, 4] == pytest.approx(0.12, abs=0.01)
    assert np.abs(states[:, 1]).max() < 1e-6
    assert reports[-1].path_time == pytest.approx(6.0 - 1 / 30)


def test_it_hovers_where_it_comes_to_rest_and_goes_on_from_there_without_a_dash():
    states, reports = flown_straight([Conduct()] * 3 + [Conduct(pace=0.0, hover=True)] * 3 + [Conduct()] * 2)
    spot = reports[91].wanted
    assert 0.02 < spot[0] - states[89, 0] < 0.2  # ahead, as far as it takes to brake
    np.testing.assert_allclose(states[179, :3], spot[:3], atol=0.005)
    assert states[90:180, 4].min() > -0.02  # it does not come back for it
    assert np.diff(states[180:, 4]).max() < 0.5 / 30 * 1.5
    assert states[-1, 4] > 0.25
    assert all(r.hovering for r in reports[90:180])


def test_what_it_does_not_trust_it_does_not_fly_back_to():
    made = plan(line((0, 0, 1), (9, 0, 1)), SpeedSettings(cruise=0.3), FixedHeading(0.0))
    asked = []
    for trust in (1.0, 0.5, 0.0):
        follower = PathFollower(made, VehicleModel.velocity_loop(0.3), np.ones(4), HERE)
        follower.step(at(0.0, [1.0, 0, 1, 0, 0, 0, 0, 0]), 0.0, conduct=Conduct(0.0, True))
        moved = at(1 / 30, [1.0, 0.02, 1, 0, 0, 0, 0, 0])
        asked.append(follower.step(moved, 1 / 30, conduct=Conduct(0.0, True, trust))[0].left)
    assert asked[0] < asked[1] < asked[2] == 0.0


def test_it_ends_after_its_time_and_holds_where_it_then_is():
    states, reports = flown_straight([Conduct()] * 5, end_after=2.0)
    assert next(r.path_time for r in reports if r.finished) == pytest.approx(2.0, abs=0.034)
    assert abs(states[-1, 4]) < 0.01
    np.testing.assert_allclose(states[-1, :3], reports[-1].wanted[:3], atol=0.005)


COMPILING = """
import numpy as np
from noctule.control.cascade import (
    cascade, disturbance_after, disturbance_at, on_body_axes, predict_over_delay, remember,
)
from noctule.control.paths import Stop, loc_1, plan
from noctule.control.paths.nearest import foot_between, foot_speed
from noctule.control.paths.progress import _moving
from noctule.control.paths.space_path import sample
from noctule.estimation.filter_state import StateEstimate
from noctule.estimation.vehicle_model import VehicleModel
from noctule.pilots.path_follower import FollowerSettings, PathFollower, warm_up

warm_up()
functions = (
    cascade, disturbance_after, disturbance_at, on_body_axes, predict_over_delay, remember, foot_between,
    foot_speed, sample, _moving,
)
before = [len(f.signatures) for f in functions]
path, phases = loc_1().path, set()
made = plan(path, stops=(Stop(4.0, time=2.0),), laps=None)
settings = FollowerSettings(go_to_start=False)
follower = PathFollower(made, VehicleModel.identified(delay=0.02), np.ones(4), settings)
for k in range(120):
    x = np.append(path.at(0.01 * min(k, 70)).position, [1.6, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    phases.add(follower.step(StateEstimate(k / 30, x, np.eye(11)), k / 30)[1].phase)
assert {"follow", "stop"} <= phases, phases
assert before == [1] * len(functions) == [len(f.signatures) for f in functions], before
"""


def test_after_the_warm_up_nothing_is_left_to_compile():
    done = subprocess.run([sys.executable, "-c", COMPILING], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def fails(model, limits):
    with pytest.raises(FollowerError) as caught:
        PathFollower(short_eight(), model, np.asarray(limits), HERE)
    return str(caught.value)


def test_a_vehicle_that_cannot_be_commanded_is_refused():
    assert fails(VehicleModel.velocity_loop(0.3), [1.0, 1.0, 0.0, 1.0]) == (
        "follower: limits [1.0, 1.0, 0.0, 1.0]; expected four numbers above 0"
    )
    assert fails(VehicleModel(np.array([1.0, 1.0, 0.0, 1.0]), np.ones(4)), np.ones(4)) == (
        "follower: the vehicle's input gains are [1.0, 1.0, 0.0, 1.0]; expected all above 0: "
        "identify the vehicle again"
    )
