"""Columns: tall, upright, filled things of a known colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from noctule.geometry import Array
from noctule.messages import ColumnBox
from noctule.settings import Settings

Pixels = NDArray[np.uint8]

_ROWS, _COLS = 8, 2  # a column is tall, so every eighth row tells where one may be
_BAND = 24  # [px], rows above and below mid-height that share in its edges
_REACH = 10  # [px], how far from the coarse edge the fine one may be


class ColumnColour(Settings):
    """What counts as a column. Saturation and value are fractions of the full range."""

    hue: float = Field(default=0.0, ge=0.0, lt=360.0, description="[deg], 0 red, 120 green, 240 blue")
    tolerance: float = Field(default=15.0, gt=0.0, le=90.0, description="[deg], hue may differ by this much")
    min_saturation: float = Field(default=0.55, ge=0.0, le=1.0, description="grayer pixels do not count")
    min_value: float = Field(default=0.15, ge=0.0, le=1.0, description="darker pixels do not count")
    min_height: float = Field(default=0.3, gt=0.0, le=1.0, description="of the picture's height")
    min_aspect: float = Field(
        default=2.0, gt=0.0, description="height over width, unless cut above and below"
    )
    max_slope: float = Field(
        default=0.25, ge=0.0, le=1.0, description="lean, sideways over down: the camera's roll"
    )


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A component of the coarse mask that stands like a column; rows and columns are coarse ones."""

    rows: NDArray[np.intp]  # (k,) rows where its width is the usual one
    left: NDArray[np.intp]  # (k,) first column of each
    right: NDArray[np.intp]  # (k,) last column of each
    slope: float  # columns a row
    middle: float  # its centre at row 0


def colour_mask(hsv: Pixels, colour: ColumnColour) -> Pixels:
    """Return 255 where an HSV picture (h, w, 3), all channels 0 to 255, has the colour, else 0, (h, w)."""
    low = (colour.hue - colour.tolerance) * 256.0 / 360.0
    high = (colour.hue + colour.tolerance) * 256.0 / 360.0
    s, v = 255.0 * colour.min_saturation, 255.0 * colour.min_value
    mask = cv2.inRange(hsv, np.array([low, s, v]), np.array([high, 255.0, 255.0]))
    # Hue is a circle: what hangs over one end counts at the other.
    if low < 0.0:
        rest = cv2.inRange(hsv, np.array([low + 256.0, s, v]), np.array([255.0, 255.0, 255.0]))
        mask = cv2.bitwise_or(mask, rest)
    if high > 255.0:
        rest = cv2.inRange(hsv, np.array([0.0, s, v]), np.array([high - 256.0, 255.0, 255.0]))
        mask = cv2.bitwise_or(mask, rest)
    return np.asarray(mask, dtype=np.uint8)


def _candidate(member: NDArray[np.bool_], top: int, left: int, colour: ColumnColour) -> _Candidate | None:
    """Judge one component (h, w) whose corner is at (`top`, `left`); None when it is no column."""
    first = np.argmax(member, axis=1)
    last = member.shape[1] - 1 - np.argmax(member[:, ::-1], axis=1)
    width = last - first + 1
    usual = float(np.median(width))
    # Where a patch of the same colour touches the column its rows are wider: they do not speak for it.
    good = np.abs(width - usual) <= 0.3 * usual + 1.0
    if good.mean() < 0.6 or member[good].sum() < 0.75 * width[good].sum():
        return None
    rows = np.flatnonzero(good)
    centres = 0.5 * (first[rows] + last[rows])
    away = rows - rows.mean()
    slope = float(away @ centres / max(float(away @ away), 1e-9))
    middle = float(centres.mean() - slope * rows.mean())
    spread = float(np.sqrt(np.mean((centres - slope * rows - middle) ** 2)))
    if abs(slope) * _COLS / _ROWS > colour.max_slope or spread > 0.2 * usual + 1.0:
        return None
    return _Candidate(rows + top, first[rows] + left, last[rows] + left, slope, middle + left - slope * top)


def _edge(profile: Array, coarse: float, centre: float, step: int) -> float:
    """Return where a column ends in the colour profile (w, 3), near `coarse` [px], going outward by `step`.

    Every pixel is split between the colour inside and the colour outside; the shares of the column, summed
    from a pixel that is surely inside, give the edge to a fraction of a pixel.
    """
    inner = round(coarse - step * min(4.0, abs(coarse - centre) - 0.5))
    outer = int(np.clip(round(coarse + step * _REACH), 0, len(profile) - 1))
    samples = profile[np.arange(inner, outer + step, step)]
    if len(samples) < 5:
        return coarse
    inside = samples[:2].mean(axis=0)
    # The colour outside is that of the three pixels past the steepest change.
    steepest = int(np.argmax(np.linalg.norm(samples[2:] - samples[:-2], axis=1))) + 1
    beyond = samples[min(steepest + 2, len(samples) - 1) : steepest + 5].mean(axis=0)
    axis = inside - beyond
    share = np.clip((samples - beyond) @ axis / max(float(axis @ axis), 1e-9), 0.0, 1.0)
    return float(inner + step * (share[: steepest + 3].sum() - 0.5))


