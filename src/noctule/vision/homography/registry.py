"""The estimators by name, and the one call that picks among them."""

from __future__ import annotations

from typing import Protocol

from numpy.typing import ArrayLike

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


METHODS: dict[str, Estimator] = {"planar": estimate_planar, "upright": estimate_upright}


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
    """Estimate the homography from the reference to the current view of the same points."""
    estimator = METHODS.get(method)
    if estimator is None:
        raise UnknownMethodError(
            f"homography: unknown method '{method}', expected one of {', '.join(sorted(METHODS))}; correct the name"
        )
    return estimator(m_ref, m_current, attitude_sd, start=start, noise=noise, seed=seed)
