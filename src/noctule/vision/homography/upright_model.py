"""The `upright` model of two views: a turn in yaw, a translation, and an inverse depth per point.

Unknowns, in this order: yaw, t (3), slopes a and b, roll, pitch. In coordinates of the reference camera (RDF)

    X_cur = R X_ref + rho t,   R = R_z(roll) R_x(pitch) R_y(yaw),   X_ref = (x, y, 1),
    rho   = 1 + a (x - x_mean) + b (y - y_mean) + deviation,   deviation ~ N(0, spread^2),

where rho is a point's inverse depth in units of the mean inverse depth, so t is in harmonic mean depths.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from noctule.compiled import compiled
from noctule.geometry import Array

YAW, TX, TY, TZ, SLOPE_X, SLOPE_Y, ROLL, PITCH = range(8)
N_PARAMETERS = 8
NEWTON_STEPS = 4
NEAREST = 0.05
"""A point's depth in the current camera, in reference depths, is never taken to be less than this."""


class TwoViews(NamedTuple):
    """The matched points, and what is assumed about them."""

    m_ref: Array  # (n, 2)
    m_cur: Array  # (n, 2)
    centre: Array  # (2,), mean of m_ref
    noise: float  # of both images together, in normalised units
    spread: float  # standard deviation of a point's inverse depth about the sloped plane
    prior: Array  # (8,), inverse variances of the unknowns
    n_free: int  # 6 with roll and pitch held, else 8


@compiled
def rotation(yaw: float, roll: float, pitch: float) -> Array:
    """Return R_z(roll) R_x(pitch) R_y(yaw), (3, 3); angles [rad] about the camera's axes."""
    cy, sy = math.cos(yaw), math.sin(yaw)
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = cr * cy - sr * sp * sy, -sr * cp, cr * sy + sr * sp * cy
    R[1, 0], R[1, 1], R[1, 2] = sr * cy + cr * sp * sy, cr * cp, sr * sy - cr * sp * cy
    R[2, 0], R[2, 1], R[2, 2] = -cp * sy, sp, cp * cy
    return R


@compiled
def rotation_derivatives(yaw: float, roll: float, pitch: float) -> Array:
    """Return dR/dyaw, dR/droll and dR/dpitch of `rotation`, (3, 3, 3)."""
    cy, sy = math.cos(yaw), math.sin(yaw)
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    D = np.zeros((3, 3, 3))
    D[0, 0, 0], D[0, 0, 2] = -cr * sy - sr * sp * cy, cr * cy - sr * sp * sy
    D[0, 1, 0], D[0, 1, 2] = -sr * sy + cr * sp * cy, sr * cy + cr * sp * sy
    D[0, 2, 0], D[0, 2, 2] = -cp * cy, -cp * sy
    D[1, 0, 0], D[1, 0, 1], D[1, 0, 2] = -sr * cy - cr * sp * sy, -cr * cp, -sr * sy + cr * sp * cy
    D[1, 1, 0], D[1, 1, 1], D[1, 1, 2] = cr * cy - sr * sp * sy, -sr * cp, cr * sy + sr * sp * cy
    D[2, 0, 0], D[2, 0, 1], D[2, 0, 2] = -sr * cp * sy, sr * sp, sr * cp * cy
    D[2, 1, 0], D[2, 1, 1], D[2, 1, 2] = cr * cp * sy, -cr * sp, -cr * cp * cy
    D[2, 2, 0], D[2, 2, 1], D[2, 2, 2] = sp * sy, cp, -sp * cy
    return D


@compiled
def project(
    qx: float, qy: float, qz: float, tx: float, ty: float, tz: float, rho: float
) -> tuple[float, float, float]:
    """Return the image (u, v) of q + rho t, and 1 / its depth; q = R X_ref."""
    inverse_z = 1.0 / max(qz + rho * tz, NEAREST)
    return (qx + rho * tx) * inverse_z, (qy + rho * ty) * inverse_z, inverse_z


