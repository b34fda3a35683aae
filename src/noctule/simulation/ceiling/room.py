"""The room under the camera: a laboratory, and any room as parts."""

from __future__ import annotations

import zlib

import numpy as np

from noctule.geometry import Array
from noctule.simulation.ceiling.shapes import Part, Shape, pack
from noctule.simulation.furniture import Block
from noctule.simulation.layout import Layout
from noctule.simulation.spec import KeepClear, LightSpec, RoomSpec

_THICK = 0.05  # [m], half of what walls are made of
_REFLECTANCES = (0.25, 0.7)  # of infrared, from dark cloth to paper


def lab_room(seed: int) -> RoomSpec:
    """Return a laboratory: 6 x 6 m, 3.6 m high, furniture at its walls, nothing hanging in the way."""
    return RoomSpec(
        seed=seed,
        corner=(-3.0, -3.0),
        size=(6.0, 6.0, 3.6),
        furniture=12,
        pictures=16,
        lamps=0,
        keep_clear=KeepClear(x_min=-1.7, x_max=1.7, y_min=-1.7, y_max=1.9, margin=0.4),
        lights=(LightSpec(x=-1.5, y=0.0, z=3.4), LightSpec(x=1.5, y=0.0, z=3.4)),
    )


def room_rows(layout: Layout) -> Array:
    """Return what stands still, shell, furniture and columns, as parts (n, COLUMNS) in the world."""
    parts = [_of_block(block) for block in layout.blocks]
    for solid in layout.solids:
        if solid.kind == "column":
            shape = Shape.BOX if solid.shape == "box" else Shape.TUBE
            parts.append(Part(shape, solid.centre, solid.half, _turned(solid.yaw), rgb=solid.rgb))
    room = layout.spec
    x, y, z = (e / 2.0 for e in room.size)
    mx, my = room.corner[0] + x, room.corner[1] + y
    t = _THICK
    shell = [
        ((mx, my, -t), (x, y, t)),
        ((mx - x - t, my, z), (t, y, z)),
        ((mx + x + t, my, z), (t, y, z)),
        ((mx, my - y - t, z), (x, t, z)),
        ((mx, my + y + t, z), (x, t, z)),
        ((mx, my, 2.0 * z + t), (x, y, t)),
    ]
    parts += [Part(Shape.BOX, centre, half, reflectance=0.6) for centre, half in shell]
    return pack(parts)


def _of_block(block: Block) -> Part:
    shape = Shape.BOX if block.shape == "box" else Shape.TUBE
    # A texture's name decides how it looks in infrared, the same in every room.
    share = zlib.crc32(block.skin.texture.encode()) % 1000 / 999.0
    reflectance = _REFLECTANCES[0] + share * (_REFLECTANCES[1] - _REFLECTANCES[0])
    return Part(shape, block.centre, block.half, _turned(block.yaw), reflectance=reflectance)


def _turned(yaw: float) -> Array:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
