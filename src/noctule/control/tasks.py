"""Tasks on what the camera sees: collision avoidance and visibility."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from noctule.control.hierarchy import TaskRows
from noctule.errors import NoctuleError
from noctule.geometry import Array


class TaskError(NoctuleError):
    """A task that was built from numbers it cannot work with."""


def point_interaction(m: Array, depth: float) -> Array:
    """Return the interaction matrix of a normalised point, (2, 6): m_dot = L nu_c.

    `m` (2,) is the point, `depth` [m] its z in the camera, nu_c = (v, w) the camera's twist in its own axes.
    Corrected: the paper's twist prints w_y twice; the first is w_x.
    """
    x, y = m[0], m[1]
    return np.array(
        [
            [-1.0 / depth, 0.0, x / depth, x * y, -(1.0 + x * x), y],
            [0.0, -1.0 / depth, y / depth, 1.0 + y * y, -x * y, -x],
        ]
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Task(ABC):
    """Something to bring to zero, as it was measured at one tick.

    A task has an error e (m,), in any units, and its Jacobian J (m, 6): e_dot = J nu_c, with nu_c = (v, w)
    (6,) the twist of the camera in its own right-down-forward axes [m/s, rad/s]. It asks for e_dot = -gain e,
    so that e falls as exp(-gain t) while it is the top active task. The drone moves in four degrees of
    freedom only, so the hierarchy is handed J B (m, 4), with B (6, 4) from `servoing.camera_twist_matrix`.

    To add a task, write `error` and `jacobian`, and test the second by finite differences of the first.
    """

    gain: float  # [1/s]
    activation: float = 1.0  # h in [0, 1]

    def __post_init__(self) -> None:
        """Check gain and activation; a subclass with a check of its own calls this too."""
        if not (math.isfinite(self.gain) and self.gain > 0.0):
            raise TaskError(f"{self.name}: gain is {self.gain:g}, expected more than 0; or leave it out")
        if not 0.0 <= self.activation <= 1.0:
            raise TaskError(
                f"{self.name}: activation {self.activation:g}, expected 0 to 1; take Activation.h"
            )

    @abstractmethod
    def error(self) -> Array:
        """Return e, (m,)."""

    @abstractmethod
    def jacobian(self) -> Array:
        """Return J, (m, 6), of the camera's twist in its own axes."""

    @property
    def name(self) -> str:
        """The class name, for messages and recordings."""
        return type(self).__name__

    @property
    def demand(self) -> Array:
        """The wanted rate of the error, -gain e, (m,)."""
        return -self.gain * self.error()

    def rows(self, B: Array) -> TaskRows:
        """Return (J B, demand, activation) for the hierarchy; B (6, 4) is of `camera_twist_matrix`."""
        return TaskRows(self.jacobian() @ B, self.demand, self.activation)


def _check_depth(name: str, depth: float) -> None:
    if not (math.isfinite(depth) and depth > 0.0):
        raise TaskError(f"{name}: depth is {depth:g} m, expected more than 0; give an estimate")


@dataclass(frozen=True, slots=True, kw_only=True)
class CollisionAvoidance(Task):
    """Eqs. (8) and (9): hold the width of a column in the image at `sigma`.

    e = d - sigma with d = |m1 - m2|, active while e > 0. With L of
    `point_interaction`, J = (1/d) (m1 - m2)' (L(m1, z1) - L(m2, z2)), (1, 6).
    For equal depths and heights J has no lateral term: it stops forward motion and turns toward the column;
    what passes it is the servoing below.
    """

    m1: Array  # (2,), one edge of the column, normalised
    m2: Array  # (2,), the other edge
    z1: float  # [m], estimated depth of m1
    z2: float  # [m]
    sigma: float  # reference width, normalised

    def __post_init__(self) -> None:
        """Check the edges and depths."""
        Task.__post_init__(self)
        _check_depth(self.name, self.z1)
        _check_depth(self.name, self.z2)
        if not self.width > 0.0:
            raise TaskError(f"{self.name}: both edges at {np.asarray(self.m1).tolist()}, expected two points")

    @property
    def width(self) -> float:
        """The width d of the column in the image, normalised."""
        return float(np.linalg.norm(np.asarray(self.m1) - self.m2))

    def error(self) -> Array:
        """Return d - sigma, (1,)."""
        return np.array([self.width - self.sigma])

    def jacobian(self) -> Array:
        """Return J_a, (1, 6)."""
        along = (np.asarray(self.m1) - self.m2) / self.width
        return (along @ (point_interaction(self.m1, self.z1) - point_interaction(self.m2, self.z2)))[None, :]


@dataclass(frozen=True, slots=True, kw_only=True)
class Visibility(Task):
    """Eqs. (10) to (12): bring the centroid of the points to `centroid_ref`.

    e = mean(m) - c*, (2,); J is that of a virtual point at the centroid at the estimated depth, (2, 6), an
    approximation: in a cloud with variance s^2 along x the true yaw column is -(1 + x^2 + s^2).

    The safety box and the desired centroid must agree: with c* at the image centre and target points outside
    the box, this task and servoing block each other. Use matches whose reference is inside the box, and their
    own centroid as c*; `SafetyBox` does both.
    """

    points: Array  # (n, 2), current points, normalised
    centroid_ref: Array  # (2,), normalised
    depth: float  # [m], estimated
    centroid: Array = field(init=False)  # (2,), normalised

    def __post_init__(self) -> None:
        """Check the points and the depth, and take the centroid once."""
        Task.__post_init__(self)
        _check_depth(self.name, self.depth)
        shape = np.shape(self.points)
        if len(shape) != 2 or shape[1] != 2 or shape[0] == 0:
            raise TaskError(f"{self.name}: points have shape {shape}, expected (n, 2) with n of 1 or more")
        object.__setattr__(self, "centroid", np.mean(self.points, axis=0))

    def error(self) -> Array:
        """Return the centroid minus the desired one, (2,)."""
        return np.asarray(self.centroid - self.centroid_ref)

    def jacobian(self) -> Array:
        """Return J_m, (2, 6)."""
        return point_interaction(self.centroid, self.depth)


@dataclass(frozen=True, slots=True)
class SafetyBox:
    """The part of the picture in which points are safe from leaving it."""

    left: float  # [px]
    top: float  # [px]
    right: float  # [px]
    bottom: float  # [px]

    def __post_init__(self) -> None:
        """Refuse an empty box."""
        if not (self.left < self.right and self.top < self.bottom):
            raise TaskError(
                f"SafetyBox: ({self.left:g}, {self.top:g}) to ({self.right:g}, {self.bottom:g}) px is empty, "
                "expected left < right and top < bottom"
            )

    def contains(self, p: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return which of the points (n, 2) [px] are inside, (n,)."""
        low, high = np.array([self.left, self.top]), np.array([self.right, self.bottom])
        return np.asarray(((p >= low) & (p <= high)).all(axis=1))

    def centroid_of(self, p_ref: Array) -> Array | None:
        """Return the centroid (2,) [px] of the reference points (n, 2) [px] inside; None when none is."""
        inside = p_ref[self.contains(p_ref)]
        return np.asarray(inside.mean(axis=0)) if len(inside) else None
