"""Homographies between two views: `planar`, `generic` and `upright` behind one call."""

from noctule.vision.homography.registry import METHODS, Estimator, estimate_homography
from noctule.vision.homography.result import (
    EstimatorValueError,
    HomographyEstimate,
    NoHomographyError,
    NonFinitePointsError,
    PointShapeError,
    TooFewPointsError,
    UnknownMethodError,
)
from noctule.vision.homography.upright import estimate_upright, refine_upright

__all__ = [
    "METHODS",
    "Estimator",
    "EstimatorValueError",
    "HomographyEstimate",
    "NoHomographyError",
    "NonFinitePointsError",
    "PointShapeError",
    "TooFewPointsError",
    "UnknownMethodError",
    "estimate_homography",
    "estimate_upright",
    "refine_upright",
]
