from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.control.activation import Activation
from noctule.control.hierarchy import HierarchyError, TaskRows, solve_hierarchy

SEEDS = st.integers(0, 2**32 - 1)


def draw_tasks(rng, activations, rows=(1, 2, 1, 1)):
    return [
        TaskRows(rng.normal(size=(m, 4)), rng.normal(size=m), h)
        for m, h in zip(rows, activations, strict=False)
    ]


def strict(tasks, bottom):
    """Eqs. (13) to (16) with the projectors as printed; the bottom task has J = I."""
    nu, N = np.zeros(4), np.eye(4)
    for J, demand, _ in [*tasks, (np.eye(4), bottom, 1.0)]:
        P = np.linalg.pinv(J @ N, rcond=1e-6) if np.linalg.norm(J @ N) > 1e-9 else np.zeros(J.T.shape)
        nu = nu + P @ (demand - J @ nu)
        N = N - P @ (J @ N)
    return nu


def over_all_subsets(tasks, bottom):
    """The convex combination over all subsets, by brute force."""
    total = np.zeros(4)
    for chosen in product((False, True), repeat=len(tasks)):
        weight = np.prod([t[2] if on else 1.0 - t[2] for t, on in zip(tasks, chosen, strict=True)])
        total += weight * strict([t for t, on in zip(tasks, chosen, strict=True) if on], bottom)
    return total


def printed(tasks, bottom):
    """Eqs. (13) to (19) as printed, with h = 1 for the bottom task: kept here to show that it leaks."""
    pinv = np.linalg.pinv
    (Ja, da, ha), (Jm, dm, hm) = tasks
    ia = ha * da + (1 - ha) * Ja @ (hm * pinv(Jm) @ dm + bottom)
    im = hm * dm + (1 - hm) * Jm @ (ha * pinv(Ja) @ da + bottom)
    return strict([(Ja, ia, 1.0), (Jm, im, 1.0)], bottom)


def test_no_tasks_return_the_bottom():
    bottom = np.array([0.3, -0.1, 0.2, 0.5])
    np.testing.assert_array_equal(solve_hierarchy([], bottom), bottom)


@given(SEEDS, st.floats(-8.0, 8.0))
def test_all_inactive_gives_the_bottom_whatever_the_upper_jacobians(seed, exponent):
    rng = np.random.default_rng(seed)
    bottom = rng.normal(size=4)
    direction = rng.normal(size=4)
    tasks = [
        (10.0**exponent * rng.normal(size=(2, 4)), rng.normal(size=2), 0.0),
        (np.outer([1.0, 2.0], direction), rng.normal(size=2), 0.0),  # rank one
        (np.zeros((1, 4)), np.ones(1), 0.0),
        (np.full((1, 4), np.nan), np.ones(1), 0.0),  # not even read
    ]
    np.testing.assert_allclose(solve_hierarchy(tasks, bottom), bottom, atol=1e-12)


@given(SEEDS, st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.integers(0, 2))
def test_an_inactive_task_leaves_no_trace(seed, h1, h2, place):
    rng = np.random.default_rng(seed)
    others, bottom = draw_tasks(rng, (h1, h2)), rng.normal(size=4)
    idle = TaskRows(1e3 * rng.normal(size=(2, 4)), rng.normal(size=2), 0.0)
    with_idle = [*others[:place], idle, *others[place:]]
    np.testing.assert_array_equal(solve_hierarchy(with_idle, bottom), solve_hierarchy(others, bottom))


@given(SEEDS, st.integers(1, 4))
def test_all_active_is_the_strict_hierarchy_as_printed(seed, n):
    rng = np.random.default_rng(seed)
    tasks, bottom = draw_tasks(rng, n * (1.0,)), rng.normal(size=4)
    wanted = strict(tasks, bottom)
    np.testing.assert_allclose(solve_hierarchy(tasks, bottom), wanted, atol=1e-9 * (1 + abs(wanted).max()))


