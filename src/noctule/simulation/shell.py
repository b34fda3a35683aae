"""What is painted on walls, floor and ceiling, with the light of the lamps and soft shadows painted in."""

from __future__ import annotations

import zlib

import cv2
import numpy as np

from noctule.geometry import Array
from noctule.simulation.layout import Layout, solid_polygon
from noctule.simulation.photos import Image, desaturate, fractal, photo, tinted

PIXELS_PER_METRE = 150
MOST_PIXELS = 2048
_PAINTS = ((214, 208, 196), (196, 204, 204), (206, 196, 182), (188, 194, 182))

SHELL = ("wall_front", "wall_left", "wall_back", "wall_right", "floor", "ceiling")


def paint_shell(name: str, layout: Layout) -> Image:
    """Return the texture of one of SHELL (h, w, 3) RGB; walls are seen from inside, the floor from above."""
    rng = np.random.default_rng([layout.spec.seed, zlib.crc32(name.encode())])
    x, y, z = layout.spec.size
    if name == "floor":
        return desaturate(_floor(layout, rng, *_pixels(x, y)))
    if name == "ceiling":
        return desaturate(_ceiling(layout, rng, *_pixels(x, y)))
    wide, tall = _pixels(x if name in ("wall_left", "wall_right") else y, z)
    brick = name == ("wall_front", "wall_left", "wall_right")[layout.spec.seed % 3]
    wall = _bricks(rng, wide, tall) if brick else _plaster(rng, wide, tall, z)
    # Darker in the corners, brighter in the middle of the upper half: what lamps do to a wall.
    return desaturate(wall * _corners(wide, tall, x if name in ("wall_left", "wall_right") else y)[..., None])


def _pixels(wide: float, tall: float) -> tuple[int, int]:
    scale = min(PIXELS_PER_METRE, MOST_PIXELS / max(wide, tall))
    return max(64, round(wide * scale)), max(64, round(tall * scale))


def _corners(wide: int, tall: int, metres: float) -> np.ndarray:
    per_metre = wide / metres
    x, y = np.arange(wide, dtype=np.float32), np.arange(tall, dtype=np.float32)
    from_side, from_top = np.minimum(x, wide - 1 - x), np.minimum(y, tall - 1 - y)
    edge = np.minimum(from_side[None, :], from_top[:, None]) / np.float32(per_metre)
    return np.asarray(1.0 - 0.28 * np.exp(-edge / 0.22) - 0.08 * np.exp(-edge / 0.9), dtype=np.float32)


