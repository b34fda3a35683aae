"""The cost of the `upright` model, its normal equations, and what a minimum says about each point."""

from __future__ import annotations

import math

import numpy as np

from noctule.compiled import compiled
from noctule.geometry import Array
from noctule.vision.homography.upright_model import (
    N_PARAMETERS,
    PITCH,
    ROLL,
    TX,
    TY,
    TZ,
    YAW,
    TwoViews,
    jacobian,
    residual,
    rotation,
    rotation_derivatives,
)

SHARPNESS = 2.4
"""c of both losses, in standard deviations."""


@compiled
def mahalanobis(
    eu: float, ev: float, gu: float, gv: float, noise: float, spread: float
) -> tuple[float, float]:
    """Return e' C^-1 e for C = noise^2 I + spread^2 g g', and k in C^-1 = (I - k g g') / noise^2."""
    k = spread * spread / (noise * noise + spread * spread * (gu * gu + gv * gv))
    along = gu * eu + gv * ev
    return (eu * eu + ev * ev - k * along * along) / (noise * noise), k


@compiled
def robust_loss(chi2: float, redescending: bool) -> tuple[float, float]:
    """Return the loss of a squared residual and its derivative, the weight.

    With q = chi2 / c^2: Cauchy's c^2 log(1 + q), which still pulls from afar, and for the last steps Geman
    and McClure's c^2 q / (1 + q), which lets go of what does not fit.
    """
    c2 = SHARPNESS * SHARPNESS
    inverse = 1.0 / (1.0 + chi2 / c2)
    if redescending:
        return chi2 * inverse, inverse * inverse
    return c2 * math.log1p(chi2 / c2), inverse


@compiled
def absorbed(
    tx: float, ty: float, tz: float, u: float, v: float, noise: float, spread: float
) -> tuple[float, float]:
    """Return how much of its squared residual a point is expected to lose to its own inverse depth, and d/dG.

    The free inverse depth takes k G / (1 + k G) of one squared standard deviation of pure noise, with
    G = |t_xy - m t_z|^2 and k = (spread / noise)^2. Without giving it back the cost prefers a longer t, and a
    view that only turned is read as a translation and 0.2 degrees of yaw that are not there.
    """
    k = (spread / noise) ** 2
    pu, pv = tx - u * tz, ty - v * tz
    inverse = 1.0 / (1.0 + k * (pu * pu + pv * pv))
    return 1.0 - inverse, k * inverse * inverse


@compiled
def add_absorbed(parameters: Array, views: TwoViews, j: int, A: Array, b: Array) -> float:
    """Add the term `absorbed` of point j to the normal equations; return its cost."""
    u, v = views.m_cur[j, 0], views.m_cur[j, 1]
    tx, ty, tz = parameters[TX], parameters[TY], parameters[TZ]
    cost, weight = absorbed(tx, ty, tz, u, v, views.noise, views.spread)
    pu, pv = tx - u * tz, ty - v * tz
    b[TX] += weight * pu
    b[TY] += weight * pv
    b[TZ] -= weight * (u * pu + v * pv)
    A[TX, TX] += weight
    A[TY, TY] += weight
    A[TZ, TX] -= weight * u
    A[TZ, TY] -= weight * v
    A[TZ, TZ] += weight * (u * u + v * v)
    return cost


@compiled
def normal_equations(
    parameters: Array, views: TwoViews, redescending: bool, bias: bool, A: Array, b: Array
) -> float:
    """Fill A = sum w J' C^-1 J + P and b = sum w J' C^-1 e + P parameters; return the cost.

    Cost: sum loss(e' C^-1 e) + sum absorbed + parameters' P parameters, and b is half its gradient. There is
    no log det C in it: that pulls t towards zero (measured: 1.8 deg of yaw on a real pair).
    `bias` False leaves the term `absorbed` out of A and b: A is then the information that the points carry.
    """
    R = rotation(parameters[YAW], parameters[ROLL], parameters[PITCH])
    D = rotation_derivatives(parameters[YAW], parameters[ROLL], parameters[PITCH])
    J = np.zeros((2, N_PARAMETERS))
    n = views.n_free
    A[:] = 0.0
    cost = 0.0
    for p in range(n):
        A[p, p] = views.prior[p]
        b[p] = views.prior[p] * parameters[p]
        cost += views.prior[p] * parameters[p] ** 2
    for j in range(len(views.m_ref)):
        at = residual(parameters, R, views, j)
        eu, ev, gu, gv = at[0], at[1], at[2], at[3]
        chi2, k = mahalanobis(eu, ev, gu, gv, views.noise, views.spread)
        loss, weight = robust_loss(chi2, redescending)
        cost += loss
        if bias:
            cost += add_absorbed(parameters, views, j, A, b)
        scale = weight / (views.noise * views.noise)
        jacobian(D, views, j, at, J)
        along_e = gu * eu + gv * ev
        for p in range(n):
            along_p = k * (gu * J[0, p] + gv * J[1, p])
            b[p] += scale * (J[0, p] * eu + J[1, p] * ev - along_p * along_e)
            ju, jv = scale * (J[0, p] - along_p * gu), scale * (J[1, p] - along_p * gv)
            for q in range(p + 1):
                A[p, q] += ju * J[0, q] + jv * J[1, q]
    for p in range(n):
        for q in range(p):
            A[q, p] = A[p, q]
    return cost


@compiled
def describe(parameters: Array, views: TwoViews) -> tuple[Array, Array, Array]:
    """Return e' C^-1 e, the best inverse depth, and the residual across the epipolar line, (n,) each."""
    n = len(views.m_ref)
    chi2, rho, across = np.empty(n), np.empty(n), np.empty(n)
    R = rotation(parameters[YAW], parameters[ROLL], parameters[PITCH])
    for j in range(n):
        eu, ev, gu, gv, rho[j], _, _, _ = residual(parameters, R, views, j)
        chi2[j], _ = mahalanobis(eu, ev, gu, gv, views.noise, views.spread)
        across[j] = (gu * ev - gv * eu) / (math.sqrt(gu * gu + gv * gv) + 1e-12)
    return chi2, rho, across