@given(SEEDS, st.lists(st.floats(0.0, 1.0), min_size=1, max_size=4))
@settings(max_examples=60)
def test_the_recursion_equals_brute_force_over_subsets(seed, activations):
    rng = np.random.default_rng(seed)
    tasks, bottom = draw_tasks(rng, activations, rows=(1, 1, 2, 1)), rng.normal(size=4)
    wanted = over_all_subsets(tasks, bottom)
    np.testing.assert_allclose(solve_hierarchy(tasks, bottom), wanted, atol=1e-9 * (1 + abs(wanted).max()))


@given(SEEDS)
def test_the_executed_motion_meets_the_upper_task(seed):
    rng = np.random.default_rng(seed)
    tasks = draw_tasks(rng, (1.0, 0.5, 1.0))
    nu = solve_hierarchy(tasks, rng.normal(size=4))
    assert abs(tasks[0].J @ nu - tasks[0].demand) <= 1e-12 * (1 + np.linalg.norm(nu))


@given(st.floats(-6.5, 0.0))
def test_the_upper_task_is_met_even_when_a_lower_one_is_nearly_parallel(exponent):
    J = np.array([[1.0, 0.2, -0.3, 0.1]])
    near = J + 10.0**exponent * np.array([[0.0, 1.0, 0.0, 0.5]])
    nu = solve_hierarchy([(J, np.ones(1), 1.0), (near, -np.ones(1), 1.0)], np.ones(4))
    assert abs(J @ nu - 1.0)[0] <= 1e-15 * np.linalg.norm(nu) + 1e-14


def test_a_task_that_repeats_the_one_above_changes_nothing():
    J, bottom = np.array([[1.0, 0.5, 0.0, -0.2]]), np.array([0.1, 0.2, 0.3, 0.4])
    once = solve_hierarchy([(J, np.ones(1), 1.0)], bottom)
    np.testing.assert_allclose(
        solve_hierarchy([(J, np.ones(1), 1.0), (3 * J, -np.ones(1), 1.0)], bottom), once, atol=1e-14
    )


@given(SEEDS, st.floats(-6.0, 6.0))
def test_the_unit_of_a_task_does_not_matter(seed, exponent):
    rng = np.random.default_rng(seed)
    (upper, lower), bottom, unit = draw_tasks(rng, (1.0, 0.7)), rng.normal(size=4), 10.0**exponent
    nu = solve_hierarchy([upper, lower], bottom)
    rescaled = solve_hierarchy([upper, (unit * lower.J, unit * lower.demand, 0.7)], bottom)
    np.testing.assert_allclose(rescaled, nu, atol=1e-9 * (1 + np.linalg.norm(nu)))


def test_a_jacobian_of_zeros_changes_nothing():
    bottom = np.array([0.1, 0.2, 0.3, 0.4])
    np.testing.assert_array_equal(
        solve_hierarchy([(np.zeros((1, 4)), np.ones(1), 1.0), (np.zeros((0, 4)), np.ones(0), 1.0)], bottom),
        bottom,
    )


def test_tasks_below_a_full_set_of_four_rows_are_silent():
    rng = np.random.default_rng(5)
    demand = rng.normal(size=4)
    tasks = [(np.eye(4), demand, 1.0), (rng.normal(size=(2, 4)), rng.normal(size=2), 1.0)]
    np.testing.assert_allclose(solve_hierarchy(tasks, rng.normal(size=4)), demand, atol=1e-14)


def test_nothing_is_damped():
    # A weak row is served in full: its demand is met, however large the motion.
    nu = solve_hierarchy(
        [(np.array([[1e-3, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]), np.ones(2), 1.0)], np.zeros(4)
    )
    np.testing.assert_allclose(nu, [1e3, 1.0, 0.0, 0.0], rtol=1e-12)


@given(SEEDS, st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1e-6))
def test_the_command_is_continuous_in_each_activation(seed, h1, h2, change):
    rng = np.random.default_rng(seed)
    (a, m), bottom = draw_tasks(rng, (h1, h2)), rng.normal(size=4)
    moved = a._replace(activation=min(1.0, h1 + change))
    ends = [solve_hierarchy([a._replace(activation=h), m], bottom) for h in (0.0, 1.0)]
    step = np.linalg.norm(solve_hierarchy([moved, m], bottom) - solve_hierarchy([a, m], bottom))
    # It is linear in each activation, so the step is a known part of the way between the ends.
    assert step <= change * np.linalg.norm(ends[1] - ends[0]) + 1e-12 * (1 + np.abs(ends).max())


