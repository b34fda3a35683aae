"""The parts of `upright` between the points and the answer, and of the other two methods."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from vision_homography_scenes import angle_deg, make_pair

from noctule.geometry import rot_y
from noctule.vision.homography import HomographyEstimate, NoHomographyError, estimate_upright, refine_upright
from noctule.vision.homography.generic import epipolar_distance, homogeneous, virtual_plane_homography
from noctule.vision.homography.planar import (
    direct_linear_transform,
    hartley,
    robust_inliers,
    transfer_distance,
)
from noctule.vision.homography.result import scaled_homography
from noctule.vision.homography.upright import approach, held, two_views, with_noise
from noctule.vision.homography.upright_answers import distinct, nearest_first, still_open
from noctule.vision.homography.upright_cost import describe
from noctule.vision.homography.upright_model import rotation
from noctule.vision.homography.upright_report import chi2_of, estimate_at
from noctule.vision.homography.upright_start import (
    cold_starts,
    determinant,
    distinct_best,
    epipolar_row,
    fill_rows,
    null_direction,
    sample_candidates,
    sampson_score,
    sized_start,
)


def exact_pair(seed=0, n=40, kind="cloud", **arguments):
    return make_pair(kind, n, np.random.default_rng(seed), **{"baseline": 0.5, "noise_px": 0.0, **arguments})


def minimum(cost, yaw, t=(0.1, 0.0, 0.0)):
    return cost, np.array([yaw, *t, 0.0, 0.0, 0.0, 0.0])


# ---- scaling


@given(st.integers(0, 1000), st.floats(-5.0, 5.0).filter(lambda k: abs(k) > 1e-3))
@settings(deadline=None, max_examples=40)
def test_the_scaled_homography_does_not_depend_on_the_scale_or_sign_it_came_with(seed, factor):
    pair = exact_pair(seed % 7, kind="planar")
    H = rot_y(pair.yaw) + np.outer(pair.t, [0.0, 0.0, 1.0])
    scaled = scaled_homography(factor * H, pair.m_ref, pair.m_cur)
    assert np.allclose(scaled, scaled_homography(H, pair.m_ref, pair.m_cur), atol=1e-12)
    assert np.linalg.svd(scaled, compute_uv=False)[1] == pytest.approx(1.0)
    assert np.linalg.det(scaled) > 0.0


# ---- start


def test_an_epipolar_row_is_the_cross_product_of_the_turned_point_and_the_bearing():
    row = np.zeros(3)
    epipolar_row(0.2, -0.1, 0.3, 0.4, 1.1, np.cos(0.3), np.sin(0.3), row)
    assert np.allclose(row, np.cross(rot_y(0.3) @ [0.2, -0.1, 1.0], [0.3, 0.4, 1.1]))


def test_the_determinant_of_three_points_vanishes_at_the_true_yaw_and_t_is_its_null_vector():
    pair = exact_pair()
    rows, d = np.zeros((3, 3)), np.zeros(3)
    triple = np.array([0, 7, 21])
    value = fill_rows(pair.m_ref, homogeneous(pair.m_cur)[triple], triple, pair.yaw, rows)
    assert abs(value) < 1e-12
    assert value == pytest.approx(np.linalg.det(rows), abs=1e-15)
    assert null_direction(rows, d)
    assert min(angle_deg(d, pair.t), angle_deg(-d, pair.t)) < 1e-3
    assert abs(fill_rows(pair.m_ref, homogeneous(pair.m_cur)[triple], triple, pair.yaw + 0.1, rows)) > 1e-9


def test_the_determinant_agrees_with_numpy():
    rows = np.random.default_rng(0).normal(size=(3, 3))
    assert determinant(rows) == pytest.approx(np.linalg.det(rows))


def test_rows_without_a_direction_are_refused():
    assert not null_direction(np.zeros((3, 3)), np.zeros(3))


def test_the_sampson_score_counts_outliers_and_nothing_else():
    pair = exact_pair(n=50, outliers=0.2)
    score = sampson_score(rot_y(pair.yaw), pair.t / np.linalg.norm(pair.t), pair.m_ref, pair.m_cur, 1e-3)
    assert 7.0 <= score <= 10.0  # one or two of ten may fall on their line


def test_a_draw_of_three_good_points_holds_the_truth():
    pair = exact_pair()
    found, scores = sample_candidates(pair.m_ref, pair.m_cur, np.array([[1, 11, 30]]), np.zeros((1, 2)), 1e-3)
    best = found[np.argmin(scores)]
    assert best[0] == pytest.approx(pair.yaw, abs=1e-3)
    assert min(angle_deg(best[1:4], pair.t), angle_deg(-best[1:4], pair.t)) < 0.5


def test_the_best_candidates_differ_from_each_other():
    found = np.array(
        [[0.0, 1, 0, 0, 0, 0], [0.001, -1, 0, 0, 0, 0], [0.5, 1, 0, 0, 0, 0], [0.0, 0, 1, 0, 0, 0]]
    )
    kept = distinct_best(found, np.array([2.0, 1.0, 3.0, 4.0]), 4, 0.02, 0.98)
    assert kept.tolist() == [1, 2, 3]
    assert distinct_best(found, np.array([2.0, 1.0, 3.0, 4.0]), 2, 0.02, 0.98).tolist() == [1, 2]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_size_and_sign_of_a_start_come_from_the_points(sign):
    pair, out = exact_pair(n=60), np.zeros(8)
    candidate = np.array([pair.yaw, *(sign * pair.t / np.linalg.norm(pair.t)), 0.0, 0.0])
    sized_start(candidate, pair.m_ref, pair.m_cur, 1e-3, out)
    assert angle_deg(out[1:4], pair.t) < 1e-3
    assert np.linalg.norm(out[1:4]) == pytest.approx(np.linalg.norm(pair.t), rel=0.4)


def test_the_cold_starts_hold_one_near_the_truth_despite_half_of_outliers():
    for seed in range(10):
        pair = exact_pair(seed, n=60, noise_px=0.3, outliers=0.5)
        views = two_views(pair.m_ref, pair.m_cur, 0.0, 1e-3)
        starts = cold_starts(views, 0.0, 0)
        assert min(abs(s[0] - pair.yaw) + np.linalg.norm(s[1:4] - pair.t) for s in starts) < 0.15


def test_another_seed_draws_other_starts_and_the_same_seed_the_same():
    pair = exact_pair(n=60, noise_px=0.3)
    views = two_views(pair.m_ref, pair.m_cur, 0.0, 1e-3)
    a, b, c = (cold_starts(views, 0.0, seed) for seed in (0, 0, 1))
    assert np.array_equal(a, b)
    assert not np.array_equal(a[0], c[0])


# ---- answers


def test_minima_that_repeat_a_better_one_are_dropped_and_the_best_comes_first():
    kept = distinct([minimum(5.0, 0.2), minimum(3.0, 0.1), minimum(3.1, 0.1001)])
    assert [cost for cost, _ in kept] == [3.0, 5.0]


def test_answers_that_explain_the_points_alike_are_ordered_by_nearness_to_the_start():
    start = replace(estimate_of(), parameters=minimum(0.0, 0.21)[1])
    minima = [minimum(3.0, 0.1), minimum(5.0, 0.2), minimum(50.0, 0.21)]
    assert [cost for cost, _ in nearest_first(minima, start)] == [5.0, 3.0]
    assert [cost for cost, _ in nearest_first(minima, None)] == [3.0, 5.0]


def test_the_followed_answer_stays_until_another_is_clearly_better():
    assert [cost for cost, _ in still_open([minimum(6.0, 0.1), minimum(3.0, 0.3)])] == [6.0, 3.0]
    assert [cost for cost, _ in still_open([minimum(8.0, 0.1), minimum(3.0, 0.3)])] == [3.0, 8.0]


def test_an_alternative_that_is_clearly_worse_or_has_merged_is_dropped():
    assert [cost for cost, _ in still_open([minimum(3.0, 0.1), minimum(30.0, 0.3)])] == [3.0]
    assert [cost for cost, _ in still_open([minimum(3.0, 0.1), minimum(3.1, 0.1)])] == [3.0]


def estimate_of():
    return HomographyEstimate(np.eye(3), "upright", 1.0, np.ones(8, dtype=np.bool_))


def test_a_start_of_another_method_is_not_followed():
    pair = exact_pair(noise_px=0.3)
    start = replace(estimate_of(), method="planar")
    warm = refine_upright(pair.m_ref, pair.m_cur, start)
    assert warm.cost == estimate_upright(pair.m_ref, pair.m_cur).cost


# ---- warm start


def test_roll_and_pitch_of_a_start_are_dropped_where_they_are_held():
    pair = exact_pair(noise_px=0.3)
    views = two_views(pair.m_ref, pair.m_cur, 0.0, 1e-3)
    parameters = np.arange(8.0)
    assert held(parameters, views).tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 0.0, 0.0]
    assert parameters[7] == 7.0


def test_the_approach_comes_from_far_off():
    pair = exact_pair(n=60, noise_px=0.3)
    views = two_views(pair.m_ref, pair.m_cur, 0.0, 1e-3)
    parameters = np.array([pair.yaw + 0.05, *(pair.t + 0.05), 0.0, 0.0, 0.0, 0.0])
    approach(parameters, views)
    assert angle_deg(parameters[1:4], pair.t) < 2.0


def test_the_noise_of_the_points_is_found_at_the_minimum():
    pair = exact_pair(n=150, noise_px=1.0)
    r = estimate_upright(pair.m_ref, pair.m_cur)
    assert r.noise == pytest.approx(np.sqrt(2.0) / 510.0, rel=0.2)
    views = with_noise(two_views(pair.m_ref, pair.m_cur, 0.0, 1e-3), r.parameters, 15)
    assert views.noise == pytest.approx(r.noise, rel=0.05)


def test_a_known_noise_is_kept():
    pair = exact_pair(noise_px=1.0)
    assert estimate_upright(pair.m_ref, pair.m_cur, noise=2e-3).noise == 2e-3


# ---- report


def test_the_statistic_is_the_quadratic_form_and_zero_without_an_inverse():
    X = np.random.default_rng(0).normal(size=(4, 4))
    covariance, t = X @ X.T, np.array([0.1, -0.2, 0.3])
    assert chi2_of(covariance, t) == pytest.approx(t @ np.linalg.solve(covariance[1:, 1:], t))
    assert chi2_of(np.full((4, 4), np.nan), t) == 0.0


def test_t_is_in_harmonic_mean_depths_of_the_inliers():
    pair = exact_pair(n=60, kind="room")
    r = estimate_upright(pair.m_ref, pair.m_cur)
    metric = pair.t / np.mean(1.0 / pair.depth)
    assert np.allclose(r.t, metric * np.mean(1.0 / pair.depth[r.inliers]), rtol=0.02, atol=1e-3)


def test_more_noise_gives_a_larger_covariance_and_the_covariance_is_one():
    pair = exact_pair(n=60, noise_px=0.3)
    small, large = (
        estimate_upright(pair.m_ref, pair.m_cur, noise=noise).covariance for noise in (5e-4, 2e-3)
    )
    assert np.allclose(small, small.T)
    assert np.all(np.linalg.eigvalsh(small) > 0.0)
    assert large[0, 0] > 4.0 * small[0, 0]
    assert np.linalg.det(large) > 16.0 * np.linalg.det(small)


def test_the_report_describes_the_parameters_it_is_given():
    pair = exact_pair(n=60)
    views = two_views(pair.m_ref, pair.m_cur, 0.01, 1e-3)
    parameters = np.array([pair.yaw, *pair.t, 0.3, 0.4, 0.01, 0.02])
    r = estimate_at(views, (12.0, parameters), "why")
    assert (r.roll, r.pitch, r.cost, r.note) == (0.01, 0.02, 12.0, "why")
    assert r.yaw == pytest.approx(pair.yaw)
    assert r.slopes.tolist() == [0.3, 0.4]
    assert angle_deg(r.t, parameters[1:4]) < 1e-3
    assert np.array_equal(r.inliers, describe(parameters, views)[0] < 11.8)
    assert np.linalg.det(rotation(r.yaw, r.roll, r.pitch)) == pytest.approx(1.0)


# ---- planar and generic


def test_hartleys_similarity_puts_the_points_around_zero_at_distance_sqrt_two():
    m = np.random.default_rng(0).uniform(2.0, 5.0, (30, 2))
    moved = (homogeneous(m) @ hartley(m).T)[:, :2]
    assert np.allclose(moved.mean(axis=0), 0.0, atol=1e-12)
    assert np.mean(np.linalg.norm(moved, axis=1)) == pytest.approx(np.sqrt(2.0))


def test_a_point_behind_the_camera_is_infinitely_far_from_its_match():
    H = np.diag([1.0, 1.0, -1.0])
    assert transfer_distance(H, np.zeros((1, 2)), np.zeros((1, 2))).tolist() == [np.inf]


def test_collinear_points_carry_no_homography():
    m = np.outer(np.linspace(0, 1, 9), [1.0, 2.0])
    with pytest.raises(NoHomographyError):
        direct_linear_transform(m, m)


def test_the_robust_search_is_the_same_every_time():
    pair = exact_pair(kind="planar", n=80, noise_px=0.3, outliers=0.4)
    a, b = (robust_inliers(pair.m_ref, pair.m_cur, 4e-3) for _ in range(2))
    assert np.array_equal(a, b)
    assert np.mean(a[pair.good]) > 0.95


def test_the_epipolar_distance_of_exact_points_is_zero_and_of_moved_ones_is_not():
    pair = exact_pair()
    H = virtual_plane_homography(pair.m_ref, pair.m_cur, np.array([0, 5, 9]), 0)
    assert H is not None
    assert epipolar_distance(H, pair.m_ref, pair.m_cur).max() < 1e-6
    moved = pair.m_cur.copy()
    moved[3, 1] += 0.01
    assert epipolar_distance(H, pair.m_ref, moved)[3] > 1e-3


def test_three_points_on_a_line_give_no_virtual_plane():
    pair = exact_pair()
    m = pair.m_ref.copy()
    m[2] = 0.5 * (m[0] + m[1])
    assert virtual_plane_homography(m, pair.m_cur, np.array([0, 1, 2]), 0) is None
