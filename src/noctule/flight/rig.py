"""What flies: the devices on one clock, and how they come into the air."""

from __future__ import annotations

from dataclasses import dataclass

from noctule.devices.protocols import Camera, Clock, DepthCamera, DeviceError, Referee, Vehicle
from noctule.messages import FlightState

_TAKEOFF_LIMIT = 20.0  # [s]


@dataclass(frozen=True, slots=True)
class Rig:
    """The devices; the front camera, the depth camera above and the referee where there is one."""

    clock: Clock
    vehicle: Vehicle
    camera: Camera | None = None
    referee: Referee | None = None
    ceiling: DepthCamera | None = None


def take_off(rig: Rig, height: float, rate_hz: float = 30.0) -> None:
    """Have the vehicle hover at `height` [m]; one that flies already is left alone. Raises DeviceError."""
    if rig.vehicle.state().flight_state == FlightState.FLYING:
        return
    rig.vehicle.arm()
    rig.vehicle.takeoff(height)
    begin = rig.clock.now()
    while (state := rig.vehicle.state()).flight_state != FlightState.FLYING:
        waited = rig.clock.now() - begin
        if waited > _TAKEOFF_LIMIT:
            rig.vehicle.land()
            raise DeviceError(
                f"take-off: the vehicle still says {str(state.flight_state)!r} after {waited:.0f} s, "
                "expected 'flying'; is it armed, level and charged?"
            )
        rig.clock.sleep_until(rig.clock.now() + 1.0 / rate_hz)
