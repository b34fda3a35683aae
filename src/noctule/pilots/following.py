"""What the path follower is told, and what it says: settings, how to fly at a tick, phases, reports."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from pydantic import Field

from noctule.control.cascade import CascadeSettings
from noctule.control.paths.speed import SpeedSettings
from noctule.errors import NoctuleError
from noctule.geometry import Array
from noctule.settings import Settings


class FollowerError(NoctuleError):
    """A vehicle that the follower cannot fly."""


class FollowPhase(StrEnum):
    """What the follower is doing."""

    TO_START = "to start"
    SETTLE = "settle"  # at the start, until it stands still there and it is time
    FOLLOW = "follow"
    STOP = "stop"
    RETURN = "return"
    HOLD = "hold"  # at the end of everything


ON_PATH = (FollowPhase.FOLLOW, FollowPhase.STOP)


class FollowerSettings(Settings):
    """Gains, and what happens before and after the path."""

    cascade: CascadeSettings = CascadeSettings()
    transfer: SpeedSettings = SpeedSettings(cruise=0.3)  # on the way to the start and back
    go_to_start: bool = Field(True, description="fly to the path's first point first; false: be there")
    return_home: bool = Field(False, description="fly back to where it began")
    arrive_m: float = Field(0.05, gt=0.0, le=1.0, description="at the start within this [m]")
    arrive_deg: float = Field(5.0, gt=0.0, le=90.0, description="and within this heading [deg]")
    settle_s: float = Field(0.5, ge=0.0, le=60.0, description="for this long [s]")
    hover_speed: float = Field(
        0.3, gt=0.0, le=2.0, description="fastest command while it hovers in doubt [m/s]"
    )
    hover_turn: float = Field(0.5, gt=0.0, le=5.0, description="fastest turn then [rad/s]")


@dataclass(frozen=True, slots=True)
class Conduct:
    """How to fly at a tick: as one who is sure, or as one in doubt."""

    pace: float = 1.0  # 0 to 1, times the wanted speed
    hover: bool = False  # on the spot where this began, whatever the path asks for
    trust: float = 1.0  # 0 to 1, while it hovers: share of a position error that is flown; 0 asks for nothing


SURE = Conduct()


@dataclass(frozen=True, slots=True)
class FollowerReport:
    """What the follower saw and thought at a tick; recorded and drawn, never flown on."""

    phase: FollowPhase
    path_time: float  # [s] since the path was begun; NaN before
    s: float  # [m] along the path, or along the way to it or back
    cross_track: float  # [m] from the nearest or the wanted point, as predicted
    yaw_error: float  # [rad], wanted minus predicted
    speed: float  # [m/s], v_d
    wanted: Array  # (4,) x, y, z [m], yaw [rad]
    predicted: Array  # (8,) the state at which the command takes effect
    velocity_ref: Array  # (4,) v_r [m/s, rad/s], world
    disturbance: Array  # (4,) forward, left, up [m/s^2], yaw [rad/s^2], as learnt
    saturated: bool
    holding: bool
    finished: bool
    hovering: bool = False  # in doubt