@compiled
def best_inverse_depth(
    qx: float,
    qy: float,
    qz: float,
    tx: float,
    ty: float,
    tz: float,
    u_seen: float,
    v_seen: float,
    rho_model: float,
    noise: float,
    spread: float,
) -> float:
    """Return the rho that minimises |r|^2 / noise^2 + (rho - rho_model)^2 / spread^2, by four Newton steps.

    r = pi(q + rho t) - m_cur. The second derivative is taken as g'g, g = dr/drho.
    """
    ratio = (noise / spread) ** 2
    rho = rho_model
    for _ in range(NEWTON_STEPS):
        u, v, inverse_z = project(qx, qy, qz, tx, ty, tz, rho)
        gu, gv = (tx - u * tz) * inverse_z, (ty - v * tz) * inverse_z
        slope = gu * (u - u_seen) + gv * (v - v_seen) + ratio * (rho - rho_model)
        rho -= slope / (gu * gu + gv * gv + ratio)
    return rho


@compiled
def model_inverse_depth(parameters: Array, dx: float, dy: float) -> float:
    """Return 1 + a dx + b dy, the inverse depth of the sloped plane."""
    return 1.0 + float(parameters[SLOPE_X]) * dx + float(parameters[SLOPE_Y]) * dy


@compiled
def residual(
    parameters: Array, R: Array, views: TwoViews, j: int
) -> tuple[float, float, float, float, float, float, float, float]:
    """Return (e_u, e_v, g_u, g_v, rho, u, v, 1/z) of point j, linearised at its best inverse depth.

    With rho the best inverse depth, e = r + g (rho_model - rho) is the residual that the linear model
    predicts at rho_model; its covariance is C = noise^2 I + spread^2 g g', and e' C^-1 e is the least value
    of |r|^2 / noise^2 + (rho - rho_model)^2 / spread^2.
    """
    x, y, m = views.m_ref[j, 0], views.m_ref[j, 1], views.m_cur[j]
    tx, ty, tz = parameters[TX], parameters[TY], parameters[TZ]
    qx = R[0, 0] * x + R[0, 1] * y + R[0, 2]
    qy = R[1, 0] * x + R[1, 1] * y + R[1, 2]
    qz = R[2, 0] * x + R[2, 1] * y + R[2, 2]
    rho_model = model_inverse_depth(parameters, x - views.centre[0], y - views.centre[1])
    rho = best_inverse_depth(qx, qy, qz, tx, ty, tz, m[0], m[1], rho_model, views.noise, views.spread)
    u, v, inverse_z = project(qx, qy, qz, tx, ty, tz, rho)
    gu, gv = (tx - u * tz) * inverse_z, (ty - v * tz) * inverse_z
    gap = rho_model - rho
    return u - m[0] + gu * gap, v - m[1] + gv * gap, gu, gv, rho, u, v, inverse_z


@compiled
def jacobian(
    D: Array,
    views: TwoViews,
    j: int,
    at: tuple[float, float, float, float, float, float, float, float],
    J: Array,
) -> None:
    """Write de/dparameters of point j into J (2, 8), taken at its best inverse depth; `at` is `residual`'s.

    With d(u, v)/dX = ((1, 0, -u), (0, 1, -v)) / z: dX/dangle = dR/dangle X_ref, dX/dt = rho I, and the slopes
    act through rho_model: de/da = g dx, de/db = g dy.
    """
    _, _, gu, gv, rho, u, v, inverse_z = at
    x, y = views.m_ref[j, 0], views.m_ref[j, 1]
    dx, dy = x - views.centre[0], y - views.centre[1]
    for k in range(3):
        if k == 0 or views.n_free == N_PARAMETERS:
            column = YAW if k == 0 else (ROLL if k == 1 else PITCH)
            vx = D[k, 0, 0] * x + D[k, 0, 1] * y + D[k, 0, 2]
            vy = D[k, 1, 0] * x + D[k, 1, 1] * y + D[k, 1, 2]
            vz = D[k, 2, 0] * x + D[k, 2, 1] * y + D[k, 2, 2]
            J[0, column] = (vx - u * vz) * inverse_z
            J[1, column] = (vy - v * vz) * inverse_z
    J[0, TX], J[0, TY], J[0, TZ] = rho * inverse_z, 0.0, -u * rho * inverse_z
    J[1, TX], J[1, TY], J[1, TZ] = 0.0, rho * inverse_z, -v * rho * inverse_z
    J[0, SLOPE_X], J[1, SLOPE_X] = gu * dx, gv * dx
    J[0, SLOPE_Y], J[1, SLOPE_Y] = gu * dy, gv * dy
