"""The real collision check: distances of the hull to everything that stands in the room."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from noctule.geometry import Pose
from noctule.simulation.ceiling import Motion
from noctule.simulation.ceiling.nearness import FAR, ThingDistance
from noctule.simulation.engine import mujoco
from noctule.simulation.layout import Layout
from noctule.simulation.spec import VehicleSpec

TOUCH = 1e-4  # [m], nearer than this is a contact


class Clearance:
    """The hull, a cylinder, against the solids (exact, by MuJoCo) and against walls, floor and ceiling.

    Things that move count where a time is given.
    """

    def __init__(self, layout: Layout, vehicle: VehicleSpec, motions: Sequence[Motion] = ()) -> None:
        self._room = layout.spec
        self._radius, self._half = vehicle.hull_diameter / 2.0, vehicle.hull_height / 2.0
        self._motions = tuple(motions)
        self._moving = ThingDistance(self._radius, self._half) if motions else None
        self._names = [solid.name for solid in layout.solids]
        spec = mujoco.MjSpec()
        hull = spec.worldbody.add_body(name="hull", mocap=True)
        hull.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[self._radius, self._half, 0.0])
        for solid in layout.solids:
            box = solid.shape == "box"
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX if box else mujoco.mjtGeom.mjGEOM_CYLINDER,
                size=list(solid.half) if box else [solid.half[0], solid.half[2], 0.0],
                pos=list(solid.centre),
                quat=[math.cos(solid.yaw / 2.0), 0.0, 0.0, math.sin(solid.yaw / 2.0)],
            )
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, self._data)
        # MuJoCo orders geoms by body; the world's come first, the hull's is the last.
        self._hull = self._model.ngeom - 1
        self._centres = np.array([solid.centre for solid in layout.solids]).reshape(-1, 3)
        self._reach = np.array([math.dist((0.0, 0.0, 0.0), solid.half) for solid in layout.solids])
        self._reach += math.hypot(self._radius, self._half)

    def measure(self, pose: Pose, stamp: float | None = None) -> tuple[float, tuple[str, ...]]:
        """Return (distance to the nearest solid [m], negative inside, inf in an empty room; what is touched).

        Walls, floor and ceiling count as contacts only. With a `stamp` [s] what moves counts, as it is then;
        it is called `moving_`, its kind and its number.
        """
        R = pose.R_world_body
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, np.ascontiguousarray(R).ravel())
        self._data.mocap_pos[0] = pose.position
        self._data.mocap_quat[0] = quat
        mujoco.mj_kinematics(self._model, self._data)
        nearest, touched = math.inf, []
        bounds = np.linalg.norm(self._centres - pose.position, axis=1) - self._reach
        for i in np.argsort(bounds, kind="stable"):
            if bounds[i] > max(nearest, TOUCH):
                break
            d = mujoco.mj_geomDistance(self._model, self._data, self._hull, int(i), FAR, None)
            nearest = min(nearest, d)
            if d < TOUCH:
                touched.append(self._names[i])
        for i, motion in enumerate(self._motions):
            thing = None if stamp is None else motion.at(stamp)
            if self._moving is None or thing is None:
                continue
            d = self._moving.measure(pose, thing)
            nearest = min(nearest, d)
            if d < TOUCH:
                touched.append(f"moving_{thing.kind}_{i}")
        return nearest, tuple(sorted({*touched, *self._shell(pose.position, R[:, 2])}))

    def _shell(self, position: np.ndarray, axis: np.ndarray) -> list[str]:
        room = self._room
        reach = self._radius * np.sqrt(np.clip(1.0 - axis**2, 0.0, 1.0)) + self._half * np.abs(axis)
        low, high = position - reach, position + reach
        gaps = {
            "wall_back": low[0] - room.x_min,
            "wall_front": room.x_max - high[0],
            "wall_right": low[1] - room.y_min,
            "wall_left": room.y_max - high[1],
            "floor": low[2],
            "ceiling": room.size[2] - high[2],
        }
        return [name for name, gap in gaps.items() if gap < TOUCH]
