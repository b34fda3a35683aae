"""Turns blocks into textured quadrilaterals: exact control of what is on each face."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from noctule.geometry import Array
from noctule.simulation.furniture import Block, Skin

SIDES_OF_A_DRUM = 14


@dataclass(slots=True)
class Mesh:
    """Quadrilaterals that share a texture."""

    corners: list[Array] = field(default_factory=list)  # each (4, 3) [m], counterclockwise seen from outside
    uv: list[Array] = field(default_factory=list)  # each (4, 2), v up


class MeshSet:
    """Collects quadrilaterals by texture."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self.meshes: dict[str, Mesh] = {}

    def quad(self, corners: Array, skin: Skin) -> None:
        """Add a face (4, 3): bottom left, bottom right, top right, top left, seen from outside."""
        if skin.metres > 0.0:
            extent = np.array([math.dist(corners[0], corners[1]), math.dist(corners[0], corners[3])])
            extent = extent / skin.metres
            # Another part of the texture on every face: repetition is what matching stumbles over.
            low = self._rng.random(2)
        else:
            extent, low = np.ones(2), np.zeros(2)
        uv = low + extent * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        mesh = self.meshes.setdefault(skin.texture, Mesh())
        mesh.corners.append(np.asarray(corners, dtype=np.float64))
        mesh.uv.append(uv)

    def block(self, block: Block) -> None:
        """Add all faces of a block."""
        c, s = math.cos(block.yaw), math.sin(block.yaw)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        faces = _box(block.half) if block.shape == "box" else _drum(block.half)
        for i, face in enumerate(faces):
            front = i == 0 and block.front is not None
            skin = block.front if front and block.front is not None else block.skin
            self.quad(face @ R.T + np.array(block.centre), skin)


def _box(half: tuple[float, float, float]) -> list[Array]:
    x, y, z = half
    return [
        np.array([[x, -y, -z], [x, y, -z], [x, y, z], [x, -y, z]]),
        np.array([[-x, y, -z], [-x, -y, -z], [-x, -y, z], [-x, y, z]]),
        np.array([[x, y, -z], [-x, y, -z], [-x, y, z], [x, y, z]]),
        np.array([[-x, -y, -z], [x, -y, -z], [x, -y, z], [-x, -y, z]]),
        np.array([[x, -y, z], [x, y, z], [-x, y, z], [-x, -y, z]]),
        np.array([[-x, -y, -z], [-x, y, -z], [x, y, -z], [x, -y, -z]]),
    ]


def _drum(half: tuple[float, float, float]) -> list[Array]:
    r, _, z = half
    a = np.linspace(0.0, 2.0 * math.pi, SIDES_OF_A_DRUM + 1)
    ring = r * np.column_stack([np.cos(a), np.sin(a)])
    faces = []
    for p, q in pairwise(ring):
        faces.append(np.array([[*p, -z], [*q, -z], [*q, z], [*p, z]]))
        faces.append(np.array([[0.0, 0.0, z], [*p, z], [*q, z], [0.0, 0.0, z]]))
    return faces
