"""The protocols between the flight loop and what it flies (simulated or real).

See the documentation's page on conventions for frames. One contract test suite runs against every
implementation.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

from noctule.camera import CameraMount, PinholeCamera
from noctule.errors import NoctuleError
from noctule.messages import Command, DepthFrame, Limits, Picture, Truth, VehicleState


class DeviceError(NoctuleError):
    """A vehicle or camera that does not do what was asked of it."""


class StaleFrameError(DeviceError):
    """The newest picture is older than the reader allows."""


class InputKind(StrEnum):
    """What the vehicle itself takes as input; a driver declares it and never pretends."""

    VELOCITY = "velocity"
    TILT = "tilt"
    STICKS = "sticks"


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What a vehicle can do."""

    input_kind: InputKind
    limits: Limits
    reports_velocity: bool
    reports_height: bool
    flat_trim: bool = False
    external_pose: bool = False


class Clock(Protocol):
    """The flight's time: the host's monotonic clock for real devices, simulated time in simulation."""

    def now(self) -> float:
        """Return the time [s]."""
        ...

    def sleep_until(self, stamp: float) -> None:
        """Return at `stamp` [s]; in simulation this is what makes the world move."""
        ...


class Vehicle(Protocol):
    """A quadcopter. Its own sender owns the fixed rate; commands expire."""

    @property
    def capabilities(self) -> Capabilities:
        """What it can do."""
        ...

    def connect(self) -> None:
        """Open the link; raises DeviceError with what was found and what to do."""
        ...

    def close(self) -> None:
        """Close the link; idempotent."""
        ...

    def __enter__(self) -> Self:
        """Connect."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        ...

    def arm(self) -> None:
        """Make ready for take-off."""
        ...

    def takeoff(self, height: float) -> None:
        """Begin to climb to `height` [m] above the floor and hover there; returns at once."""
        ...

    def land(self) -> None:
        """Begin to land; returns at once."""
        ...

    def emergency(self) -> None:
        """Stop the motors: fire and forget, idempotent, from any thread."""
        ...

    def send(self, command: Command, valid_for: float) -> Command:
        """Send a velocity and return what was really sent.

        A command older than `valid_for` [s] is replaced by hover, then by landing.
        """
        ...

    def state(self) -> VehicleState:
        """Return the newest report."""
        ...


class Camera(Protocol):
    """A colour camera. The newest picture wins."""

    @property
    def intrinsics(self) -> PinholeCamera:
        """The pinhole."""
        ...

    @property
    def mount(self) -> CameraMount:
        """How it sits on the body."""
        ...

    @property
    def live(self) -> bool:
        """Whether pictures are coming."""
        ...

    def open(self) -> None:
        """Start the stream; may block, so call it off the control thread."""
        ...

    def close(self) -> None:
        """Stop the stream; idempotent."""
        ...

    def read(self, timeout: float) -> Picture:
        """Wait up to `timeout` [s] for the next picture that was not read before; raises DeviceError."""
        ...

    def latest(self, max_age: float) -> Picture:
        """Peek at the newest picture; raises StaleFrameError when its age is above `max_age` [s]."""
        ...


class DepthCamera(Protocol):
    """An RGB-D camera that stands in the room. The newest frame wins."""

    @property
    def intrinsics(self) -> PinholeCamera:
        """The pinhole of the depth image, which the colour image is registered to."""
        ...

    @property
    def live(self) -> bool:
        """Whether frames are coming."""
        ...

    def open(self) -> None:
        """Start the stream; may block, so call it off the control thread."""
        ...

    def close(self) -> None:
        """Stop the stream; idempotent."""
        ...

    def read(self, timeout: float) -> DepthFrame:
        """Wait up to `timeout` [s] for the next frame that was not read before; raises DeviceError."""
        ...

    def latest(self, max_age: float) -> DepthFrame:
        """Peek at the newest frame; raises StaleFrameError when its age is above `max_age` [s]."""
        ...


@runtime_checkable
class Referee(Protocol):
    """The truth, where there is one. Only the recorder and the judge are handed it."""

    def truth(self) -> Truth:
        """Return the true state now."""
        ...
