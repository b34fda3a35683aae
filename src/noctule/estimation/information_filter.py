"""The information filter: the Kalman filter of the same model, kept as y = Y x and Y = P^-1.

Eq. (29) to (35) of "Indoor low-cost localization system", corrected: Y(k given k) is the inverse of
P(k given k) (29), (30); L = Y(k given k-1) A Y(k-1 given k-1)^-1 (33), which for a model that is not linear
reads y = Y f(x); and (36) to (44), which are missing in print: every node predicts, every node adds the
contributions i = H' R^-1 z and I = H' R^-1 H of all nodes, y += sum i, Y += sum I, x = Y^-1 y.

An angle needs care here. A Kalman filter sees only innovations, and those wrap. y = Y x knows how many
turns the yaw has made, and so does i: adding the i of one count of turns to the y of another pulls the yaw
through whole turns. So a measurement enters as z = h(x) + wrapped innovation with H x in the place of h(x),
and a contribution that travels says about which yaw and which heading bias it was linearised: `turned`
moves it to the nearest count of the receiver.

Whoever measured has gated. What would move the receiver by more than a thousand of its own deviations all the
same is no sensor's doing, and is not used: see `assimilate_turned`. While such a source is refused and nobody
else measures the same, the deviations grow until it is let in again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from noctule.compiled import compiled
from noctule.estimation.filter_state import YAW, StateEstimate, heading_bias_index
from noctule.estimation.kalman_filter import predict
from noctule.estimation.matrices import cholesky, inverse_spd, refuse_unsound, times
from noctule.geometry import Array

_TURN = 2.0 * math.pi
_MOST_MOVED = 1e6  # squared deviations that one contribution may move a state by


@dataclass(frozen=True, slots=True)
class InformationState:
    """What an information filter keeps."""

    stamp: float  # [s]
    y: Array  # (n,) Y x
    Y: Array  # (n, n) inverse covariance

    @classmethod
    def of(cls, estimate: StateEstimate) -> InformationState:
        """Return the same estimate as information."""
        Y = inverse_spd(estimate.P)
        return cls(estimate.stamp, Y @ estimate.x, Y)

    @property
    def estimate(self) -> StateEstimate:
        """The same information as mean and covariance."""
        P = inverse_spd(self.Y)
        return StateEstimate(self.stamp, P @ self.y, P)


@compiled
def information_predict(
    y: Array, Y: Array, dt: float, u: Array, gains: Array, drags: Array, densities: Array
) -> tuple[Array, Array]:
    """Return information vector (n,) and matrix (n, n) after `dt` [s].

    The arguments are those of kalman_filter.predict.
    """
    P = inverse_spd(Y)
    x1, P1 = predict(times(P, y), P, dt, u, gains, drags, densities)
    Y1 = inverse_spd(P1)
    return times(Y1, x1), Y1


@compiled
def contribution(x: Array, residual: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Return (i, I), (n,) and (n, n), of a measurement linearised at x: (34) and (35).

    `residual` (m,) is z - h(x), wrapped; what goes in for z is residual + H x.
    """
    W = inverse_spd(R)
    m, n = H.shape
    HW = np.zeros((n, m))
    for a in range(m):
        for b in range(m):
            for k in range(n):
                HW[k, a] += H[b, k] * W[b, a]
    i = np.zeros(n)
    I = np.zeros((n, n))  # noqa: E741 - the paper's name
    for a in range(m):
        z = residual[a]
        for k in range(n):
            z += H[a, k] * x[k]
        for k in range(n):
            i[k] += HW[k, a] * z
            for j in range(k, n):
                I[k, j] += HW[k, a] * H[a, j]
    for k in range(n):
        for j in range(k):
            I[k, j] = I[j, k]
    return i, I


@compiled
def assimilate(x: Array, P: Array, i: Array, I: Array) -> tuple[Array, Array]:  # noqa: E741
    """Return mean (n,) and covariance (n, n) after the sums of contributions `i` (n,) and `I` (n, n).

    Y += I and y += i, written without the inverse of P: with P = L L' the new covariance is
    L (1 + L' I L)^-1 L', where nothing is near singular however unequal the variances are, and the mean
    moves by that times i - I x, which loses no digits to a large x.
    """
    x1, P1, _ = _assimilated(x, P, i, I)
    return x1, P1


