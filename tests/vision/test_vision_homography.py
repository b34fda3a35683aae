"""One call, three methods: contract, errors, `planar`, `generic`, the law's sign, real pictures."""

import cv2
import numpy as np
import pytest
from skimage import data
from vision_homography_scenes import angle_deg, make_pair

from noctule.geometry import rot_x, rot_y, rot_z, skew
from noctule.vision.homography import (
    METHODS,
    EstimatorValueError,
    NoHomographyError,
    NonFinitePointsError,
    PointShapeError,
    TooFewPointsError,
    UnknownMethodError,
    estimate_homography,
)
from noctule.vision.homography.generic import diagonal_ratios, monomial_rows, point_triples
from noctule.vision.homography.planar import direct_linear_transform, transfer_distance
from noctule.vision.triangle import largest_triangle


def scene(kind="cloud", n=40, seed=0, **arguments):
    return make_pair(kind, n, np.random.default_rng(seed), **{"baseline": 0.5, **arguments})


def triangle_homography(pair):
    """Return the true homography of the plane through the largest triangle."""
    k = largest_triangle(pair.m_ref)
    X = np.column_stack([pair.m_ref[k], np.ones(3)]) * pair.depth[k, None]
    t = pair.t / np.mean(1.0 / pair.depth[pair.good])
    H = rot_y(pair.yaw) + np.outer(t, np.linalg.solve(X, np.ones(3)))
    return H / np.linalg.svd(H, compute_uv=False)[1]


@pytest.mark.parametrize("method", sorted(METHODS))
@pytest.mark.parametrize("kind", ["planar", "cloud"])
def test_every_method_keeps_the_contract(method, kind):
    pair = scene(kind, 60)
    r = estimate_homography(pair.m_ref, pair.m_cur, method, noise=1e-3)
    assert np.linalg.svd(r.H, compute_uv=False)[1] == pytest.approx(1.0)
    in_front = np.column_stack([pair.m_ref, np.ones(60)]) @ r.H.T
    assert np.median(in_front[:, 2]) > 0.0
    assert 0.0 <= r.quality <= 1.0
    assert r.inliers.shape == (60,)
    assert r.inliers.dtype == np.bool_
    again = estimate_homography(pair.m_ref, pair.m_cur, method, noise=1e-3)
    assert np.array_equal(r.H, again.H)


def test_upright_is_the_default():
    pair = scene()
    assert estimate_homography(pair.m_ref, pair.m_cur).method == "upright"


def test_the_direct_linear_transform_finds_an_exact_homography():
    H = rot_x(0.1) @ rot_z(-0.2) + np.outer([0.3, -0.1, 0.2], [0.1, 0.2, 0.9])
    m = np.random.default_rng(0).uniform(-0.5, 0.5, (12, 2))
    y = np.column_stack([m, np.ones(12)]) @ H.T
    found = direct_linear_transform(m, y[:, :2] / y[:, 2:])
    assert np.allclose(found / found[2, 2], H / H[2, 2], atol=1e-9)
    assert np.all(transfer_distance(found * np.sign(found[2, 2]), m, y[:, :2] / y[:, 2:]) < 1e-9)


@pytest.mark.parametrize("n", [4, 8, 100])
def test_planar_finds_the_plane(n):
    pair = scene("planar", n, noise_px=0.0)
    assert estimate_homography(pair.m_ref, pair.m_cur, "planar").H == pytest.approx(
        triangle_homography(pair), abs=1e-6
    )


def test_planar_leaves_outliers_out():
    pair = scene("planar", 80, outliers=0.3)
    r = estimate_homography(pair.m_ref, pair.m_cur, "planar", noise=1e-3)
    assert np.mean(r.inliers[pair.good]) > 0.95
    assert np.mean(r.inliers[~pair.good]) < 0.1
    assert np.abs(r.H - triangle_homography(pair)).max() < 0.03


def test_the_polynomial_of_generic_vanishes_at_the_true_diagonal_and_gives_it_back():
    h, rng = np.array([0.8, 1.3, 1.0]), np.random.default_rng(1)
    x_ref, epipole = rng.normal(size=(9, 3)), rng.normal(size=3)
    x_cur = x_ref * h + rng.normal(size=(9, 1)) * epipole
    u, v, w = h
    monomials = np.array([u * u * v, u * v * v, u * u * w, v * v * w, u * w * w, v * w * w, u * v * w])
    rows = monomial_rows(x_ref, x_cur, point_triples(9, 0))
    assert np.abs(rows @ monomials).max() < 1e-10 * np.abs(rows).max()
    assert diagonal_ratios(-monomials) == pytest.approx((0.8, 1.3))


