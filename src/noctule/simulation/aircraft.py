"""The simulated quadcopter and its autopilot: flight states, expiring commands, gusts, one step at a time."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np

from noctule.devices.protocols import DeviceError
from noctule.geometry import Pose, wrap_angle
from noctule.messages import Command, FlightState, VehicleState
from noctule.simulation.dynamics import STEPS_PER_SECOND, Four, Motion, advance, fall, make_model, rest
from noctule.simulation.navdata import Navdata
from noctule.simulation.sensors import StateSensors
from noctule.simulation.spec import VehicleSpec

Three = tuple[float, float, float]

HOVER: Four = (0.0, 0.0, 0.0, 0.0)
DESCENT = 0.3  # [m/s]
GUST_BLOCK = 1024  # steps drawn at a time


class Aircraft:
    """The truth about the vehicle. Only the world holds it; pilots get `SimulatedVehicle`."""

    def __init__(
        self, spec: VehicleSpec, start: Pose, flying: bool, seeds: tuple[np.random.SeedSequence, ...]
    ) -> None:
        self.spec = spec
        self.limits = spec.limits.values()
        self.floor = spec.hull_height / 2.0  # height of the hull's centre when it stands [m]
        z = float(start.position[2]) if flying else self.floor
        self.motion = Motion(float(start.position[0]), float(start.position[1]), z, start.yaw)
        self.steps = 0
        self.armed = flying
        self._model = make_model(spec)
        self._state = FlightState.FLYING if flying else FlightState.LANDED
        self._motors_off = False
        self._target_height = z
        self._arriving: deque[tuple[int, int, Four]] = deque()  # (step of effect, step of expiry, command)
        self._command = HOVER
        self._expiry: int | None = None  # step; None: nothing was ever sent since the take-off
        self._gust_rng = np.random.default_rng(seeds[0])
        self._gusts: list[Three] = []
        self._sensors = StateSensors(spec, seeds[1])
        self._report_every = max(1, round(STEPS_PER_SECOND / spec.report_rate))
        self._report = self._sensors.report(self.motion, 0.0, self._state)
        self.navdata: Navdata | None = None
        if spec.navdata is not None:
            self.navdata = Navdata(spec.navdata, seeds[1], STEPS_PER_SECOND)
            self._report = self.navdata.measured(self._true_report())
        self._pushes = [
            (first, first + max(1, round(push.seconds * STEPS_PER_SECOND)), push)
            for push in spec.pushes
            for first in [round(push.time_s * STEPS_PER_SECOND)]
        ]

    @property
    def now(self) -> float:
        """Simulated time [s]."""
        return self.steps / STEPS_PER_SECOND

    @property
    def flight_state(self) -> FlightState:
        """What it is doing."""
        return FlightState.EMERGENCY if self._motors_off else self._state

    @property
    def pose(self) -> Pose:
        """The true pose of the hull's centre."""
        m = self.motion
        return Pose(np.array([m.x, m.y, m.z]), wrap_angle(m.yaw), m.roll, m.pitch)

    def report(self) -> VehicleState:
        """Return the newest report; the flight state is always that of now."""
        return replace(self._report, flight_state=self.flight_state)

    def arm(self) -> None:
        """Make ready; raises DeviceError while falling with the motors off."""
        if self._motors_off:
            if self.motion.z > self.floor:
                raise DeviceError(
                    f"simulated vehicle: cannot arm while it falls, height {self.motion.z:.2f} m; "
                    "wait until it lies on the floor"
                )
            self._motors_off = False
            self._state = FlightState.LANDED
        self.armed = True

    def takeoff(self, height: float) -> None:
        """Begin to climb; raises DeviceError when it is not armed or stands not on the floor."""
        state = self.flight_state
        if state is not FlightState.LANDED or not self.armed:
            found = state.value if state is not FlightState.LANDED else "not armed"
            raise DeviceError(
                f"simulated vehicle: cannot take off, it is {found}; "
                "expected landed and armed: call arm() first"
            )
        if not math.isfinite(height) or height <= self.floor:
            raise DeviceError(
                f"simulated vehicle: cannot take off to {height:g} m; expected more than {self.floor:g} m"
            )
        self._target_height = height
        self._forget_commands()
        self._state = FlightState.TAKING_OFF

    def land(self) -> None:
        """Begin to land; nothing happens when it is not in the air."""
        if self._state in (FlightState.FLYING, FlightState.TAKING_OFF):
            self._forget_commands()
            self._state = FlightState.LANDING

    def emergency(self) -> None:
        """Stop the motors; one assignment, so any thread may call it."""
        self._motors_off = True

    def send(self, command: Command, valid_for: float) -> Command:
        """Take a command, cut to the limits; outside of FLYING nothing is sent but hover."""
        values = (command.forward, command.left, command.up, command.yaw_rate)
        if not all(map(math.isfinite, values)) or not valid_for > 0.0:
            raise DeviceError(
                f"simulated vehicle: command {values} for {valid_for} s; "
                "expected finite numbers and a time above 0"
            )
        if self.flight_state is not FlightState.FLYING:
            return Command()
        limits = self.limits
        sent: Four = (
            _cut(command.forward, limits.forward),
            _cut(command.left, limits.left),
            _cut(command.up, limits.up),
            _cut(command.yaw_rate, limits.yaw_rate),
        )
        effect = self.steps + round(self.spec.command_latency * STEPS_PER_SECOND)
        expiry = self.steps + math.ceil(valid_for * STEPS_PER_SECOND - 1e-6)
        self._arriving.append((effect, expiry, sent))
        return Command(*sent)

    def step(self) -> None:
        """Move by one step of 1/300 s."""
        if not self._gusts:
            block = self.spec.gusts * self._gust_rng.standard_normal((GUST_BLOCK, 3))
            self._gusts = [(float(g[0]), float(g[1]), float(g[2])) for g in block]
        blow, twist = self._gusts.pop(), 0.0
        if self._pushes:
            blow, twist = self._pushed(blow)
        if self._motors_off:
            fall(self.motion, self.floor)
            self.armed = False
        elif self._state is not FlightState.LANDED:
            wanted = self._wanted()
            advance(self.motion, self._model, self.spec, wanted, blow, twist, self._bias())
            if self.motion.z <= self.floor:
                self.motion.z = self.floor
                self.motion.vz = max(0.0, self.motion.vz)
                if self._state is FlightState.LANDING:
                    rest(self.motion, self.floor)
                    self._state = FlightState.LANDED
                    self.armed = False
        self.steps += 1
        if self.navdata is not None:
            self._report = self.navdata.step(self.steps, self._true_report) or self._report
        elif self.steps % self._report_every == 0:
            self._report = self._sensors.report(self.motion, self.now, self._state)

    def _pushed(self, gust: Three) -> tuple[Three, float]:
        """Return (gust [m/s^2, world], yaw acceleration [rad/s^2]) with the pushes of this step."""
        (x, y, z), twist = gust, 0.0
        for first, end, push in self._pushes:
            if first <= self.steps < end:
                a = push.acceleration_m_s2
                x, y, z, twist = x + a[0], y + a[1], z + a[2], twist + push.yaw_rad_s2
        return (x, y, z), twist

    def _bias(self) -> Three | None:
        """Return what the onboard loop takes the velocity for too much, [m/s] in the heading frame."""
        if self.navdata is None or not self.spec.loop_on_measured:
            return None
        forward, left, up = self.navdata.velocity_bias.tolist()
        # Taking off and landing go by the height: by the velocity alone they might never end.
        return forward, left, up if self._state is FlightState.FLYING else 0.0

    def _true_report(self) -> VehicleState:
        """Return a report without errors in what navdata has errors of its own for."""
        velocity = np.array(self.motion.heading_velocity()[:3])
        report = self._sensors.report(self.motion, self.now, self._state)
        return replace(report, yaw=wrap_angle(self.motion.yaw), v_body=velocity, height=self.motion.z)

    def _wanted(self) -> Four:
        if self._state is FlightState.TAKING_OFF:
            error = self._target_height - self.motion.z
            if abs(error) < 0.02 and abs(self.motion.vz) < 0.05:
                self._state = FlightState.FLYING
            return (0.0, 0.0, _cut(1.5 * error, self.limits.up), 0.0)
        if self._state is FlightState.LANDING:
            return (0.0, 0.0, -min(DESCENT, self.limits.up), 0.0)
        while self._arriving and self._arriving[0][0] <= self.steps:
            _, self._expiry, self._command = self._arriving.popleft()
        if self._expiry is None or self.steps < self._expiry:
            return self._command
        if self.steps >= self._expiry + round(self.spec.land_after * STEPS_PER_SECOND):
            self.land()
        return HOVER

    def _forget_commands(self) -> None:
        self._arriving.clear()
        self._command, self._expiry = HOVER, None


def _cut(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
