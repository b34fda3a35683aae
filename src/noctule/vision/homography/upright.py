"""`upright`: yaw and translation of a camera whose roll and pitch are known, or nearly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from noctule.geometry import Array, wrap_angle
from noctule.vision.homography.compiled import compiled
from noctule.vision.homography.result import (
    DEFAULT_NOISE,
    HomographyEstimate,
    checked_options,
    checked_points,
    scaled_homography,
)
from noctule.vision.homography.upright_cost import absorbed, describe, normal_equations
from noctule.vision.homography.upright_model import (
    N_PARAMETERS,
    PITCH,
    ROLL,
    SLOPE_X,
    SLOPE_Y,
    TX,
    TZ,
    YAW,
    TwoViews,
    rotation,
)
from noctule.vision.homography.upright_noise import estimate_noise
from noctule.vision.homography.upright_solver import COARSE, FINE, cholesky, cholesky_solve, inverse, minimise
from noctule.vision.homography.upright_start import cold_starts

LEAST_POINTS = 5
SPREAD = 0.6
"""Standard deviation of inverse depths about the sloped plane; 0.5 to 0.7 measured alike over rooms and clouds."""
SLOPE_SD = 0.5
N_FINISHED = 3
INLIER_CHI2 = 11.8
"""A point of the right answer exceeds this in 0.3 % of cases (chi-square, two degrees of freedom)."""
T_CHI2 = 11.34
"""A view that did not move exceeds this in 1 % of cases (chi-square, three degrees of freedom), when the noise is
known; with noise estimated from n points, times 1 + 6 / (n - 3): Fisher's distribution, within 3 %."""
ALTERNATIVE_COST = 9.0
"""An answer that costs this much more than the best, three standard deviations, is no longer kept."""
SWITCH_COST = 4.0
"""A kept answer that costs this much less than the one followed takes its place."""
WARM_SHARE = 0.5
"""A warm start that explains fewer of the points is dropped."""

Minimum = tuple[float, Array]
"""A cost, and the parameters (8,) where it is reached."""


def two_views(m_ref: Array, m_current: Array, attitude_sd: float, noise: float) -> TwoViews:
    """Return the points with their priors: slopes, and roll and pitch where they are free."""
    prior = np.zeros(N_PARAMETERS)
    prior[SLOPE_X] = prior[SLOPE_Y] = 1.0 / SLOPE_SD**2
    n_free = N_PARAMETERS - 2
    if attitude_sd > 0.0:
        prior[ROLL] = prior[PITCH] = 1.0 / attitude_sd**2
        n_free = N_PARAMETERS
    return TwoViews(m_ref, m_current, m_ref.mean(axis=0), noise, SPREAD, prior, n_free)


def with_noise(views: TwoViews, parameters: Array, rounds: int) -> TwoViews:
    """Return the views with the noise that the residuals at `parameters` show."""
    used = float(views.n_free - 3)  # the size of t and the slopes hide in the inverse depths
    return views._replace(noise=estimate_noise(describe(parameters, views)[2], views.noise, used, rounds))


@compiled
def chi2_of(covariance: Array, t: Array) -> float:
    """Return t' covariance_tt^-1 t for the covariance (4, 4) of (yaw, t); 0 where it is not positive definite."""
    L, weighted = np.zeros((3, 3)), np.zeros(3)
    if not cholesky(covariance[1:, 1:], 3, 0.0, L):
        return 0.0
    cholesky_solve(L, 3, t, weighted)
    return float(t[0] * weighted[0] + t[1] * weighted[1] + t[2] * weighted[2])


