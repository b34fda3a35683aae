"""How wide the edges of a board are in a picture: what tells a blurred picture from a sharp one."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.geometry import Array

_STEP = 0.5  # [px] between samples across an edge
_ALONG = np.linspace(-0.3, 0.3, 9)  # where edges are crossed, in squares from their middle


def edge_width(grey: NDArray[np.uint8], p: Array, cells: NDArray[np.int64], rim: float) -> float:
    """Return the width [px] of the board's edges: contrast over steepest slope, 2.5 sd of a Gaussian blur.

    Of the edges along the board's two axes the wider (a moving board blurs one of them), each the median of
    its edges; nan where no two neighbours are seen along one of the axes.

    Parameters
    ----------
    grey
        The picture (height, width).
    p
        The corners (n, 2) [px].
    cells
        Column and row of each corner on the board, (n, 2).
    rim
        How much white there is between an edge and a marker, in squares.
    """
    places = {(int(column), int(row)): k for k, (column, row) in enumerate(cells)}
    contrast = _contrast(grey, p)
    medians = []
    for across in ((1, 0), (0, 1)):
        pairs = [
            (k, places[c + across[0], r + across[1]])
            for (c, r), k in places.items()
            if (c + across[0], r + across[1]) in places
        ]
        widths = [contrast / slope for a, b in pairs if (slope := _slope(grey, p[a], p[b], rim)) > 0.0]
        medians.append(float(np.median(widths)) if widths else np.nan)
    return float(max(medians)) if np.isfinite(medians).all() else float("nan")


def _contrast(grey: NDArray[np.uint8], p: Array) -> float:
    """Return the difference between white and black of the board."""
    low, high = np.floor(p.min(axis=0)).astype(int), np.ceil(p.max(axis=0)).astype(int) + 1
    inside = grey[max(low[1], 0) : high[1], max(low[0], 0) : high[0]]
    dark, bright = np.percentile(inside, [5.0, 95.0])
    return float(bright - dark)


def _slope(grey: NDArray[np.uint8], begin: Array, end: Array, rim: float) -> float:
    """Return the steepest slope [grey values per px] across the edge from corner to corner."""
    along = end - begin
    length = float(np.hypot(*along))
    normal = np.array([-along[1], along[0]]) / length
    reach = max(2.0, rim * length)
    t = np.arange(-reach, reach + _STEP / 2, _STEP)
    points = (begin + end) / 2.0 + _ALONG[:, None, None] * along + t[None, :, None] * normal
    map_xy = points.astype(np.float32)
    values = cv2.remap(grey.astype(np.float32), map_xy[..., 0], map_xy[..., 1], cv2.INTER_LINEAR)
    profile = values.mean(axis=0)
    # Over one pixel: the picture holds nothing finer.
    apart = round(1.0 / _STEP)
    return float(np.abs(profile[apart:] - profile[:-apart]).max())