def _fine_edges(pixels: Pixels, found: _Candidate, row: float) -> tuple[float, float]:
    """Return the left and right edge [px] at `row`, from the full picture around it."""
    height, width = pixels.shape[:2]
    half = (float(np.median(found.right - found.left)) + 1.0) * _COLS / 2.0
    slope = found.slope * _COLS / _ROWS
    centre = (found.middle + found.slope * (row - _ROWS / 2) / _ROWS + 0.5) * _COLS - 0.5
    first, last = max(int(row) - _BAND, 0), min(int(row) + _BAND, height - 1)
    margin = int(_REACH + abs(slope) * _BAND) + 3
    x_0 = int(np.clip(centre - half - margin, 0, width - 1))
    x_1 = int(np.clip(centre + half + margin, 0, width - 1))
    band = pixels[first : last + 1 : 3, x_0 : x_1 + 1]
    if abs(slope) > 0.01:
        # Stand the column up before its rows are averaged.
        shear = np.array([[1.0, 3.0 * slope, -slope * (row - first)], [0.0, 1.0, 0.0]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        size = (band.shape[1], band.shape[0])
        upright = cv2.warpAffine(band, shear, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        band = np.asarray(upright, dtype=np.uint8)
    profile = band.mean(axis=0)
    left, right = centre - half, centre + half
    fine_left = 0.0 if left <= _COLS else x_0 + _edge(profile, left - x_0, centre - x_0, -1)
    fine_right = (
        width - 1.0 if right >= width - 1 - _COLS else x_0 + _edge(profile, right - x_0, centre - x_0, 1)
    )
    return float(np.clip(fine_left, 0.0, width - 1.0)), float(np.clip(fine_right, 0.0, width - 1.0))


def _box(pixels: Pixels, found: _Candidate) -> ColumnBox:
    height, width = pixels.shape[:2]
    top = float(found.rows[0] * _ROWS)
    bottom = float(min((found.rows[-1] + 1) * _ROWS, height) - 1)
    row = float(np.clip((height - 1) / 2.0, top, bottom))
    x1, x2 = _fine_edges(pixels, found, row)
    left = min(float(found.left.min() * _COLS), x1)
    right = max(float(min((found.right.max() + 1) * _COLS, width) - 1), x2)
    return ColumnBox(left, top, right, bottom, np.array([x1, row]), np.array([x2, row]))


def _find(hsv: Pixels, colour: ColumnColour, height: int) -> list[_Candidate]:
    """Return what stands like a column in the coarse HSV picture of a picture of `height` [px]."""
    mask = colour_mask(hsv, colour)
    least = colour.min_height * height / _ROWS
    highest, lowest = 0.6 * height / _ROWS, 0.4 * height / _ROWS
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 1), np.uint8))
    # What is not tall goes: bars, specks, and the patches that touch a column.
    opened = cv2.morphologyEx(closed, cv2.MORPH_OPEN, np.ones((4, 1), np.uint8))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(opened, connectivity=8)
    top, tall = stats[:, cv2.CC_STAT_TOP], stats[:, cv2.CC_STAT_HEIGHT]
    stands = (tall >= least) & (top <= highest) & (top + tall >= lowest)
    candidates = []
    for k in np.flatnonzero(stands[1:]) + 1:
        x, y, w, h = (int(value) for value in stats[k, :4])
        found = _candidate(labels[y : y + h, x : x + w] == k, y, x, colour)
        if found is None:
            continue
        wide = (float(np.median(found.right - found.left)) + 1.0) * _COLS
        if h * _ROWS >= colour.min_aspect * wide or h * _ROWS >= 0.95 * height:
            candidates.append(found)
    return candidates


def detect_columns(pixels: Pixels, colours: ColumnColour | Sequence[ColumnColour]) -> tuple[ColumnBox, ...]:
    """Find the columns of an RGB picture (height, width, 3), sorted by their left edge.

    p1 and p2 are the left and right edge at mid-height of the picture, to a fraction of a pixel: a column
    that fills the pixels 100 to 109 has its edges at 99.5 and 109.5. What ends more than a tenth of the
    picture's height above or below mid-height is no column: it does not stand in the way of a level flight.
    A column that leaves the picture is clipped to it: left is 0 or right is width - 1. Two of one colour that
    overlap in the picture may come as one box, and what stands before a large area of its own colour is not
    seen. A column must be wide enough not to lean out of itself: 7 px at a slope of 0.2, 4 px at 0.1.
    """
    wanted = (colours,) if isinstance(colours, ColumnColour) else tuple(colours)
    rows = pixels[_ROWS // 2 :: _ROWS]
    size = ((pixels.shape[1] + 1) // _COLS, len(rows))
    coarse = cv2.resize(rows, size, interpolation=cv2.INTER_NEAREST)
    hsv = np.asarray(cv2.cvtColor(coarse, cv2.COLOR_RGB2HSV_FULL), dtype=np.uint8)
    boxes = [_box(pixels, found) for colour in wanted for found in _find(hsv, colour, pixels.shape[0])]
    return tuple(sorted(boxes, key=lambda box: (box.left, box.right, box.top)))