def _bricks(rng: np.random.Generator, wide: int, tall: int) -> np.ndarray:
    mortar = tinted(np.ones((tall, wide)), (150, 142, 132))
    long, high = int(0.24 * PIXELS_PER_METRE), int(0.085 * PIXELS_PER_METRE)
    grain = photo("gravel")[..., :1].astype(np.float32)
    surface = np.tile(grain / grain.mean(), (tall // len(grain) + 1, wide // grain.shape[1] + 1, 1))[
        :tall, :wide
    ]
    tone = np.array((170, 122, 102), dtype=np.float32)
    for row, y in enumerate(range(0, tall, high)):
        for x in range(-(row % 2) * long // 2, wide, long):
            # Every brick has its own colour, so that a wall of equal bricks can be matched.
            rgb = tone * np.float32(rng.uniform(0.62, 1.25)) + rng.uniform(-8.0, 8.0, 3).astype(np.float32)
            mortar[y + 1 : y + high - 1, max(x + 1, 0) : max(x + long - 1, 0)] = rgb
    stains = 1.0 + 0.10 * fractal(rng, tall, wide, 4, 8, 0.8)
    return np.asarray(mortar * (0.75 + 0.25 * surface) * stains[..., None])


def _plaster(rng: np.random.Generator, wide: int, tall: int, height: float) -> np.ndarray:
    rgb = _PAINTS[int(rng.integers(len(_PAINTS)))]
    wall = tinted(1.0 + 0.04 * fractal(rng, tall, wide, 3, 9, 0.9), rgb)
    per_metre = tall / height
    rail = int(tall - 0.95 * per_metre)
    if rng.random() < 0.6:
        wall[rail:] *= np.array([0.72, 0.74, 0.76], dtype=np.float32) * float(rng.uniform(0.85, 1.1))
        wall[rail - 6 : rail + 6] = (228, 224, 216)
        wall[rail + 6 : rail + 9] *= 0.6
        at = 0
        while at < wide:
            cv2.line(wall, (at, rail + 9), (at, tall), (96, 96, 96), 2)
            at += int(rng.uniform(0.16, 0.34) * per_metre)
    wall[tall - int(0.1 * per_metre) :] = (186, 180, 170)
    marks = np.ones((tall, wide), dtype=np.float32)
    for _ in range(int(wide / per_metre * 14)):
        spot = (int(rng.integers(0, wide)), int(rng.integers(0, tall)))
        axes = (int(rng.integers(1, 9)), int(rng.integers(1, 4)))
        cv2.ellipse(marks, spot, axes, float(rng.uniform(0, 180)), 0, 360, float(rng.uniform(0.6, 1.15)), -1)
    wall *= cv2.GaussianBlur(marks, (0, 0), 1.0)[..., None]
    return wall


def _floor(layout: Layout, rng: np.random.Generator, wide: int, tall: int) -> np.ndarray:
    floor = np.empty((tall, wide, 3), dtype=np.float32)
    per_metre = wide / layout.spec.size[0]
    plank = max(4, int(0.16 * per_metre))
    grain = cv2.resize(
        fractal(rng, tall, wide // 6, 64, 5, 0.9), (wide, tall), interpolation=cv2.INTER_LINEAR
    )
    for r in range(0, tall, plank):
        c = -int(rng.integers(0, int(1.2 * per_metre)))
        while c < wide:
            long = int(rng.uniform(0.7, 1.6) * per_metre)
            floor[r : r + plank, max(c, 0) : max(c + long, 0)] = np.array((168, 136, 102)) * rng.uniform(
                0.78, 1.15
            )
            floor[r : r + plank, max(c, 0) : max(c + 2, 0)] *= 0.55
            c += long
        floor[r : r + 2] *= 0.6
    floor *= (1.0 + 0.09 * grain + 0.05 * fractal(rng, tall, wide, 4, 8, 0.8))[..., None]
    _rugs(layout, rng, floor, per_metre)
    soft = cv2.resize(_shadows(layout, per_metre / 4.0, tall // 4, wide // 4), (wide, tall))
    return np.asarray(floor * soft[..., None] * _corners(wide, tall, layout.spec.size[0])[..., None])


def _shadows(layout: Layout, per_metre: float, tall: int, wide: int) -> np.ndarray:
    """Return how much light reaches the floor under and around what stands on it, 0 to 1."""
    shade = np.ones((tall, wide), dtype=np.float32)
    for solid in layout.solids:
        if solid.centre[2] - solid.half[2] < 0.6:
            cv2.fillPoly(shade, [_to_pixels(layout, solid_polygon(solid), per_metre, tall)], 0.42)
    wide_blur = cv2.GaussianBlur(shade, (0, 0), 0.22 * per_metre)
    return np.asarray(0.5 * wide_blur + 0.5 * cv2.GaussianBlur(shade, (0, 0), 0.05 * per_metre))


def _rugs(layout: Layout, rng: np.random.Generator, floor: np.ndarray, per_metre: float) -> None:
    room = layout.spec
    for _ in range(3):
        size = rng.uniform((1.4, 0.9), (2.6, 1.7))
        low = np.array([room.x_min, room.y_min]) + rng.random(2) * (np.array(room.size[:2]) - size).clip(0.0)
        corners = low + size * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        box = _to_pixels(layout, corners, per_metre, len(floor))
        (x0, y0), (x1, y1) = box.min(axis=0).clip(0), box.max(axis=0)
        tall, wide = floor[y0:y1, x0:x1].shape[:2]
        if tall < 40 or wide < 40:
            continue
        cells = rng.uniform(0.55, 1.1, (int(size[1] * 9), int(size[0] * 9), 1)) * np.array(
            [rng.uniform(130, 190), rng.uniform(115, 140), rng.uniform(95, 135)]
        )
        rug = cv2.resize(cells.astype(np.float32), (wide, tall), interpolation=cv2.INTER_NEAREST)
        rug *= (1.0 + 0.12 * fractal(rng, tall, wide, 32, 5, 0.95))[..., None]
        edge = int(0.07 * per_metre)
        rug[:edge], rug[-edge:], rug[:, :edge], rug[:, -edge:] = ((74, 62, 60),) * 4
        floor[y0:y1, x0:x1] = rug


def _ceiling(layout: Layout, rng: np.random.Generator, wide: int, tall: int) -> np.ndarray:
    ceiling = tinted(1.0 + 0.03 * fractal(rng, tall, wide, 4, 9, 0.85), (212, 210, 204))
    per_metre = wide / layout.spec.size[0]
    panel = int(0.6 * per_metre)
    for r in range(0, tall, panel):
        for c in range(0, wide, panel):
            cell = ceiling[r : r + panel, c : c + panel]
            cell *= float(rng.uniform(0.9, 1.06))
            cell[:2], cell[:, :2] = 120.0, 120.0
            kind = rng.random()
            inner = cell[panel // 6 : -panel // 6, panel // 6 : -panel // 6]
            if kind < 0.06:
                inner[::6] = 90.0
            elif kind < 0.12:
                inner *= float(rng.uniform(0.75, 0.9))
    for lamp in layout.spec.lights:
        spot = np.array([[lamp.x, lamp.y]])
        x, y = (int(v) for v in _to_pixels(layout, spot, per_metre, tall)[0])
        cv2.rectangle(ceiling, (x - panel, y - panel // 4), (x + panel, y + panel // 4), (252, 250, 244), -1)
        cv2.rectangle(ceiling, (x - panel, y - panel // 4), (x + panel, y + panel // 4), (110, 110, 110), 3)
    # The ceiling's texture is that of someone who lies on the floor: y grows downward in it.
    return np.asarray(ceiling[::-1] * _corners(wide, tall, layout.spec.size[0])[..., None])


def _to_pixels(layout: Layout, xy: Array, per_metre: float, tall: int) -> np.ndarray:
    x = (xy[:, 0] - layout.spec.x_min) * per_metre
    y = tall - (xy[:, 1] - layout.spec.y_min) * per_metre
    return np.column_stack([x, y]).round().astype(np.int32)
