"""`upright`: yaw and translation of a camera whose roll and pitch are known, or nearly."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from noctule.geometry import Array, wrap_angle
from noctule.vision.homography.compiled import compiled
from noctule.vision.homography.result import (
    DEFAULT_NOISE,
    HomographyEstimate,
    checked_points,
    scaled_homography,
)
from noctule.vision.homography.upright_model import (
    N_PARAMETERS,
    PITCH,
    ROLL,
    SLOPE_X,
    SLOPE_Y,
    TX,
    TZ,
    YAW,
    residual,
    rotation,
)
from noctule.vision.homography.upright_solver import (
    cholesky,
    cholesky_solve,
    mahalanobis,
    minimise,
    normal_equations,
)
from noctule.vision.homography.upright_start import distinct_best, sample_candidates, sized_start

LEAST_POINTS = 5
SPREAD = 0.5
SLOPE_SD = 0.5
CAUCHY = 2.4
N_DRAWS = 100
N_REFINED = 8
N_FINISHED = 3
INLIER_CHI2 = 11.8  # 3 standard deviations of a point in the plane
T_CHI2 = 11.34  # 99 % of chi-square with 3 degrees of freedom
NOISE_PRIOR_POINTS = 6.0


@compiled
def describe(
    parameters: Array,
    m_ref: Array,
    m_cur: Array,
    centre: Array,
    noise: float,
    spread: float,
) -> tuple[Array, Array, Array]:
    """Return per point e' C^-1 e, the best inverse depth, and the residual across the epipolar line."""
    n = len(m_ref)
    chi2, depth, across = np.empty(n), np.empty(n), np.empty(n)
    R = rotation(parameters[YAW], parameters[ROLL], parameters[PITCH])
    for j in range(n):
        x, y = m_ref[j, 0], m_ref[j, 1]
        at = residual(parameters, R, x, y, x - centre[0], y - centre[1], m_cur[j], noise, spread)
        eu, ev, gu, gv = at[0], at[1], at[2], at[3]
        chi2[j], _ = mahalanobis(eu, ev, gu, gv, noise, spread)
        depth[j] = at[4]
        size = math.sqrt(gu * gu + gv * gv) + 1e-12
        across[j] = (gu * ev - gv * eu) / size
    return chi2, depth, across


@compiled
def inverse_of(A: Array, n: int) -> Array:
    """Return the inverse of the leading n x n block of a positive definite matrix, zeros elsewhere."""
    L = np.zeros((N_PARAMETERS, N_PARAMETERS))
    out = np.zeros((N_PARAMETERS, N_PARAMETERS))
    unit = np.zeros(N_PARAMETERS)
    if not cholesky(A, n, 1e-12, L):
        for k in range(n):
            out[k, k] = np.inf
        return out
    for k in range(n):
        unit[:] = 0.0
        unit[k] = 1.0
        cholesky_solve(L, n, unit, out[k])
    return out


def prior_weights(attitude_sd: float) -> Array:
    """Return the (8,) inverse variances of the priors: slopes, and roll and pitch where they are free."""
    prior = np.zeros(N_PARAMETERS)
    prior[SLOPE_X] = prior[SLOPE_Y] = 1.0 / SLOPE_SD**2
    if attitude_sd > 0.0:
        prior[ROLL] = prior[PITCH] = 1.0 / attitude_sd**2
    return prior


@dataclass(frozen=True, slots=True)
class Problem:
    """Everything of one estimate that does not change while it is being made."""

    m_ref: Array
    m_cur: Array
    centre: Array
    spread: float
    prior: Array
    cauchy: float
    n_free: int
    attitude_sd: float

    def minimise(self, parameters: Array, noise: float, steps: int) -> float:
        """Refine `parameters` in place; return the cost."""
        return minimise(
            parameters, self.m_ref, self.m_cur, self.centre, noise, self.spread, self.prior, self.cauchy,
            self.n_free, steps,
        )  # fmt: skip

    def noise_at(self, parameters: Array, noise: float) -> float:
        across = describe(parameters, self.m_ref, self.m_cur, self.centre, noise, self.spread)[2]
        n = len(across)
        dof = max(n - (self.n_free - 2), 1)
        sd2 = (1.4826 * float(np.median(np.abs(across)))) ** 2 * n / dof
        return math.sqrt((NOISE_PRIOR_POINTS * DEFAULT_NOISE**2 + dof * sd2) / (NOISE_PRIOR_POINTS + dof))


def make_problem(m_ref: Array, m_cur: Array, attitude_sd: float, spread: float = SPREAD) -> Problem:
    n_free = N_PARAMETERS if attitude_sd > 0.0 else N_PARAMETERS - 2
    return Problem(
        m_ref, m_cur, m_ref.mean(axis=0), spread, prior_weights(attitude_sd), CAUCHY, n_free, attitude_sd
    )


