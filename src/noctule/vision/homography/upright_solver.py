"""Levenberg-Marquardt on the `upright` model: cost, normal equations, step, loop, and the covariance at the end."""

from __future__ import annotations

import math

import numpy as np

from noctule.geometry import Array
from noctule.vision.homography.compiled import compiled
from noctule.vision.homography.upright_model import (
    N_PARAMETERS,
    PITCH,
    ROLL,
    SLOPE_X,
    SLOPE_Y,
    YAW,
    jacobian,
    residual,
    rotation,
    rotation_derivatives,
)


@compiled
def mahalanobis(eu: float, ev: float, gu: float, gv: float, noise: float, spread: float) -> tuple[float, float]:
    """Return e' C^-1 e for C = noise^2 I + spread^2 g g', and the factor k in C^-1 = (I - k g g') / noise^2."""
    k = spread * spread / (noise * noise + spread * spread * (gu * gu + gv * gv))
    along = gu * eu + gv * ev
    return (eu * eu + ev * ev - k * along * along) / (noise * noise), k


@compiled
def normal_equations(
    parameters: Array,
    m_ref: Array,
    m_cur: Array,
    centre: Array,
    noise: float,
    spread: float,
    prior: Array,
    cauchy: float,
    n_free: int,
    A: Array,
    b: Array,
) -> float:
    """Fill A = sum w J' C^-1 J + P and b = sum w J' C^-1 e + P parameters; return the cost.

    Cost: sum c^2 log(1 + e' C^-1 e / c^2) + parameters' P parameters (Cauchy), so w = 1 / (1 + e' C^-1 e / c^2).
    """
    R = rotation(parameters[YAW], parameters[ROLL], parameters[PITCH])
    D = rotation_derivatives(parameters[YAW], parameters[ROLL], parameters[PITCH])
    J = np.zeros((2, N_PARAMETERS))
    c2 = cauchy * cauchy
    A[:] = 0.0
    cost = 0.0
    for k in range(n_free):
        A[k, k] = prior[k]
        b[k] = prior[k] * parameters[k]
        cost += prior[k] * parameters[k] ** 2
    for j in range(len(m_ref)):
        x, y = m_ref[j, 0], m_ref[j, 1]
        dx, dy = x - centre[0], y - centre[1]
        at = residual(parameters, R, x, y, dx, dy, m_cur[j], noise, spread)
        eu, ev, gu, gv = at[0], at[1], at[2], at[3]
        f, k_along = mahalanobis(eu, ev, gu, gv, noise, spread)
        cost += c2 * math.log1p(f / c2)
        scale = 1.0 / ((1.0 + f / c2) * noise * noise)
        jacobian(D, n_free, x, y, dx, dy, at, J)
        along_e = gu * eu + gv * ev
        for p in range(n_free):
            along_p = k_along * (gu * J[0, p] + gv * J[1, p])
            b[p] += scale * (J[0, p] * eu + J[1, p] * ev - along_p * along_e)
            ju, jv = scale * (J[0, p] - along_p * gu), scale * (J[1, p] - along_p * gv)
            for q in range(p + 1):
                A[p, q] += ju * J[0, q] + jv * J[1, q]
    for p in range(n_free):
        for q in range(p):
            A[q, p] = A[p, q]
    return cost


@compiled
def cholesky(A: Array, n: int, damping: float, L: Array) -> bool:
    """Factor A + damping diag(A) = L L' for the leading n x n block; False where it is not positive definite."""
    for i in range(n):
        for j in range(i + 1):
            total = A[i, j]
            if i == j:
                total += damping * A[i, i]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                L[i, i] = math.sqrt(total)
            else:
                L[i, j] = total / L[j, j]
    return True


@compiled
def cholesky_solve(L: Array, n: int, b: Array, out: Array) -> None:
    """Solve L L' out = b."""
    for i in range(n):
        total = b[i]
        for k in range(i):
            total -= L[i, k] * out[k]
        out[i] = total / L[i, i]
    for i in range(n - 1, -1, -1):
        total = out[i]
        for k in range(i + 1, n):
            total -= L[k, i] * out[k]
        out[i] = total / L[i, i]


@compiled
def minimise(
    parameters: Array,
    m_ref: Array,
    m_cur: Array,
    centre: Array,
    noise: float,
    spread: float,
    prior: Array,
    cauchy: float,
    n_free: int,
    max_steps: int,
) -> float:
    """Move `parameters` (8,) to the nearest minimum, at most `max_steps` steps; return the cost there."""
    A = np.zeros((N_PARAMETERS, N_PARAMETERS))
    A_trial = np.zeros((N_PARAMETERS, N_PARAMETERS))
    L = np.zeros((N_PARAMETERS, N_PARAMETERS))
    b = np.zeros(N_PARAMETERS)
    b_trial = np.zeros(N_PARAMETERS)
    step = np.zeros(N_PARAMETERS)
    trial = parameters.copy()
    damping = 1e-3
    cost = normal_equations(parameters, m_ref, m_cur, centre, noise, spread, prior, cauchy, n_free, A, b)
    for _ in range(max_steps):
        if not cholesky(A, n_free, damping, L):
            damping = max(10.0 * damping, 1e-6)
            continue
        cholesky_solve(L, n_free, b, step)
        decrement = 0.0
        for k in range(n_free):
            trial[k] = parameters[k] - step[k]
            decrement += step[k] * b[k]
        trial_cost = normal_equations(
            trial, m_ref, m_cur, centre, noise, spread, prior, cauchy, n_free, A_trial, b_trial
        )
        if trial_cost < cost:
            cost = trial_cost
            parameters[:] = trial
            A, A_trial = A_trial, A
            b, b_trial = b_trial, b
            damping = max(0.1 * damping, 1e-9)
        else:
            damping = 10.0 * damping
        # The step is a hundredth of a standard deviation: nothing is left to gain.
        if decrement < 1e-4 or damping > 1e8:
            break
    return cost
