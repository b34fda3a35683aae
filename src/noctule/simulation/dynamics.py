"""How a simulated quadcopter moves: velocity models behind one interface, and the step that they share.

Everything here is plain floats: ten steps of 1/300 s make a camera frame, and numpy costs more than it
gives on vectors of three.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Protocol

from noctule.errors import NoctuleError
from noctule.simulation.spec import VehicleSpec

STEPS_PER_SECOND = 300
STEP = 1.0 / STEPS_PER_SECOND
GRAVITY = 9.81  # [m/s^2]

Four = tuple[float, float, float, float]


class UnknownModelError(NoctuleError):
    """A vehicle model whose name nobody registered."""


class VehicleModel(Protocol):
    """A quadcopter with its autopilot, seen from outside: a velocity is asked, an acceleration follows."""

    def acceleration(self, velocity: Four, command: Four, measured: Four | None = None) -> Four:
        """Return (forward, left, up [m/s^2], yaw [rad/s^2]) before the vehicle's limits.

        `velocity` and `command` are (forward, left, up [m/s], yaw rate [rad/s]). The accelerations are
        those of the world, resolved on the axes of the levelled heading frame: body velocities are not
        differentiated. `measured` is what the vehicle's own loop takes its velocity for; None: the true one.
        """
        ...


@dataclass(frozen=True, slots=True)
class FirstOrderModel:
    """The velocity follows the command with a lag: a = (command - v) / lag on every axis."""

    lag: float  # [s]

    def acceleration(self, velocity: Four, command: Four, measured: Four | None = None) -> Four:
        """See VehicleModel; the whole response is the loop's, so it sees nothing but what is measured."""
        gain, v = 1.0 / self.lag, velocity if measured is None else measured
        return (
            gain * (command[0] - v[0]),
            gain * (command[1] - v[1]),
            gain * (command[2] - v[2]),
            gain * (command[3] - v[3]),
        )


@dataclass(frozen=True, slots=True)
class IdentifiedModel:
    """The AR.Drone 2.0 as identified by Santana et al.: a = k_u u - k_v v with inputs u in [-1, 1].

    Eq. (2) and Table 1 of "Indoor localization and path following", corrected: the left side is the world
    acceleration resolved on body axes. Its inputs are not velocities, so an onboard loop goes with it,
    u = (k_v command + gain (command - v)) / k_u cut to [-1, 1], with the gain that gives the wanted lag
    where the drag alone is slower.
    """

    input_gains: Four  # k1, k3, k5, k7
    drags: Four  # k2, k4, k6, k8 [1/s]
    lag: float  # [s]

    def inputs(self, velocity: Four, command: Four) -> Four:
        """Return what the onboard loop sends: (u_x, u_y, u_z, u_yaw), each in [-1, 1]."""
        return (
            self._input(0, velocity[0], command[0]),
            self._input(1, velocity[1], command[1]),
            self._input(2, velocity[2], command[2]),
            self._input(3, velocity[3], command[3]),
        )

    def acceleration(self, velocity: Four, command: Four, measured: Four | None = None) -> Four:
        """See VehicleModel; drag acts on the true velocity, the loop on the measured one."""
        seen = velocity if measured is None else measured
        u, k, d = self.inputs(seen, command), self.input_gains, self.drags
        return (
            k[0] * u[0] - d[0] * velocity[0],
            k[1] * u[1] - d[1] * velocity[1],
            k[2] * u[2] - d[2] * velocity[2],
            k[3] * u[3] - d[3] * velocity[3],
        )

    def _input(self, axis: int, velocity: float, command: float) -> float:
        drag = self.drags[axis]
        gain = max(0.0, 1.0 / self.lag - drag)
        u = (drag * command + gain * (command - velocity)) / self.input_gains[axis]
        return max(-1.0, min(1.0, u))


def _first_order(spec: VehicleSpec) -> VehicleModel:
    return FirstOrderModel(spec.lag)


def _identified(spec: VehicleSpec) -> VehicleModel:
    k = spec.k
    return IdentifiedModel((k[0], k[2], k[4], k[6]), (k[1], k[3], k[5], k[7]), spec.lag)


ModelFactory = Callable[[VehicleSpec], VehicleModel]
_FACTORIES: dict[str, ModelFactory] = {"first_order": _first_order, "identified": _identified}
ENTRY_POINT_GROUP = "noctule.vehicle_models"


