"""Columns: tall upright things of a known colour."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from noctule.geometry import Array
from noctule.messages import ColumnBox
from noctule.settings import Settings

_ROWS = 8  # a column is tall, so few rows tell where it may be
_COLS = 2


class ColumnColour(Settings):
    """What counts as a column's colour. Saturation and value are fractions of the full range."""

    hue: float = Field(default=0.0, ge=0.0, lt=360.0, description="[deg], 0 red, 120 green, 240 blue")
    tolerance: float = Field(default=15.0, gt=0.0, le=90.0, description="[deg], hue may differ by this much")
    min_saturation: float = Field(default=0.5, ge=0.0, le=1.0, description="grayer pixels do not count")
    min_value: float = Field(default=0.2, ge=0.0, le=1.0, description="darker pixels do not count")
    min_height: float = Field(default=0.25, gt=0.0, le=1.0, description="of the picture's height")
    min_aspect: float = Field(
        default=1.5, gt=0.0, description="height over width, unless it fills the height"
    )


def colour_mask(pixels: NDArray[np.uint8], colour: ColumnColour) -> NDArray[np.uint8]:
    """Return 1 where a pixel of an RGB picture (h, w, 3) has the colour, else 0, (h, w)."""
    hsv = cv2.cvtColor(pixels, cv2.COLOR_RGB2HSV_FULL)
    hues = np.arange(256) * (360.0 / 256.0)
    table = (np.abs((hues - colour.hue + 180.0) % 360.0 - 180.0) <= colour.tolerance).astype(np.uint8)
    mask = table[hsv[:, :, 0]]
    mask &= hsv[:, :, 1] >= int(255 * colour.min_saturation)
    mask &= hsv[:, :, 2] >= int(255 * colour.min_value)
    return np.asarray(mask, dtype=np.uint8)


def _edge(profile: Array, inner: int, step: int) -> float:
    """Return where the colour ends in `profile` (w, 3), going from `inner` by `step` (-1 or 1), sub-pixel."""
    end = int(np.clip(inner + step * 12, 0, len(profile) - 1))
    samples = profile[inner : end + step if end + step >= 0 else None : step]
    if len(samples) < 4:
        return float(end)
    inside, outside = samples[0], samples[-3:].mean(axis=0)
    axis = inside - outside
    share = np.clip((samples - outside) @ axis / max(float(axis @ axis), 1e-9), 0.0, 1.0)
    gone = np.flatnonzero(share < 0.1)
    share = share[: gone[0]] if len(gone) else share
    return float(inner + step * (share.sum() - 0.5))


def _box(
    pixels: NDArray[np.uint8], member: NDArray[np.bool_], row_0: int, col_0: int, colour: ColumnColour
) -> ColumnBox:
    height, width = pixels.shape[:2]
    rows, cols = np.flatnonzero(member.any(axis=1)), np.flatnonzero(member.any(axis=0))
    top, bottom = float((row_0 + rows[0]) * _ROWS), float(min((row_0 + rows[-1] + 1) * _ROWS, height) - 1)
    left = float((col_0 + cols[0]) * _COLS)
    right = float(min((col_0 + cols[-1] + 1) * _COLS, width) - 1)
    middle = int(np.clip((height - 1) // 2, top, bottom))
    first, last = max(int(top), middle - 24), min(int(bottom), middle + 24)
    near = member[np.clip(middle // _ROWS - row_0, rows[0], rows[-1])]
    at = np.flatnonzero(near) if near.any() else cols
    inner_left, inner_right = (col_0 + at[0]) * _COLS, min((col_0 + at[-1] + 1) * _COLS, width) - 1
    step_in = min(3, (inner_right - inner_left) // 2)
    profile = pixels[first : last + 1 : 4].mean(axis=0)
    x1 = max(_edge(profile, inner_left + step_in, -1), 0.0) if inner_left > 0 else 0.0
    x2 = (
        min(_edge(profile, inner_right - step_in, 1), width - 1.0) if inner_right < width - 1 else width - 1.0
    )
    left, right = min(left, x1), max(right, x2)
    return ColumnBox(left, top, right, bottom, np.array([x1, middle]), np.array([x2, middle]))


def _detect(pixels: NDArray[np.uint8], colour: ColumnColour) -> list[ColumnBox]:
    height = pixels.shape[0]
    mask = colour_mask(np.ascontiguousarray(pixels[_ROWS // 2 :: _ROWS, ::_COLS]), colour)
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 1), np.uint8))
    tall = max(2, round(0.4 * colour.min_height * height / _ROWS))
    opened = cv2.morphologyEx(closed, cv2.MORPH_OPEN, np.ones((tall, 1), np.uint8))
    n, labels, stats, _ = cv2.connectedComponentsWithStats(opened, connectivity=8)
    found = []
    for k in range(1, n):
        x, y, w, h, _area = (int(v) for v in stats[k])
        if h * _ROWS < colour.min_height * height:
            continue
        full = h * _ROWS >= 0.9 * height
        if not full and h * _ROWS < colour.min_aspect * w * _COLS:
            continue
        found.append(_box(pixels, labels[y : y + h, x : x + w] == k, y, x, colour))
    return found


def detect_columns(
    pixels: NDArray[np.uint8], colours: ColumnColour | Sequence[ColumnColour]
) -> tuple[ColumnBox, ...]:
    """Find the columns of an RGB picture (height, width, 3), sorted by their left edge.

    A column that leaves the picture is clipped to it: left is 0 or right is width - 1. Two of one colour
    that overlap in the picture may come as one box.
    """
    wanted = (colours,) if isinstance(colours, ColumnColour) else tuple(colours)
    boxes = [box for colour in wanted for box in _detect(pixels, colour)]
    return tuple(sorted(boxes, key=lambda box: (box.left, box.right, box.top)))
