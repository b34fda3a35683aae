"""Furniture: what each piece is made of, as solids for the collision check and blocks for the eye."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from noctule.simulation.spec import FurnitureSpec

Triple = tuple[float, float, float]
Shape = Literal["box", "cylinder"]


@dataclass(frozen=True, slots=True)
class Solid:
    """A convex body that can be hit; upright, turned about the vertical only."""

    name: str
    kind: Literal["furniture", "person", "column"]
    shape: Shape
    centre: Triple  # [m], world
    half: Triple  # [m], half extents; a cylinder has (radius, radius, half height)
    yaw: float  # [rad]
    rgb: Triple  # 0 to 1


@dataclass(frozen=True, slots=True)
class Skin:
    """A texture on a face."""

    texture: str
    metres: float = 0.0  # extent of one repetition [m]; 0: the texture fills the face once


@dataclass(frozen=True, slots=True)
class Block:
    """Something to look at; its front is its +x face."""

    shape: Shape
    centre: Triple  # [m], world
    half: Triple  # [m]
    yaw: float  # [rad]
    skin: Skin
    front: Skin | None = None  # another skin for the front face


@dataclass(slots=True)
class _Builder:
    """Collects parts given in the piece's own frame: x toward its front, y to its left, z above the floor."""

    spec: FurnitureSpec
    name: str
    rng: np.random.Generator
    solids: list[Solid] = field(default_factory=list)
    blocks: list[Block] = field(default_factory=list)

    def place(self, x: float, y: float, z: float) -> Triple:
        c, s = math.cos(self.spec.yaw), math.sin(self.spec.yaw)
        return (self.spec.x + c * x - s * y, self.spec.y + s * x + c * y, z)

    def block(
        self, at: Triple, half: Triple, skin: Skin, front: Skin | None = None, turn: float = 0.0
    ) -> None:
        self.blocks.append(Block("box", self.place(*at), half, self.spec.yaw + turn, skin, front))

    def drum(self, at: Triple, radius: float, half_height: float, skin: Skin) -> None:
        half = (radius, radius, half_height)
        self.blocks.append(Block("cylinder", self.place(*at), half, self.spec.yaw, skin))

    def solid(self, at: Triple, half: Triple, shape: Shape = "box", turn: float = 0.0) -> None:
        kind: Literal["furniture", "person"] = "person" if self.spec.kind == "person" else "furniture"
        rgb = (0.76, 0.45, 0.4) if kind == "person" else (0.66, 0.6, 0.53)
        place = self.place(*at)
        self.solids.append(Solid(self.name, kind, shape, place, half, self.spec.yaw + turn, rgb))

    def pick(self, *names: str) -> str:
        return names[int(self.rng.integers(len(names)))]


def _bookcase(b: _Builder) -> None:
    w, d, h = b.spec.width / 2.0, b.spec.depth / 2.0, b.spec.height
    wood = Skin(b.pick("wood_dark", "wood_light"), 0.9)
    board = 0.012
    b.solid((0.0, 0.0, h / 2.0), (d, w, h / 2.0))
    b.block((-d + board, 0.0, h / 2.0), (board, w, h / 2.0), wood)
    for side in (-1.0, 1.0):
        b.block((0.0, side * (w - board), h / 2.0), (d, board, h / 2.0), wood)
    shelves = max(2, round(h / 0.36))
    gap = h / shelves
    for i in range(shelves + 1):
        b.block((0.0, 0.0, min(max(i * gap, board), h - board)), (d, w, board), wood)
    for i in range(shelves):
        y = -w + 0.03
        while y < w - 0.1:
            run = min(float(b.rng.uniform(0.12, 0.5)), w - 0.03 - y)
            if b.rng.random() < 0.8 and run > 0.06:
                tall = gap * float(b.rng.uniform(0.55, 0.9)) / 2.0
                deep = d * float(b.rng.uniform(0.55, 0.85))
                books = Skin(b.pick("books_a", "books_b"), 0.5)
                at = (-d + 2 * board + deep, y + run / 2.0, i * gap + board + tall)
                b.block(at, (deep, run / 2.0, tall), books)
            y += run + float(b.rng.uniform(0.0, 0.12))


