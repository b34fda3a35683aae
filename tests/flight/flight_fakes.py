"""A world without physics or pictures worth looking at: what the loop's tests fly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from noctule.camera import CameraMount, PinholeCamera
from noctule.devices.protocols import Capabilities, InputKind, StaleFrameError
from noctule.flight.rig import Rig
from noctule.geometry import Pose, rot_z
from noctule.messages import (
    Command,
    Decision,
    DepthFrame,
    Diagnostics,
    FlightState,
    Limits,
    MatchResult,
    Observation,
    Picture,
    Truth,
    VehicleState,
    Whereabouts,
)

RATE = 30.0


class FakeClock:
    """Moves what is registered when it is slept on."""

    def __init__(self) -> None:
        self.time = 0.0
        self.moved: list[Callable[[float], None]] = []

    def now(self) -> float:
        return self.time

    def sleep_until(self, stamp: float) -> None:
        dt = max(stamp - self.time, 0.0)
        self.time += dt
        for move in self.moved:
            move(dt)


class FakeVehicle:
    """Does exactly what it is told, at once."""

    capabilities = Capabilities(InputKind.VELOCITY, Limits(), True, True)

    def __init__(self, clock: FakeClock) -> None:
        self.clock = clock
        self.position = np.array([0.0, 0.0, 1.0])
        self.yaw = 0.0
        self.command = Command()
        self.flight_state = FlightState.FLYING
        self.battery: float | None = None
        self.frozen_since: float | None = None
        self.reports_velocity = True
        self.calls: list[str] = []
        self.sent: list[Command] = []
        self.takeoff_s = 1.0
        self._flying_at = np.inf
        clock.moved.append(self.move)

    def move(self, dt: float) -> None:
        if self.flight_state == FlightState.LANDING:
            self.position[2] = max(0.0, self.position[2] - 0.5 * dt)
            if self.position[2] == 0.0:
                self.flight_state = FlightState.LANDED
        elif self.flight_state == FlightState.TAKING_OFF and self.clock.time >= self._flying_at:
            self.flight_state = FlightState.FLYING
        elif self.flight_state == FlightState.FLYING:
            nu = self.command.as_array()
            self.position = self.position + rot_z(self.yaw) @ nu[:3] * dt
            self.yaw += float(nu[3]) * dt

    def arm(self) -> None:
        self.calls.append("arm")

    def takeoff(self, height: float) -> None:
        self.calls.append("takeoff")
        self.flight_state, self._flying_at = FlightState.TAKING_OFF, self.clock.time + self.takeoff_s

    def land(self) -> None:
        self.calls.append("land")
        self.flight_state = FlightState.LANDING

    def emergency(self) -> None:
        self.calls.append("emergency")
        self.flight_state = FlightState.EMERGENCY

    def send(self, command: Command, valid_for: float) -> Command:
        self.command = command
        self.sent.append(command)
        return command

    def state(self) -> VehicleState:
        stamp = self.clock.time if self.frozen_since is None else self.frozen_since
        v_body = self.command.as_array()[:3] if self.reports_velocity else None
        return VehicleState(
            stamp, self.flight_state, 0.0, 0.0, self.yaw, v_body, float(self.position[2]), self.battery
        )


class FakeCamera:
    """A grey picture that gets brighter, one per tick, delivered a tick after its exposure."""

    intrinsics = PinholeCamera.centred(32, 24, 30.0)
    mount = CameraMount()
    live = True

    def __init__(self, clock: FakeClock) -> None:
        self.clock = clock
        self.dead_after = np.inf

    def latest(self, max_age: float) -> Picture:
        stamp = min((round(self.clock.time * RATE) - 1) / RATE, self.dead_after)
        if self.clock.time - stamp > max_age or stamp < 0.0:
            raise StaleFrameError("fake camera: too old")
        shade = round(stamp * RATE) % 256
        return Picture(stamp, np.full((24, 32, 3), shade, dtype=np.uint8))


class FakeCeiling:
    """A flat depth image, one per tick, delivered a tick after its exposure."""

    intrinsics = PinholeCamera.centred(8, 6, 8.0)
    live = True

    def __init__(self, clock: FakeClock) -> None:
        self.clock = clock
        self.dead_after = np.inf

    def latest(self, max_age: float) -> DepthFrame:
        stamp = min((round(self.clock.time * RATE) - 1) / RATE, self.dead_after)
        if self.clock.time - stamp > max_age or stamp < 0.0:
            raise StaleFrameError("fake depth camera: too old")
        return DepthFrame(stamp, np.full((6, 8), 2000, dtype=np.uint16))


class FakeReferee:
    """Knows where the fake vehicle is."""

    def __init__(self, clock: FakeClock, vehicle: FakeVehicle) -> None:
        self.clock, self.vehicle = clock, vehicle
        self.wall_x = np.inf

    def truth(self) -> Truth:
        clearance = float(self.wall_x - self.vehicle.position[0])
        return Truth(
            self.clock.time,
            Pose(self.vehicle.position.copy(), self.vehicle.yaw),
            np.zeros(3),
            clearance,
            ("column_0",) if clearance <= 0.0 else (),
        )


class FakeWorld:
    """Clock, vehicle, camera and referee that belong together."""

    def __init__(self) -> None:
        self.clock = FakeClock()
        self.vehicle = FakeVehicle(self.clock)
        self.camera = FakeCamera(self.clock)
        self.referee = FakeReferee(self.clock, self.vehicle)
        self.ceiling = FakeCeiling(self.clock)
        self.rig = Rig(self.clock, self.vehicle, self.camera, self.referee)
        self.located_rig = Rig(self.clock, self.vehicle, referee=self.referee, ceiling=self.ceiling)


class ScriptedPilot:
    """Answers each observation with the next line of a script, and remembers what it was told."""

    def __init__(self, answer: Callable[[int, Observation], Decision]) -> None:
        self.answer = answer
        self.told: list[Observation] = []

    def step(self, observation: Observation) -> Decision:
        self.told.append(observation)
        return self.answer(len(self.told) - 1, observation)


def forward(speed: float = 0.3) -> ScriptedPilot:
    """A pilot that flies ahead and never ends."""
    return ScriptedPilot(lambda i, o: Decision(Command(speed), "flying", Diagnostics(epsilon_px=9.0)))


def whereabouts(stamp: float, position: np.ndarray, yaw: float = 0.0, sd: float = 0.0) -> Whereabouts:
    """What a located pilot says of itself."""
    return Whereabouts(stamp, position, yaw, np.zeros(4), sd, 0.0, np.append(position, yaw))


def no_match(picture: Picture, index: int) -> MatchResult:
    """A matcher that finds nothing."""
    return MatchResult(picture.stamp, index, np.empty((0, 2)), np.empty((0, 2)), "nothing alike")
