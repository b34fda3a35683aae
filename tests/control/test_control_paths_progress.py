"""Along a plan: stops at times and places, headings, laps; flown by a point that does what is wanted."""

import math

import numpy as np
import pytest

from noctule.control.paths import (
    AlongPath,
    FixedHeading,
    SpeedSettings,
    Stop,
    line,
    loc_1,
    loc_2,
    plan,
    polyline,
)
from noctule.control.paths.heading import TurnReference
from noctule.control.paths.progress import advance, begin
from noctule.geometry import wrap_angle

DT = 1 / 30


class Ride:
    """A point that flies as the reference wants it, with a pull towards the wanted point."""

    def __init__(self, made, x=None, yaw=0.0):
        self.plan, self.progress, self.t = made, begin(made, TurnReference(yaw)), 0.0
        self.x = np.zeros(8)
        self.x[:3] = made.path.position[0] if x is None else x
        self.rows = []

    def step(self, push=(0.0, 0.0, 0.0)):
        self.progress, wanted = advance(self.plan, self.progress, self.x, self.t, DT)
        self.rows.append((self.t, self.progress, wanted, self.x.copy()))
        v = wanted.velocity.copy()
        v[:3] += 3.0 * (wanted.pose[:3] - self.x[:3]) + push
        self.x[4:] = v
        self.x[:4] += DT * v
        self.t += DT
        return wanted

    def fly(self, seconds):
        for _ in range(round(seconds / DT)):
            self.step()
        return self

    def speeds(self):
        return np.array([p.speed for _, p, _, _ in self.rows])

    def times(self, condition):
        return [t for t, p, w, x in self.rows if condition(p, w, x)]


def test_it_starts_gently_flies_at_cruise_and_stops_at_the_end():
    ride = Ride(plan(line((0, 0, 1), (2, 0, 1)), SpeedSettings(cruise=0.4))).fly(8.0)
    v = ride.speeds()
    assert v[0] <= 0.5 * DT
    assert v.max() == pytest.approx(0.4)
    assert np.abs(np.diff(v)).max() < 0.5 * DT * 1.2 + 0.11  # the last step is the capture of the end
    assert ride.progress.arrived
    assert ride.progress.holding
    np.testing.assert_allclose(ride.x[:3], (2, 0, 1), atol=1e-3)


