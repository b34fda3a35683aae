"""`upright`: yaw and translation of a camera whose roll and pitch are known, or nearly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from noctule.geometry import Array
from noctule.vision.homography.result import (
    DEFAULT_NOISE,
    HomographyEstimate,
    checked_options,
    checked_points,
)
from noctule.vision.homography.upright_answers import Minimum, distinct, nearest_first, still_open
from noctule.vision.homography.upright_cost import describe
from noctule.vision.homography.upright_model import N_PARAMETERS, PITCH, ROLL, SLOPE_X, SLOPE_Y, TwoViews
from noctule.vision.homography.upright_noise import estimate_noise
from noctule.vision.homography.upright_report import estimate_at
from noctule.vision.homography.upright_solver import COARSE, FINE, minimise
from noctule.vision.homography.upright_start import cold_starts

LEAST_POINTS = 5
SPREAD = 0.6
"""Standard deviation of inverse depths about the sloped plane; 0.5 to 0.7 measure alike in all scenes."""
SLOPE_SD = 0.5
N_FINISHED = 3

MEDIAN_CHI2 = 1.39
"""Median of chi-square with two degrees of freedom."""
FAR_OFF = 9.0
"""A start is far off where the residuals are three times what noise explains."""
CHECK_DRAWS = 60
CHECK_STARTS = 3
"""With a free attitude a warm start alone slides into a second minimum: each tick tries fresh starts."""
WARM_SHARE = 0.5
WARM_LOSS = 0.85
WARM_NOISE = 1.25
WARM_COST = 1.3
"""A warm start is dropped that explains less than the first share of the points, or less than the second
share of what the tick before explained, or at more than these multiples of its noise or cost."""


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


def held(parameters: Array, views: TwoViews) -> Array:
    """Return a copy of the parameters (8,) with roll and pitch at zero where they are not free."""
    parameters = parameters.copy()
    parameters[ROLL] = parameters[PITCH] = 0.0
    return parameters


def approach(parameters: Array, views: TwoViews) -> None:
    """Move `parameters` to the minimum nearby, first with a noise that explains how far off they are.

    Far off, every point looks like an outlier, and each would explain itself by its own depth.
    """
    excess = float(np.median(describe(parameters, views)[0])) / MEDIAN_CHI2
    if excess > FAR_OFF:
        minimise(parameters, views._replace(noise=views.noise * (2.0 * excess) ** 0.5), False, 4, COARSE)
    minimise(parameters, views, False, 8, COARSE)


def follow(
    views: TwoViews, start: HomographyEstimate, attitude_sd: float, fixed_noise: bool, seed: int
) -> tuple[TwoViews, list[Minimum]]:
    """Return the minima near `start` and its alternatives, in this order, and the views with their noise."""
    if not fixed_noise:
        views = views._replace(noise=start.noise)
    parameters = held(start.parameters, views)
    approach(parameters, views)
    if not fixed_noise:
        views = with_noise(views, parameters, 2)
    minima = [(minimise(parameters, views, True, 8, FINE), parameters)]
    others = [held(other.parameters, views) for other in start.alternatives]
    if attitude_sd > 0.0:
        others += cold_starts(views, attitude_sd, seed, CHECK_DRAWS, CHECK_STARTS)[:CHECK_STARTS]
    for parameters in others:
        approach(parameters, views)
        minima.append((minimise(parameters, views, True, 8, FINE), parameters))
    return views, minima


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
        Matched points (n, 2), normalised; roll and pitch as far as known taken out (`camera.derotate`).
    attitude_sd
        Standard deviation [rad] of what is left of roll and pitch; 0 holds both at zero.
    start
        The estimate of the previous tick: the search starts there and in its alternatives, and only where
        that explains too few of the points does it start anew, and then prefers, among answers that explain
        them alike, the one near `start`. Without it (a new key image) it starts cold.
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
        warm, minima = follow(views, start, attitude_sd, noise is not None, seed)
        minima = still_open(minima)
        followed = estimate_at(warm, minima[0])
        least = max(WARM_SHARE, WARM_LOSS * float(start.inliers.mean()))
        worse = followed.noise > WARM_NOISE * start.noise or followed.cost > WARM_COST * start.cost
        if float(followed.inliers.mean()) >= least and not worse:
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