def test_the_polynomial_agrees_with_the_determinant_of_the_lines_anywhere():
    rng = np.random.default_rng(2)
    x_ref, x_cur, (u, v, w) = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.normal(size=3)
    monomials = np.array([u * u * v, u * v * v, u * u * w, v * v * w, u * w * w, v * w * w, u * v * w])
    row = monomial_rows(x_ref, x_cur, np.array([[0, 1, 2]]))[0]
    assert row @ monomials == pytest.approx(np.linalg.det(np.cross(x_cur, x_ref * [u, v, w])))


@pytest.mark.parametrize(("noise_px", "bound"), [(0.0, 1e-6), (0.35, 0.05)])
def test_generic_finds_the_plane_of_the_largest_triangle_without_any_plane_in_the_scene(noise_px, bound):
    errors = []
    for seed in range(20):
        pair = scene(noise_px=noise_px, seed=seed)
        r = estimate_homography(pair.m_ref, pair.m_cur, "generic")
        assert r.method == "generic"
        H = triangle_homography(pair)
        errors.append(np.linalg.norm(r.H - H) / np.linalg.norm(H - np.eye(3)))
    assert np.median(errors) < bound


@pytest.mark.parametrize(
    ("arguments", "note"),
    [
        ({"kind": "planar", "noise_px": 0.0}, "one plane, or a turn alone, explains the points"),
        ({"kind": "planar"}, "one plane, or a turn alone, explains the points"),
        ({"baseline": 0.0}, "one plane, or a turn alone, explains the points"),
        ({"baseline": 0.005}, "one plane, or a turn alone, explains the points"),
        ({"n": 7}, "7 points, generic needs 8"),
    ],
)
def test_generic_falls_back_to_planar_in_the_open(arguments, note):
    pair = scene(**arguments)
    r = estimate_homography(pair.m_ref, pair.m_cur, "generic")
    assert r.method == "planar"
    assert r.note == note + "; planar was used instead of generic"


def test_planar_says_when_no_plane_was_found():
    m_ref, m_cur = np.random.default_rng(0).uniform(-0.5, 0.5, (2, 40, 2))
    r = estimate_homography(m_ref, m_cur, "planar", noise=1e-8)
    assert r.note == "no plane holds enough of the points; least squares over all of them"
    assert r.quality < 0.1


@pytest.mark.parametrize(
    ("error", "arguments", "text"),
    [
        (
            TooFewPointsError,
            {"m_ref": np.zeros((4, 2)), "m_current": np.zeros((4, 2))},
            "homography 'upright': 4 matched points, at least 5 are needed; "
            "match more features or choose another method",
        ),
        (
            PointShapeError,
            {"m_ref": np.zeros((9, 2)), "m_current": np.zeros((8, 2))},
            "homography 'upright': m_ref has shape (9, 2) and m_current (8, 2), "
            "expected (n, 2) twice; pass matched points in rows",
        ),
        (
            NonFinitePointsError,
            {"m_ref": np.zeros((9, 2)), "m_current": np.full((9, 2), np.nan)},
            "homography 'upright': 9 of 9 points in m_current are not finite, "
            "expected numbers; drop lost points first",
        ),
        (
            UnknownMethodError,
            {"m_ref": np.zeros((9, 2)), "m_current": np.zeros((9, 2)), "method": "affine"},
            "homography: unknown method 'affine', expected one of generic, planar, upright; correct the name",
        ),
        (
            EstimatorValueError,
            {"m_ref": np.zeros((9, 2)), "m_current": np.zeros((9, 2)), "attitude_sd": -1.0},
            "homography 'upright': attitude_sd is -1.0 rad, expected 0 (roll and pitch are exact) to 0.5; "
            "give the standard deviation in radians",
        ),
        (
            EstimatorValueError,
            {"m_ref": np.zeros((9, 2)), "m_current": np.zeros((9, 2)), "noise": 1.0},
            "homography 'upright': noise is 1.0, expected above 0 and below 0.1 in normalised units; "
            "divide pixels by the focal length",
        ),
        (
            NoHomographyError,
            {"m_ref": np.zeros((9, 2)), "m_current": np.zeros((9, 2)), "method": "planar"},
            "homography 'planar': the 9 points coincide or lie on one line, "
            "expected points that are spread over a surface; match other features",
        ),
    ],
)
def test_a_mistake_is_refused_in_one_line(error, arguments, text):
    with pytest.raises(error) as raised:
        estimate_homography(**arguments)
    assert str(raised.value) == text


@pytest.mark.parametrize("attitude_sd", [0.0, 0.01])
@pytest.mark.parametrize("points", ["same", "line", "far"])
def test_upright_survives_degenerate_points_and_defines_no_direction(points, attitude_sd):
    rng = np.random.default_rng(0)
    m = np.zeros((12, 2)) if points == "same" else np.outer(np.linspace(-0.4, 0.4, 12), [1.0, 0.0])
    other = rng.uniform(-0.4, 0.4, (12, 2)) if points == "far" else m
    r = estimate_homography(m, other, "upright", attitude_sd)
    assert np.isfinite(r.H).all()
    assert points == "far" or not r.t_defined
    assert points != "far" or r.quality < 0.7


