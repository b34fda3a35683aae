"""Navigation data of a low-cost quadcopter: how late, how irregular, how wrong."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from noctule.geometry import Pose, wrap_angle
from noctule.messages import FlightState, VehicleState
from noctule.simulation import NavdataSpec, VehicleSpec
from noctule.simulation.aircraft import Aircraft
from noctule.simulation.dynamics import STEPS_PER_SECOND
from noctule.simulation.navdata import TABLE_3, Navdata, table_3_error

SECONDS = 60


def still(stamp: float, yaw: float = 0.3) -> VehicleState:
    return VehicleState(stamp, FlightState.FLYING, yaw=yaw, v_body=np.array([0.2, -0.1, 0.05]), height=1.203)


def received(spec: NavdataSpec, seed: int = 0, yaw: float = 0.3) -> list[tuple[float, VehicleState]]:
    """Return (arrival [s], report) of a minute."""
    navdata = Navdata(spec, np.random.SeedSequence(seed), STEPS_PER_SECOND)
    found = []
    for step in range(SECONDS * STEPS_PER_SECOND):
        now = step / STEPS_PER_SECOND
        report = navdata.step(step, lambda now=now: still(now, yaw))
        if report is not None:
            found.append((now, report))
    return found


def test_reports_are_measured_at_irregular_times_between_the_rates():
    stamps = [report.stamp for _, report in received(NavdataSpec(loss=0.0, soonest=0.05, latest=0.05))]
    gaps = np.diff(stamps)
    assert gaps.min() > 1 / 67 - 2 / STEPS_PER_SECOND
    assert gaps.max() < 1 / 28 + 2 / STEPS_PER_SECOND
    assert gaps.std() > 0.004


def test_reports_arrive_as_late_as_the_link_makes_them_and_in_order():
    found = received(NavdataSpec())
    late = np.array([arrival - report.stamp for arrival, report in found])
    assert late.min() >= 0.042
    assert late.max() <= 0.09 + 1 / STEPS_PER_SECOND
    assert np.all(np.diff([report.stamp for _, report in found]) > 0.0)


def test_a_lossy_link_delivers_fewer_reports():
    steady = {"soonest": 0.05, "latest": 0.05}
    all_of_them = len(received(NavdataSpec(loss=0.0, **steady)))
    assert len(received(NavdataSpec(loss=0.3, **steady))) == pytest.approx(0.7 * all_of_them, rel=0.06)


def test_what_is_measured_while_the_link_is_gone_never_arrives_and_the_rest_is_the_same():
    gone = ({"begin_s": 10.0, "seconds": 5.0}, {"begin_s": 30.0, "seconds": 0.5})
    whole = received(NavdataSpec())
    left = received(NavdataSpec(silences=gone))
    stamps = np.array([report.stamp for _, report in left])
    assert not ((stamps >= 10.0) & (stamps < 15.0)).any()
    assert not ((stamps >= 30.0) & (stamps < 30.5)).any()
    outside = [(a, r.stamp) for a, r in whole if not 10.0 <= r.stamp < 15.0 and not 30.0 <= r.stamp < 30.5]
    assert {(a, r.stamp) for a, r in left} >= set(outside)


def test_losses_do_not_change_the_times_of_measurement():
    steady = {"soonest": 0.05, "latest": 0.05}
    whole = {report.stamp for _, report in received(NavdataSpec(loss=0.0, **steady))}
    assert {report.stamp for _, report in received(NavdataSpec(loss=0.5, **steady))} < whole


def test_the_errors_are_as_large_as_the_settings_say():
    spec = NavdataSpec(heading_drift=0.0, loss=0.0)
    reports = [report for seed in range(3) for _, report in received(spec, seed)]
    velocity = np.array([report.v_body for report in reports])
    assert np.diff(velocity, axis=0).std() / math.sqrt(2) == pytest.approx(0.06, rel=0.05)
    height = np.array([report.height for report in reports])
    assert height.std() == pytest.approx(math.hypot(0.02, 0.01 / math.sqrt(12)), rel=0.05)
    yaw = np.array([report.yaw for report in reports])
    assert yaw.std() == pytest.approx(math.radians(2.0), rel=0.05)
    assert yaw.mean() - 0.3 == pytest.approx(table_3_error(0.3), abs=math.radians(0.15))


def test_the_velocitys_bias_wanders_and_keeps_its_size():
    spec = NavdataSpec(velocity_bias=0.03)
    biases = []
    for seed in range(40):
        navdata = Navdata(spec, np.random.SeedSequence(seed), STEPS_PER_SECOND)
        first = navdata.velocity_bias
        for k in range(60):
            navdata.measured(still(float(k)))
        biases.append((first, navdata.velocity_bias))
    first, last = np.array(biases).transpose(1, 0, 2)
    assert first.std() == pytest.approx(0.03, rel=0.15)
    assert last.std() == pytest.approx(0.03, rel=0.15)
    assert abs(np.corrcoef(first.ravel(), last.ravel())[0, 1]) < 0.35


def test_heights_come_in_steps():
    steps = np.array([report.height for _, report in received(NavdataSpec())]) / 0.01
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)


@pytest.mark.parametrize(("reference", "reported"), TABLE_3)
def test_the_headings_error_goes_through_table_3(reference, reported):
    error = math.degrees(table_3_error(math.radians(reference)))
    assert error == pytest.approx(reported - reference, abs=1e-9)
    assert math.degrees(table_3_error(math.radians(reference - 360.0))) == pytest.approx(error, abs=1e-9)


def test_the_headings_error_has_no_step_at_a_full_turn():
    assert table_3_error(1e-9) == pytest.approx(table_3_error(2.0 * math.pi - 1e-9), abs=1e-8)


def test_the_heading_drifts_away():
    spec = NavdataSpec(heading_error=0.0, heading_noise=0.0, heading_drift=0.01)
    reports = [report for _, report in received(spec)]
    off = np.unwrap([wrap_angle(report.yaw - 0.3) for report in reports])
    rate = np.polyfit([report.stamp for report in reports], off, 1)
    assert abs(rate[0]) > 1e-4
    assert np.polyval(rate, 30.0) == pytest.approx(30.0 * rate[0], abs=1e-6)


def test_the_same_seed_gives_the_same_reports_and_another_seed_others():
    first, again, other = (received(NavdataSpec(), seed) for seed in (1, 1, 2))
    assert [(a, r.stamp, r.yaw, *r.v_body) for a, r in first] == [
        (a, r.stamp, r.yaw, *r.v_body) for a, r in again
    ]
    assert [r.stamp for _, r in first] != [r.stamp for _, r in other]


def flown(spec: VehicleSpec) -> Aircraft:
    seeds = tuple(np.random.SeedSequence(4).spawn(2))
    aircraft = Aircraft(spec, Pose(np.array([0.0, 0.0, 1.0]), 0.5), True, seeds)
    for _ in range(STEPS_PER_SECOND):
        aircraft.step()
    return aircraft


def test_a_vehicle_that_flies_without_its_navdata_moves_as_one_without_and_reports_late():
    plain = flown(VehicleSpec(gusts=0.5))
    late = flown(VehicleSpec(gusts=0.5, navdata=NavdataSpec(), loop_on_measured=False))
    assert plain.motion == late.motion
    assert plain.report().stamp == 1.0
    assert 0.042 <= 1.0 - late.report().stamp < 0.2
    assert late.report().flight_state is FlightState.FLYING


def test_a_vehicle_without_navdata_has_none():
    assert flown(VehicleSpec()).navdata is None


@pytest.mark.parametrize("wrong", [{"slowest": 70.0}, {"soonest": 0.1}])
def test_limits_the_wrong_way_round_are_refused(wrong):
    with pytest.raises(ValidationError, match="give the smaller one first"):
        NavdataSpec(**wrong)
