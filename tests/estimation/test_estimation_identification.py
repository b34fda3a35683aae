"""The vehicle's parameters come back from a flight of it, and come with honest deviations."""

from dataclasses import replace

import numpy as np
import pytest

from noctule.estimation.identification import (
    AXES,
    AxisFlight,
    ExcitationError,
    IdentificationError,
    check_excitation,
    cramer_rao,
    identify,
    published,
)
from noctule.estimation.identification.output_error import CLOSEST, CLOSEST_DELAY
from noctule.estimation.identification.response import response
from noctule.estimation.vehicle_model import TABLE_1, VehicleModel, transition

MODEL = VehicleModel.identified(delay=0.067)
TRUE = np.array(TABLE_1)
RATE, LENGTH = 30.0, 82.0


def excitation(t, period):
    """A sinusoid whose phase and height are deformed, so that it holds more than one frequency."""
    w = 2.0 * np.pi / period
    return np.sin(w * t + 0.8 * np.sin(0.37 * w * t)) * (0.7 + 0.3 * np.cos(0.23 * w * t))


def flown(noise, seed=0, bias=0.0, model=MODEL, phase=0.0, length=LENGTH):
    rng = np.random.default_rng(seed)
    sent = np.arange(0.0, length, 1.0 / RATE)
    measured = sent + 0.011
    flights = []
    for axis, (name, period, height) in enumerate(
        zip(AXES, (8, 8, 5, 5), (0.15, 0.15, 0.5, 0.5), strict=True)
    ):
        u = height * excitation(sent + phase, period)
        v = response(model.input_gains[axis], model.drags[axis], model.delay, 0.0, sent, u, measured)[0]
        flights.append(AxisFlight(sent, u, measured, v + bias + noise * rng.standard_normal(v.size), name))
    return flights


def test_the_response_is_the_filter_s_own_model_step_by_step():
    rng = np.random.default_rng(0)
    sent, u = np.arange(0.0, 3.0, 0.1), rng.uniform(-1, 1, 30)
    v = response(4.7, 0.3, 0.0, 0.2, sent, u, sent)[0]
    x = np.zeros(8)
    x[4] = 0.2
    for k in range(29):
        x, _ = transition(x, 0.1, np.array([u[k], 0, 0, 0]), np.full(4, 4.7), np.full(4, 0.3))
        assert v[k + 1] == pytest.approx(x[4], abs=1e-12)


def test_without_noise_the_parameters_are_exact():
    found = identify(flown(0.0))
    assert np.abs(found.k / TRUE - 1.0).max() < 1e-9
    assert found.delay == pytest.approx(0.067, abs=1e-10)


