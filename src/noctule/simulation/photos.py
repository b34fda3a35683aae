"""Photographs that scikit-image ships, made mild in colour, and the noise that other textures are made of.

Only free pictures of the installed package are used, read from its files; nothing is downloaded.
"""

from __future__ import annotations

import importlib.util
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.errors import NoctuleError

Image = NDArray[np.uint8]

# name of the texture -> file in skimage/data; public domain or CC0, see NOTICE
FILES = {
    "astronaut": "astronaut.png",
    "brick": "brick.png",
    "camera": "camera.png",
    "cat": "chelsea.png",
    "clock": "clock_motion.png",
    "coffee": "coffee.png",
    "coins": "coins.png",
    "grass": "grass.png",
    "gravel": "gravel.png",
    "hubble": "hubble_deep_field.jpg",
    "retina": "retina.jpg",
    "rocket": "rocket.jpg",
}
MOST_SATURATED = 0.45
"""No texture is more saturated (HSV, 0 to 1) than this, so that a column's colour stands out."""


class PhotoError(NoctuleError):
    """A photograph that the installed scikit-image does not have."""


@lru_cache(maxsize=32)
def photo(name: str) -> Image:
    """Return a photograph (h, w, 3) RGB, at most 640 pixels wide and high, read-only."""
    package = importlib.util.find_spec("skimage")
    folder = Path(package.origin).parent / "data" if package is not None and package.origin else Path()
    found = cv2.imread(str(folder / FILES[name]), cv2.IMREAD_COLOR_RGB)
    if found is None:
        raise PhotoError(
            f"simulation: photograph {FILES[name]!r} is not in {folder}; "
            "expected it in the installed scikit-image: install scikit-image>=0.25 again"
        )
    picture = np.asarray(found, dtype=np.uint8)
    scale = min(1.0, 640.0 / max(picture.shape[:2]))
    if scale < 1.0:
        size = (round(scale * picture.shape[1]), round(scale * picture.shape[0]))
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    mild = desaturate(picture)
    mild.setflags(write=False)
    return mild


def desaturate(picture: NDArray[np.generic], most: float = MOST_SATURATED) -> Image:
    """Return the picture (h, w, 3) RGB with each pixel's saturation at most `most` and its luminance kept."""
    x = np.asarray(picture, dtype=np.float32)
    # Rounding to whole grey levels may add saturation to dark pixels: aim a little lower.
    most = most - 0.02
    r, g, b = x[..., 0], x[..., 1], x[..., 2]
    y = np.float32(0.299) * r + np.float32(0.587) * g + np.float32(0.114) * b
    high, low = np.maximum(np.maximum(r, g), b), np.minimum(np.minimum(r, g), b)
    # S of y + k (x - y) is k (high - low) / (y + k (high - y)); solve S = most for k.
    need = (high - low) - most * (high - y)
    strong = need > most * y
    if strong.any():
        luminance = y[strong]
        k = (most * luminance / need[strong])[:, None]
        x = x.copy()
        x[strong] = luminance[:, None] + k * (x[strong] - luminance[:, None])
    return np.asarray(np.clip(np.rint(x), 0, 255), dtype=np.uint8)


def fractal(
    rng: np.random.Generator, height: int, width: int, coarsest: int = 4, octaves: int = 6, keep: float = 0.6
) -> NDArray[np.float32]:
    """Return noise (height, width) of many scales, mean 0, sd 1; `keep` is the weight from scale to scale."""
    total: NDArray[np.float32] = np.zeros((1, 1), dtype=np.float32)
    for octave in range(octaves):
        rows = min(height, coarsest << octave)
        columns = min(width, max(1, (coarsest << octave) * width // height))
        # Each scale is laid over the enlarged coarser ones, so only the last one costs the full size.
        finer = rng.standard_normal((rows, columns), dtype=np.float32)
        total = _enlarged(total, rows, columns) + np.float32(keep**octave) * finer
    total = _enlarged(total, height, width)
    return np.asarray((total - total.mean()) / (total.std() + 1e-9), dtype=np.float32)


def _enlarged(grey: NDArray[np.float32], rows: int, columns: int) -> NDArray[np.float32]:
    return np.asarray(cv2.resize(grey, (columns, rows), interpolation=cv2.INTER_CUBIC), dtype=np.float32)


def tinted(grey: NDArray[np.floating], rgb: tuple[float, float, float]) -> NDArray[np.float32]:
    """Return grey (h, w), 1 for the colour itself, times the colour `rgb` (0 to 255), (h, w, 3)."""
    return np.asarray(grey, dtype=np.float32)[..., None] * np.array(rgb, dtype=np.float32)
