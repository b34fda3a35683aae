"""Things that move about in the room: people, boxes, trays, chairs, boards."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from noctule.geometry import Array, rot_z
from noctule.simulation.ceiling.shapes import Part, Shape, Triple, along, moved, pack

ThingKind = Literal["person", "box", "tray", "chair", "board"]

SIZES: dict[ThingKind, Triple] = {
    "person": (0.28, 0.46, 1.75),
    "box": (0.4, 0.3, 0.3),
    "tray": (0.45, 0.32, 0.03),
    "chair": (0.45, 0.45, 0.85),
    "board": (1.4, 2.0, 0.02),
}
"""Default length (ahead), width and height [m]."""

STRIDE = 1.4  # [m], two steps of a person
_CLOTHES: tuple[tuple[Triple, Triple], ...] = (  # shirt, trousers
    ((0.75, 0.74, 0.7), (0.2, 0.22, 0.3)),
    ((0.25, 0.4, 0.3), (0.55, 0.5, 0.42)),
    ((0.62, 0.16, 0.15), (0.15, 0.15, 0.17)),
    ((0.16, 0.24, 0.6), (0.35, 0.35, 0.36)),
)
_HAIR: tuple[Triple, ...] = ((0.12, 0.09, 0.07), (0.35, 0.24, 0.14), (0.6, 0.5, 0.35))
_SKIN: Triple = (0.78, 0.58, 0.47)
_CARD: Triple = (0.69, 0.57, 0.42)


@dataclass(frozen=True, slots=True)
class ThingPose:
    """A thing of the room at a moment."""

    kind: ThingKind
    x: float  # [m], its middle, world
    y: float  # [m]
    yaw: float = 0.0  # [rad], where its front points
    z: float = 0.0  # [m], its underside above the floor: a tray that someone carries
    size: Triple | None = None  # [m], length, width and height; None for SIZES
    walked: float = 0.0  # [m], a person's legs and arms swing with the way walked
    look: int = 0  # whose clothes


def thing_rows(thing: ThingPose) -> Array:
    """Return the parts of a thing (n, COLUMNS) in the world."""
    size = SIZES[thing.kind] if thing.size is None else thing.size
    parts = _RECIPES[thing.kind](thing, size)
    return moved(pack(parts), rot_z(thing.yaw), np.array([thing.x, thing.y, thing.z]))


def _person(thing: ThingPose, size: Triple) -> list[Part]:
    deep, wide, h = size[0] / 2.0, size[1] / 2.0, size[2]
    shirt, trousers = _CLOTHES[thing.look % len(_CLOTHES)]
    swing = math.sin(2.0 * math.pi * thing.walked / STRIDE)
    parts = [
        Part(Shape.ELLIPSOID, (0.02, 0.0, 0.925 * h), (0.095, 0.075, 0.075 * h), rgb=_SKIN),
        Part(
            Shape.ELLIPSOID,
            (-0.005, 0.0, 0.945 * h),
            (0.098, 0.082, 0.055 * h),
            reflectance=0.12,
            rgb=_HAIR[thing.look % len(_HAIR)],
        ),
        Part(Shape.ELLIPSOID, (0.0, 0.0, 0.795 * h), (0.65 * deep, 0.95 * wide, 0.055 * h), rgb=shirt),
        Part(Shape.ELLIPSOID, (0.0, 0.0, 0.665 * h), (0.8 * deep, 0.72 * wide, 0.2 * h), rgb=shirt),
    ]
    for side in (-1.0, 1.0):
        s = side * swing
        shoulder = (0.0, 0.87 * side * wide, 0.8 * h)
        hand = (0.12 - 0.22 * s, 0.95 * side * wide, 0.5 * h)
        hip, foot = (0.0, 0.4 * side * wide, 0.52 * h), (0.3 * s, 0.4 * side * wide, 0.03 * h)
        parts.append(_limb(shoulder, hand, 0.05, shirt))
        parts.append(_limb(hip, foot, 0.085, trousers))
        shoe = (foot[0] + 0.05, foot[1], 0.035)
        parts.append(Part(Shape.ELLIPSOID, shoe, (0.14, 0.05, 0.035), reflectance=0.2, rgb=(0.1, 0.1, 0.1)))
    return parts


def _limb(start: Triple, end: Triple, radius: float, rgb: Triple) -> Part:
    middle, rotation, half = along(start, end)
    # An ellipsoid tapers off: longer by a little, so that it joins.
    return Part(Shape.ELLIPSOID, middle, (radius, radius, 1.12 * half), rotation, rgb=rgb)


def _box(thing: ThingPose, size: Triple) -> list[Part]:
    return [Part(Shape.BOX, (0.0, 0.0, size[2] / 2.0), _halved(size), rgb=_CARD)]


def _tray(thing: ThingPose, size: Triple) -> list[Part]:
    deep, wide, tall = _halved(size)
    board = Part(Shape.BOX, (0.0, 0.0, 0.3 * tall), (deep, wide, 0.3 * tall), rgb=(0.5, 0.48, 0.46))
    rims = [
        Part(Shape.BOX, (at, 0.0, tall), (0.012, wide, tall), rgb=(0.3, 0.3, 0.32))
        for at in (-deep + 0.012, deep - 0.012)
    ]
    return [board, *rims]


def _chair(thing: ThingPose, size: Triple) -> list[Part]:
    deep, wide, h = size[0] / 2.0, size[1] / 2.0, size[2]
    cloth: Triple = (0.22, 0.24, 0.28)
    seat = 0.52 * h
    legs = [
        Part(
            Shape.BOX,
            (x * (deep - 0.02), y * (wide - 0.02), seat / 2.0),
            (0.015, 0.015, seat / 2.0),
            rgb=cloth,
        )
        for x in (-1.0, 1.0)
        for y in (-1.0, 1.0)
    ]
    return [
        Part(Shape.BOX, (0.0, 0.0, seat), (deep, wide, 0.025), reflectance=0.3, rgb=cloth),
        Part(
            Shape.BOX,
            (-deep + 0.02, 0.0, (seat + h) / 2.0),
            (0.02, wide, (h - seat) / 2.0),
            reflectance=0.3,
            rgb=cloth,
        ),
        *legs,
    ]


def _halved(size: Triple) -> Triple:
    return size[0] / 2.0, size[1] / 2.0, size[2] / 2.0


_RECIPES: dict[ThingKind, Callable[[ThingPose, Triple], list[Part]]] = {
    "person": _person,
    "box": _box,
    "tray": _tray,
    "chair": _chair,
    "board": _box,
}
