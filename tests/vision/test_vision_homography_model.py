"""The `upright` model: every derivative by finite differences, and what its parts mean."""

import numpy as np
import pytest
from vision_homography_scenes import make_pair

from noctule.geometry import rot_x, rot_y, rot_z
from noctule.vision.homography.upright import two_views
from noctule.vision.homography.upright_cost import (
    absorbed,
    add_absorbed,
    describe,
    mahalanobis,
    normal_equations,
    robust_loss,
)
from noctule.vision.homography.upright_model import (
    best_inverse_depth,
    project,
    rotation,
    rotation_derivatives,
)
from noctule.vision.homography.upright_noise import estimate_noise
from noctule.vision.homography.upright_solver import FINE, cholesky, inverse, minimise

PARAMETERS = np.array([0.11, 0.12, -0.04, 0.09, 0.15, -0.2, 0.01, -0.02])


def views_of(n=30, attitude_sd=0.02, noise=1e-3, **scene):
    pair = make_pair("room", n, np.random.default_rng(4), **{"baseline": 0.3, **scene})
    return two_views(pair.m_ref, pair.m_cur, attitude_sd, noise), pair


def difference(function, x, step=1e-6):
    columns = []
    for k in range(len(x)):
        up, down = x.copy(), x.copy()
        up[k] += step
        down[k] -= step
        columns.append((np.asarray(function(up)) - np.asarray(function(down))) / (2 * step))
    return np.array(columns)


def test_the_rotation_turns_by_yaw_then_pitch_then_roll():
    assert np.allclose(rotation(0.3, -0.1, 0.2), rot_z(-0.1) @ rot_x(0.2) @ rot_y(0.3), atol=1e-15)


def test_the_rotation_derivatives_agree_with_finite_differences():
    angles = np.array([0.3, -0.1, 0.2])
    assert np.allclose(difference(lambda a: rotation(*a), angles), rotation_derivatives(*angles), atol=1e-9)


@pytest.mark.parametrize("redescending", [False, True])
def test_the_gradient_agrees_with_finite_differences_of_the_cost(redescending):
    # Away from the minimum, so that every weight, slope and prior takes part.
    views, pair = views_of(noise=0.005)
    at = np.array([pair.yaw + 0.01, *(pair.t + 0.03), *PARAMETERS[4:]])

    def cost(p):
        return normal_equations(p, views, redescending, True, np.zeros((8, 8)), np.zeros(8))

    b = np.zeros(8)
    normal_equations(at, views, redescending, True, np.zeros((8, 8)), b)
    numeric = 0.5 * difference(cost, at, 1e-5)
    # Four Newton steps leave the best inverse depth a little short of its best.
    assert np.abs(numeric).min() > 0.1
    assert np.allclose(b, numeric, rtol=1e-2, atol=1e-3 * np.abs(numeric).max())


def test_the_normal_matrix_is_half_the_second_derivative_at_a_perfect_fit():
    # No noise and true parameters: residuals vanish, so the Gauss-Newton matrix is the exact Hessian.
    planar = make_pair("planar", 40, np.random.default_rng(1), baseline=0.3, noise_px=0.0)
    views = two_views(planar.m_ref, planar.m_cur, 0.02, 1e-3)
    truth = np.array([planar.yaw, *planar.t, 0.0, 0.0, 0.0, 0.0])
    truth[4:6] = np.linalg.lstsq(
        np.column_stack([np.ones(40), planar.m_ref - views.centre]),
        1.0 / planar.depth / np.mean(1.0 / planar.depth),
        rcond=None,
    )[0][1:]
    A = np.zeros((8, 8))
    normal_equations(truth, views, False, False, A, np.zeros(8))

    def gradient(p):
        b = np.zeros(8)
        normal_equations(p, views, False, False, np.zeros((8, 8)), b)
        return b

    assert np.allclose(A, difference(gradient, truth), rtol=1e-3, atol=1e-3 * np.abs(A).max())


def test_the_loss_has_its_weight_as_derivative_and_lets_go_of_outliers():
    for redescending in (False, True):
        for chi2 in (0.0, 1.0, 7.0, 300.0):
            _, weight = robust_loss(chi2, redescending)
            numeric = (
                robust_loss(chi2 + 1e-6, redescending)[0]
                - robust_loss(max(chi2 - 1e-6, 0.0), redescending)[0]
            )
            assert weight == pytest.approx(numeric / (2e-6 if chi2 else 1e-6), rel=1e-4)
    assert robust_loss(1e9, True)[0] < 2.4**2 + 1e-3
    assert robust_loss(1e9, False)[0] > 50.0


