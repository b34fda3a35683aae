"""`generic`: Malis and Chaumette 2000, the homography of a virtual plane through three of the points.

In the basis of the three points, m~ = M^-1 m with M = [p1 p2 p3], the homography of their plane is
diagonal, D = diag(h_u, h_v, h_w), and the line m~_cur x (D m~_ref) of every other point passes through the
epipole. So the determinant of any three such lines vanishes. It is a polynomial in D with seven monomials;
many triples give a linear system for them, whose null vector holds the ratios of D.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from noctule.geometry import Array, skew
from noctule.vision.homography.planar import THRESHOLD as PLANE_THRESHOLD
from noctule.vision.homography.planar import estimate_planar, robust_inliers
from noctule.vision.homography.result import (
    DEFAULT_NOISE,
    HomographyEstimate,
    checked_options,
    checked_points,
    scaled_homography,
)
from noctule.vision.triangle import TriangleError, largest_triangle

LEAST_POINTS = 8
MAX_TRIPLES = 4000
PLANE_SHARE = 0.9
"""Where one plane explains this share of the points, the virtual plane's equations are degenerate."""
AGREEING_SHARE = 0.5
"""Where fewer points agree with the epipolar geometry found, it is not believed."""
THRESHOLD = 4.0
"""Of an inlier, in standard deviations of the noise."""


def homogeneous(m: Array) -> Array:
    """Return m (n, 2) with a third coordinate of 1, (n, 3)."""
    return np.column_stack([m, np.ones(len(m))])


def point_triples(n: int, seed: int) -> NDArray[np.int64]:
    """Return all triples of n points (k, 3), or MAX_TRIPLES drawn from them where there are more."""
    if n * (n - 1) * (n - 2) // 6 <= MAX_TRIPLES:
        return np.array(list(combinations(range(n), 3)), dtype=np.int64)
    rng = np.random.default_rng(seed)
    return np.asarray(rng.random((MAX_TRIPLES, n)).argpartition(3, axis=1)[:, :3], dtype=np.int64)


def monomial_rows(x_ref: Array, x_cur: Array, triples: NDArray[np.int64]) -> Array:
    """Return the coefficients (k, 7) of the triples' determinants, for points (n, 3) in the triangle's basis.

    A point's line is (a h_w - b h_v, c h_u - d h_w, e h_v - f h_u) with a = v'w, b = w'v, c = w'u, d = u'w,
    e = u'v, f = v'u. The monomials are h_u^2 h_v, h_u h_v^2, h_u^2 h_w, h_v^2 h_w, h_u h_w^2, h_v h_w^2 and
    h_u h_v h_w.
    """
    u, v, w = x_ref.T
    u2, v2, w2 = x_cur.T
    a, b, c, d, e, f = (column[triples] for column in (v2 * w, w2 * v, w2 * u, u2 * w, u2 * v, v2 * u))

    def det(p: Array, q: Array, r: Array) -> Array:
        return np.asarray(np.einsum("ki,ki->k", p, np.cross(q, r)))

    return np.column_stack(
        [
            det(b, c, f),
            -det(b, c, e),
            -det(a, c, f),
            det(b, d, e),
            det(a, d, f),
            -det(a, d, e),
            det(a, c, e) - det(b, d, f),
        ]
    )


def diagonal_ratios(x: Array) -> tuple[float, float]:
    """Return h_u / h_w and h_v / h_w from the seven monomials, by least squares over all their quotients."""
    uuv, uvv, uuw, vvw, uww, vww, uvw = x
    over_w = np.array([uvw, vvw, uww, vww])
    ratio_u = float(np.array([uuv, uvv, uuw, uvw]) @ over_w / (over_w @ over_w))
    over_w = np.array([uuw, uvw, uww, vww])
    ratio_v = float(np.array([uuv, uvv, uvw, vvw]) @ over_w / (over_w @ over_w))
    return ratio_u, ratio_v


