"""How well least squares knows its parameters, when what is left is white noise and when it is not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from noctule.geometry import Array

CORRELATED = 0.15
"""Correlation of neighbouring residuals, either way, above which they are not taken for white noise."""
_NOTHING = 1e-14
_LAGS = 90  # residuals farther apart than this are taken for independent: gusts last less than 3 s at 30 Hz


def correlation(residuals: Array) -> float:
    """Return the correlation of neighbours in (n,), 0 where all are 0."""
    square = float(residuals @ residuals)
    return float(residuals[1:] @ residuals[:-1]) / square if square > 0.0 else 0.0


def deviations(W: Array, residuals: Array, sizes: Sequence[int]) -> Array:
    """Return the standard deviations (p,) of least squares.

    `W` (n, p) and `residuals` (n,) are in units of the noise; `sizes` are the lengths of the stretches, one
    for each measured axis, that follow each other in them. For white noise it is (W' W)^-1. Residuals that
    are correlated hold less than their number says (gusts move a vehicle, and it keeps moving) or, when
    neighbours are opposed, more: of these Newey and West's covariance is taken.
    """
    bread = inverse(W.T @ W)
    meat = np.zeros(bread.shape)
    begin = 0
    for size in sizes:
        part, r = W[begin : begin + size], residuals[begin : begin + size]
        begin += size
        white = abs(correlation(r)) < CORRELATED
        meat += part.T @ part if white else long_run(part * r[:, None])
    return np.asarray(np.sqrt(np.maximum(np.diag(bread @ meat @ bread), 0.0)))


def inverse(A: Array) -> Array:
    """Return the inverse (p, p) of information; of what nothing is known, it is very large and never 0."""
    # In the units of each parameter, since information of one may be 10^12 times that of another.
    scale = np.sqrt(np.maximum(np.diag(A), _NOTHING))
    values, vectors = np.linalg.eigh(A / np.outer(scale, scale))
    return np.asarray((vectors / np.maximum(values, _NOTHING)) @ vectors.T / np.outer(scale, scale))


def long_run(scores: Array) -> Array:
    """Return the covariance (p, p) of the sum of `scores` (n, p) that follow each other in time."""
    total = scores.T @ scores
    for lag in range(1, min(_LAGS, scores.shape[0] - 1) + 1):
        product = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (_LAGS + 1)) * (product + product.T)
    return np.asarray(total)