def test_a_stop_in_time_holds_a_point_and_goes_on_when_it_is_over():
    ride = Ride(plan(loc_1().path, stops=(Stop(5.0, time=4.0),), laps=None)).fly(14.0)
    held = ride.times(lambda p, w, x: p.holding)
    assert 4.2 < held[0] < 5.2
    assert held[-1] == pytest.approx(9.0, abs=2 * DT)
    points = np.array([w.pose[:3] for _, p, w, _ in ride.rows if p.holding])
    assert np.ptp(points, axis=0).max() == 0.0
    # It brakes ahead to the point, and does not come back to it.
    s = np.array([p.s for _, p, _, _ in ride.rows])
    assert np.diff(s).min() > -1e-3
    assert s[-1] > s[len(s) // 2] + 0.8


def test_the_held_point_is_a_braking_distance_ahead():
    ride = Ride(plan(loc_1().path, stops=(Stop(5.0, time=4.0),), laps=None)).fly(8.0)
    at_four = next(p.s for t, p, _, _ in ride.rows if t >= 4.0)
    assert ride.progress.gate - at_four == pytest.approx(0.108, abs=0.01)


def test_a_stop_at_a_place_begins_on_arrival():
    ride = Ride(plan(line((0, 0, 1), (2, 0, 1)), stops=(Stop(3.0, s=1.0),))).fly(14.0)
    held = ride.times(lambda p, w, x: p.holding and p.s < 1.5)
    assert held[-1] - held[0] == pytest.approx(3.0, abs=0.1)
    assert {p.s for _, p, _, _ in ride.rows if p.holding} == {1.0, ride.plan.total}
    assert ride.progress.arrived


def test_a_push_while_holding_moves_neither_the_point_nor_the_clock():
    ride = Ride(plan(line((0, 0, 1), (2, 0, 1)), stops=(Stop(3.0, s=1.0),))).fly(5.0)
    assert ride.progress.holding
    for _ in range(12):
        wanted = ride.step(push=(1.0, 0.7, 0.0))
    assert ride.x[0] > 1.15
    np.testing.assert_array_equal(wanted.pose[:3], (1, 0, 1))
    np.testing.assert_array_equal(wanted.velocity[:3], 0.0)
    ride.fly(3.5)
    assert not ride.progress.holding
    assert ride.progress.s > 1.0


def test_a_vehicle_that_is_held_back_is_not_let_go_at_full_speed():
    ride = Ride(plan(line((0, 0, 1), (5, 0, 1)), SpeedSettings(cruise=0.6))).fly(3.0)
    assert ride.progress.speed == pytest.approx(0.6)
    for _ in range(60):
        ride.step()
        ride.x[4:7] = 0.0  # something holds it
        ride.x[0] = 1.0
    assert ride.progress.speed <= 0.16


def test_the_corner_of_a_polyline_is_stopped_at_and_left_in_the_new_direction():
    path = polyline([(0, 0, 1), (1, 0, 1), (1, 1, 1)])
    ride = Ride(plan(path, heading=AlongPath(), stops=(Stop(0.0, s=1.0),))).fly(12.0)
    xs = np.array([x for _, _, _, x in ride.rows])
    off = np.minimum(np.abs(xs[:, 1]), np.abs(xs[:, 0] - 1.0))
    assert off.max() < 0.02
    assert xs[:, 0].max() < 1.02
    assert ride.progress.arrived
    assert wrap_angle(ride.x[3] - math.pi / 2) == pytest.approx(0.0, abs=0.02)


def test_out_and_back_on_the_same_line_ends_where_it_began():
    path = polyline([(0, 0, 1), (1, 0, 1), (0, 0, 1)])
    ride = Ride(plan(path, stops=(Stop(1.0, s=1.0),), heading=FixedHeading())).fly(14.0)
    assert ride.progress.arrived
    s = np.array([p.s for _, p, _, _ in ride.rows])
    assert np.diff(s).min() > -1e-3
    assert max(x[0] for _, _, _, x in ride.rows) > 0.97
    np.testing.assert_allclose(ride.x[:3], (0, 0, 1), atol=2e-3)


def test_experiment_two_turns_by_half_a_turn_four_seconds_into_its_stop_and_stays_so():
    ride = Ride(loc_2()).fly(82.0)
    assert max(ride.times(lambda p, w, x: w.pose[3] == 0.0 and p.yaw is None)) == pytest.approx(44.0, abs=0.1)
    at = {round(t, 2): w.pose[3] for t, _, w, _ in ride.rows}
    assert abs(wrap_angle(at[49.0] - math.pi)) < 0.02
    assert abs(wrap_angle(ride.rows[-1][2].pose[3] - math.pi)) < 1e-3
    held = ride.times(lambda p, w, x: p.holding)
    assert held[0] < 41.2
    assert held[-1] == pytest.approx(70.0, abs=0.1)
    assert ride.progress.s == pytest.approx(0.3 * 52.0, abs=0.3)


def test_a_heading_of_a_stop_may_end_with_it():
    stops = (Stop(4.0, s=1.0, yaw=1.5, keep_yaw=False),)
    ride = Ride(plan(line((0, 0, 1), (2, 0, 1)), heading=FixedHeading(0.2), stops=stops), yaw=0.2).fly(16.0)
    yaws = np.array([w.pose[3] for _, _, w, _ in ride.rows])
    assert yaws.max() == pytest.approx(1.5, abs=0.02)
    assert yaws[-1] == pytest.approx(0.2, abs=1e-3)


def test_laps_are_counted_and_the_last_one_ends():
    made = plan(loc_1().path, SpeedSettings(cruise=0.6, turn_rate=2.5, lateral=2.0), laps=2)
    ride = Ride(made, yaw=math.pi / 2).fly(18.0)
    assert ride.progress.arrived
    assert ride.progress.s == pytest.approx(2 * made.path.length)
    np.testing.assert_allclose(ride.x[:3], made.path.position[0], atol=5e-3)


def test_a_stop_that_is_over_before_it_was_looked_at_is_left_out():
    ride = Ride(plan(loc_1().path, stops=(Stop(2.0, time=1.0), Stop(2.0, time=8.0)), laps=None))
    ride.t = 5.0
    ride.fly(1.0)
    assert not ride.progress.holding
    ride.fly(3.5)
    assert ride.progress.holding


def test_a_stop_in_time_that_comes_while_holding_only_lasts_longer():
    stops = (Stop(3.0, s=0.5), Stop(6.0, time=4.0))
    ride = Ride(plan(line((0, 0, 1), (2, 0, 1)), stops=stops)).fly(14.0)
    held = [t for t in ride.times(lambda p, w, x: p.holding) if t < 12.0]
    assert held[-1] == pytest.approx(10.0, abs=0.1)
    assert {p.s for t, p, _, _ in ride.rows if p.holding and t < 12.0} == {0.5}


def test_the_acceleration_that_is_fed_forward_is_that_of_the_wanted_velocity():
    ride = Ride(loc_1(), yaw=math.pi / 2).fly(10.0)
    v = np.array([w.velocity for _, _, w, _ in ride.rows[200:]])
    a = np.array([w.acceleration for _, _, w, _ in ride.rows[200:]])
    numeric = (v[2:, :3] - v[:-2, :3]) / (2 * DT)
    assert np.abs(numeric).max() > 0.15
    np.testing.assert_allclose(a[1:-1, :3], numeric, atol=0.02)
