"""Which figures the report of many flights tells, by what kind of flights they are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from noctule.reports.summary import find, number


@dataclass(frozen=True, slots=True)
class Column:
    """A figure of every flight."""

    path: tuple[str, ...]  # of keys in a run
    label: str
    unit: str
    scale: float = 1.0  # how many of the unit are one of the run's
    asked: float | None = None  # [unit], what it is to stay below

    def value(self, run: Mapping[str, Any]) -> float | None:
        """Return it in its unit, None where it was not measured."""
        value = find(run, self.path)
        return None if value is None else self.scale * float(value)

    def told(self, run: Mapping[str, Any], missing: str = "not available") -> str:
        """Return it with its unit."""
        return number(self.value(run), self.unit, missing)


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of flights."""

    columns: tuple[Column, ...]
    panels: tuple[Column, ...]  # those that are drawn
    done: str  # what flights did that went well, in words
    marked: str  # what the figure says of them
    pooled: str  # how the figures were pooled


_CLEARANCE = Column(("min_clearance_m",), "least clearance", "m")
_BY_PICTURES = (
    Column(("duration_s",), "duration", "s"),
    Column(("position_error_m",), "position error", "m"),
    Column(("yaw_error_deg",), "heading error", "°"),
    Column(("epsilon_px",), "points at the end", "px"),
    _CLEARANCE,
    Column(("max_command_step", "linear"), "largest step, linear", "m/s"),
    Column(("max_command_step", "angular"), "largest step, angular", "rad/s"),
    Column(("tick_ms", "p95"), "tick, 95th percentile", "ms"),
)
# What is asked for is that of the experiments loc-1 to loc-3.
_LOCATED = (
    Column(("cross_track_mean_m",), "from the path, mean", "mm", 1e3, 10.0),
    Column(("cross_track_p95_m",), "from the path, 95 %", "mm", 1e3, 20.0),
    Column(("hover_rms_m",), "hover, rms", "mm", 1e3, 12.0),
    Column(("recovery_s", "max"), "back after a push", "s", 1.0, 0.8),
    Column(("position_rms_m",), "estimate, rms", "mm", 1e3, 8.0),
    Column(("yaw_sd_deg",), "yaw estimate, sd", "°", 1.0, 1.2),
    Column(("heading_p95_deg",), "heading, 95 %", "°"),
    Column(("lost_s",), "lost", "s"),
    _CLEARANCE,
)
BY_PICTURES = Kind(
    _BY_PICTURES,
    (*_BY_PICTURES[:3], _CLEARANCE),
    "reached the last image",
    "reached the last image",
    "Medians; of the clearance the least, of the command steps the largest, of the ticks all together.",
)
LOCATED = Kind(
    _LOCATED, _LOCATED[:6], "completed their path", "completed its path", "Means over the flights."
)
GOOD = ("reached", "completed")
"""The outcomes of flights that went well."""


def kind_of(runs: Iterable[Mapping[str, Any]]) -> Kind:
    """Return the kind of flights: located ones know how they hovered, if only that they did not."""
    return LOCATED if any("hover_rms_m" in run for run in runs) else BY_PICTURES
