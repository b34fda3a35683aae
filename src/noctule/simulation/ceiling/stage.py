"""What a depth camera on the ceiling sees of a room, a quadrotor in it and things that move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.geometry import Array, Pose
from noctule.messages import DepthFrame
from noctule.simulation.ceiling.casting import Canvas
from noctule.simulation.ceiling.painter import Painter
from noctule.simulation.ceiling.quadrotor import quadrotor
from noctule.simulation.ceiling.room import lab_room, room_rows
from noctule.simulation.ceiling.sensor import DepthSensor
from noctule.simulation.ceiling.shapes import COLUMNS, OPACITY, moved, pack
from noctule.simulation.ceiling.spec import CeilingSpec
from noctule.simulation.ceiling.things import ThingPose, thing_rows
from noctule.simulation.layout import draw_layout
from noctule.simulation.spec import RoomSpec

_NUMBERS = 2**32  # of milliseconds, after which errors come again


class DepthStage:
    """Draws depth frames. The same spec, seed, room, stamp and poses give the same frame bit for bit.

    Stamps are what tells the sensor's errors of two frames apart: give each frame one of its own.

    Parameters
    ----------
    spec : the camera, its errors, and the quadrotor's hull and markers
    seed : draws the sensor's errors and, where no room is given, the room
    room : what stands still; `lab_room(seed)` by default
    """

    def __init__(self, spec: CeilingSpec, seed: int, room: RoomSpec | None = None) -> None:
        self.spec = spec
        self.room = lab_room(seed) if room is None else room
        self.camera: FixedCamera = spec.camera
        pinhole = self.camera.intrinsics
        errors, self._seed = np.random.SeedSequence([seed, 4]).spawn(2)
        self._sensor = DepthSensor(pinhole, spec, errors)
        self._layout = draw_layout(self.room)
        self._drone = pack(list(quadrotor(spec.hull, spec.markers)))
        self._canvas, self._still = Canvas(pinhole), Canvas(pinhole)
        size = (pinhole.height, pinhole.width)
        self._still.cast(self._seen(room_rows(self._layout)), np.zeros(size, np.uint16))
        self._still_loss = np.full(size, 65535, np.uint16)
        self._sensor.lose(self._still, self._still_loss)
        self._painter: Painter | None = None

    def frame(
        self,
        stamp: float,
        drone_pose: Pose | None,
        things: Sequence[ThingPose] = (),
        colour: bool = False,
    ) -> DepthFrame:
        """Return what the camera sees at `stamp` [s]; without a pose there is no quadrotor in the room."""
        number = round(stamp * 1000.0) % _NUMBERS
        rows = self._rows(drone_pose, things)
        self._canvas.copy_from(self._still)
        self._canvas.cast(rows, self._sensor.bank.veil(number))
        loss = self._still_loss.copy()
        self._sensor.lose(self._canvas, loss)
        depth = self._sensor.sense(number, self._canvas, loss)
        return DepthFrame(stamp, depth, self._colour(number, rows) if colour else None)

    def exact(self, drone_pose: Pose | None, things: Sequence[ThingPose] = ()) -> Array:
        """Return the exact depth [m] (height, width), 0 where there is none, rotors left out: for tests."""
        rows = self._rows(drone_pose, things)
        self._canvas.copy_from(self._still)
        self._canvas.cast(rows[rows[:, OPACITY] == 1.0], np.zeros(self._still_loss.shape, np.uint16))
        n = self._canvas.nearness.astype(np.float64)
        return np.divide(1.0, n, out=np.zeros_like(n), where=n > 0.0)

    def _rows(self, drone_pose: Pose | None, things: Sequence[ThingPose]) -> Array:
        parts = [thing_rows(thing) for thing in things]
        if drone_pose is not None:
            parts.append(moved(self._drone, drone_pose.R_world_body, drone_pose.position))
        return self._seen(np.vstack(parts)) if parts else np.empty((0, COLUMNS))

    def _seen(self, rows: Array) -> Array:
        """Take parts in the world to camera coordinates."""
        R = self.camera.R_world_camera.T
        return moved(rows, R, -R @ self.camera.t_world_camera)

    def _colour(self, number: int, rows: Array) -> NDArray[np.uint8]:
        if self._painter is None:
            self._painter = Painter(self._layout, self.camera, self._still, self.spec.sensor, self._seed)
        return self._painter.paint(number, rows)
