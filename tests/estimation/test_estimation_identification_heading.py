"""Yaw from a heading: whatever its noise, deviations are those of the errors and near the data's bound."""

import numpy as np
import pytest

from noctule.estimation.identification import (
    EXCITATIONS,
    AxisFlight,
    WholeFlight,
    check_excitation,
    cramer_rao,
    identify,
    validate,
)
from noctule.estimation.identification.noise import Noise, noises_of, whitened
from noctule.estimation.identification.response import response
from noctule.estimation.vehicle_model import TABLE_1, VehicleModel

TRUE = np.array(TABLE_1)
DELAY = 0.067
MODEL = VehicleModel.identified(delay=DELAY)
SENT = np.arange(0.0, 82.0, 1.0 / 30.0)
INPUTS = EXCITATIONS[3].inputs(SENT)
STAMPS = SENT + 0.011
DRAWS = 12


def turned(stamps=STAMPS):
    """The heading [rad] of a vehicle of Table 1."""
    return response(TRUE[6], TRUE[7], DELAY, 0.0, SENT, INPUTS, stamps)[2]


def yaw_flight(yaw, stamps=STAMPS):
    return AxisFlight(SENT, INPUTS, stamps, np.diff(yaw) / np.diff(stamps), "yaw", means=True)


def drawn(draw, heading=0.0, rate=0.0, stamps=STAMPS):
    """Noise of the heading [rad] and of its rate over a report [rad/s]."""
    rng = np.random.default_rng([draw, 7])
    steps = np.diff(stamps, prepend=stamps[0])
    walk = np.cumsum(rate * np.sqrt(steps / 30.0) * rng.standard_normal(stamps.size))
    return yaw_flight(turned(stamps) + heading * rng.standard_normal(stamps.size) + walk, stamps)


def errors(found):
    return np.append(found.k - TRUE[6:], found.delay - DELAY) / np.append(found.sd, found.delay_sd)


@pytest.mark.parametrize("heading", [0.0035, 0.0175, 0.035])
def test_with_noise_of_the_heading_deviations_are_near_the_bound_and_true(heading):
    z = []
    for draw in range(DRAWS):
        flight = drawn(draw, heading)
        found = identify([flight])
        bound, delay_bound = cramer_rao(MODEL, [flight], 1.0, heading=heading)
        assert (found.sd <= 1.3 * bound[6:]).all()
        assert found.delay_sd <= 1.3 * delay_bound
        assert abs(found.axes[0].residual_correlation) < 0.1
        z.append(errors(found))
    # 36 normal numbers: beyond 3.5 once in 60 such tests.
    assert np.abs(z).max() < 3.5
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.4


def test_with_noise_of_the_rate_too():
    z = []
    for draw in range(DRAWS):
        flight = drawn(draw, rate=0.1)
        found = identify([flight])
        bound, _ = cramer_rao(MODEL, [flight], 0.1)
        assert (found.sd <= 1.3 * bound[6:]).all()
        z.append(errors(found))
    assert np.abs(z).max() < 3.5


@pytest.mark.parametrize("rate", [0.02, 0.1, 0.5])
def test_with_both_neither_is_taken_for_the_other(rate):
    z = [errors(identify([drawn(draw, 0.01, rate)])) for draw in range(DRAWS)]
    assert np.abs(z).max() < 3.5
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.4


def test_reports_that_come_irregularly_are_as_good():
    rng = np.random.default_rng(4)
    stamps = np.sort(rng.choice(np.arange(SENT.size * 4) / 120.0, SENT.size, replace=False)) + 0.011
    flight = drawn(1, 0.0175, stamps=stamps)
    found = identify([flight])
    bound, _ = cramer_rao(MODEL, [flight], 1.0, heading=0.0175)
    assert (found.sd <= 1.3 * bound[6:]).all()
    assert np.abs(errors(found)).max() < 3.0


def test_without_noise_it_is_exact():
    found = identify([yaw_flight(turned())])
    assert found.k == pytest.approx(TRUE[6:], rel=1e-8)
    assert found.delay == pytest.approx(DELAY, abs=1e-9)


def test_a_heading_that_was_added_up_by_euler_s_steps_is_off_by_no_more_than_it_says():
    fine = np.arange(82 * 300) / 300.0
    rates = response(TRUE[6], TRUE[7], DELAY, 0.0, SENT, INPUTS, fine)[0]
    yaw = np.cumsum(rates) / 300.0
    found = identify([yaw_flight(yaw[::10], fine[::10])])
    assert found.k == pytest.approx(TRUE[6:], rel=2e-5)
    assert (np.abs(found.k - TRUE[6:]) < 3.0 * found.sd).all()
    assert found.delay == pytest.approx(DELAY - 1.0 / 600.0, abs=1e-5)  # half a step ahead


def test_a_noisy_heading_hides_no_excitation_and_costs_the_fit_little():
    flight = drawn(0, 0.035)
    inputs = np.zeros((SENT.size, 4))
    inputs[:, 3] = INPUTS
    yaw = np.concatenate([[0.0], np.cumsum(flight.velocities * np.diff(STAMPS))])
    whole = WholeFlight(SENT, inputs, STAMPS, np.zeros((SENT.size, 3)), yaw)
    others = []
    for a, axis in enumerate(("forward", "left", "up")):
        u = EXCITATIONS[a].inputs(SENT)
        v = response(TRUE[2 * a], TRUE[2 * a + 1], DELAY, 0.0, SENT, u, STAMPS)[0]
        others.append(AxisFlight(SENT, u, STAMPS, v, axis))
    found = identify([*others, *whole.parts()])
    check_excitation(found)
    assert found.k[6:] == pytest.approx(TRUE[6:], rel=0.03)
    # Differences between neighbours have 1.5 rad/s of noise, five times what the vehicle turns.
    assert np.std(flight.velocities) > 1.4
    assert validate(found, whole).fit[3] > 0.6


def test_whitening_by_the_heading_s_noise_is_the_output_error_on_the_heading():
    # Least squares on a heading whose beginning is unknown, against the whitened differences.
    rng = np.random.default_rng(2)
    columns = np.cumsum(rng.standard_normal((STAMPS.size, 2)), axis=0)
    flight = yaw_flight(turned())
    rows = np.diff(columns, axis=0) / np.diff(STAMPS)[:, None]
    white = whitened([flight], [Noise.of_heading(0.02, flight)], rows)
    centred = columns - columns.mean(axis=0)
    assert white.T @ white == pytest.approx(centred.T @ centred / 0.02**2, rel=1e-9)


def test_what_of_the_noise_is_the_heading_s_own_is_told():
    for heading, rate, share in ((0.02, 0.0, 1.0), (0.0, 0.1, 0.0)):
        flight = drawn(3, heading, rate)
        r = flight.velocities - np.diff(turned()) / np.diff(STAMPS)
        (noise,) = noises_of(flight, r[None], 0.0)
        assert noise.heading == pytest.approx(share, abs=0.02)
        sd = noise.sd / 30.0 if heading else noise.sd
        assert sd == pytest.approx(heading or rate, rel=0.05)
