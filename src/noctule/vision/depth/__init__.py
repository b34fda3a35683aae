"""Depth images to foreground, blobs and shapes."""

from noctule.vision.depth.background import Background, BackgroundSettings, fits
from noctule.vision.depth.blob import Blob
from noctule.vision.depth.blobs import find_blobs
from noctule.vision.depth.errors import (
    DepthFormatError,
    EmptyBackgroundError,
    MovingBackgroundError,
    TooFewFramesError,
)
from noctule.vision.depth.learning import learn_background
from noctule.vision.depth.moments import Ellipse, ellipse, hu_moments, normalised_moments, shape_distance

__all__ = [
    "Background",
    "BackgroundSettings",
    "Blob",
    "DepthFormatError",
    "Ellipse",
    "EmptyBackgroundError",
    "MovingBackgroundError",
    "TooFewFramesError",
    "ellipse",
    "find_blobs",
    "fits",
    "hu_moments",
    "learn_background",
    "normalised_moments",
    "shape_distance",
]
