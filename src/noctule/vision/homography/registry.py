"""The estimators by name, and the one call that picks among them."""

from __future__ import annotations

from typing import Protocol

from numpy.typing import ArrayLike

from noctule.vision.homography.generic import estimate_generic
from noctule.vision.homography.planar import estimate_planar
from noctule.vision.homography.result import (
    HomographyEstimate,
    UnknownMethodError,
)
from noctule.vision.homography.upright import estimate_upright


class Estimator(Protocol):
    """What a method has to accept."""

    def __call__(
        self,
        m_ref: ArrayLike,
        m_current: ArrayLike,
        attitude_sd: float = 0.0,
        *,
        start: HomographyEstimate | None = None,
        noise: float | None = None,
        seed: int = 0,
    ) -> HomographyEstimate:
        """Estimate the homography from the reference to the current view."""


METHODS: dict[str, Estimator] = {
    "generic": estimate_generic,
    "planar": estimate_planar,
    "upright": estimate_upright,
}
"""Add an estimator by adding its name here."""


def estimate_homography(
    m_ref: ArrayLike,
    m_current: ArrayLike,
    method: str = "upright",
    attitude_sd: float = 0.0,
    *,
    start: HomographyEstimate | None = None,
    noise: float | None = None,
    seed: int = 0,
) -> HomographyEstimate:
    """Estimate the homography from the reference to the current view of the same points.

    Parameters
    ----------
    m_ref, m_current
        Matched points (n, 2) in normalised coordinates, each with its own camera's principal point removed.
    method
        A name in METHODS. The result's `method` is the one really used.
    attitude_sd
        For `upright`: standard deviation [rad] of the roll and pitch that are left between the views.
    start
        For `upright`: the estimate of the previous tick.
    noise
        Of a match, both images together, in normalised units; a default, or estimated, where it is None.
    seed
        Of random draws; the same input and seed give the same estimate bit for bit.

    Raises
    ------
    UnknownMethodError, PointShapeError, NonFinitePointsError, TooFewPointsError, EstimatorValueError,
    NoHomographyError

    """
    estimator = METHODS.get(method)
    if estimator is None:
        raise UnknownMethodError(
            f"homography: unknown method '{method}', expected one of {', '.join(sorted(METHODS))}; "
            "correct the name"
        )
    return estimator(m_ref, m_current, attitude_sd, start=start, noise=noise, seed=seed)
