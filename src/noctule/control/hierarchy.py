"""The exact hierarchy of tasks with smooth activation, in the four degrees of freedom that exist."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from noctule.errors import NoctuleError
from noctule.geometry import Array

RELATIVE_CUT = 1e-6
"""Singular values of J N below this part of the (Frobenius) norm of J count as zero."""

ABSOLUTE_CUT = 1e-12
"""A Jacobian whose norm is below this says nothing about the motion."""


class HierarchyError(NoctuleError):
    """Tasks that do not fit the four degrees of freedom, or numbers that are none."""


class TaskRows(NamedTuple):
    """What the hierarchy needs of a task: wanted is J @ nu = demand, as far as `activation` goes."""

    J: Array  # (m, 4), of the body velocity (forward, left, up, yaw rate)
    demand: Array  # (m,), wanted rate of the task's error
    activation: float = 1.0  # h in [0, 1]


def solve_hierarchy(tasks: Sequence[tuple[Array, Array, float]], bottom: Array) -> Array:
    """Return the velocity (4,) that serves `tasks`, highest first, and below them `bottom`.

    Parameters
    ----------
    tasks
        (J (m, 4), demand (m,), activation in [0, 1]) each; `TaskRows` is such a tuple.
    bottom
        (4,), the velocity wanted by the lowest task, whose Jacobian is the identity.

    Notes
    -----
    For a set S of tasks the strict hierarchy is eqs. (13) to (16) of Toro-Arcila et al.:
    nu <- nu + (J N)^+ (demand - J nu), N <- N - (J N)^+ (J N), task by task, and at last nu + N (bottom -
    nu). The result is the convex combination of these over all subsets S, weighted by the product of h_i (i
    in S) and 1 - h_i (i not in S). Corrected: (17) to (19) let an inactive task leak into the command, by up
    to 159 %. Both agree when every h is 1.

    Undamped: the bottom task has J = I and needs no damping, and damping would spoil the tasks above.
    Singular values of J N below 1e-6 of the norm of J are cut, so that a task's unit does not matter. A
    task whose activation is 0 has its shape checked and is otherwise not read. k tasks that are fading cost
    2^k solutions.

    Raises
    ------
    HierarchyError
        When a shape, an activation or a number is not as above.
    """
    wanted = _checked_bottom(bottom)
    active = [rows for i, task in enumerate(tasks) if (rows := _checked(i, task)).activation > 0.0]
    return _descend(active, wanted, np.zeros(4), np.eye(4))


def _descend(tasks: list[TaskRows], bottom: Array, nu: Array, Z: Array) -> Array:
    """Serve `tasks` below what fixed `nu`; the columns of Z (4, k) span what is still free.

    Z is an orthonormal basis of the range of the paper's projector, N = Z Z'. Working in it keeps the tasks
    above exact to rounding even where J N is nearly singular; a product of projectors loses six digits there.
    """
    if Z.shape[1] == 0:
        return nu
    if not tasks:
        return np.asarray(nu + Z @ (Z.T @ (bottom - nu)))
    (J, demand, h), lower = tasks[0], tasks[1:]
    with_task = _descend(lower, bottom, *_serve(J, demand, nu, Z))
    if h == 1.0:
        return with_task
    return h * with_task + (1.0 - h) * _descend(lower, bottom, nu, Z)


def _serve(J: Array, demand: Array, nu: Array, Z: Array) -> tuple[Array, Array]:
    """Return nu + (J N)^+ (demand - J nu) and the basis of what is free below this task."""
    size = float(np.linalg.norm(J))
    if size < ABSOLUTE_CUT:
        return nu, Z
    U, s, Vt = np.linalg.svd(J @ Z / size)
    rank = int(np.count_nonzero(s > RELATIVE_CUT))
    gap = (demand - J @ nu) / size
    return nu + Z @ (Vt[:rank].T @ (U[:, :rank].T @ gap / s[:rank])), Z @ Vt[rank:].T


def _checked_bottom(bottom: Array) -> Array:
    wanted = np.asarray(bottom, dtype=np.float64)
    if wanted.shape != (4,):
        raise HierarchyError(
            f"bottom: shape is {wanted.shape}, expected (4,); take a camera twist through body_velocity first"
        )
    if not np.isfinite(wanted).all():
        raise HierarchyError(f"bottom: {wanted.tolist()} is not finite; check the servoing error")
    return wanted


def _checked(index: int, task: tuple[Array, Array, float]) -> TaskRows:
    J, demand = np.asarray(task[0], dtype=np.float64), np.asarray(task[1], dtype=np.float64)
    h = float(task[2])
    if J.ndim != 2 or J.shape[1] != 4:
        raise HierarchyError(
            f"task {index}: J has shape {J.shape}, expected (m, 4); multiply a camera Jacobian (m, 6) by B"
        )
    if demand.shape != J.shape[:1]:
        raise HierarchyError(
            f"task {index}: demand has shape {demand.shape}, expected {J.shape[:1]}, one for each row of J"
        )
    if not 0.0 <= h <= 1.0:
        raise HierarchyError(f"task {index}: activation is {h:g}, expected 0 to 1; take Activation.h")
    if h > 0.0 and not (np.isfinite(J).all() and np.isfinite(demand).all()):
        raise HierarchyError(f"task {index}: J or demand is not finite; check its measurement and depth")
    return TaskRows(J, demand, h)