def _cabinet(b: _Builder) -> None:
    w, d, h = b.spec.width / 2.0, b.spec.depth / 2.0, b.spec.height
    b.solid((0.0, 0.0, h / 2.0), (d, w, h / 2.0))
    body = Skin(b.pick("wood_dark", "wood_light", "paint"), 0.9)
    b.block((0.0, 0.0, h / 2.0), (d, w, h / 2.0), body, Skin(b.pick("drawers_a", "drawers_b")))
    # Small things on top: in view they stand before other depths.
    y = -w + 0.1
    while y < w - 0.12:
        size = float(b.rng.uniform(0.05, 0.13))
        tall = float(b.rng.uniform(0.06, 0.2))
        skin = Skin(b.pick("poster_0", "poster_1", "fabric_b", "books_a"), 0.3)
        b.block(
            (0.0, y + size, h + tall), (size * 0.7, size, tall), skin, turn=float(b.rng.uniform(-0.4, 0.4))
        )
        b.solid((0.0, y + size, h + tall), (size, size, tall))
        y += 2.0 * size + float(b.rng.uniform(0.05, 0.4))


def _table(b: _Builder) -> None:
    w, d, h = b.spec.width / 2.0, b.spec.depth / 2.0, b.spec.height
    wood = Skin(b.pick("wood_dark", "wood_light"), 0.9)
    b.block((0.0, 0.0, h - 0.02), (d, w, 0.02), wood)
    b.solid((0.0, 0.0, h - 0.02), (d, w, 0.02))
    for x in (-d + 0.04, d - 0.04):
        for y in (-w + 0.04, w - 0.04):
            half = (0.025, 0.025, (h - 0.04) / 2.0)
            b.block((x, y, half[2]), half, wood)
            b.solid((x, y, half[2]), half)
    for _ in range(int(b.rng.integers(2, 5))):
        tall = float(b.rng.uniform(0.03, 0.18))
        half = (float(b.rng.uniform(0.06, 0.12)), float(b.rng.uniform(0.06, 0.15)), tall)
        x, y = (float(b.rng.uniform(-1.0, 1.0)) * max(0.0, e - 0.17) for e in (d, w))
        turn = float(b.rng.uniform(-0.8, 0.8))
        b.block(
            (x, y, h + tall), half, Skin(b.pick("books_a", "poster_2", "poster_3", "coffee"), 0.35), turn=turn
        )
        b.solid((x, y, h + tall), half, turn=turn)


def _sofa(b: _Builder) -> None:
    w, d, h = b.spec.width / 2.0, b.spec.depth / 2.0, b.spec.height
    cloth = Skin(b.pick("fabric_a", "fabric_b"), 0.6)
    other = Skin(b.pick("poster_4", "weave", "poster_1"), 0.4)
    seat = 0.45 * h
    arm = min(0.1, 0.2 * w)
    parts: list[tuple[Triple, Triple]] = [
        ((0.0, 0.0, seat / 2.0), (d, w - 2 * arm, seat / 2.0)),
        ((-0.75 * d, 0.0, h / 2.0), (0.25 * d, w, h / 2.0)),
        ((0.0, w - arm, 0.35 * h), (d, arm, 0.35 * h)),
        ((0.0, -w + arm, 0.35 * h), (d, arm, 0.35 * h)),
    ]
    for at, half in parts:
        b.block(at, half, cloth)
        b.solid(at, half)
    for side in (-0.5, 0.45):
        b.block((-0.3 * d, side * w, seat + 0.2), (0.06, 0.2, 0.18), other, turn=0.3 * side)


