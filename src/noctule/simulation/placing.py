"""Draws furniture along the walls, at several depths, away from where flights go."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from noctule.simulation.spec import FurnitureKind, FurnitureSpec, RoomSpec

TRIES = 60
OVERHANG = 0.06  # [m], what a piece may stick out of its rectangle, for instance a turned crate
GAP = 0.15  # [m] between pieces, and between pieces and columns

# width, depth and height [m], each from and to
_SIZES: dict[FurnitureKind, tuple[float, float, float, float, float, float]] = {
    "bookcase": (0.8, 1.6, 0.28, 0.38, 1.4, 2.2),
    "cabinet": (0.7, 1.3, 0.35, 0.5, 0.6, 1.2),
    "table": (0.9, 1.4, 0.55, 0.75, 0.7, 0.78),
    "sofa": (1.3, 1.9, 0.7, 0.85, 0.75, 0.95),
    "crates": (0.4, 0.7, 0.35, 0.6, 0.7, 1.9),
    "plant": (0.5, 0.7, 0.5, 0.7, 1.1, 1.9),
    "panel": (0.8, 1.2, 0.05, 0.08, 1.5, 2.1),
}
_KINDS = tuple(_SIZES)
# Walls in the order in which they get their pieces: the one ahead of the start is looked at most.
_SIDES = ("front", "left", "right", "front", "back", "front", "right", "left", "front", "left", "right")


@dataclass(frozen=True, slots=True)
class _Rectangle:
    x_min: float
    x_max: float
    y_min: float
    y_max: float

    def distance(self, other: _Rectangle) -> float:
        dx = max(self.x_min - other.x_max, other.x_min - self.x_max, 0.0)
        dy = max(self.y_min - other.y_max, other.y_min - self.y_max, 0.0)
        return math.hypot(dx, dy)


def place_furniture(spec: RoomSpec, rng: np.random.Generator) -> tuple[FurnitureSpec, ...]:
    """Draw up to `spec.furniture` pieces; a full room gets fewer."""
    count = spec.furniture if isinstance(spec.furniture, int) else len(spec.furniture)
    taken = [_around(c.x, c.y, max(c.width or 0.0, c.depth or 0.0, c.diameter or 0.0)) for c in spec.columns]
    pieces: list[FurnitureSpec] = []
    for i in range(count):
        for attempt in range(TRIES):
            side = _SIDES[(i + attempt // (TRIES // 4)) % len(_SIDES)]
            piece = _draw(spec, side, _KINDS[int(rng.integers(len(_KINDS)))], rng)
            if piece is None:
                continue
            print_ = footprint(piece)
            if _allowed(spec, print_, taken):
                pieces.append(piece)
                taken.append(print_)
                break
    return tuple(pieces)


def footprint(piece: FurnitureSpec) -> _Rectangle:
    """Return the rectangle along the world's axes that holds the piece."""
    c, s = abs(math.cos(piece.yaw)), abs(math.sin(piece.yaw))
    hx = (c * piece.depth + s * piece.width) / 2.0
    hy = (s * piece.depth + c * piece.width) / 2.0
    return _Rectangle(piece.x - hx, piece.x + hx, piece.y - hy, piece.y + hy)


def _allowed(spec: RoomSpec, print_: _Rectangle, taken: list[_Rectangle]) -> bool:
    clear = spec.keep_clear
    corridor = _Rectangle(clear.x_min, clear.x_max, clear.y_min, clear.y_max)
    inside = (
        print_.x_min >= spec.x_min
        and print_.x_max <= spec.x_max
        and print_.y_min >= spec.y_min
        and print_.y_max <= spec.y_max
    )
    return (
        inside
        and print_.distance(corridor) >= clear.margin + OVERHANG
        and all(print_.distance(other) >= GAP for other in taken)
    )


def _around(x: float, y: float, extent: float) -> _Rectangle:
    half = extent / 2.0
    return _Rectangle(x - half, x + half, y - half, y + half)


def _draw(spec: RoomSpec, side: str, kind: FurnitureKind, rng: np.random.Generator) -> FurnitureSpec | None:
    w0, w1, d0, d1, h0, h1 = _SIZES[kind]
    u = rng.random(6)
    width, depth = w0 + (w1 - w0) * u[0], d0 + (d1 - d0) * u[1]
    height = min(h0 + (h1 - h0) * u[2], 0.9 * spec.size[2])
    clear = spec.keep_clear
    # Room between the wall and the clear rectangle: some pieces stand at the wall, some anywhere in it.
    rooms = {
        "front": spec.x_max - clear.x_max - clear.margin,
        "back": clear.x_min - clear.margin - spec.x_min,
        "left": spec.y_max - clear.y_max - clear.margin,
        "right": clear.y_min - clear.margin - spec.y_min,
    }
    slack = rooms[side] - depth - 0.04
    if slack < 0.0:
        return None
    away = 0.02 + depth / 2.0 + (slack * float(u[3]) if u[4] > 0.4 else 0.0)
    turn = float(rng.uniform(-0.15, 0.15)) if u[4] > 0.4 else 0.0
    if side in ("front", "back"):
        y = spec.y_min + (spec.y_max - spec.y_min) * float(u[5])
        x, yaw = (spec.x_max - away, math.pi) if side == "front" else (spec.x_min + away, 0.0)
    else:
        x = spec.x_min + (spec.x_max - spec.x_min) * float(u[5])
        y, yaw = (spec.y_max - away, -math.pi / 2.0) if side == "left" else (spec.y_min + away, math.pi / 2.0)
    return FurnitureSpec(
        kind=kind, x=x, y=y, yaw=yaw + turn, width=float(width), depth=float(depth), height=float(height)
    )
