"""What the locator says of a frame, and when it believes what it sees."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from pydantic import Field

from noctule.localization.detection.splinters import MIN_AREA
from noctule.messages import PoseMeasurement
from noctule.settings import Settings


class LocatorSettings(Settings):
    """When the locator believes what it sees."""

    min_ratio: float = Field(
        default=1.0 / 3.0, ge=0.0, le=1.0, description="score over nominal below which the drone is lost"
    )
    max_relief: float = Field(
        default=1.4,
        gt=0.0,
        le=4.5,
        description="misfit of the surface, per cell, above which the drone is lost",
    )
    min_visible: float = Field(
        default=0.35, ge=0.0, le=1.0, description="share of the drone that must be seen while it is tracked"
    )
    sure_ratio: float = Field(
        default=0.5, ge=0.0, le=2.0, description="score over nominal that leaves no doubt"
    )
    sure_outline: float = Field(
        default=0.85, gt=0.0, le=10.0, description="misfit of the outline that leaves no doubt"
    )
    sure_visible: float = Field(default=0.45, ge=0.0, le=1.0, description="share seen that leaves no doubt")
    max_doubt: float = Field(default=0.25, ge=0.0, le=5.0, description="[s], longest time in doubt")
    start_ratio: float = Field(
        default=0.6, ge=0.0, le=2.0, description="score over nominal of a drone found anew"
    )
    start_outline: float = Field(
        default=0.6, gt=0.0, le=10.0, description="misfit of the outline of a drone found anew"
    )
    start_relief: float = Field(
        default=1.2, gt=0.0, le=4.5, description="misfit of the surface of a drone found anew"
    )
    start_visible: float = Field(default=0.5, ge=0.0, le=1.0, description="share seen of a drone found anew")
    start_frames: int = Field(
        default=3, ge=1, le=30, description="in a row that must agree on a drone found anew"
    )
    coast: float = Field(
        default=0.5, ge=0.0, le=5.0, description="[s], an unseen drone is looked for where it was"
    )
    min_area: int = Field(
        default=MIN_AREA, ge=1, le=100000, description="[px], smaller pieces are not looked at"
    )


class LocatorState(StrEnum):
    """What the locator is doing."""

    SEARCHING = "searching"  # it never saw the drone
    TRACKING = "tracking"
    LOST = "lost"


@dataclass(frozen=True, slots=True)
class LocatorDiagnostics:
    """What was thought of a frame; recorded and drawn, never flown on."""

    ratio: float = math.nan  # score over nominal
    outline: float = math.nan  # misfit per cell
    relief: float = math.nan  # misfit per cell
    visible: float = math.nan  # share of the drone
    half_turn: float = 0.0  # sum of the evidence for the heading held
    roll: float = 0.0  # [rad], as seen
    pitch: float = 0.0  # [rad]
    proposals: int = 0  # blobs that were looked at


@dataclass(frozen=True, slots=True)
class Located:
    """What a frame says of the drone: a measurement, or why there is none."""

    stamp: float  # [s], exposure
    state: LocatorState
    measurement: PoseMeasurement | None
    reason: str  # empty with a measurement
    heading_certain: bool = False  # the half turn is decided
    slipped: bool = False  # a heading that was certain was turned around in this frame
    diagnostics: LocatorDiagnostics = LocatorDiagnostics()
