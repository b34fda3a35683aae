"""Yaw and direction of `upright` over many synthetic views, with fewer trials than the benchmark."""

import numpy as np
import pytest
from vision_homography_scenes import angle_deg, make_pair

from noctule.geometry import rot_x, rot_y, rot_z
from noctule.vision.homography import estimate_homography, estimate_upright, refine_upright

DEGREE = np.radians(1.0)


def errors(kind, trials=60, n=80, attitude_sd=0.0, seed=11, **scene):
    """Return yaw errors [deg], direction errors [deg], |t| over the true |t|, and the estimates."""
    rng = np.random.default_rng(seed)
    yaw, direction, size, estimates = [], [], [], []
    for _ in range(trials):
        pair = make_pair(kind, n, rng, **scene)
        r = estimate_homography(pair.m_ref, pair.m_cur, "upright", attitude_sd)
        estimates.append((r, pair))
        yaw.append(abs(np.degrees(r.yaw - pair.yaw)))
        if scene["baseline"] > 0:
            direction.append(angle_deg(r.t, pair.t))
            size.append(np.linalg.norm(r.t) / np.linalg.norm(pair.t))
    return np.array(yaw), np.array(direction), np.array(size), estimates


def p95(values):
    return np.percentile(values, 95)


@pytest.mark.parametrize(
    ("kind", "scene", "yaw_bound", "direction_bound"),
    [  # medians; the 95th percentile may be four times as large
        ("room", {"baseline": 0.17}, 0.04, 0.6),
        ("cloud", {"baseline": 0.17}, 0.04, 0.6),
        ("two", {"baseline": 0.17}, 0.04, 0.6),
        ("room", {"baseline": 1.5}, 0.05, 0.1),
        ("room", {"baseline": 1.5, "yaw_max": 30 * DEGREE}, 0.05, 0.1),
        ("planar", {"baseline": 0.3}, 0.05, 0.6),
        ("room", {"baseline": 0.3, "outliers": 0.3}, 0.06, 0.4),
        ("room", {"baseline": 0.3, "outliers": 0.5}, 0.08, 0.5),
        ("room", {"baseline": 0.17, "noise_px": 1.0}, 0.2, 2.0),
        ("room", {"baseline": 0.17, "noise_px": 0.1}, 0.02, 0.2),
        ("room", {"baseline": 0.3, "n": 8}, 0.2, 1.5),
        ("room", {"baseline": 0.3, "n": 200}, 0.04, 0.25),
    ],
)
def test_yaw_direction_and_size_are_found(kind, scene, yaw_bound, direction_bound):
    yaw, direction, size, _ = errors(kind, **scene)
    assert np.median(yaw) < yaw_bound
    assert p95(yaw) < 5 * yaw_bound
    assert np.median(direction) < direction_bound
    assert p95(direction) < 5 * direction_bound
    assert np.median(size) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("attitude", [0.5, 1.0, 2.0])
def test_a_free_attitude_takes_up_roll_and_pitch_that_a_held_one_turns_into_motion(attitude):
    scene = {"baseline": 0.3, "attitude": attitude * DEGREE, "trials": 40}
    _, held, _, _ = errors("room", **scene)
    yaw, free, _, estimates = errors("room", attitude_sd=attitude * DEGREE, **scene)
    assert np.median(free) < 0.5
    assert p95(free) < 1.5
    assert p95(yaw) < 0.2
    assert np.median(held) > 5 * np.median(free)
    assert np.median([abs(r.roll - pair.roll) for r, pair in estimates]) < 0.1 * DEGREE
    assert np.median([abs(r.pitch - pair.pitch) for r, pair in estimates]) < 0.1 * DEGREE


@pytest.mark.parametrize("attitude_sd", [0.0, DEGREE])
def test_a_view_that_only_turned_has_its_yaw_and_no_direction(attitude_sd):
    yaw, _, _, estimates = errors("room", baseline=0.0, attitude_sd=attitude_sd, attitude=attitude_sd)
    assert p95(yaw) < 0.04
    assert np.mean([r.t_defined for r, _ in estimates]) <= 0.05
    assert max(np.linalg.norm(r.t) for r, _ in estimates) < 0.01


