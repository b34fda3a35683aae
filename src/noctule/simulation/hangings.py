"""What hangs: pictures, windows, a door, shelves on the walls, lamps from the ceiling."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from noctule.simulation.furniture import Block, Skin, Solid, Triple
from noctule.simulation.photos import FILES
from noctule.simulation.spec import RoomSpec

TRIES = 30
GAP = 0.08  # [m] between things on a wall
_PHOTOS = tuple(name for name in sorted(FILES) if name not in ("brick", "grass", "gravel"))
_POSTERS = tuple(f"poster_{i}" for i in range(6))


@dataclass(frozen=True, slots=True)
class _Wall:
    origin: tuple[float, float]  # [m], its left end seen from inside
    along: tuple[float, float]  # unit vector to the right, seen from inside
    length: float  # [m]

    @property
    def yaw(self) -> float:
        """The heading that looks away from the wall, into the room [rad]."""
        # Seen from inside with `along` to the right, the room is behind the eye's back: turn by -90 degrees.
        return math.atan2(-self.along[0], self.along[1])

    def place(self, at: float, off: float, z: float) -> Triple:
        """Return the point `at` [m] along the wall, `off` [m] into the room, `z` [m] above the floor."""
        yaw = self.yaw
        x = self.origin[0] + at * self.along[0] + off * math.cos(yaw)
        y = self.origin[1] + at * self.along[1] + off * math.sin(yaw)
        return (x, y, z)


def hang(spec: RoomSpec, rng: np.random.Generator) -> tuple[list[Solid], list[Block]]:
    """Return what hangs on walls and ceiling; what stands out by more than a hand is a solid."""
    x0, x1, y0, y1 = spec.x_min, spec.x_max, spec.y_min, spec.y_max
    walls = (
        _Wall((x1, y1), (0.0, -1.0), y1 - y0),  # front
        _Wall((x0, y1), (1.0, 0.0), x1 - x0),  # left
        _Wall((x1, y0), (-1.0, 0.0), x1 - x0),  # right
        _Wall((x0, y0), (0.0, 1.0), y1 - y0),  # back
    )
    solids: list[Solid] = []
    blocks: list[Block] = []
    used: list[list[tuple[float, float, float, float]]] = [[] for _ in walls]
    photos = list(rng.permutation(_PHOTOS)) + list(rng.permutation(_POSTERS))
    top = spec.size[2]
    door = float(rng.uniform(0.8, walls[3].length - 0.8))
    if top > 2.1:
        used[3].append((door - 0.45, door + 0.45, 0.0, 2.02))
        place = walls[3].place(door, 0.015, 1.01)
        blocks.append(
            Block("box", place, (0.015, 0.45, 1.01), walls[3].yaw, Skin("wood_dark", 0.9), Skin("door"))
        )
    for i in range(spec.pictures):
        wall = (0, 1, 2, 0, 3)[i % 5]
        shelf = i % 4 == 3
        for _ in range(TRIES):
            wide = float(rng.uniform(0.7, 1.2) if shelf else rng.uniform(0.55, 1.15))
            tall = 0.3 if shelf else wide * float(rng.uniform(0.7, 1.0))
            at = float(rng.uniform(0.2 + wide / 2.0, walls[wall].length - 0.2 - wide / 2.0))
            z = float(rng.uniform(min(1.15, 0.5 * top), max(1.2, top - 0.25 - tall / 2.0)))
            box = (at - wide / 2.0, at + wide / 2.0, z - tall / 2.0, z + tall / 2.0)
            if all(_apart(box, other) for other in used[wall]):
                used[wall].append(box)
                if shelf:
                    _shelf(walls[wall], f"shelf_{i}", at, z, wide, rng, solids, blocks)
                else:
                    skin = Skin(f"framed:{photos[i % len(photos)]}")
                    if i in (1, 12, 21):
                        skin = Skin("window")
                    off = float(rng.uniform(0.015, 0.05))
                    half = (off, wide / 2.0, tall / 2.0)
                    at_wall = walls[wall].place(at, off, z)
                    blocks.append(Block("box", at_wall, half, walls[wall].yaw, Skin("wood_dark", 0.9), skin))
                break
    _lamps(spec, rng, solids, blocks)
    return solids, blocks


def _apart(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[1] + GAP < b[0] or b[1] + GAP < a[0] or a[3] + GAP < b[2] or b[3] + GAP < a[2]


def _shelf(
    wall: _Wall,
    name: str,
    at: float,
    z: float,
    wide: float,
    rng: np.random.Generator,
    solids: list[Solid],
    blocks: list[Block],
) -> None:
    low, deep = z - 0.15, 0.13
    board = wall.place(at, deep, low + 0.015)
    blocks.append(Block("box", board, (deep, wide / 2.0, 0.015), wall.yaw, Skin("wood_light", 0.9)))
    solid = wall.place(at, deep, z)
    rgb = (0.66, 0.6, 0.53)
    solids.append(Solid(name, "furniture", "box", solid, (deep, wide / 2.0, 0.15), wall.yaw, rgb))
    a = at - wide / 2.0
    while a < at + wide / 2.0 - 0.12:
        run = min(float(rng.uniform(0.1, 0.35)), at + wide / 2.0 - a)
        tall, out = float(rng.uniform(0.08, 0.13)), float(rng.uniform(0.07, deep))
        skin = Skin(("books_a", "books_b", "poster_1", "clay")[int(rng.integers(4))], 0.5)
        place = wall.place(a + run / 2.0, out, low + 0.03 + tall)
        blocks.append(Block("box", place, (out, run / 2.0, tall), wall.yaw, skin))
        a += run + float(rng.uniform(0.02, 0.15))


def _lamps(spec: RoomSpec, rng: np.random.Generator, solids: list[Solid], blocks: list[Block]) -> None:
    clear, top = spec.keep_clear, spec.size[2]
    margin = clear.margin + 0.25
    for i in range(spec.lamps):
        x = float(rng.uniform(spec.x_min + 0.4, spec.x_max - 0.4))
        y = float(rng.uniform(spec.y_min + 0.4, spec.y_max - 0.4))
        low = top - float(rng.uniform(0.35, 0.8))
        if (
            clear.x_min - margin < x < clear.x_max + margin
            and clear.y_min - margin < y < clear.y_max + margin
        ) or low < 1.8:
            continue
        blocks.append(Block("cylinder", (x, y, low + 0.1), (0.2, 0.2, 0.1), 0.0, Skin("shade", 0.4)))
        cord = (top - low - 0.2) / 2.0
        blocks.append(Block("box", (x, y, top - cord), (0.008, 0.008, cord), 0.0, Skin("wood_dark", 0.9)))
        half = (0.2, 0.2, (top - low) / 2.0)
        solids.append(
            Solid(f"lamp_{i}", "furniture", "cylinder", (x, y, top - half[2]), half, 0.0, (0.9, 0.86, 0.7))
        )
