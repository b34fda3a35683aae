"""How a flight came down after its pilot was done: in words, and as a line in the figures."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from noctule.reports.flight_log import FlightLog, Landing
from noctule.reports.headings import LOW, turning
from noctule.reports.style import INK, MUTED

LANDING_LOOK: dict[str, Any] = {"color": MUTED, "lw": 1.8, "ls": (0, (1.2, 1.0)), "label": "landing"}
_MARK: dict[str, Any] = {"marker": "v", "ls": "", "ms": 7, "color": MUTED, "mec": INK, "zorder": 7}
_NEAR = 0.05  # [m], from the underside to the floor: it stands on it
_GIVEN_UP = ("lost", "landed_lost", "stuck")


def landing_in_words(log: FlightLog) -> str:
    """Return a sentence on where the drone came down, or how high it was when the recording ends; or none.

    Without truth it is the vehicle's own word.
    """
    landing = log.landing
    if landing is None:
        return ""
    height = max(float(landing.pose[-1, 2]) - log.hull.height / 2.0, 0.0)  # [m], of the underside
    if not landing.true:
        if landing.said_landed:
            seconds = landing.times[-1] - landing.times[0]
            return f"The vehicle says that it landed, {seconds:.1f} s later."
        known = np.isfinite(height)
        return f"The recording ends with the drone {height:.2f} m above the floor, it says." if known else ""
    if "floor" not in landing.touching and height > _NEAR:
        return f"The recording ends with the drone {height:.2f} m above the floor."
    x, y = landing.pose[-1, :2]
    away = float(np.hypot(*(landing.pose[-1, :2] - landing.pose[0, :2])))
    whence = "the pilot gave up" if log.summary.get("outcome") in _GIVEN_UP else "the pilot's flight ended"
    touched = f", and touched {', '.join(landing.touched)} on the way" if landing.touched else ""
    return f"It landed at x {x:.2f}, y {y:.2f} m, {away:.2f} m from where {whence}{touched}."


def landing_end(log: FlightLog) -> float:
    """Return when the landing, or without one the flight, ends [s]."""
    return log.span[1] if log.landing is None else float(log.landing.times[-1])


def draw_landing_over_time(axis: Axes, landing: Landing, column: int) -> None:
    """Draw x, y or z [m] over time or, in the last column, the heading [deg]; the unknown leaves no line."""
    rows = landing.pose[:, column]
    if len(rows) > 1 and np.isfinite(landing.pose).any():
        line = turning(landing.times, rows, LOW) if column == 3 else (landing.times, rows)
        axis.plot(*line, **LANDING_LOOK)


def draw_landing_way(axis: Any, landing: Landing, dimensions: int) -> None:
    """Draw the way down, from above (2 dimensions) or in space (3), and where it ended; where it is known."""
    rows = landing.pose[:, :dimensions]
    if len(rows) > 1 and np.isfinite(rows).all():
        axis.plot(*rows.T, **LANDING_LOOK)
        axis.plot(*rows[-1:].T, **_MARK, label="landed" if "floor" in landing.touching else "end")
