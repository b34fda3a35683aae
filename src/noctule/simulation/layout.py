"""Where everything stands: solids for the collision check, blocks for the eye, footprints for the map."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Literal

import numpy as np

from noctule.geometry import Array
from noctule.simulation.furniture import Block, Solid, furnish
from noctule.simulation.hangings import hang
from noctule.simulation.placing import place_furniture
from noctule.simulation.spec import FurnitureSpec, RoomSpec


@dataclass(frozen=True, slots=True)
class Layout:
    """A room with everything that its description leaves open drawn from its seed."""

    spec: RoomSpec
    furniture: tuple[FurnitureSpec, ...]
    solids: tuple[Solid, ...]  # furniture, persons and columns
    blocks: tuple[Block, ...]  # what is drawn of furniture


@dataclass(frozen=True, slots=True)
class Footprint:
    """A thing of the room as seen from above."""

    name: str
    kind: Literal["wall", "furniture", "person", "column"]
    polygon: Array  # (n, 2) [m], world x and y, counterclockwise
    rgb: tuple[float, float, float]  # a colour to draw it in, 0 to 1


def draw_layout(spec: RoomSpec) -> Layout:
    """Draw what the description leaves open. Columns and furniture have seeds of their own.

    So a column more does not move the furniture, and other furniture does not recolour the columns.
    """
    places, hues, looks, hooks = np.random.SeedSequence(spec.seed).spawn(4)
    if isinstance(spec.furniture, int):
        furniture = place_furniture(spec, np.random.default_rng(places))
    else:
        furniture = spec.furniture
    solids: list[Solid] = []
    blocks: list[Block] = []
    counts: Counter[str] = Counter()
    for piece, seed in zip(furniture, looks.spawn(len(furniture)), strict=True):
        number = counts[piece.kind]
        counts[piece.kind] += 1
        new_solids, new_blocks = furnish(piece, f"{piece.kind}_{number}", np.random.default_rng(seed))
        solids += new_solids
        blocks += new_blocks
    hung_solids, hung_blocks = hang(spec, np.random.default_rng(hooks))
    solids += hung_solids
    blocks += hung_blocks
    solids += _columns(spec, np.random.default_rng(hues))
    return Layout(spec, tuple(furniture), tuple(solids), tuple(blocks))


def _columns(spec: RoomSpec, rng: np.random.Generator) -> list[Solid]:
    solids = []
    hues = rng.random(64)
    for i, column in enumerate(spec.columns):
        rgb = column.rgb(float(hues[i % 64]))
        half_height = column.height / 2.0
        if column.diameter is not None:
            half = (column.diameter / 2.0, column.diameter / 2.0, half_height)
        else:
            assert column.width is not None
            assert column.depth is not None
            half = (column.depth / 2.0, column.width / 2.0, half_height)
        shape: Literal["box", "cylinder"] = "box" if column.diameter is None else "cylinder"
        centre = (column.x, column.y, half_height)
        solids.append(Solid(f"column_{i}", "column", shape, centre, half, column.yaw, rgb))
    return solids


def room_layout(spec: RoomSpec) -> tuple[Footprint, ...]:
    """Return the footprints of walls, furniture, persons and columns, for maps."""
    x0, x1, y0, y1 = spec.x_min, spec.x_max, spec.y_min, spec.y_max
    inside = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    walls = Footprint("walls", "wall", inside, (0.35, 0.35, 0.38))
    solids = draw_layout(spec).solids
    return (walls, *(Footprint(s.name, s.kind, solid_polygon(s), s.rgb) for s in solids))


def solid_polygon(solid: Solid) -> Array:
    """Return the footprint of a solid (n, 2) [m], counterclockwise."""
    if solid.shape == "cylinder":
        angles = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
        corners = solid.half[0] * np.column_stack([np.cos(angles), np.sin(angles)])
    else:
        hx, hy = solid.half[:2]
        corners = np.array([[-hx, -hy], [hx, -hy], [hx, hy], [-hx, hy]])
    c, s = math.cos(solid.yaw), math.sin(solid.yaw)
    return np.asarray(corners @ np.array([[c, s], [-s, c]]) + np.array(solid.centre[:2]))