@given(SEEDS, st.lists(st.tuples(st.booleans(), st.booleans()), min_size=5, max_size=40))
@settings(max_examples=40)
def test_the_command_is_continuous_under_random_switching(seed, switches):
    rng = np.random.default_rng(seed)
    (a, m), bottom, dt = draw_tasks(rng, (1.0, 1.0)), rng.normal(size=4), 1.0 / 30.0
    clocks = [Activation(0.5), Activation(1.3)]
    corners = [
        solve_hierarchy([a._replace(activation=i), m._replace(activation=j)], bottom)
        for i, j in product((0.0, 1.0), repeat=2)
    ]
    widest = max(np.linalg.norm(p - q) for p in corners for q in corners)
    nu = bottom
    for on in switches:
        clocks = [clock.step(wanted, dt) for clock, wanted in zip(clocks, on, strict=True)]
        new = solve_hierarchy(
            [a._replace(activation=clocks[0].h), m._replace(activation=clocks[1].h)], bottom
        )
        # |dh| <= pi dt / (2 T) for each of the two activations.
        assert np.linalg.norm(new - nu) <= 0.5 * np.pi * dt * (1 / 0.5 + 1 / 1.3) * widest + 1e-12
        nu = new


def test_the_printed_intermediate_values_leak_and_the_exact_form_does_not():
    rng = np.random.default_rng(0)
    worst = {"printed": 0.0, "exact": 0.0}
    for _ in range(200):
        (a, m), bottom = draw_tasks(rng, (1.0, 0.0)), rng.normal(size=4)
        alone = strict([a], bottom)  # visibility inactive: what the two-task solution commands
        for name, law in (("printed", printed), ("exact", solve_hierarchy)):
            leak = np.linalg.norm(law([a, m], bottom) - alone) / np.linalg.norm(alone)
            worst[name] = max(worst[name], leak)
    assert worst["printed"] > 0.5
    assert worst["exact"] < 1e-12


def test_the_printed_form_agrees_when_every_task_is_active():
    rng = np.random.default_rng(1)
    tasks, bottom = draw_tasks(rng, (1.0, 1.0)), rng.normal(size=4)
    np.testing.assert_allclose(printed(tasks, bottom), solve_hierarchy(tasks, bottom), atol=1e-12)


ROW, ONE = np.ones((1, 4)), np.ones(1)


@pytest.mark.parametrize(
    ("tasks", "bottom", "message"),
    [
        (
            [],
            np.zeros(6),
            "bottom: shape is (6,), expected (4,); take a camera twist through body_velocity first",
        ),
        (
            [],
            np.array([0.0, np.inf, 0.0, 0.0]),
            "bottom: [0.0, inf, 0.0, 0.0] is not finite; check the servoing error",
        ),
        (
            [(ROW, ONE, 1.0), (np.ones((1, 6)), ONE, 1.0)],
            np.zeros(4),
            "task 1: J has shape (1, 6), expected (m, 4); multiply a camera Jacobian (m, 6) by B",
        ),
        (
            [(np.ones(4), ONE, 0.0)],
            np.zeros(4),
            "task 0: J has shape (4,), expected (m, 4); multiply a camera Jacobian (m, 6) by B",
        ),
        (
            [(ROW, np.ones(2), 1.0)],
            np.zeros(4),
            "task 0: demand has shape (2,), expected (1,), one for each row of J",
        ),
        ([(ROW, ONE, 1.2)], np.zeros(4), "task 0: activation is 1.2, expected 0 to 1; take Activation.h"),
        ([(ROW, ONE, np.nan)], np.zeros(4), "task 0: activation is nan, expected 0 to 1; take Activation.h"),
        (
            [(ROW, np.array([np.nan]), 0.1)],
            np.zeros(4),
            "task 0: J or demand is not finite; check its measurement and depth",
        ),
    ],
)
def test_bad_input_says_what_was_given_and_what_was_expected(tasks, bottom, message):
    with pytest.raises(HierarchyError) as caught:
        solve_hierarchy(tasks, bottom)
    assert str(caught.value) == message
