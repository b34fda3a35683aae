"""Depth images to foreground, blobs and shapes."""

from noctule.vision.depth.background import Background, BackgroundSettings, fits, learn_background
from noctule.vision.depth.blob import Blob
from noctule.vision.depth.errors import (
    DepthFormatError,
    EmptyBackgroundError,
    MovingBackgroundError,
    TooFewFramesError,
)

__all__ = [
    "Background",
    "BackgroundSettings",
    "Blob",
    "DepthFormatError",
    "EmptyBackgroundError",
    "MovingBackgroundError",
    "TooFewFramesError",
    "fits",
    "learn_background",
]