def test_the_absorbed_share_has_its_gradient_and_stays_between_zero_and_one():
    views, _ = views_of()
    p = PARAMETERS * [1, 0.02, 0.02, 0.02, 1, 1, 1, 1]
    b = np.zeros(8)
    add_absorbed(p, views, 3, np.zeros((8, 8)), b)
    numeric = difference(lambda q: add_absorbed(q, views, 3, np.zeros((8, 8)), np.zeros(8)), p, 1e-8)
    assert np.allclose(b, 0.5 * numeric, rtol=1e-5, atol=1e-6 * np.abs(b).max())
    assert absorbed(0.0, 0.0, 0.0, 0.1, 0.2, 1e-3, 0.5)[0] == 0.0
    assert 0.99 < absorbed(0.3, 0.0, 0.0, 0.1, 0.2, 1e-3, 0.5)[0] < 1.0


def test_the_mahalanobis_distance_equals_the_one_of_the_whole_covariance():
    e, g, noise, spread = np.array([0.01, -0.02]), np.array([0.3, 0.1]), 0.004, 0.5
    C = noise**2 * np.eye(2) + spread**2 * np.outer(g, g)
    chi2, k = mahalanobis(*e, *g, noise, spread)
    assert chi2 == pytest.approx(e @ np.linalg.solve(C, e))
    assert np.allclose(np.linalg.inv(C), (np.eye(2) - k * np.outer(g, g)) / noise**2)


def test_no_inverse_depth_near_the_best_one_costs_less():
    q, t, seen = (0.2, -0.1, 1.05), (0.2, 0.05, 0.1), (0.36, -0.02)

    def cost(rho):
        u, v, _ = project(*q, *t, rho)
        return ((u - seen[0]) ** 2 + (v - seen[1]) ** 2) / 1e-4 + (rho - 1.0) ** 2 / 0.25

    best = best_inverse_depth(*q, *t, *seen, 1.0, 1e-2, 0.5)
    assert all(cost(best) <= cost(best + step) for step in (-0.1, -1e-3, 1e-3, 0.1))


def test_the_linearised_distance_equals_the_least_cost_over_inverse_depth():
    views, pair = views_of(noise=0.003)
    p = np.array([pair.yaw, *pair.t, 0.0, 0.0, 0.0, 0.0])
    chi2, rho, _ = describe(p, views)
    x = np.column_stack([pair.m_ref, np.ones(30)]) @ rot_y(pair.yaw).T + rho[:, None] * pair.t
    r = x[:, :2] / x[:, 2:] - pair.m_cur
    least = (r**2).sum(axis=1) / views.noise**2 + (rho - 1.0) ** 2 / views.spread**2
    assert np.allclose(chi2, least, rtol=1e-3, atol=1e-3)


def test_the_inverse_and_the_factor_agree_with_the_matrix():
    X = np.random.default_rng(0).normal(size=(8, 8))
    A = X @ X.T + np.eye(8)
    L = np.zeros((8, 8))
    assert cholesky(A, 6, 0.0, L)
    assert np.allclose((L @ L.T)[:6, :6], A[:6, :6])
    assert np.allclose(inverse(A, 6)[:6, :6], np.linalg.inv(A[:6, :6]))
    assert not cholesky(-A, 6, 0.0, L)


def test_the_minimum_has_no_slope_left_and_costs_no_more_than_the_truth():
    views, pair = views_of(60)
    p = np.array([pair.yaw + 0.02, *(pair.t + 0.02), 0.0, 0.0, 0.0, 0.0])
    cost = minimise(p, views, False, 30, FINE)
    A, b = np.zeros((8, 8)), np.zeros(8)
    normal_equations(p, views, False, True, A, b)
    assert b @ np.linalg.solve(A, b) < 10 * FINE
    truth = np.array([pair.yaw, *pair.t, 0.0, 0.0, 0.0, 0.0])
    minimise(truth, views, False, 30, FINE)
    assert cost == pytest.approx(normal_equations(truth, views, False, True, A, b), abs=0.05)


@pytest.mark.parametrize("sd", [2e-4, 8e-4, 3e-3])
@pytest.mark.parametrize("outliers", [0.0, 0.5])
def test_the_noise_is_read_from_residuals_that_hold_outliers(sd, outliers):
    rng = np.random.default_rng(2)
    estimates = []
    for _ in range(20):
        across = rng.normal(0, sd, 100)
        bad = rng.random(100) < outliers
        across[bad] = rng.uniform(-0.15, 0.15, bad.sum())
        estimates.append(estimate_noise(across, 1e-3, 0.0, 30))
    assert np.median(estimates) == pytest.approx(sd, rel=0.25)
