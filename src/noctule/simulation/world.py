"""A simulated world: a room, a vehicle in it, its camera, a clock that makes it move, and the referee."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import TracebackType
from typing import Self

import numpy as np

from noctule.geometry import Pose
from noctule.messages import Picture, Truth
from noctule.simulation.aircraft import Aircraft
from noctule.simulation.camera import PixelNoise, Shutter, SimulatedCamera
from noctule.simulation.ceiling import CeilingSpec, Motion
from noctule.simulation.ceiling.device import DepthShutter, SimulatedDepthCamera
from noctule.simulation.clearance import Clearance
from noctule.simulation.darkroom import Darkroom, Eye
from noctule.simulation.dynamics import STEPS_PER_SECOND
from noctule.simulation.layout import draw_layout
from noctule.simulation.renderer import Renderer
from noctule.simulation.scene import build_scene
from noctule.simulation.spec import CameraSpec, RoomSpec, VehicleSpec, WorldSpec
from noctule.simulation.vehicle import SimulatedVehicle


class SimulatedClock:
    """Implements `noctule.devices.protocols.Clock`: time passes only in `sleep_until`."""

    def __init__(self, aircraft: Aircraft, shutters: Sequence[Shutter | DepthShutter]) -> None:
        self.__aircraft = aircraft
        self.__shutters = tuple(shutters)

    def now(self) -> float:
        """Return the simulated time [s]."""
        return self.__aircraft.now

    def sleep_until(self, stamp: float) -> None:
        """Move the world, in steps of 1/300 s, until `stamp` [s] or just past it; the past is no error."""
        last = math.ceil(stamp * STEPS_PER_SECOND - 1e-6)
        while self.__aircraft.steps < last:
            self.__aircraft.step()
            for shutter in self.__shutters:
                shutter.step()


class SimulatedReferee:
    """Implements `noctule.devices.protocols.Referee`."""

    def __init__(self, aircraft: Aircraft, clearance: Clearance) -> None:
        self._aircraft = aircraft
        self._clearance = clearance

    def truth(self) -> Truth:
        """Return the true state now; the clearance is that of the tilted hull, of what moves too."""
        pose, m = self._aircraft.pose, self._aircraft.motion
        clearance, contacts = self._clearance.measure(pose, self._aircraft.now)
        return Truth(self._aircraft.now, pose, np.array([m.vx, m.vy, m.vz]), clearance, contacts)


class SimulatedWorld:
    """A room with a vehicle in it. Close it, or use it in a with block.

    The same settings and seed give the same flight bit for bit. Looks of the room, gusts, the errors of
    reports and the pixels' noise have random streams of their own: one does not shift another. Nothing is
    drawn before the first picture is read.

    With a `ceiling` there is a depth camera above, `world.ceiling`. `motions` move about in the room: the
    ceiling camera sees them and the referee knows how near they are, the front camera does not see them.
    """

    def __init__(
        self,
        room: RoomSpec,
        vehicle: VehicleSpec,
        camera: CameraSpec,
        start: Pose,
        seed: int,
        *,
        start_flying: bool = True,
        ceiling: CeilingSpec | None = None,
        motions: Sequence[Motion] = (),
    ) -> None:
        gusts, reports, pixels, photographs, above = np.random.SeedSequence(seed).spawn(5)
        self.room = room
        self._camera_spec = camera
        self._layout = draw_layout(room)
        self._aircraft = Aircraft(vehicle, start, start_flying, (gusts, reports))
        self._clearance = Clearance(self._layout, vehicle, motions)
        self._darkroom = Darkroom(self._make_eye)
        self._shutter = Shutter(camera, self._aircraft, self._darkroom, pixels)
        shutters: list[Shutter | DepthShutter] = [self._shutter]
        depth_shutter = None
        if ceiling is not None:
            depth_shutter = DepthShutter(ceiling, self._aircraft, room, tuple(motions), above)
            shutters.append(depth_shutter)
        for shutter in shutters:
            shutter.step()
        self._photo_noise = PixelNoise(camera.noise, photographs)
        self._photos = 0
        self.clock = SimulatedClock(self._aircraft, shutters)
        self.vehicle = SimulatedVehicle(self._aircraft, connected=False)
        self.camera = SimulatedCamera(camera, self._shutter, self.clock.now, self.clock.sleep_until)
        self.ceiling: SimulatedDepthCamera | None = None
        if ceiling is not None and depth_shutter is not None:
            self.ceiling = SimulatedDepthCamera(
                ceiling, depth_shutter, self.clock.now, self.clock.sleep_until
            )
        self.referee = SimulatedReferee(self._aircraft, self._clearance)

    @classmethod
    def from_spec(
        cls,
        spec: WorldSpec,
        *,
        start_flying: bool = True,
        ceiling: CeilingSpec | None = None,
        motions: Sequence[Motion] = (),
    ) -> Self:
        """Make the world that a description, for example a TOML file's, asks for."""
        start = Pose(np.array([spec.start.x, spec.start.y, spec.start.z]), spec.start.yaw)
        return cls(
            spec.room,
            spec.vehicle,
            spec.camera,
            start,
            spec.seed,
            start_flying=start_flying,
            ceiling=ceiling,
            motions=motions,
        )

    def photograph(self, pose: Pose, *, noisy: bool = False) -> Picture:
        """Return what the vehicle's camera would see from `pose`, stamped with the present."""
        pixels = self._darkroom.draw(pose)
        if noisy:
            pixels = self._photo_noise.add(pixels, self._photos)
            self._photos += 1
        return Picture(self._aircraft.now, pixels)

    def clearance(self, pose: Pose) -> tuple[float, tuple[str, ...]]:
        """Return (clearance [m], contacts) of the hull at `pose`: to plan experiments, not for pilots.

        What stands still counts, `motions` do not.
        """
        return self._clearance.measure(pose)

    def close(self) -> None:
        """Free the renderer; idempotent."""
        self._darkroom.close()

    def __enter__(self) -> Self:
        """Return the world."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def _make_eye(self) -> Eye:
        return Renderer(build_scene(self._layout), self._camera_spec.intrinsics, self._camera_spec.mount)
