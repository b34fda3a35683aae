"""How near a hull is to a thing that moves: exact distances to every part of it, by MuJoCo."""

from __future__ import annotations

import math

import numpy as np

from noctule.geometry import Pose
from noctule.simulation.ceiling.shapes import Shape
from noctule.simulation.ceiling.things import ThingPose, thing_rows
from noctule.simulation.engine import mujoco

FAR = 100.0  # [m], distances beyond are cut to this

_GEOMS = {
    Shape.BOX: mujoco.mjtGeom.mjGEOM_BOX,
    Shape.ELLIPSOID: mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    Shape.TUBE: mujoco.mjtGeom.mjGEOM_CYLINDER,
}


class ThingDistance:
    """A hull, a cylinder of `radius` and half height `half` [m], against things; rings count as discs."""

    def __init__(self, radius: float, half: float) -> None:
        spec = mujoco.MjSpec()
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[radius, half, 0.0])
        for geom in _GEOMS.values():
            spec.worldbody.add_geom(type=geom, size=[1.0, 1.0, 1.0])
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._slots = {int(shape): i + 1 for i, shape in enumerate(_GEOMS)}
        self._reach = math.hypot(radius, half)

    def measure(self, pose: Pose, thing: ThingPose) -> float:
        """Return the distance [m] of the hull at `pose` to a thing, negative inside."""
        model, data = self._model, self._data
        self._put(0, pose.position, pose.R_world_body.ravel())
        rows = thing_rows(thing)
        bounds = np.linalg.norm(rows[:, 1:4] - pose.position, axis=1) - self._reach
        bounds -= np.linalg.norm(rows[:, 13:16], axis=1)
        nearest = math.inf
        for i in np.argsort(bounds, kind="stable"):
            if bounds[i] > max(nearest, 0.0):
                break
            row, slot = rows[i], self._slots[int(rows[i, 0])]
            half = row[13:16]
            # The sizes of MuJoCo's cylinders are radius and half height.
            model.geom_size[slot] = half if row[0] != Shape.TUBE else (half[0], half[2], 0.0)
            model.geom_rbound[slot] = np.linalg.norm(half)
            self._put(slot, row[1:4], row[4:13])
            nearest = min(nearest, mujoco.mj_geomDistance(model, data, 0, slot, FAR, None))
        return nearest

    def _put(self, geom: int, position: np.ndarray, rotation: np.ndarray) -> None:
        self._data.geom_xpos[geom] = position
        self._data.geom_xmat[geom] = rotation
