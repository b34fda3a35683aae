"""The simulated vehicle as the flight loop sees it: the `Vehicle` protocol, and no way to the truth."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from noctule.devices.protocols import Capabilities, DeviceError, InputKind
from noctule.messages import Command, VehicleState
from noctule.simulation.aircraft import Aircraft


class SimulatedVehicle:
    """Implements `noctule.devices.protocols.Vehicle` in a simulated world."""

    def __init__(self, aircraft: Aircraft, connected: bool) -> None:
        self.__aircraft = aircraft
        self._connected = connected

    @property
    def capabilities(self) -> Capabilities:
        """It takes velocities and reports velocity and height."""
        return Capabilities(
            InputKind.VELOCITY, self.__aircraft.limits, reports_velocity=True, reports_height=True
        )

    def connect(self) -> None:
        """Open the link; nothing can fail here."""
        self._connected = True

    def close(self) -> None:
        """Close the link; commands then expire by themselves."""
        self._connected = False

    def __enter__(self) -> Self:
        """Connect."""
        self.connect()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def arm(self) -> None:
        """Make ready for take-off; after an emergency, when it lies on the floor, this resets it."""
        self._link().arm()

    def takeoff(self, height: float) -> None:
        """Begin to climb to `height` [m]: the hull's centre above the floor."""
        self._link().takeoff(height)

    def land(self) -> None:
        """Begin to land; returns at once."""
        self._link().land()

    def emergency(self) -> None:
        """Stop the motors; from any thread, as often as wanted, whether connected or not."""
        self.__aircraft.emergency()

    def send(self, command: Command, valid_for: float) -> Command:
        """Send a velocity and return it as cut to the limits; hover when it is not flying."""
        return self._link().send(command, valid_for)

    def state(self) -> VehicleState:
        """Return the newest report."""
        return self._link().report()

    def _link(self) -> Aircraft:
        if not self._connected:
            raise DeviceError(
                "simulated vehicle: not connected; call connect() first, or use it in a with block"
            )
        return self.__aircraft