@compiled
def conclude(parameters: Array, views: TwoViews) -> tuple[Array, Array, float, float]:
    """Return chi2 per point (n,), the covariance of (yaw, t) (4, 4), the unit of t and t' covariance^-1 t.

    The mean inverse depth of the inliers may differ a little from the prior's 1; in units of it t is exact. What
    the prior says about that mean, spread^2 / n times the share that `absorbed` gives the depths, is then no
    longer an error of t and leaves its covariance.
    """
    chi2, rho, _ = describe(parameters, views)
    t = parameters[TX : TZ + 1]
    total, share, count = 0.0, 0.0, 0
    for j in range(len(chi2)):
        if chi2[j] < INLIER_CHI2:
            u, v = views.m_cur[j, 0], views.m_cur[j, 1]
            total += rho[j]
            share += absorbed(t[0], t[1], t[2], u, v, views.noise, views.spread)[0]
            count += 1
    A = np.zeros((N_PARAMETERS, N_PARAMETERS))
    normal_equations(parameters, views, True, False, A, np.zeros(N_PARAMETERS))
    covariance = inverse(A, views.n_free)[:4, :4].copy()
    size = total / count if count > 0 else 1.0
    if count > 0:
        known = views.spread**2 * share / count / count
        known = min(known, 0.9 / max(chi2_of(covariance, t), 1e-12))
        for k in range(3):
            for i in range(3):
                covariance[k + 1, i + 1] -= known * t[k] * t[i]
    statistic = chi2_of(covariance, t)
    for k in range(1, 4):
        covariance[k, :] *= size
        covariance[:, k] *= size
    return chi2, covariance, size, statistic


def estimate_at(views: TwoViews, minimum: Minimum, note: str = "") -> HomographyEstimate:
    """Describe a minimum as an estimate."""
    cost, parameters = minimum
    chi2, covariance, size, statistic = conclude(parameters, views)
    inliers = chi2 < INLIER_CHI2
    t = parameters[TX : TZ + 1] * size
    H = rotation(parameters[YAW], parameters[ROLL], parameters[PITCH])
    H[:, 2] += t
    return HomographyEstimate(
        H=scaled_homography(H, views.m_ref, views.m_cur),
        method="upright",
        quality=float(np.maximum(0.0, 1.0 - chi2 / INLIER_CHI2).mean()),
        inliers=inliers,
        note=note,
        noise=views.noise,
        yaw=wrap_angle(float(parameters[YAW])),
        t=t,
        covariance=covariance,
        roll=float(parameters[ROLL]),
        pitch=float(parameters[PITCH]),
        slopes=parameters[SLOPE_X : SLOPE_Y + 1].copy(),
        t_defined=statistic > T_CHI2 * (1.0 + 6.0 / max(int(np.count_nonzero(inliers)) - 3, 1)),
        cost=cost,
        parameters=parameters.copy(),
    )


def distinct(minima: list[Minimum]) -> list[Minimum]:
    """Return the minima, best first, without those that repeat a better one."""
    kept: list[Minimum] = []
    for cost, p in sorted(minima, key=lambda minimum: minimum[0]):
        near = 0.01 + 0.03 * float(np.abs(p[TX : TZ + 1]).max())
        if all(abs(p[YAW] - q[YAW]) > 0.01 or np.abs(p - q)[TX : TZ + 1].max() > near for _, q in kept):
            kept.append((cost, p))
    return kept


def solve_cold(
    views: TwoViews, attitude_sd: float, fixed_noise: bool, seed: int
) -> tuple[TwoViews, list[Minimum]]:
    """Return the distinct minima, best first, and the views with their noise."""
    tried = [
        (minimise(start, views, False, 4, COARSE), start) for start in cold_starts(views, attitude_sd, seed)
    ]
    best = distinct(tried)[:N_FINISHED]
    best = distinct([(minimise(parameters, views, False, 20, COARSE), parameters) for _, parameters in best])
    if not fixed_noise:
        for _ in range(2):
            views = with_noise(views, best[0][1], 15)
            minimise(best[0][1], views, False, 10, COARSE)
    return views, distinct(
        [(minimise(parameters, views, True, 20, FINE), parameters) for _, parameters in best]
    )


def follow(views: TwoViews, start: HomographyEstimate, fixed_noise: bool) -> tuple[TwoViews, list[Minimum]]:
    """Return the minima near `start` and near its alternatives, in this order, and the views with their noise."""
    if not fixed_noise:
        views = views._replace(noise=start.noise)
    parameters = start.parameters.copy()
    if views.n_free < N_PARAMETERS:
        parameters[ROLL] = parameters[PITCH] = 0.0
    minimise(parameters, views, False, 8, COARSE)
    if not fixed_noise:
        views = with_noise(views, parameters, 2)
    minima = [(minimise(parameters, views, True, 8, FINE), parameters)]
    for other in start.alternatives:
        parameters = other.parameters.copy()
        minimise(parameters, views, False, 8, COARSE)
        minima.append((minimise(parameters, views, True, 8, FINE), parameters))
    return views, minima