def estimate_at(problem: Problem, parameters: Array, noise: float, cost: float) -> HomographyEstimate:
    """Describe the minimum at `parameters` as an estimate."""
    chi2, depth, _ = describe(parameters, problem.m_ref, problem.m_cur, problem.centre, noise, problem.spread)
    inliers = chi2 < INLIER_CHI2
    A = np.zeros((N_PARAMETERS, N_PARAMETERS))
    normal_equations(
        parameters, problem.m_ref, problem.m_cur, problem.centre, noise, problem.spread, problem.prior,
        problem.cauchy, problem.n_free, A, np.zeros(N_PARAMETERS),
    )  # fmt: skip
    # The mean over the inliers may differ a little from the prior's 1: this makes the unit of t exact.
    scale = float(depth[inliers].mean()) if inliers.any() else 1.0
    unit = np.array([1.0, scale, scale, scale])
    covariance = inverse_of(A, problem.n_free)[:4, :4] * np.outer(unit, unit)
    t = parameters[TX : TZ + 1] * scale
    H = rotation(parameters[YAW], parameters[ROLL], parameters[PITCH])
    H[:, 2] += t
    defined = bool(t @ np.linalg.solve(covariance[1:, 1:], t) > T_CHI2)
    return HomographyEstimate(
        H=scaled_homography(H, problem.m_ref, problem.m_cur),
        method="upright",
        quality=float(np.mean(np.maximum(0.0, 1.0 - chi2 / INLIER_CHI2))),
        inliers=inliers,
        noise=noise,
        yaw=wrap_angle(float(parameters[YAW])),
        t=t,
        covariance=covariance,
        roll=float(parameters[ROLL]),
        pitch=float(parameters[PITCH]),
        slopes=parameters[SLOPE_X : SLOPE_Y + 1].copy(),
        t_defined=defined,
        cost=cost,
        parameters=parameters.copy(),
    )


def cold_starts(problem: Problem, noise: float, seed: int) -> list[Array]:
    """Return parameters to start from, best first: three-point RANSAC, and the view that only turned."""
    rng = np.random.default_rng(seed)
    n = len(problem.m_ref)
    triples = rng.random((N_DRAWS, n)).argpartition(3, axis=1)[:, :3]
    tilts = rng.normal(0.0, 1.0, (N_DRAWS, 2)) * problem.attitude_sd
    limit = 3.0 * noise
    found, scores = sample_candidates(problem.m_ref, problem.m_cur, triples, tilts, limit)
    starts = []
    for index in distinct_best(found, scores, N_REFINED, 0.02, 0.98):
        start = np.zeros(N_PARAMETERS)
        sized_start(found[index], problem.m_ref, problem.m_cur, limit, start)
        starts.append(start)
    turned = np.zeros(N_PARAMETERS)
    turned[YAW] = np.median(np.arctan(problem.m_cur[:, 0]) - np.arctan(problem.m_ref[:, 0]))
    return [*starts, turned]


def solve_cold(problem: Problem, noise: float, seed: int) -> list[tuple[float, Array]]:
    """Return the distinct minima as (cost, parameters), best first."""
    tried = []
    for start in cold_starts(problem, noise, seed):
        cost = problem.minimise(start, noise, 4)
        tried.append((cost, start))
    tried.sort(key=lambda pair: pair[0])
    finished = []
    for _, start in tried[:N_FINISHED]:
        cost = problem.minimise(start, noise, 20)
        finished.append((cost, start))
    finished.sort(key=lambda pair: pair[0])
    return finished


def estimate_upright(
    m_ref: ArrayLike,
    m_current: ArrayLike,
    attitude_sd: float = 0.0,
    *,
    start: HomographyEstimate | None = None,
    noise: float | None = None,
    spread: float = SPREAD,
    seed: int = 0,
) -> HomographyEstimate:
    """Estimate yaw and t between two views of an upright camera."""
    a, b = checked_points(m_ref, m_current, "upright", LEAST_POINTS)
    problem = make_problem(a, b, attitude_sd, spread)
    level = DEFAULT_NOISE if noise is None else noise
    if start is not None:
        parameters = start.parameters.copy()
        level = start.noise if noise is None else noise
        cost = problem.minimise(parameters, level, 10)
        warm = estimate_at(problem, parameters, level, cost)
        if warm.inliers.mean() > 0.5:
            return warm
    minima = solve_cold(problem, level, seed)
    cost, parameters = minima[0]
    if noise is None:
        for _ in range(2):
            level = problem.noise_at(parameters, level)
            cost = problem.minimise(parameters, level, 10)
    return replace(estimate_at(problem, parameters, level, cost), note="")


def refine_upright(
    m_ref: NDArray[np.float64], m_current: NDArray[np.float64], start: HomographyEstimate, attitude_sd: float = 0.0
) -> HomographyEstimate:
    """Warm-start `upright` from the estimate of the previous tick."""
    return estimate_upright(m_ref, m_current, attitude_sd, start=start)
