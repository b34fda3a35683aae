"""What all figures of a located flight share: colours of who says it, stops, pushes, turns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes

from noctule.reports.located_log import LocatedLog
from noctule.reports.style import FORWARD, INK, LEFT, MUTED, UP, YAW

WANTED, TRUE, FUSED, CAMERA, VEHICLE = INK, UP, YAW, FORWARD, LEFT
DASHES: Any = (0, (4, 3))
PUSH = "#E69F00"
HANDED_OVER = "#9A3412"
_STOP = "#6b7280"


def mark_stops_and_pushes(axes: Sequence[Axes], log: LocatedLog) -> None:
    """Shade the stops, draw the pushes, as the paper does, and the hand-over; the first panel names them."""
    end = float(log.times[-1])
    pushes = [p for p in log.pushes if 0.0 <= p.time <= end]
    for axis in axes:
        for a, b in log.stops:
            axis.axvspan(a, b, color=_STOP, alpha=0.13, lw=0, zorder=0)
        for push in pushes:
            axis.axvline(push.time, color=PUSH, lw=1.2, zorder=1)
            axis.plot(
                push.time, 1.0, "*", color=PUSH, ms=8, clip_on=False, zorder=6,
                transform=axis.get_xaxis_transform(),
            )  # fmt: skip
        if math.isfinite(log.handed_over):
            axis.axvline(log.handed_over, color=HANDED_OVER, lw=1.2, ls="-.", zorder=1)
    if math.isfinite(log.handed_over):
        axes[0].plot([], [], "-.", color=HANDED_OVER, lw=1.2, label="handed over")
    if log.stops:
        axes[0].fill_between([], [], color=_STOP, alpha=0.13, lw=0, label="holding a point")
    if pushes:
        axes[0].plot([], [], "*-", color=PUSH, lw=1.2, ms=8, label="pushed")


def zero(axis: Axes) -> None:
    """Draw the line at zero."""
    axis.axhline(0.0, color=MUTED, lw=0.8, zorder=1)
