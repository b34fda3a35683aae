"""Colour pictures that belong to the depth, pixel for pixel."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.geometry import Array
from noctule.simulation.camera import PixelNoise
from noctule.simulation.ceiling.casting import Canvas
from noctule.simulation.ceiling.shapes import OPACITY, RED, REFLECTANCE
from noctule.simulation.ceiling.spec import DepthSensorSpec
from noctule.simulation.layout import Layout
from noctule.simulation.renderer import Renderer
from noctule.simulation.scene import build_scene

_DARKEST = 0.45  # of a surface seen edge on, beside one that faces the camera
_SOFT = 0.6  # [px], blur of the lens


class Painter:
    """The room is drawn once, by OpenGL; what moves is laid over it."""

    def __init__(
        self,
        layout: Layout,
        camera: FixedCamera,
        still: Canvas,
        spec: DepthSensorSpec,
        seed: np.random.SeedSequence,
    ) -> None:
        eye = Renderer(build_scene(layout), camera.intrinsics)
        try:
            self._picture = eye.draw(camera.R_world_camera, camera.t_world_camera).astype(np.float32)
        finally:
            eye.close()
        self._still, self._canvas = still, Canvas(camera.intrinsics)
        self._solid = np.zeros(still.nearness.shape, np.uint16)
        self._noise = PixelNoise(spec.colour_noise, seed)

    def paint(self, number: int, rows: Array) -> NDArray[np.uint8]:
        """Return picture `number` (height, width, 3) RGB of parts (n, COLUMNS) in camera coordinates."""
        picture = self._picture.copy()
        self._canvas.copy_from(self._still)
        solid = rows[:, OPACITY] >= 1.0
        self._lay(picture, rows[solid])
        veils = rows[~solid]
        for i in range(len(veils)):  # one by one: where two overlap both are seen
            self._lay(picture, veils[i : i + 1])
        soft = cv2.GaussianBlur(picture, (0, 0), _SOFT)
        return self._noise.add(np.rint(soft).astype(np.uint8), number)

    def _lay(self, picture: NDArray[np.float32], rows: Array) -> None:
        if len(rows) == 0:
            return
        opaque = rows.copy()
        opaque[:, OPACITY] = 1.0
        self._canvas.owner.fill(-1)
        self._canvas.cast(opaque, self._solid)
        drawn = self._canvas.owner >= 0
        owner = self._canvas.owner[drawn]
        cosine = self._canvas.echo[drawn] / rows[owner, REFLECTANCE]
        rgb = 255.0 * rows[owner, RED : RED + 3] * (_DARKEST + (1.0 - _DARKEST) * cosine)[:, None]
        share = rows[owner, OPACITY][:, None]
        picture[drawn] = (1.0 - share) * picture[drawn] + share * rgb