def make_model(spec: VehicleSpec) -> VehicleModel:
    """Return the model that `spec.model` names: built in, or another package's entry point.

    Raises UnknownModelError.
    """
    factory = _FACTORIES.get(spec.model)
    if factory is None:
        check_model_name(spec.model)
        factory = _in_packages()[spec.model].load()
    return factory(spec)


def check_model_name(name: str) -> None:
    """Raise UnknownModelError unless a model is called so."""
    if name in _FACTORIES:  # every mission asks, and looking through all packages takes milliseconds
        return
    known = sorted({*_FACTORIES, *_in_packages()})
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]}?" if near else f"expected one of: {', '.join(known)}"
        raise UnknownModelError(
            f"vehicle model {name!r} is not known; {hint}; a package adds one as an entry point of the group "
            f"{ENTRY_POINT_GROUP!r}"
        )


def _in_packages() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=ENTRY_POINT_GROUP)}


@dataclass(slots=True)
class Motion:
    """The moving state: hull centre and velocity in the world, heading, tilt; changed in place."""

    x: float
    y: float
    z: float
    yaw: float  # [rad], unwrapped
    vx: float = 0.0  # [m/s], world
    vy: float = 0.0
    vz: float = 0.0
    yaw_rate: float = 0.0  # [rad/s]
    roll: float = 0.0  # [rad]
    pitch: float = 0.0  # [rad]

    def heading_velocity(self) -> Four:
        """Return (forward, left, up [m/s], yaw rate [rad/s])."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return (c * self.vx + s * self.vy, c * self.vy - s * self.vx, self.vz, self.yaw_rate)


def advance(
    motion: Motion,
    model: VehicleModel,
    spec: VehicleSpec,
    command: Four,
    gust: tuple[float, float, float],
    twist: float = 0.0,
    bias: tuple[float, float, float] | None = None,
) -> None:
    """Move by one step of 1/300 s, in place (semi-implicit Euler).

    The autopilot's acceleration is cut to the limits; the gust [m/s^2, world] and the twist [rad/s^2] come
    on top of it. Roll and pitch are those of a rotor thrust that gives the autopilot's acceleration: it leans
    against a gust as far as the velocity loop asks for it, and nothing leans against drag. The loop takes the
    velocity for what it is plus `bias` [m/s, heading frame].
    """
    c, s = math.cos(motion.yaw), math.sin(motion.yaw)
    velocity = (c * motion.vx + s * motion.vy, c * motion.vy - s * motion.vx, motion.vz, motion.yaw_rate)
    if bias is None:
        forward, left, up, turn = model.acceleration(velocity, command)
    else:
        measured = (velocity[0] + bias[0], velocity[1] + bias[1], velocity[2] + bias[2], velocity[3])
        forward, left, up, turn = model.acceleration(velocity, command, measured)
    norm = math.sqrt(forward * forward + left * left + up * up)
    if norm > spec.limits.acceleration:
        scale = spec.limits.acceleration / norm
        forward, left, up = forward * scale, left * scale, up * scale
    turn = max(-spec.limits.yaw_acceleration, min(spec.limits.yaw_acceleration, turn))
    motion.vx += STEP * (c * forward - s * left + gust[0])
    motion.vy += STEP * (s * forward + c * left + gust[1])
    motion.vz += STEP * (up + gust[2])
    motion.yaw_rate += STEP * (turn + twist)
    _move(motion)
    # The thrust direction is R_y(pitch) R_x(roll) e_z = (sin p cos r, -sin r, cos p cos r).
    lift = GRAVITY + up
    pitch = math.atan2(forward, lift)
    roll = math.atan2(-left, math.sqrt(forward * forward + lift * lift))
    share = 1.0 - math.exp(-STEP / spec.tilt_lag)
    motion.roll += share * (roll - motion.roll)
    motion.pitch += share * (pitch - motion.pitch)


def fall(motion: Motion, floor: float) -> None:
    """Move by one step of 1/300 s with the motors off; the hull's centre stops at height `floor` [m]."""
    motion.vz -= STEP * GRAVITY
    motion.yaw_rate = 0.0
    _move(motion)
    if motion.z <= floor:
        rest(motion, floor)


def rest(motion: Motion, floor: float) -> None:
    """Put the vehicle on the floor, level and still."""
    motion.z = floor
    motion.vx = motion.vy = motion.vz = motion.yaw_rate = motion.roll = motion.pitch = 0.0


def _move(motion: Motion) -> None:
    motion.x += STEP * motion.vx
    motion.y += STEP * motion.vy
    motion.z += STEP * motion.vz
    motion.yaw += STEP * motion.yaw_rate
