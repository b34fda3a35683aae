"""The Kalman filter: predict with the vehicle model, correct with a linearised measurement.

Mean and covariance in, mean and covariance out; nothing is kept here. Corrections go in one number at a
time after the measurement's own correlations are taken out, each in Joseph's form, so that the covariance
stays symmetric and positive definite whatever comes.
"""

from __future__ import annotations

import numpy as np

from noctule.compiled import compiled
from noctule.estimation.matrices import cholesky, refuse_unsound
from noctule.estimation.vehicle_model import process_covariance, transition
from noctule.geometry import Array


@compiled
def predict(
    x: Array, P: Array, dt: float, u: Array, gains: Array, drags: Array, densities: Array
) -> tuple[Array, Array]:
    """Return mean (n,) and covariance (n, n) after `dt` [s] under the input `u` (4,).

    `gains` and `drags` (4,) are those of the VehicleModel, zero for constant velocity; `densities` (5,) those
    of the ProcessNoise. x = f(x, u), P = F P F' + Q.
    """
    n = x.size
    x1, F = transition(x, dt, u, gains, drags)
    P1 = process_covariance(0.5 * (x[3] + x1[3]), dt, drags, densities, n)
    FP = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            f = F[i, k]
            if f != 0.0:  # three in four are
                for j in range(n):
                    FP[i, j] += f * P[k, j]
    for j in range(n):
        for k in range(n):
            f = F[j, k]
            if f != 0.0:
                for i in range(j + 1):
                    P1[i, j] += FP[i, k] * f
    for i in range(n):
        for j in range(i):
            P1[i, j] = P1[j, i]
    return x1, P1


@compiled
def correct(x: Array, P: Array, residual: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Return mean (n,) and covariance (n, n) after a measurement.

    `residual` (m,) is z - h(x) with its angles wrapped, `H` (m, n) the Jacobian of h at x and `R` (m, m) the
    measurement's covariance. An R that is not positive definite, or numbers beyond use, give NaN throughout.
    """
    n, m = x.size, residual.size
    L = cholesky(R)
    if np.isnan(L[0, 0]):
        return np.full(n, np.nan), np.full((n, n), np.nan)
    dx = np.zeros(n)
    P1 = P.copy()
    white = np.zeros((m, n))  # L^-1 H: rows whose errors are independent and of unit variance
    z = np.zeros(m)
    ph = np.empty(n)
    mh = np.empty(n)
    gain = np.empty(n)
    for a in range(m):
        z[a] = residual[a]
        white[a] = H[a]
        for b in range(a):
            z[a] -= L[a, b] * z[b]
            for i in range(n):
                white[a, i] -= L[a, b] * white[b, i]
        z[a] /= L[a, a]
        s, e = 1.0, z[a]
        for i in range(n):
            white[a, i] /= L[a, a]
        h = white[a]
        for i in range(n):
            ph[i] = 0.0
            for j in range(n):
                ph[i] += P1[i, j] * h[j]
        for i in range(n):
            s += h[i] * ph[i]
            e -= h[i] * dx[i]
        for i in range(n):
            gain[i] = ph[i] / s
            dx[i] += gain[i] * e
        # Joseph: M = (I - K h) P, then M (I - K h)' + K K'.
        for i in range(n):
            mh[i] = 0.0
            for j in range(n):
                mh[i] += (P1[i, j] - gain[i] * ph[j]) * h[j]
        for i in range(n):
            for j in range(i, n):
                P1[i, j] += -gain[i] * ph[j] - mh[i] * gain[j] + gain[i] * gain[j]
                P1[j, i] = P1[i, j]
    return refuse_unsound(x + dx, P1)