def virtual_plane_homography(
    m_ref: Array, m_current: Array, triangle: NDArray[np.int64], seed: int
) -> Array | None:
    """Return the homography (3, 3) of the plane through the triangle; None where no depths allow it."""
    x, y = homogeneous(m_ref), homogeneous(m_current)
    M_ref, M_cur = x[triangle].T, y[triangle].T
    if min(abs(np.linalg.det(M_ref)), abs(np.linalg.det(M_cur))) < 1e-9:
        return None
    others = np.setdiff1d(np.arange(len(x)), triangle)
    x_ref = x[others] @ np.asarray(np.linalg.inv(M_ref), dtype=np.float64).T
    x_cur = y[others] @ np.asarray(np.linalg.inv(M_cur), dtype=np.float64).T
    rows = monomial_rows(x_ref, x_cur, point_triples(len(others), seed))
    monomials = np.linalg.eigh(rows.T @ rows)[1][:, 0]
    ratio_u, ratio_v = diagonal_ratios(monomials)
    # The ratios are ratios of depths, so a negative one means that no scene fits.
    if not (np.isfinite([ratio_u, ratio_v]).all() and ratio_u > 0.0 and ratio_v > 0.0):
        return None
    return np.asarray(M_cur @ np.diag([ratio_u, ratio_v, 1.0]) @ np.linalg.inv(M_ref))


def epipolar_distance(H: Array, m_ref: Array, m_current: Array) -> Array:
    """Return each point's Sampson distance (n,) from the epipolar geometry [e]x H, e the best epipole."""
    x, y = homogeneous(m_ref), homogeneous(m_current)
    lines = np.cross(y, x @ H.T)
    epipole = np.linalg.eigh(lines.T @ lines)[1][:, 0]
    F = skew(epipole) @ H
    a, b = x @ F.T, y @ F
    size = np.sqrt((a[:, :2] ** 2).sum(axis=1) + (b[:, :2] ** 2).sum(axis=1))
    return np.asarray(np.abs((y * a).sum(axis=1)) / np.maximum(size, 1e-15))


def estimate_generic(
    m_ref: ArrayLike,
    m_current: ArrayLike,
    attitude_sd: float = 0.0,
    *,
    start: HomographyEstimate | None = None,
    noise: float | None = None,
    seed: int = 0,
) -> HomographyEstimate:
    """Estimate the homography of the plane through the largest triangle of points of any scene.

    It fails on points of one plane, on pure rotation and on tiny baselines, where the lines above have no
    length, and outliers spoil it. It detects these and falls back to `planar`; `method` and `note` say so.
    The plane belongs to three of the points: when one of them is lost, the next estimate is of another plane.

    Raises
    ------
    PointShapeError, NonFinitePointsError, TooFewPointsError, EstimatorValueError, NoHomographyError

    """
    a, b = checked_points(m_ref, m_current, "generic", 4)
    checked_options("generic", attitude_sd, noise)
    level = DEFAULT_NOISE if noise is None else noise

    def fall_back(why: str) -> HomographyEstimate:
        plane = estimate_planar(a, b, attitude_sd, noise=noise, seed=seed)
        return replace(plane, note=f"{why}; planar was used instead of generic")

    if len(a) < LEAST_POINTS:
        return fall_back(f"{len(a)} points, generic needs {LEAST_POINTS}")
    if robust_inliers(a, b, PLANE_THRESHOLD * level).mean() >= PLANE_SHARE:
        return fall_back("one plane, or a turn alone, explains the points")
    try:
        triangle = largest_triangle(a)
    except TriangleError:
        return fall_back("the points lie on one line")
    H = virtual_plane_homography(a, b, triangle, seed)
    if H is None:
        return fall_back("the virtual plane has no positive depths")
    distance = epipolar_distance(H, a, b)
    inliers = distance < THRESHOLD * level
    if inliers.mean() < AGREEING_SHARE:
        return fall_back("too few points agree with the virtual plane")
    return HomographyEstimate(
        H=scaled_homography(H, a, b),
        method="generic",
        quality=float(np.mean(np.maximum(0.0, 1.0 - (distance / (THRESHOLD * level)) ** 2))),
        inliers=inliers,
        noise=level,
    )