@pytest.mark.parametrize("delay", [0.0, 0.02, 0.3])
def test_any_delay_is_found(delay):
    found = identify(flown(0.0, model=VehicleModel.identified(delay=delay)))
    assert found.delay == pytest.approx(delay, abs=1e-9)
    assert found.model().delay == pytest.approx(delay, abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_at_a_centimetre_a_second_of_noise_the_parameters_are_within_their_percents(seed):
    found = identify(flown(0.01, seed))
    error = np.abs(found.k / TRUE - 1.0)
    assert error[:4].max() < 0.01
    assert error[4:].max() < 0.03
    assert abs(found.delay - 0.067) < 0.005


def test_at_ten_centimetres_a_second_the_deviations_are_honest_and_near_the_bound():
    z = []
    for seed in range(12):
        flights = flown(0.1, seed)
        found = identify(flights)
        bound, delay_bound = cramer_rao(MODEL, flights, 0.1)
        assert (found.sd <= 1.3 * bound).all()
        assert found.delay_sd <= 1.3 * delay_bound
        z.append(np.append((found.k - TRUE) / found.sd, (found.delay - 0.067) / found.delay_sd))
    # 108 normal numbers: beyond 3.7 once in 40 such tests; their rms is 1 with a deviation of 0.07.
    assert np.abs(z).max() < 3.7
    assert 0.75 < np.sqrt(np.mean(np.square(z))) < 1.3


def test_a_bias_of_the_sensor_goes_nowhere_else():
    found = identify(flown(0.0, bias=0.05))
    assert np.abs(found.k / TRUE - 1.0).max() < 1e-9


def test_the_deviations_are_those_of_the_noise_of_each_axis():
    quiet, loud = flown(0.01, 1), flown(0.1, 2)
    mixed = identify([loud[0], *quiet[1:]])
    assert mixed.axes[0].residual_sd == pytest.approx(0.1, rel=0.1)
    assert mixed.axes[1].residual_sd == pytest.approx(0.01, rel=0.1)
    # The loud axis has the delay in common with the quiet ones and spoils none of their parameters.
    without = identify(quiet[1:])
    assert mixed.sd[2:] == pytest.approx(without.sd, rel=0.05)
    assert mixed.k[2:] == pytest.approx(without.k, rel=0.005)


def test_the_published_least_squares_is_right_without_noise_and_delay_and_biased_with_them():
    calm = flown(0.0, model=VehicleModel.identified())
    for axis, flight in enumerate(calm):
        (fit,) = published([flight]).axes
        assert fit.k_u == pytest.approx(TRUE[2 * axis], rel=0.03)
    noisy = flown(0.1, model=VehicleModel.identified())
    drags = [fit.k_v for fit in published(noisy).axes]
    assert all(drag > 5.0 * true for drag, true in zip(drags, TRUE[1::2], strict=True))


def test_the_published_fit_follows_its_formula():
    flight = flown(0.05, 3)[2]
    u = np.interp(flight.stamps, flight.command_stamps, np.arange(flight.inputs.size))
    held = flight.inputs[np.floor(u).astype(int)]
    G = np.column_stack([np.gradient(flight.velocities, flight.stamps), flight.velocities])
    theta = np.linalg.inv(G.T @ G) @ G.T @ held
    (fit,) = published([flight]).axes
    assert fit.k_u == pytest.approx(1.0 / theta[0])
    assert fit.k_v == pytest.approx(theta[1] / theta[0])
    assert fit.k_u_sd > 0.0 < fit.k_v_sd


def test_what_is_identified_is_a_model_that_the_filter_takes():
    found = identify(flown(0.0))
    model = found.model()
    assert np.allclose(model.input_gains, TRUE[0::2])
    assert np.allclose(model.drags, TRUE[1::2])
    assert found.sd.shape == (8,)


def made(**changes):
    good = {
        "command_stamps": np.arange(30.0),
        "inputs": np.sin(np.arange(30.0)),
        "stamps": np.arange(30.0),
        "velocities": np.zeros(30),
        "axis": "left",
    }
    return AxisFlight(**{**good, **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"velocities": np.zeros(29)},
            "identification of left: 30 inputs at 30 stamps, 29 velocities at 30 stamps; expected as many of "
            "both, at least 2 inputs and 20 velocities",
        ),
        (
            {"stamps": np.append(np.arange(29.0), 2.5)},
            "identification of left: stamps of measurements do not increase, 2.5 s follows 28 s at number 29"
            "; expected each later than the one before: put them in order",
        ),
        (
            {"velocities": np.append(np.zeros(28), [np.nan, np.inf])},
            "identification of left: 2 of 30 measurements are not finite, the first is nan at number 28; "
            "expected finite numbers: leave them out",
        ),
        (
            {"inputs": np.full(30, 0.2)},
            "identification of left: its input is 0.2 throughout; expected one that varies: fly the deformed "
            "sinusoid",
        ),
    ],
)
def test_a_flight_that_says_nothing_is_refused(changes, message):
    with pytest.raises(IdentificationError) as told:
        made(**changes)
    assert str(told.value) == message


@pytest.mark.parametrize("method", [identify, published])
def test_no_axes_are_refused(method):
    with pytest.raises(IdentificationError) as told:
        method([])
    assert str(told.value) == (
        "identification: no flight moves an axis; expected at least one whose inputs vary: "
        "fly the deformed sinusoid on each axis"
    )


def test_an_unknown_axis_is_refused():
    with pytest.raises(IdentificationError) as told:
        made(axis="sideways")
    assert str(told.value) == (
        "identification: axis 'sideways' is not known; expected one of forward, left, up, yaw"
    )


def test_an_axis_that_was_not_moved_is_named():
    found = identify(flown(0.01)[:2])
    with pytest.raises(ExcitationError) as told:
        check_excitation(found)
    assert str(told.value) == (
        "identification: nothing was sent on up and yaw; expected all of forward, left, up, yaw to be moved: "
        "fly the deformed sinusoid on each"
    )
    with pytest.raises(ExcitationError, match="nothing was sent on up and yaw"):
        found.model()