def still_open(minima: list[Minimum]) -> list[Minimum]:
    """Return the answer that is followed and the alternatives that are still open, in this order.

    An alternative that costs clearly less takes the first place; one that costs clearly more, or has run into
    the answer that is followed, is dropped.
    """
    if len(minima) == 1:
        return minima
    best = min(minima, key=lambda minimum: minimum[0])
    first = best if best[0] < minima[0][0] - SWITCH_COST else minima[0]
    others = [
        minimum for minimum in minima if minimum is not first and minimum[0] < best[0] + ALTERNATIVE_COST
    ]
    return [first, *(other for other in others if len(distinct([first, other])) == 2)]


def nearest_first(minima: list[Minimum], start: HomographyEstimate | None) -> list[Minimum]:
    """Return the minima that explain the points about as well as the best, the nearest to `start` first."""
    best = min(cost for cost, _ in minima)
    kept = [minimum for minimum in minima if minimum[0] < best + ALTERNATIVE_COST]
    if start is not None and len(kept) > 1:
        kept.sort(key=lambda minimum: float(np.linalg.norm((minimum[1] - start.parameters)[: TZ + 1])))
    return kept


def estimate_upright(
    m_ref: ArrayLike,
    m_current: ArrayLike,
    attitude_sd: float = 0.0,
    *,
    start: HomographyEstimate | None = None,
    noise: float | None = None,
    seed: int = 0,
) -> HomographyEstimate:
    """Estimate yaw and t between two views of an upright camera.

    Source: the model of servoing.md, "Homography"; corrected: the term `absorbed`.

    Parameters
    ----------
    m_ref, m_current
        Matched points (n, 2), normalised; roll and pitch as far as known taken out (`noctule.camera.derotate`).
    attitude_sd
        Standard deviation [rad] of what is left of roll and pitch; 0 holds both at zero.
    start
        The estimate of the previous tick: the search starts there and in its alternatives, and only where that
        explains fewer than half of the points does it start anew. Without it (a new key image) it starts cold.
    noise
        Of a match, both images together, in normalised units; estimated from the points where it is None.
    seed
        Of the random draws of a cold start.

    Raises
    ------
    PointShapeError, NonFinitePointsError, TooFewPointsError, EstimatorValueError

    """
    a, b = checked_points(m_ref, m_current, "upright", LEAST_POINTS)
    checked_options("upright", attitude_sd, noise)
    views = two_views(a, b, attitude_sd, DEFAULT_NOISE if noise is None else noise)
    note = ""
    if start is not None and start.method == "upright":
        warm, minima = follow(views, start, noise is not None)
        minima = still_open(minima)
        followed = estimate_at(warm, minima[0])
        if np.count_nonzero(followed.inliers) > WARM_SHARE * len(a):
            return with_alternatives(followed, warm, minima[1:])
        note = "the start explained too few points; started anew"
    views, minima = solve_cold(views, attitude_sd, noise is not None, seed)
    kept = nearest_first(minima, start)
    return with_alternatives(estimate_at(views, kept[0], note), views, kept[1:])


def with_alternatives(
    estimate: HomographyEstimate, views: TwoViews, others: list[Minimum]
) -> HomographyEstimate:
    """Return the estimate with the other answers described beside it."""
    if not others:
        return estimate
    return replace(estimate, alternatives=tuple(estimate_at(views, minimum) for minimum in others))


def refine_upright(
    m_ref: ArrayLike, m_current: ArrayLike, start: HomographyEstimate, attitude_sd: float = 0.0
) -> HomographyEstimate:
    """Return `estimate_upright` from the estimate of the previous tick; the entry for the flight loop."""
    return estimate_upright(m_ref, m_current, attitude_sd, start=start)