def _crates(b: _Builder) -> None:
    w, d, h = b.spec.width / 2.0, b.spec.depth / 2.0, b.spec.height
    z, grow = 0.0, 1.0
    while z < h - 0.05:
        tall = min(float(b.rng.uniform(0.25, 0.45)), h - z)
        turn = float(b.rng.uniform(-0.12, 0.12))
        half = (d * grow * 0.93, w * grow * 0.93, tall / 2.0)
        label = Skin(b.pick("poster_0", "poster_2", "poster_3", "poster_5", "crate"))
        b.block((0.0, 0.0, z + tall / 2.0), half, Skin("crate", 0.7), label, turn=turn)
        b.solid((0.0, 0.0, z + tall / 2.0), half, turn=turn)
        z += tall
        grow *= float(b.rng.uniform(0.82, 1.0))


def _plant(b: _Builder) -> None:
    r, h = min(b.spec.width, b.spec.depth) / 2.0, b.spec.height
    pot = 0.25 * h
    b.drum((0.0, 0.0, pot / 2.0), 0.45 * r, pot / 2.0, Skin("clay", 0.4))
    b.solid((0.0, 0.0, pot / 2.0), (0.45 * r, 0.45 * r, pot / 2.0), "cylinder")
    b.solid((0.0, 0.0, (pot + h) / 2.0), (r, r, (h - pot) / 2.0), "cylinder")
    for _ in range(26):
        a, z = float(b.rng.uniform(0.0, 2.0 * math.pi)), float(b.rng.uniform(1.05 * pot, h - 0.12))
        reach = r * 0.6 * math.sqrt(float(b.rng.random()))
        half = (0.01, float(b.rng.uniform(0.05, 0.3 * r + 0.02)), float(b.rng.uniform(0.05, 0.11)))
        at = (reach * math.cos(a), reach * math.sin(a), z)
        b.block(at, half, Skin("leaves", 0.25), turn=a + float(b.rng.uniform(-0.6, 0.6)))


def _panel(b: _Builder) -> None:
    w, d, h = b.spec.width / 2.0, b.spec.depth / 2.0, b.spec.height
    picture = Skin(b.pick("poster_0", "poster_1", "poster_2", "poster_3", "poster_4", "poster_5"))
    b.solid((0.0, 0.0, h / 2.0), (d, w, h / 2.0))
    b.block((0.0, 0.0, h / 2.0), (d, w, h / 2.0), Skin("wood_light", 0.9), picture)


def _person(b: _Builder) -> None:
    h = b.spec.height
    r = min(b.spec.width, b.spec.depth) / 2.0
    legs, chest = 0.48 * h, 0.84 * h
    b.solid((0.0, 0.0, chest / 2.0), (r, r, chest / 2.0), "cylinder")
    b.solid((0.0, 0.0, (chest + h) / 2.0), (0.1, 0.1, (h - chest) / 2.0), "cylinder")
    for side in (-0.45, 0.45):
        b.drum((0.0, side * r, legs / 2.0), 0.42 * r, legs / 2.0, Skin("fabric_b", 0.5))
    b.drum((0.0, 0.0, (legs + chest) / 2.0), 0.95 * r, (chest - legs) / 2.0, Skin("weave", 0.5))
    b.drum((0.0, 0.0, (chest + h) / 2.0), 0.09, (h - chest) / 2.0, Skin("clay", 0.5))


_RECIPES: dict[str, Callable[[_Builder], None]] = {
    "bookcase": _bookcase,
    "cabinet": _cabinet,
    "table": _table,
    "sofa": _sofa,
    "crates": _crates,
    "plant": _plant,
    "panel": _panel,
    "person": _person,
}


def furnish(
    spec: FurnitureSpec, name: str, rng: np.random.Generator
) -> tuple[tuple[Solid, ...], tuple[Block, ...]]:
    """Return what a piece is made of; every solid carries its `name`."""
    builder = _Builder(spec, name, rng)
    _RECIPES[spec.kind](builder)
    return tuple(builder.solids), tuple(builder.blocks)
