"""What travels between rooms: small frozen records, no behaviour.

Stamps are seconds of the flight's clock at the moment of exposure or measurement, not of arrival.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from noctule.geometry import Array, Pose


def _no_points() -> Array:
    return np.empty((0, 2))


@dataclass(frozen=True, slots=True)
class Command:
    """A velocity in the levelled heading frame (FLU)."""

    forward: float = 0.0  # [m/s]
    left: float = 0.0  # [m/s]
    up: float = 0.0  # [m/s]
    yaw_rate: float = 0.0  # [rad/s], counterclockwise

    def as_array(self) -> Array:
        """Return (forward, left, up, yaw rate) as an array (4,)."""
        return np.array([self.forward, self.left, self.up, self.yaw_rate])

    @classmethod
    def from_array(cls, nu: Array) -> Command:
        """Make a command of an array (4,): forward, left, up [m/s], yaw rate [rad/s]."""
        return cls(float(nu[0]), float(nu[1]), float(nu[2]), float(nu[3]))


@dataclass(frozen=True, slots=True)
class Limits:
    """What a vehicle is allowed: speeds per axis and the length of the acceleration vector."""

    forward: float = 0.6  # [m/s]
    left: float = 0.6  # [m/s]
    up: float = 0.5  # [m/s]
    yaw_rate: float = 0.8  # [rad/s]
    acceleration: float = 1.0  # [m/s^2], norm of the change of the linear velocity
    yaw_acceleration: float = 2.0  # [rad/s^2]

    @property
    def speeds(self) -> Array:
        """The four speed limits, (4,)."""
        return np.array([self.forward, self.left, self.up, self.yaw_rate])


@dataclass(frozen=True, slots=True)
class Picture:
    """A colour picture."""

    stamp: float  # [s], exposure
    pixels: NDArray[np.uint8]  # (height, width, 3) RGB


def read_only(image: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Return a contiguous view that cannot be written to: one type, so that it is compiled for once.

    Compiled code is compiled anew for each memory layout, and for what may be written to.
    """
    view = np.ascontiguousarray(image).view()
    view.setflags(write=False)
    return view


@dataclass(frozen=True, slots=True)
class DepthFrame:
    """What an RGB-D camera saw: depth and, registered to it, colour. The depth cannot be written to."""

    stamp: float  # [s], exposure
    depth: NDArray[np.uint16]  # (height, width) [mm] along the optical axis, 0 where there is none
    colour: NDArray[np.uint8] | None = None  # (height, width, 3) RGB, pixel for pixel as the depth

    def __post_init__(self) -> None:
        # One kind of frame, whatever it was read from: what was compiled before a flight serves in it.
        object.__setattr__(self, "depth", read_only(self.depth))


@dataclass(frozen=True, slots=True)
class PoseMeasurement:
    """Where a sensor in the room saw the vehicle."""

    stamp: float  # [s], exposure
    position: Array  # (3,) [m], world, of the body's origin
    yaw: float  # [rad]
    covariance: Array  # (4, 4), of x, y, z [m] and yaw [rad]
    source: str  # what measured it, for example "registration"


@dataclass(frozen=True, slots=True)
class HeadingMeasurement:
    """How a sensor in the room saw the vehicle turned, and nothing else."""

    stamp: float  # [s], exposure
    yaw: float  # [rad]
    variance: float  # [rad^2]
    source: str  # what measured it, for example "markers"


class FlightState(StrEnum):
    """What the vehicle says it is doing."""

    LANDED = "landed"
    TAKING_OFF = "taking_off"
    FLYING = "flying"
    LANDING = "landing"
    EMERGENCY = "emergency"


@dataclass(frozen=True, slots=True)
class VehicleState:
    """What the vehicle reports of itself; None where it does not say."""

    stamp: float  # [s]
    flight_state: FlightState
    roll: float | None = None  # [rad], as measured on board, with its error
    pitch: float | None = None  # [rad]
    yaw: float | None = None  # [rad], drifts
    v_body: Array | None = None  # (3,) [m/s], levelled heading frame FLU
    height: float | None = None  # [m] above the floor
    battery: float | None = None  # 0 to 1
    link_quality: float | None = None  # 0 to 1


@dataclass(frozen=True, slots=True)
class MatchRequest:
    """Asks the worker beside the loop to match this observation's picture to a key image."""

    key_index: int


@dataclass(frozen=True, slots=True)
class MatchResult:
    """What the worker found: matched points, or the reason why there are none."""

    stamp: float  # [s], exposure of the live picture that was matched
    key_index: int
    p_ref: Array  # (n, 2) [px] in the key image
    p_current: Array  # (n, 2) [px] in the live picture
    reason: str = ""  # empty when the match is good