def test_too_little_excitation_names_the_axis_and_the_parameter():
    flights = flown(0.05)
    left = flights[1]
    sent, little = left.command_stamps, 0.004 * left.inputs
    moved = response(6.233, 0.5328, 0.067, 0.0, sent, little, left.stamps)[0]
    noise = 0.05 * np.random.default_rng(5).standard_normal(moved.size)
    flights[1] = AxisFlight(sent, little, left.stamps, moved + noise, "left")
    found = identify(flights)
    with pytest.raises(ExcitationError) as told:
        check_excitation(found)
    fit = found.axes[1]
    name, value, sd, known = "k3", fit.k_u, fit.k_u_sd, 0.2 * fit.k_u
    if sd <= known:
        name, value, sd, known = "k4", fit.k_v, fit.k_v_sd, 0.5 * max(fit.k_v, 0.1)
    assert str(told.value) == (
        f"identification of left: too little excitation, {name} is {value:.3g} with a deviation of {sd:.2g}, "
        f"expected at most {known:.2g}; fly the deformed sinusoid longer or larger"
    )


def test_several_flights_of_an_axis_are_one_identification_with_a_bias_each():
    once, twice = flown(0.02, 1, bias=0.1), flown(0.02, 2, bias=-0.2)
    both = identify([*once, *twice])
    assert both.k == pytest.approx(TRUE, rel=0.05)
    assert both.sd == pytest.approx(identify(once).sd / np.sqrt(2.0), rel=0.05)


def test_a_drag_or_a_gain_below_zero_is_no_vehicle():
    found = identify(flown(0.0))
    grows = replace(found, axes=(replace(found.axes[0], k_v=-0.02), *found.axes[1:]))
    with pytest.raises(IdentificationError) as told:
        grows.model()
    backwards = replace(found, axes=(*found.axes[:3], replace(found.axes[3], k_u=-1.0)))
    with pytest.raises(
        IdentificationError, match=r"identification of yaw: its gain is -1, its drag 1\.52 1/s"
    ):
        backwards.model()
    assert str(told.value) == (
        "identification of forward: its gain is 4.72, its drag -0.02 1/s, expected a gain above 0 and a drag "
        "of 0 or more; are signs and stamps of inputs and velocities the same?"
    )


def test_gusts_widen_the_deviations_to_what_they_are():
    z = []
    for seed in range(6):
        rng = np.random.default_rng([seed, 1])
        flights = []
        for flight, k_v in zip(flown(0.02, seed), TRUE[1::2], strict=True):
            # A velocity that gusts moved decays with the vehicle's own drag.
            drifting, kicks = 0.0, 0.02 * rng.standard_normal(flight.stamps.size)
            moved = np.empty(kicks.size)
            for i, kick in enumerate(kicks):
                drifting = np.exp(-k_v / RATE) * drifting + kick
                moved[i] = drifting
            sent, u, stamps = flight.command_stamps, flight.inputs, flight.stamps
            flights.append(AxisFlight(sent, u, stamps, flight.velocities + moved, flight.axis))
        found = identify(flights)
        assert min(fit.residual_correlation for fit in found.axes) > 0.15
        z.append((found.k - TRUE) / found.sd)
    # As white noise they would be taken for three to five times smaller.
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.5


def test_reports_that_are_stamped_early_are_refused_and_a_delay_of_0_is_none():
    early = [replace(flight, stamps=flight.stamps - 0.2) for flight in flown(0.02)]
    with pytest.raises(IdentificationError) as told:
        identify(early).model()
    text = str(told.value)
    assert text.startswith("identification: the delay is -13")
    assert text.endswith(
        " ms, the vehicle answers before it is asked; expected 0 or more: the stamps of reports are early, "
        "or those of commands late; stamp both by one clock, reports when they were measured"
    )
    found = identify(flown(0.0))
    # Within 5 ms or 3 deviations of 0 it is 0.
    assert replace(found, delay=-0.0049, delay_sd=0.0).model().delay == 0.0
    assert replace(found, delay=-0.029, delay_sd=0.01).model().delay == 0.0
    for delay, sd in ((-0.0051, 0.0), (-0.031, 0.01)):
        with pytest.raises(IdentificationError, match="before it is asked"):
            replace(found, delay=delay, delay_sd=sd).model()


def test_no_deviation_is_less_than_a_vehicle_can_be_known():
    found = identify(flown(0.0))
    assert (found.sd >= CLOSEST * found.k).all()
    assert (found.sd < 1e-4 * found.k).all()
    assert found.delay_sd >= CLOSEST_DELAY