def test_a_tiny_motion_invents_no_yaw():
    yaw, _, _, _ = errors("room", baseline=0.01)
    assert p95(yaw) < 0.3


def test_a_motion_of_a_few_hundredths_of_the_depth_is_defined():
    _, _, _, estimates = errors("room", baseline=0.17)
    assert all(r.t_defined for r, _ in estimates)


@pytest.mark.parametrize(
    "scene",
    [
        {"baseline": 0.17},
        {"baseline": 0.17, "noise_px": 0.1},
        {"baseline": 0.17, "noise_px": 1.0},
        {"baseline": 0.3, "n": 20},
        {"baseline": 0.3, "outliers": 0.3},
        {"baseline": 0.3, "attitude": DEGREE, "attitude_sd": DEGREE},
    ],
)
def test_the_covariance_is_honest(scene):
    _, _, _, estimates = errors("cloud", **scene)
    nees = []
    for r, pair in estimates:
        e = np.array([r.yaw - pair.yaw, *(r.t - pair.t)])
        nees.append(e @ np.linalg.solve(r.covariance, e))
    assert 1.5 < np.mean(nees) < 8.0


def test_outliers_are_told_from_inliers():
    rng = np.random.default_rng(0)
    for _ in range(10):
        pair = make_pair("room", 80, rng, baseline=0.3, outliers=0.3)
        inliers = estimate_upright(pair.m_ref, pair.m_cur).inliers
        assert np.mean(inliers[pair.good]) > 0.9
        # An outlier along its own epipolar line looks like a point at another depth.
        assert np.mean(inliers[~pair.good]) < 0.35


def test_quality_falls_with_outliers_and_stays_in_its_range():
    pairs = [
        make_pair("room", 80, np.random.default_rng(0), baseline=0.3, outliers=o) for o in (0.0, 0.3, 0.6)
    ]
    quality = [estimate_upright(p.m_ref, p.m_cur).quality for p in pairs]
    assert 1.0 >= quality[0] > quality[1] > quality[2] >= 0.0


def test_yaw_is_positive_when_the_camera_turned_left():
    x = np.column_stack([np.random.default_rng(0).uniform(-0.5, 0.5, (30, 2)), np.ones(30)]) * 3.0
    # Camera RDF: to turn left moves what was seen ahead to the right.
    y = x @ rot_y(0.2).T
    r = estimate_homography(x[:, :2] / x[:, 2:], y[:, :2] / y[:, 2:])
    assert y[:, 0].mean() > x[:, 0].mean()
    assert r.yaw == pytest.approx(0.2, abs=1e-4)


def test_the_homography_is_the_rotation_plus_t_on_the_plane_at_mean_depth():
    pair = make_pair("room", 60, np.random.default_rng(1), baseline=0.4)
    r = estimate_homography(pair.m_ref, pair.m_cur, "upright", 0.01)
    H = rot_z(r.roll) @ rot_x(r.pitch) @ rot_y(r.yaw) + np.outer(r.t, [0.0, 0.0, 1.0])
    assert np.allclose(r.H, H / np.linalg.svd(H, compute_uv=False)[1])
    assert np.linalg.svd(r.H, compute_uv=False)[1] == pytest.approx(1.0)


def test_the_same_points_give_the_same_estimate_bit_for_bit():
    pair = make_pair("room", 60, np.random.default_rng(1), baseline=0.4, outliers=0.2)
    a, b = (estimate_homography(pair.m_ref, pair.m_cur, "upright", 0.01) for _ in range(2))
    assert np.array_equal(a.H, b.H)
    assert np.array_equal(a.covariance, b.covariance)
    assert (a.yaw, a.cost, a.noise) == (b.yaw, b.cost, b.noise)


@pytest.mark.parametrize("attitude_sd", [0.0, DEGREE])
def test_a_warm_start_three_degrees_and_a_tenth_off_ends_where_the_cold_start_ends(attitude_sd):
    rng = np.random.default_rng(5)
    missed = 0
    for _ in range(50):
        pair = make_pair("room", 60, rng, baseline=0.3, attitude=attitude_sd)
        cold = estimate_upright(pair.m_ref, pair.m_cur, attitude_sd)
        before = cold.parameters.copy()
        before[0] += rng.choice([-1, 1]) * 3 * DEGREE
        before[1:4] += 0.1 * (v := rng.normal(size=3)) / np.linalg.norm(v)
        start = with_parameters(cold, before)
        warm = refine_upright(pair.m_ref, pair.m_cur, start, attitude_sd)
        missed += angle_deg(warm.t, cold.t) > 0.5
    assert missed <= 1


