"""What a depth camera on the ceiling sees of a room, a quadrotor in it and things that move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.geometry import Array, Pose
from noctule.messages import DepthFrame
from noctule.simulation.ceiling.casting import Canvas
from noctule.simulation.ceiling.quadrotor import quadrotor
from noctule.simulation.ceiling.room import lab_room, room_rows
from noctule.simulation.ceiling.sensor import DepthSensor
from noctule.simulation.ceiling.shapes import COLUMNS, moved, pack
from noctule.simulation.ceiling.spec import CeilingSpec
from noctule.simulation.ceiling.things import ThingPose, thing_rows
from noctule.simulation.layout import draw_layout
from noctule.simulation.renderer import Renderer
from noctule.simulation.scene import build_scene
from noctule.simulation.spec import RoomSpec

_DARKEST = 0.45  # of a surface seen edge on, beside one that faces the camera


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
        self._sensor = DepthSensor(pinhole, spec, np.random.SeedSequence([seed, 4]))
        self._layout = draw_layout(self.room)
        self._drone = pack(list(quadrotor(spec.hull, spec.markers)))
        self._canvas, self._still = Canvas(pinhole), Canvas(pinhole)
        rows = self._seen(room_rows(self._layout))
        self._still.cast(rows, np.zeros((pinhole.height, pinhole.width), np.uint16))
        self._still_echo = self._still.cosine * rows[self._still.owner, 18].astype(np.float32)
        self._still.owner[:] = -1
        self._still_lit = np.ones((pinhole.height, pinhole.width), np.bool_)
        self._sensor.shade(self._still.nearness, self._still_lit, 0, pinhole.height)
        self._picture: NDArray[np.uint8] | None = None

    def frame(
        self,
        stamp: float,
        drone_pose: Pose | None,
        things: Sequence[ThingPose] = (),
        colour: bool = False,
    ) -> DepthFrame:
        """Return what the camera sees at `stamp` [s]; without a pose there is no quadrotor in the room."""
        number = round(stamp * 1000.0)
        parts = [thing_rows(thing) for thing in things]
        if drone_pose is not None:
            parts.append(moved(self._drone, drone_pose.R_world_body, drone_pose.position))
        rows = self._seen(np.vstack(parts)) if parts else np.empty((0, COLUMNS))
        canvas = self._canvas
        canvas.copy_from(self._still)
        chance = self._sensor.bank.chances(number)[1]
        top, bottom = canvas.cast(rows, chance)
        lit, echo = self._still_lit, self._still_echo
        if top < bottom:
            lit, echo = lit.copy(), echo.copy()
            self._sensor.shade(canvas.nearness, lit, top, bottom)
            owner = canvas.owner[top:bottom]
            drawn = owner >= 0
            echo[top:bottom][drawn] = canvas.cosine[top:bottom][drawn] * rows[owner[drawn], 18]
        depth = self._sensor.sense(number, canvas.nearness, lit, echo)
        return DepthFrame(stamp, depth, self._coloured(rows) if colour else None)

    def exact(self) -> Array:
        """Return the exact depth [m] of the frame drawn last (height, width), 0 where there is none."""
        n = self._canvas.nearness.astype(np.float64)
        return np.divide(1.0, n, out=np.zeros_like(n), where=n > 0.0)

    def _seen(self, rows: Array) -> Array:
        """Take parts in the world to camera coordinates."""
        R = self.camera.R_world_camera.T
        return moved(rows, R, -R @ self.camera.t_world_camera)

    def _coloured(self, rows: Array) -> NDArray[np.uint8]:
        if self._picture is None:
            eye = Renderer(build_scene(self._layout), self.camera.intrinsics)
            try:
                self._picture = eye.draw(self.camera.R_world_camera, self.camera.t_world_camera)
            finally:
                eye.close()
        picture = self._picture.copy()
        drawn = self._canvas.owner >= 0
        if drawn.any():
            shade = _DARKEST + (1.0 - _DARKEST) * self._canvas.cosine[drawn]
            rgb = rows[self._canvas.owner[drawn], 19:22] * shade[:, None]
            picture[drawn] = np.rint(255.0 * np.clip(rgb, 0.0, 1.0)).astype(np.uint8)
        return picture
