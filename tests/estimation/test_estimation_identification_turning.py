"""A vehicle that turns: the body's axes go together, and so do the axes of a flight that is foretold."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from noctule.estimation.identification import (
    AXES,
    EXCITATIONS,
    AxisFit,
    AxisFlight,
    Excitation,
    ExcitationError,
    Identification,
    IdentificationError,
    PlaneFlight,
    VehicleModelSettings,
    WholeFlight,
    cramer_rao,
    identify,
    published,
    validate,
    validation_inputs,
)
from noctule.estimation.identification.covariance import deviations, inverse, long_run
from noctule.estimation.identification.response import held, plane_response, response
from noctule.estimation.vehicle_model import TABLE_1, VehicleModel

TRUE = np.array(TABLE_1)
MODEL = VehicleModel.identified(delay=0.067)
FITS = tuple(AxisFit(name, TRUE[2 * a], TRUE[2 * a + 1], 0.0, 0.0, 0.0) for a, name in enumerate(AXES))
EXACT = Identification(FITS, 0.067, 0.0)
SENT = np.arange(0.0, 82.0, 1.0 / 30.0)
MEASURED = SENT + 0.004


def whole(inputs, noise=0.0, seed=0, heading=0.0, drift=0.0, measured=MEASURED):
    """Fly eq. (2) with Table 1, the heading being that of the yaw axis."""
    rng = np.random.default_rng(seed)
    _, _, yaw, _ = response(TRUE[6], TRUE[7], MODEL.delay, 0.0, SENT, inputs[:, 3], measured)
    v, _ = plane_response(TRUE[:4], MODEL.delay, np.zeros(2), SENT, inputs[:, :2], measured, yaw)
    up = response(TRUE[4], TRUE[5], MODEL.delay, 0.0, SENT, inputs[:, 2], measured)[0]
    velocities = np.column_stack([v.T, up])
    said = yaw + heading * rng.standard_normal(yaw.size)
    return WholeFlight(
        SENT,
        inputs,
        measured,
        velocities + noise * rng.standard_normal(velocities.shape),
        said + 0.7 + drift * measured,
    )


@given(st.floats(-0.4, 30.0), st.floats(1e-7, 0.2))
def test_a_held_input_is_integrated_exactly_and_without_cancellation(k, dt):
    e, g, g_k, h, h_k = held(k, dt)
    d = 1e-5 * max(1.0, abs(k))
    up, down = held(k + d, dt), held(k - d, dt)
    assert e == pytest.approx(np.exp(-k * dt), rel=1e-14)
    assert g == pytest.approx(dt - k * h, rel=1e-12)
    assert g_k == pytest.approx((up[1] - down[1]) / (2 * d), rel=1e-4, abs=1e-9 * dt)
    assert h_k == pytest.approx((up[3] - down[3]) / (2 * d), rel=1e-4, abs=1e-9 * dt)
    assert 0.0 < h <= dt * dt * np.exp(max(0.0, -k * dt))


@settings(deadline=None, max_examples=40)
@given(
    st.floats(0.5, 7.0), st.floats(0.0, 4.0), st.floats(0.003, 0.2), st.floats(-1.0, 1.0), st.integers(0, 99)
)
def test_derivatives_of_velocity_and_way_are_those_of_finite_differences(k_u, k_v, delay, v0, seed):
    rng = np.random.default_rng(seed)
    sent, u = np.arange(0.0, 2.0, 0.05), rng.uniform(-1, 1, 40)
    measured = np.sort(rng.uniform(0.0, 2.0, 25))
    p = np.array([k_u, k_v, delay, v0])
    _, J, _, X = response(*p, sent, u, measured)
    near = near_a_change(sent + delay, measured)
    for j in range(4):
        d = 1e-6 * (np.arange(4) == j)
        up, down = (response(*(p + s * d), sent, u, measured) for s in (1, -1))
        assert np.allclose(J[~near, j], ((up[0] - down[0]) / 2e-6)[~near], atol=1e-6)
        assert np.allclose(X[:, j], (up[2] - down[2]) / 2e-6, atol=1e-5)


def near_a_change(changes, stamps):
    """A step of the input that passes a sample within the difference bends the curve there."""
    return np.abs(stamps[:, None] - changes).min(axis=1) < 2e-6


@settings(deadline=None, max_examples=25)
@given(st.floats(0.003, 0.2), st.integers(0, 99))
def test_derivatives_on_the_plane_are_those_of_finite_differences(delay, seed):
    rng = np.random.default_rng(seed)
    sent, u = np.arange(0.0, 2.0, 0.05), rng.uniform(-1, 1, (40, 2))
    measured = np.sort(rng.uniform(0.0, 2.0, 25))
    yaw = np.cumsum(rng.normal(0.0, 0.1, 25))
    p = np.concatenate([rng.uniform(0.5, 6.0, 4), [delay], rng.uniform(-1, 1, 2)])

    def velocities(q):
        return plane_response(q[:4], q[4], q[5:], sent, u, measured, yaw)[0]

    _, J = plane_response(p[:4], delay, p[5:], sent, u, measured, yaw)
    near = near_a_change(sent + delay, measured)
    for j in range(7):
        d = 1e-6 * (np.arange(7) == j)
        numeric = (velocities(p + d) - velocities(p - d)) / 2e-6
        # That by the delay is the exact answer's, where the turn is taken in halves about each step.
        allowed = 1e-6 if j != 4 else 0.02 * np.abs(J[..., 4]).max()
        assert np.allclose(J[:, ~near, j], numeric[:, ~near], atol=allowed)


def test_the_way_is_the_integral_of_the_velocity():
    fine = np.linspace(0.0, 5.0, 20001)
    v, _, x, _ = response(4.7, 0.3, 0.05, 0.4, SENT, EXCITATIONS[0].inputs(SENT), fine)
    assert x[-1] == pytest.approx(np.trapezoid(v, fine), abs=1e-7)


def test_without_a_turn_the_plane_is_two_axes_of_their_own():
    u = np.column_stack([EXCITATIONS[0].inputs(SENT), EXCITATIONS[1].inputs(SENT)])
    yaw = np.full(SENT.size, 1.3)
    v, J = plane_response(TRUE[:4], 0.067, np.array([0.1, -0.2]), SENT, u, MEASURED, yaw)
    for a, v0 in enumerate((0.1, -0.2)):
        alone, by, _, _ = response(TRUE[2 * a], TRUE[2 * a + 1], 0.067, v0, SENT, u[:, a].copy(), MEASURED)
        assert np.allclose(v[a], alone, atol=1e-13)
        assert np.allclose(J[a][:, [2 * a, 2 * a + 1, 4, 5 + a]], by, atol=1e-12)


def test_a_turning_vehicle_answers_as_the_equation_of_the_world_s_acceleration():
    # dV/dt = R(yaw) (K_u u - K_v R(yaw)' V), by an integrator that knows nothing of body axes.
    t = np.arange(0.0, 4.0, 1.0 / 30.0)
    turn = 1.5
    u = np.array([0.1, -0.05])

    def world(now, V):
        c, s = np.cos(turn * now), np.sin(turn * now)
        R = np.array([[c, -s], [s, c]])
        return R @ (TRUE[[0, 2]] * u - TRUE[[1, 3]] * (R.T @ V))

    solved = solve_ivp(world, (0.0, 4.0), [0.3, 0.1], t_eval=t, rtol=1e-10, atol=1e-12).y
    c, s = np.cos(turn * t), np.sin(turn * t)
    body = np.array([c * solved[0] + s * solved[1], c * solved[1] - s * solved[0]])
    v, _ = plane_response(
        TRUE[:4], 0.0, np.array([0.3, 0.1]), np.array([0.0, 9.0]), np.array([u, u]), t, turn * t
    )
    assert np.abs(v - body).max() < 2e-4 * np.abs(body).max()


def test_a_flight_on_all_axes_gives_all_parameters_exactly():
    found = identify(whole(validation_inputs(SENT)).parts())
    assert found.k == pytest.approx(TRUE, rel=1e-7)
    assert found.delay == pytest.approx(0.067, abs=1e-9)


def test_leaving_the_turn_out_costs_much_more_than_noise():
    flight = whole(validation_inputs(SENT), 0.01)
    plane = flight.plane_flight()
    still = PlaneFlight(plane.command_stamps, plane.inputs, plane.stamps, plane.velocities, 0.0 * plane.yaw)
    right, wrong = identify([plane]), identify([still])
    assert right.k == pytest.approx(TRUE[:4], rel=0.03)
    assert np.abs(wrong.k / TRUE[:4] - 1.0).max() > 0.1


def test_yaw_alone_is_enough_for_the_yaw_axis_whatever_its_drift():
    inputs = np.zeros((SENT.size, 4))
    inputs[:, 3] = EXCITATIONS[3].inputs(SENT)
    (flight,) = whole(inputs, drift=0.01).parts()
    assert flight.means
    found = identify([flight])
    assert found.k == pytest.approx(TRUE[6:], rel=1e-8)
    assert found.delay == pytest.approx(0.067, abs=1e-9)


def test_a_yaw_that_is_reported_late_does_not_spoil_the_other_axes():
    flight = whole(validation_inputs(SENT), 0.02)
    turning = flight.yaw_flight()
    late = AxisFlight(
        turning.command_stamps - 0.03, turning.inputs, turning.stamps, turning.velocities, "yaw", means=True
    )  # commands that came earlier are reports that came later
    found = identify([flight.plane_flight(), flight.up_flight(), late])
    assert np.abs((found.k - TRUE) / found.sd).max() < 4.0
    assert abs(found.delay - 0.067) < 4.0 * found.delay_sd


def test_the_bound_knows_what_was_not_moved_and_what_is_known_beforehand():
    flights = whole(validation_inputs(SENT)).parts()
    bound, delay = cramer_rao(MODEL, flights, 0.1)
    known, delay_known = cramer_rao(MODEL, flights, 0.1, own_known=True)
    assert (known <= bound * (1.0 + 1e-9)).all()
    assert delay_known <= delay
    half, _ = cramer_rao(MODEL, flights, 0.05)
    assert half == pytest.approx(0.5 * bound)
    assert np.isnan(cramer_rao(MODEL, flights[1:2], 0.1)[0][[0, 1, 2, 3, 6, 7]]).all()


def test_the_published_equations_hold_on_a_vehicle_that_turns():
    # Measured halfway between commands, where central differences see no delay of the hold.
    middle = SENT + 0.067 + 1.0 / 60.0
    flight = whole(validation_inputs(SENT), measured=middle)
    turning = PlaneFlight(SENT + 0.067, flight.inputs[:, :2], middle, flight.velocities[:, :2], flight.yaw)
    still = PlaneFlight(SENT + 0.067, flight.inputs[:, :2], middle, flight.velocities[:, :2], 0.0 * middle)
    errors = [np.abs(published([f]).k / TRUE[:4] - 1.0).max() for f in (turning, still)]
    assert errors[0] < 0.02
    assert errors[1] > 0.06


def test_a_perfect_model_foretells_a_flight_on_all_axes():
    found = validate(EXACT, whole(validation_inputs(SENT)))
    assert found.fit == pytest.approx(np.ones(4), abs=1e-4)
    assert np.nanmax(np.abs(found.measured - found.simulated)) < 1e-4


def test_a_wrong_model_and_noise_cost_fit():
    flight = whole(validation_inputs(SENT), 0.1, heading=0.05)
    noisy = validate(EXACT, flight).fit
    wrong = Identification(tuple(AxisFit(name, 1.0, 1.0, 0, 0, 0) for name in AXES), 0.0, 0.0)
    assert (noisy < 0.9).all()
    assert (validate(wrong, flight).fit < noisy - 0.05).all()


def test_axes_that_stand_still_have_no_fit_and_need_no_model():
    inputs = np.zeros((SENT.size, 4))
    inputs[:, 2] = EXCITATIONS[2].inputs(SENT)
    only_up = Identification((EXACT.axes[2],), 0.067, 0.0)
    found = validate(only_up, whole(inputs))
    assert found.fit[2] == pytest.approx(1.0)
    assert np.isnan(found.fit[[0, 1, 3]]).all()
    with pytest.raises(IdentificationError) as told:
        validate(only_up, whole(validation_inputs(SENT)))
    assert str(told.value) == (
        "validation: the flight moves forward and left and yaw, which was not identified; "
        "expected a model of that axis too"
    )


def test_the_deformed_sinusoid_begins_and_ends_gently_and_holds_many_frequencies():
    for excitation in EXCITATIONS:
        u = excitation.inputs(SENT)
        assert abs(u[0]) < 1e-3
        assert abs(u[-1]) < 1e-3
        assert 0.9 * excitation.height < np.abs(u).max() <= excitation.height
        crossings = np.flatnonzero(np.diff(np.sign(u[200:-200]))) / 30.0
        assert np.diff(crossings).max() > 2.0 * np.diff(crossings).min()


@pytest.mark.parametrize("axis", range(4))
def test_the_deformed_sinusoid_keeps_the_vehicle_in_a_room(axis):
    u = EXCITATIONS[axis].inputs(SENT)
    way = response(TRUE[2 * axis], TRUE[2 * axis + 1], 0.067, 0.0, SENT, u, SENT)[2]
    assert np.abs(way).max() < (1.1, 0.9, 0.4, 0.7)[axis]


def test_an_excitation_out_of_range_is_refused():
    with pytest.raises(ValidationError):
        Excitation(height=1.2, period=5.0)


def test_white_residuals_are_taken_as_they_are_and_correlated_ones_are_not():
    rng = np.random.default_rng(0)
    W = np.column_stack([np.sin(np.arange(3000) / 20.0), np.ones(3000)])
    white = rng.standard_normal(3000)
    assert deviations(W, white, [3000]) == pytest.approx(np.sqrt(np.diag(np.linalg.inv(W.T @ W))))
    # Neighbours that are opposed cancel in what varies slowly.
    opposed = np.diff(rng.standard_normal(3001)) / np.sqrt(2.0)
    assert (deviations(W, opposed, [3000]) < 0.3 * deviations(W, white, [3000])).all()
    smooth = np.convolve(rng.standard_normal(3019), np.ones(20) / np.sqrt(20.0), "valid")
    # White noise smoothed over 20 samples adds up as slowly varying noise of 20 times the density.
    widened = deviations(W, smooth, [3000]) / deviations(W, white, [3000])
    assert widened[1] == pytest.approx(np.sqrt(20.0), rel=0.35)
    assert widened[0] > 2.0


def test_a_parameter_that_is_known_a_million_times_better_hides_no_other():
    A = np.diag([1e24, 1.0, 1e-8])
    assert np.diag(inverse(A)) == pytest.approx([1e-24, 1.0, 1e8])
    assert inverse(np.diag([1.0, 0.0]))[1, 1] > 1e20


def test_the_long_run_covariance_of_independent_scores_is_the_plain_one():
    scores = np.random.default_rng(1).standard_normal((20000, 2))
    assert long_run(scores) / 20000 == pytest.approx(np.eye(2), abs=0.25)


def test_what_is_not_moved_is_told_by_a_whole_flight():
    inputs = np.zeros((SENT.size, 4))
    inputs[:, 0] = EXCITATIONS[0].inputs(SENT)
    flight = whole(inputs)
    assert flight.moved == (True, False, False, False)
    assert [type(part) for part in flight.parts()] == [PlaneFlight]
    with pytest.raises(ExcitationError) as told:
        flight.up_flight()
    assert str(told.value) == (
        "identification of up: its input is 0 throughout; expected one that varies: fly the deformed sinusoid"
    )


def test_flights_whose_sizes_differ_are_refused():
    with pytest.raises(IdentificationError) as told:
        WholeFlight(SENT, np.zeros((5, 4)), MEASURED, np.zeros((SENT.size, 3)), MEASURED)
    assert str(told.value) == (
        "identification of a flight: 5 inputs at 2460 stamps, 2460 velocities at 2460 stamps; "
        "expected as many of both, at least 2 inputs and 20 velocities"
    )


def test_an_identified_vehicle_is_a_model_of_the_commands_sent():
    full_scale = np.array([17.7, 11.7, 1.03, 1.56])
    settings_of = VehicleModelSettings.of(EXACT, full_scale)
    model = settings_of.model()
    assert model.input_gains == pytest.approx(TRUE[0::2] / full_scale)
    assert model.drags == pytest.approx(TRUE[1::2])
    assert model.delay == 0.067
    assert VehicleModelSettings.model_validate(settings_of.model_dump()) == settings_of
