"""What every homography estimator returns, and the mistakes of a caller."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from noctule.errors import NoctuleError
from noctule.geometry import Array

DEFAULT_NOISE = 1e-3
"""Noise of a match, both images together, in normalised units: half a pixel at a focal length of 510 px."""


class TooFewPointsError(NoctuleError):
    """Fewer matched points than the method can work with."""


class PointShapeError(NoctuleError):
    """Point arrays that are not two (n, 2) arrays of one length."""


class NonFinitePointsError(NoctuleError):
    """A coordinate is NaN or infinite."""


class UnknownMethodError(NoctuleError):
    """No estimator has this name."""


class EstimatorValueError(NoctuleError):
    """An option of an estimator is out of its range."""


class NoHomographyError(NoctuleError):
    """The points carry no homography: they coincide, or lie on one line."""


@dataclass(frozen=True, slots=True)
class HomographyEstimate:
    """A homography from the reference to the current view, and how far to trust it.

    Everything from `yaw` on belongs to `upright`; the other methods leave it at its default. The axes of the
    camera are RDF. R = R_z(roll) R_x(pitch) R_y(yaw), X_cur = R X_ref + t.
    """

    H: Array  # (3, 3), m_cur ~ H m_ref, median singular value 1, points in front
    method: str  # the method really used
    quality: float  # [0, 1]: the share of points that agree, less where they agree loosely
    inliers: NDArray[np.bool_]  # (n,)
    note: str = ""  # why another method than the one asked for was used, or a start was dropped
    noise: float = DEFAULT_NOISE  # of both images together, in normalised units, as estimated
    yaw: float = 0.0  # [rad], positive when the camera turned left
    t: Array = field(default_factory=lambda: np.zeros(3))  # (3,), harmonic mean depths of the inliers
    covariance: Array = field(default_factory=lambda: np.full((4, 4), np.inf))  # of (yaw, t)
    roll: float = 0.0  # [rad], about the optical axis
    pitch: float = 0.0  # [rad], about the camera's x axis
    slopes: Array = field(default_factory=lambda: np.zeros(2))  # (2,), of the inverse depth over its mean
    t_defined: bool = False  # t stands out of its noise, so its direction means something
    cost: float = np.inf  # of the fit; comparable between the answers for one set of points
    alternatives: tuple[HomographyEstimate, ...] = ()  # other answers that explain the points as well
    parameters: Array = field(
        default_factory=lambda: np.zeros(8)
    )  # (8,), unknowns as a warm start needs them


def checked_points(m_ref: ArrayLike, m_current: ArrayLike, method: str, n_least: int) -> tuple[Array, Array]:
    """Return both arrays as contiguous float64 (n, 2).

    Raises
    ------
    PointShapeError, NonFinitePointsError, TooFewPointsError

    """
    a = np.ascontiguousarray(m_ref, dtype=np.float64)
    b = np.ascontiguousarray(m_current, dtype=np.float64)
    if a.ndim != 2 or a.shape[1] != 2 or a.shape != b.shape:
        raise PointShapeError(
            f"homography '{method}': m_ref has shape {a.shape} and m_current {b.shape}, "
            "expected (n, 2) twice; pass matched points in rows"
        )
    if len(a) < n_least:
        raise TooFewPointsError(
            f"homography '{method}': {len(a)} matched points, at least {n_least} are needed; "
            "match more features or choose another method"
        )
    for name, points in (("m_ref", a), ("m_current", b)):
        if not np.isfinite(points).all():
            bad = int(np.count_nonzero(~np.isfinite(points).all(axis=1)))
            raise NonFinitePointsError(
                f"homography '{method}': {bad} of {len(points)} points in {name} are not finite, "
                "expected numbers; drop lost points first"
            )
    return a, b


def checked_options(method: str, attitude_sd: float, noise: float | None) -> None:
    """Refuse an attitude error or a noise that is no such thing.

    Raises
    ------
    EstimatorValueError

    """
    if not 0.0 <= attitude_sd <= 0.5:
        raise EstimatorValueError(
            f"homography '{method}': attitude_sd is {attitude_sd} rad, "
            "expected 0 (roll and pitch are exact) to 0.5; give the standard deviation in radians"
        )
    if noise is not None and not 0.0 < noise < 0.1:
        raise EstimatorValueError(
            f"homography '{method}': noise is {noise}, expected above 0 and below 0.1 in normalised units; "
            "divide pixels by the focal length"
        )


def scaled_homography(H: Array, m_ref: Array, m_current: Array) -> Array:
    """Scale H (3, 3) to a median singular value of 1 and the sign that puts the points in front.

    The sign is that of m_cur' H m_ref, positive for a point in front of both cameras; most points decide.
    """
    mapped = m_ref @ H[:, :2].T + H[:, 2]  # (n, 3)
    along = mapped[:, 2] + (mapped[:, :2] * m_current).sum(axis=1)
    sign = 1.0 if 2 * np.count_nonzero(along >= 0.0) >= len(along) else -1.0
    scale = float(np.linalg.svd(H, compute_uv=False)[1])
    return np.asarray(sign / scale * H)
