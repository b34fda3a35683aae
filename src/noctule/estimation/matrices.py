"""The few matrix routines that compiled filters share."""

from __future__ import annotations

import numpy as np

from noctule.compiled import compiled
from noctule.geometry import Array


@compiled
def cholesky(A: Array) -> Array:
    """Return the lower triangle L (n, n) with L L' = A; a NaN at [0, 0] says that A is not positive definite.

    Written out: for matrices this small a call into LAPACK costs more than the work.
    """
    n = A.shape[0]
    L = np.zeros((n, n))
    for j in range(n):
        d = A[j, j]
        for k in range(j):
            d -= L[j, k] * L[j, k]
        if not d > 0.0:
            L[0, 0] = np.nan
            return L
        d = np.sqrt(d)
        L[j, j] = d
        for i in range(j + 1, n):
            s = A[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            L[i, j] = s / d
    return L


@compiled
def inverse_spd(A: Array) -> Array:
    """Return the inverse (n, n) of a symmetric positive definite A, exactly symmetric; NaN when A is not."""
    n = A.shape[0]
    L = cholesky(A)
    if np.isnan(L[0, 0]):
        return np.full((n, n), np.nan)
    M = np.zeros((n, n))  # the inverse of L, lower triangle
    for j in range(n):
        M[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, n):
            s = 0.0
            for k in range(j, i):
                s += L[i, k] * M[k, j]
            M[i, j] = -s / L[i, i]
    inverse = np.empty((n, n))
    for i in range(n):
        for j in range(i, n):
            s = 0.0
            for k in range(j, n):
                s += M[k, i] * M[k, j]
            inverse[i, j] = s
            inverse[j, i] = s
    return inverse


@compiled
def times(A: Array, v: Array) -> Array:
    """Return A v, (m,)."""
    m, n = A.shape
    product = np.zeros(m)
    for i in range(m):
        for j in range(n):
            product[i] += A[i, j] * v[j]
    return product


@compiled
def refuse_unsound(x: Array, P: Array) -> tuple[Array, Array]:
    """Return mean and covariance; NaN throughout unless all is finite and every variance positive.

    So callers outside of compiled code need to look at one number only.
    """
    sound = True
    for i in range(x.size):
        sound = sound and np.isfinite(x[i]) and P[i, i] > 0.0
        for j in range(x.size):
            sound = sound and np.isfinite(P[i, j])
    if not sound:
        x[:] = np.nan
        P[:] = np.nan
    return x, P