def test_a_hopeless_warm_start_is_dropped_in_the_open():
    pair = make_pair("room", 60, np.random.default_rng(1), baseline=0.4)
    cold = estimate_upright(pair.m_ref, pair.m_cur)
    start = with_parameters(cold, np.array([-1.3, 5.0, 5.0, -0.9, 0.0, 0.0, 0.0, 0.0]))
    warm = refine_upright(pair.m_ref, pair.m_cur, start)
    assert abs(warm.yaw - pair.yaw) < 0.2 * DEGREE
    assert warm.note == "the start explained too few points; started anew"


def planar_with_two_answers(attitude):
    """Return an exactly planar view whose second answer survives, its truth, and the cold estimate."""
    rng = np.random.default_rng(8)
    for _ in range(200):
        pair = make_pair("planar", 60, rng, baseline=0.3, attitude=attitude)
        cold = estimate_upright(pair.m_ref, pair.m_cur, attitude)
        if cold.alternatives and angle_deg(cold.t, cold.alternatives[0].t) > 10:
            return pair, cold
    raise AssertionError("no view with two answers")


def test_a_planar_view_with_a_free_attitude_keeps_its_second_answer():
    pair, cold = planar_with_two_answers(DEGREE)
    answers = [cold, *cold.alternatives]
    assert min(angle_deg(r.t, pair.t) for r in answers) < 5.0
    assert all(r.cost < cold.cost + 9.0 for r in answers)


def test_the_answer_near_the_previous_tick_is_followed():
    pair, cold = planar_with_two_answers(DEGREE)
    other = cold.alternatives[0]
    assert angle_deg(refine_upright(pair.m_ref, pair.m_cur, cold, DEGREE).t, cold.t) < 0.5
    assert angle_deg(refine_upright(pair.m_ref, pair.m_cur, other, DEGREE).t, other.t) < 0.5


def test_the_followed_answer_still_carries_the_other():
    pair, cold = planar_with_two_answers(DEGREE)
    warm = refine_upright(pair.m_ref, pair.m_cur, cold, DEGREE)
    assert len(warm.alternatives) == len(cold.alternatives)


def test_in_most_ambiguous_planar_views_one_of_the_answers_is_right():
    rng = np.random.default_rng(3)
    right = []
    for _ in range(60):
        pair = make_pair("planar", 80, rng, baseline=0.3, attitude=DEGREE)
        r = estimate_upright(pair.m_ref, pair.m_cur, DEGREE)
        right.append(min(angle_deg(x.t, pair.t) for x in (r, *r.alternatives)) < 6.0)
    assert np.mean(right) > 0.9


def with_parameters(estimate, parameters):
    """Return the estimate as a start at other parameters, without its alternatives."""
    from dataclasses import replace

    return replace(estimate, parameters=np.asarray(parameters), alternatives=())


def test_a_flight_of_warm_starts_with_a_jittering_attitude_stays_on_the_right_answer():
    rng = np.random.default_rng(9)
    m = rng.uniform(-0.5, 0.5, (60, 2))
    X = np.column_stack([m, np.ones(60)]) * rng.uniform(2.0, 5.0, (60, 1))
    v = np.array([0.4, -0.2, 0.8])
    m_ref, r, wrong = m + rng.normal(0, 6e-4, m.shape), None, 0
    for left in np.linspace(1.0, 0.2, 50):
        roll, pitch = rng.normal(0, DEGREE, 2)
        Y = X @ (rot_z(roll) @ rot_x(pitch) @ rot_y(0.15 * left)).T + left * v
        m_cur = Y[:, :2] / Y[:, 2:] + rng.normal(0, 6e-4, m.shape)
        r = estimate_homography(m_ref, m_cur, "upright", DEGREE, start=r)
        wrong += angle_deg(r.t, v) > 5.0
    assert wrong == 0