@compiled
def _assimilated(x: Array, P: Array, i: Array, I: Array) -> tuple[Array, Array, float]:  # noqa: E741
    """Return what `assimilate` does, and how far the mean moves: (x1 - x)' P^-1 (x1 - x)."""
    n = x.size
    L = cholesky(P)
    IL = np.zeros((n, n))
    told = np.zeros(n, dtype=np.bool_)
    for a in range(n):
        for k in range(n):
            f = I[a, k]
            if f != 0.0:  # most measurements say nothing of most of the state
                told[a] = True
                for b in range(k + 1):
                    IL[a, b] += f * L[k, b]
    M = np.eye(n)
    for k in range(n):
        if not told[k]:
            continue
        for a in range(k + 1):
            f = L[k, a]
            for b in range(a + 1):
                M[a, b] += f * IL[k, b]
    C = cholesky(M)
    if np.isnan(L[0, 0]) or np.isnan(C[0, 0]):
        return np.full(n, np.nan), np.full((n, n), np.nan), np.nan
    T = np.zeros((n, n))  # C T = L', so that P1 = T' T
    P1 = np.zeros((n, n))
    for b in range(n):
        for a in range(b, n):
            T[b, a] = L[a, b]
        for k in range(b):
            f = C[b, k]
            for a in range(n):
                T[b, a] -= f * T[k, a]
        f = 1.0 / C[b, b]
        for a in range(n):
            T[b, a] *= f
        for a in range(n):
            f = T[b, a]
            for c in range(a + 1):
                P1[a, c] += f * T[b, c]
    for a in range(n):
        for b in range(a):
            P1[b, a] = P1[a, b]
    d = i - times(I, x)
    v = times(T, d)  # C' v = T d, so that x1 - x = L v
    moved = 0.0
    for a in range(n - 1, -1, -1):
        for k in range(a + 1, n):
            v[a] -= C[k, a] * v[k]
        v[a] /= C[a, a]
        moved += v[a] * v[a]
    x1, P1 = refuse_unsound(x + times(P1, d), P1)
    return x1, P1, moved


@compiled
def turned(i: Array, I: Array, x: Array, yaw: float, heading_bias: float) -> Array:  # noqa: E741
    """Return `i` (n,) moved to the count of turns of `x`.

    `yaw` and `heading_bias` [rad] are where the contribution was linearised, as its sender counts.
    """
    moved = i.copy()
    b = heading_bias_index(x.size)
    turns = round((x[YAW] - yaw) / _TURN)
    bias_turns = round((x[b] - heading_bias) / _TURN) if b >= 0 else 0
    for k in range(x.size):
        if turns != 0:
            moved[k] += turns * _TURN * I[k, YAW]
        if bias_turns != 0:
            moved[k] += bias_turns * _TURN * I[k, b]
    return moved


@compiled
def assimilate_turned(
    x: Array,
    P: Array,
    i: Array,
    I: Array,  # noqa: E741
    yaw: float,
    heading_bias: float,
) -> tuple[Array, Array]:
    """Return `assimilate` of a contribution of another count of turns, see `turned`.

    NaN throughout when it would move the mean by more than a thousand deviations.
    """
    x1, P1, moved = _assimilated(x, P, turned(i, I, x, yaw, heading_bias), I)
    if moved > _MOST_MOVED:
        x1[:] = np.nan
        P1[:] = np.nan
    return x1, P1


@compiled
def predict_and_assimilate(
    x: Array,
    P: Array,
    dt: float,
    u: Array,
    gains: Array,
    drags: Array,
    densities: Array,
    i: Array,
    I: Array,  # noqa: E741
    yaw: float,
    heading_bias: float,
) -> tuple[Array, Array]:
    """Return `assimilate_turned` after `dt` [s]: what a node does with most that it hears.

    Getting into compiled code and back costs more than either of both.
    """
    x1, P1 = predict(x, P, dt, u, gains, drags, densities)
    return assimilate_turned(x1, P1, i, I, yaw, heading_bias)