def servo(sign, method, kind):
    """Return |e| at the start and at the end of a free camera under nu_c = sign * Lambda e."""
    rng = np.random.default_rng(6)
    X = np.column_stack([rng.uniform(-0.6, 0.6, (60, 2)), np.ones(60)]) * (
        3.0 if kind == "planar" else rng.uniform(2.0, 4.0, (60, 1))
    )
    R, c = rot_y(0.12), np.array([0.25, -0.1, -0.3])  # camera: X_cur = R (X - c)
    m_ref = X[:, :2] / X[:, 2:]
    m_star = np.array([0.0, 0.0, 1.0])
    sizes = []
    for _ in range(60):
        Y = (X - c) @ R.T
        if Y[:, 2].min() < 0.3:
            break
        H = estimate_homography(m_ref, Y[:, :2] / Y[:, 2:], method, noise=1e-4).H
        A = H - H.T
        e = np.concatenate([(H - np.eye(3)) @ m_star, [A[2, 1], A[0, 2], A[1, 0]]])
        sizes.append(np.linalg.norm(e))
        velocity = 0.3 * sign * e
        if method == "upright":  # a drone's camera only turns in yaw
            velocity[[3, 5]] = 0.0
        c = c + R.T @ velocity[:3]
        R = cv2.Rodrigues(-velocity[3:])[0] @ R
    return sizes[0], sizes[-1]


@pytest.mark.parametrize(("method", "kind"), [("planar", "planar"), ("upright", "cloud")])
def test_the_closed_loop_converges_with_plus_and_diverges_with_minus(method, kind):
    first, last = servo(+1.0, method, kind)
    assert last < 0.05 * first
    first, last = servo(-1.0, method, kind)
    assert last > 2.0 * first


def test_the_interaction_matrix_at_zero_error_is_the_derivative_of_the_error():
    # e as a function of a small twist, for a plane n'X = 1: L0 = [[-(n.m*) I, [m*]x], [-[n]x, -2 I]].
    n, m = np.array([0.05, -0.1, 0.4]), np.array([0.1, 0.2, 1.0])
    L0 = np.block([[-(n @ m) * np.eye(3), skew(m)], [-skew(n), -2.0 * np.eye(3)]])
    numeric = np.zeros((6, 6))
    for k in range(6):
        twist = np.zeros(6)
        twist[k] = 1e-6
        R = cv2.Rodrigues(-twist[3:])[0]
        H = R - np.outer(R @ twist[:3], n)
        A = H - H.T
        numeric[:, k] = np.concatenate([(H - np.eye(3)) @ m, [A[2, 1], A[0, 2], A[1, 0]]]) / 1e-6
    assert np.allclose(numeric, L0, atol=1e-5)


@pytest.fixture(scope="module")
def motorcycle():
    """SIFT matches of the stereo pair that scikit-image ships; each side has its own principal point."""
    left, right, _ = data.stereo_motorcycle()
    sift = cv2.SIFT_create()
    k1, d1 = sift.detectAndCompute(cv2.cvtColor(left, cv2.COLOR_RGB2GRAY), None)
    k2, d2 = sift.detectAndCompute(cv2.cvtColor(right, cv2.COLOR_RGB2GRAY), None)
    matches = [a for a, b in cv2.BFMatcher().knnMatch(d1, d2, k=2) if a.distance < 0.7 * b.distance]
    p1 = np.array([k1[m.queryIdx].pt for m in matches])
    p2 = np.array([k2[m.trainIdx].pt for m in matches])
    return (p1 - [311.193, 254.877]) / 994.978, (p2 - [342.279, 254.877]) / 994.978


@pytest.mark.parametrize(
    ("attitude_sd", "median", "bound", "yaw_bound"), [(0.0, 0.35, 0.8, 0.15), (0.0087, 0.5, 1.3, 0.2)]
)
def test_the_real_stereo_pair_moved_sideways_and_did_not_turn(
    motorcycle, attitude_sd, median, bound, yaw_bound
):
    a, b = motorcycle
    rng = np.random.default_rng(0)
    direction, yaw = [], []
    for _ in range(40):
        pick = rng.choice(len(a), 60, replace=False)
        r = estimate_homography(a[pick], b[pick], "upright", attitude_sd)
        direction.append(angle_deg(r.t, np.array([-1.0, 0.0, 0.0])))
        yaw.append(abs(np.degrees(r.yaw)))
    assert np.median(direction) < median
    assert np.percentile(direction, 95) < bound
    assert np.percentile(yaw, 95) < yaw_bound