@dataclass(frozen=True, slots=True)
class Observation:
    """All that a pilot is told at a tick. There is no field for the truth."""

    stamp: float  # [s], the tick
    state: VehicleState
    picture: Picture | None = None  # the newest, None when nothing new came
    matches: tuple[MatchResult, ...] = ()  # what the worker finished since the last tick
    depth: DepthFrame | None = None  # of the camera on the ceiling, None when nothing new came
    sent: Command | None = None  # what was really sent at the last tick; None at the first


@dataclass(frozen=True, slots=True)
class ColumnBox:
    """A column seen in the picture: its bounding box and its edges at mid-height."""

    left: float  # [px]
    top: float  # [px]
    right: float  # [px]
    bottom: float  # [px]
    p1: Array  # (2,) [px], left edge at mid-height
    p2: Array  # (2,) [px], right edge at mid-height


class Outcome(StrEnum):
    """How a flight ended."""

    REACHED = "reached"
    COLLIDED = "collided"
    STUCK = "stuck"
    LOST = "lost"
    ABORTED = "aborted"


@dataclass(frozen=True, slots=True)
class Diagnostics:
    """What the pilot saw and thought at a tick; recorded and drawn, never flown on."""

    target_index: int = 0
    epsilon_px: float = float("nan")  # mean distance (7) [px]
    error: Array = field(default_factory=lambda: np.full(6, np.nan))  # (6,) servoing error (e_v, e_w)
    translation: Array = field(default_factory=lambda: np.full(3, np.nan))  # (3,) t [mean depths]
    yaw_error: float = float("nan")  # [rad], estimated yaw of the current image against the target's
    activations: dict[str, float] = field(default_factory=dict)  # task name -> h in [0, 1]
    points_current: Array = field(default_factory=_no_points)  # (n, 2) [px]
    points_ref: Array = field(default_factory=_no_points)  # (n, 2) [px]
    columns: tuple[ColumnBox, ...] = ()
    task_errors: dict[str, float] = field(default_factory=dict)  # task name -> norm of its error


class Doubt(StrEnum):
    """How far a pilot trusts its estimate of where it is, and what it does about it."""

    SURE = "sure"
    FLY_ON = "fly on"  # by the sensors that remain
    SLOW = "slow"
    HOVER = "hover"
    LAND = "land"


@dataclass(frozen=True, slots=True)
class Whereabouts:
    """Where a pilot that is located holds itself to be, and where it wants to be; world, at `stamp`."""

    stamp: float  # [s], of the estimate
    position: Array  # (3,) [m]
    yaw: float  # [rad]
    velocity: Array  # (4,) [m/s, rad/s], of x, y, z and yaw
    position_sd: float  # [m], root of the trace of the position's covariance
    yaw_sd: float  # [rad]
    wanted: Array  # (4,) x, y, z [m], yaw [rad]
    path_time: float = float("nan")  # [s] since the path was begun; NaN before
    s: float = float("nan")  # [m] along the leg that is flown
    holding: bool = False  # a stop, or the end
    doubt: Doubt = Doubt.SURE
    doubt_reason: str = ""  # in plain words, empty when sure
    measured: PoseMeasurement | None = None  # what this tick's depth frame said
    unseen_reason: str = ""  # why this tick's depth frame said nothing


@dataclass(frozen=True, slots=True)
class Decision:
    """What a pilot answers to an observation."""

    command: Command
    phase: str
    diagnostics: Diagnostics = field(default_factory=Diagnostics)
    requests: tuple[MatchRequest, ...] = ()
    outcome: Outcome | None = None  # the pilot may end with REACHED, LOST or STUCK
    reason: str = ""  # of the outcome; before there is one, what a pilot that searches is kept by
    whereabouts: Whereabouts | None = None  # of a pilot that is located, once it knows


class Pilot(Protocol):
    """A deterministic state machine: it never reads a clock, a file or a device."""

    def step(self, observation: Observation) -> Decision:
        """Answer one observation; the same sequence of observations gives the same decisions, bit for bit."""
        ...


@dataclass(frozen=True, slots=True)
class Truth:
    """What only the recorder and the judge are told, and only in simulation."""

    stamp: float  # [s]
    pose: Pose
    v_world: Array  # (3,) [m/s]
    clearance: float  # [m], hull surface to the nearest column, furniture or person; negative inside
    contacts: tuple[str, ...] = ()  # names of what the hull touches
