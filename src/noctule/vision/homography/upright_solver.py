"""Levenberg-Marquardt on the `upright` model, with a Cholesky factorisation of its own."""

from __future__ import annotations

import math

import numpy as np

from noctule.compiled import compiled
from noctule.geometry import Array
from noctule.vision.homography.upright_cost import normal_equations
from noctule.vision.homography.upright_model import N_PARAMETERS, TwoViews

FINE = 1e-2
"""A step that gains less in cost moves by less than a tenth of a standard deviation."""
COARSE = 0.1
"""Enough for a stage that another one follows."""


@compiled
def cholesky(A: Array, n: int, damping: float, L: Array) -> bool:
    """Factor A + damping diag(A) = L L' (leading n x n block); False where it is not positive definite."""
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
    """Solve L L' out = b for the leading n."""
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
def inverse(A: Array, n: int) -> Array:
    """Return the inverse of the leading n x n block of A, zeros elsewhere; infinite where A is singular."""
    L, out, unit = np.zeros(A.shape), np.zeros(A.shape), np.zeros(len(A))
    if not cholesky(A, n, 0.0, L):
        for k in range(n):
            out[k, k] = np.inf
        return out
    for k in range(n):
        unit[:] = 0.0
        unit[k] = 1.0
        cholesky_solve(L, n, unit, out[k])
    return out


@compiled
def minimise(parameters: Array, views: TwoViews, redescending: bool, max_steps: int, enough: float) -> float:
    """Move `parameters` (8,) to the nearest minimum, at most `max_steps` steps; return the cost there.

    It ends with a step that is predicted to gain less than `enough`; that one is taken unchecked.
    """
    A, A_trial = np.zeros((N_PARAMETERS, N_PARAMETERS)), np.zeros((N_PARAMETERS, N_PARAMETERS))
    b, b_trial = np.zeros(N_PARAMETERS), np.zeros(N_PARAMETERS)
    L = np.zeros((N_PARAMETERS, N_PARAMETERS))
    step = np.zeros(N_PARAMETERS)
    trial = parameters.copy()
    damping = 1e-3
    cost = normal_equations(parameters, views, redescending, True, A, b)
    for _ in range(max_steps):
        if not cholesky(A, views.n_free, damping, L):
            damping = 10.0 * damping
            continue
        cholesky_solve(L, views.n_free, b, step)
        gain = 0.0
        for k in range(views.n_free):
            trial[k] = parameters[k] - step[k]
            gain += step[k] * b[k]
        if gain < enough:
            parameters[:] = trial
            return cost - gain
        trial_cost = normal_equations(trial, views, redescending, True, A_trial, b_trial)
        if trial_cost < cost:
            cost = trial_cost
            parameters[:] = trial
            A, A_trial = A_trial, A
            b, b_trial = b_trial, b
            damping = max(0.1 * damping, 1e-9)
        else:
            damping = 10.0 * damping
    return cost
