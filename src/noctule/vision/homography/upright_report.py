"""A minimum of the `upright` cost as an estimate: inliers, unit of length, covariance, is t defined."""

from __future__ import annotations

import numpy as np

from noctule.compiled import compiled
from noctule.geometry import Array, wrap_angle
from noctule.vision.homography.result import HomographyEstimate, scaled_homography
from noctule.vision.homography.upright_answers import Minimum
from noctule.vision.homography.upright_cost import absorbed, describe, normal_equations, robust_loss
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
from noctule.vision.homography.upright_solver import cholesky, cholesky_solve, inverse

INLIER_CHI2 = 11.8
"""A point of the right answer exceeds this in 0.3 % of cases (chi-square, two degrees of freedom)."""
T_CHI2 = 11.34
"""A view that did not move exceeds this in 1 % of cases (chi-square, three degrees of freedom) when the noise
is known; with noise estimated from n points, times 1 + 6 / (n - 3): Fisher's distribution, within 3 %."""


@compiled
def chi2_of(covariance: Array, t: Array) -> float:
    """Return t' covariance_tt^-1 t for the covariance (4, 4) of (yaw, t); 0 where there is no inverse."""
    L, weighted = np.zeros((3, 3)), np.zeros(3)
    if not cholesky(covariance[1:, 1:], 3, 0.0, L):
        return 0.0
    cholesky_solve(L, 3, t, weighted)
    return float(t[0] * weighted[0] + t[1] * weighted[1] + t[2] * weighted[2])


@compiled
def conclude(parameters: Array, views: TwoViews) -> tuple[Array, Array, float, float]:
    """Return chi2 per point (n,), the covariance of (yaw, t) (4, 4), the unit of t and t' covariance^-1 t.

    The mean inverse depth of the inliers may differ a little from the prior's 1; in units of it t is exact.
    The variance of the size of t, spread^2 / sum w k with k = `absorbed`, comes to the share mean(k) from
    what the prior says of that mean: this is then no longer an error of t and leaves its covariance.
    """
    chi2, rho, _ = describe(parameters, views)
    t = parameters[TX : TZ + 1]
    total, share, weighed, count = 0.0, 0.0, 0.0, 0
    for j in range(len(chi2)):
        if chi2[j] < INLIER_CHI2:
            u, v = views.m_cur[j, 0], views.m_cur[j, 1]
            total += rho[j]
            part = absorbed(t[0], t[1], t[2], u, v, views.noise, views.spread)[0]
            share += part
            weighed += part * robust_loss(chi2[j], True)[1]
            count += 1
    A = np.zeros((N_PARAMETERS, N_PARAMETERS))
    normal_equations(parameters, views, True, False, A, np.zeros(N_PARAMETERS))
    covariance = inverse(A, views.n_free)[:4, :4].copy()
    size = total / count if total > 0.0 else 1.0
    if count > 0:
        known = views.spread**2 * share / count / max(weighed, 1e-12)
        known = min(known, 0.98 / max(chi2_of(covariance, t), 1e-12))
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
