"""Builds what is drawn: walls, pictures, furniture and columns as one MuJoCo model."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from noctule.simulation.engine import mujoco
from noctule.simulation.furniture import Skin
from noctule.simulation.layout import Layout
from noctule.simulation.mesh import Mesh, MeshSet
from noctule.simulation.photos import Image
from noctule.simulation.shell import SHELL, paint_shell
from noctule.simulation.textures import framed, paint


@lru_cache(maxsize=2)
def build_scene(layout: Layout) -> mujoco.MjModel:
    """Return the model to draw: nothing in it moves. The last two are kept, so do not change them."""
    meshes = MeshSet(np.random.default_rng([layout.spec.seed, 1]))
    for block in layout.blocks:
        meshes.block(block)
    # The shell comes last: where furniture hides it, nothing is textured twice.
    _shell(layout, meshes)
    spec = mujoco.MjSpec()
    _settings(spec, layout)
    for name, mesh in meshes.meshes.items():
        _add_mesh(spec, name, mesh, _texture(name, layout))
    for solid in layout.solids:
        if solid.kind == "column":
            box = solid.shape == "box"
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX if box else mujoco.mjtGeom.mjGEOM_CYLINDER,
                size=list(solid.half) if box else [solid.half[0], solid.half[2], 0.0],
                pos=list(solid.centre),
                quat=[np.cos(solid.yaw / 2.0), 0.0, 0.0, np.sin(solid.yaw / 2.0)],
                rgba=[*solid.rgb, 1.0],
            )
    return spec.compile()


def _texture(name: str, layout: Layout) -> Image:
    if name in SHELL:
        return paint_shell(name, layout)
    seed = layout.spec.seed
    return framed(name.removeprefix("framed:"), seed) if name.startswith("framed:") else paint(name, seed)


def _shell(layout: Layout, meshes: MeshSet) -> None:
    room = layout.spec
    x0, x1, y0, y1, h = room.x_min, room.x_max, room.y_min, room.y_max, room.size[2]
    walls = {
        "wall_front": [(x1, y1), (x1, y0)],
        "wall_left": [(x0, y1), (x1, y1)],
        "wall_back": [(x0, y0), (x0, y1)],
        "wall_right": [(x1, y0), (x0, y0)],
    }
    for name, (a, b) in walls.items():
        meshes.quad(np.array([[*a, 0.0], [*b, 0.0], [*b, h], [*a, h]]), Skin(name))
    floor = np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])
    meshes.quad(floor, Skin("floor"))
    ceiling = np.array([[x0, y1, h], [x1, y1, h], [x1, y0, h], [x0, y0, h]])
    meshes.quad(ceiling, Skin("ceiling"))


def _settings(spec: mujoco.MjSpec, layout: Layout) -> None:
    room = layout.spec
    spec.stat.extent = 1.0
    spec.visual.map.znear = 0.03
    spec.visual.map.zfar = 3.0 * float(np.linalg.norm(room.size))
    spec.visual.quality.offsamples = 0
    spec.visual.quality.shadowsize = 0
    spec.visual.headlight.ambient = [room.ambient] * 3
    spec.visual.headlight.diffuse = [0.0] * 3
    spec.visual.headlight.specular = [0.0] * 3
    for lamp in room.lights:
        spec.worldbody.add_light(
            pos=[lamp.x, lamp.y, lamp.z],
            # A spot that is open all round; this renderer leaves lights of type POINT dark.
            type=mujoco.mjtLightType.mjLIGHT_SPOT,
            cutoff=180.0,
            exponent=0.0,
            diffuse=[lamp.intensity] * 3,
            specular=[0.0] * 3,
            castshadow=False,
        )


def _add_mesh(spec: mujoco.MjSpec, name: str, mesh: Mesh, picture: np.ndarray) -> None:
    texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D)
    texture.height, texture.width = picture.shape[:2]
    texture.nchannel = 3
    texture.data = np.ascontiguousarray(picture[::-1]).tobytes()
    material = spec.add_material(name=name, specular=0.0, shininess=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    corners = np.array(mesh.corners)  # (n, 4, 3)
    n = len(corners)
    first = 4 * np.arange(n)[:, None]
    faces = np.vstack([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    spec.add_mesh(
        name=name,
        uservert=corners.ravel(),
        usernormal=np.repeat(normals, 4, axis=0).ravel(),
        usertexcoord=np.array(mesh.uv).ravel(),
        userface=faces.astype(np.int32).ravel(),
        userfacenormal=faces.astype(np.int32).ravel(),
        userfacetexcoord=faces.astype(np.int32).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=name, contype=0, conaffinity=0
    )
