"""Headings over time as lines that do not cross the whole figure where they start anew."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes

from noctule.geometry import Array

LOW = -90.0
"""[deg]: from here on both 0 and 180 deg, at which drones often point, lie inside of a whole turn."""


def turning(stamps: Array, yaw: Array, low: float = 0.0) -> tuple[Array, Array]:
    """Return stamps and headings [deg] from `low` to a turn more, the line broken where they start anew."""
    turned = low + np.mod(np.degrees(np.mod(yaw, 2.0 * math.pi)) - low, 360.0)
    jumps = np.flatnonzero(np.abs(np.diff(turned)) > 180.0) + 1
    return np.insert(stamps, jumps, np.nan), np.insert(turned, jumps, np.nan)


def compass(axis: Axes) -> None:
    """Give a panel of headings from LOW on its limits and quarters."""
    axis.set_ylim(LOW, LOW + 360.0)
    axis.set_yticks(np.arange(LOW, LOW + 361.0, 90.0))
