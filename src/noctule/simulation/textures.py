"""The textures of furniture and pictures, each painted from the room's seed and its own name."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np

from noctule.simulation.photos import FILES, Image, desaturate, fractal, photo, tinted

SIZE = 512
RGB = tuple[float, float, float]
_MUTED: tuple[RGB, ...] = (
    (146, 98, 92),
    (104, 122, 140),
    (122, 132, 98),
    (170, 150, 112),
    (92, 92, 100),
    (196, 188, 172),
    (128, 104, 128),
    (84, 112, 108),
    (182, 134, 104),
    (60, 66, 78),
    (220, 214, 200),
)


@lru_cache(maxsize=64)
def paint(name: str, seed: int) -> Image:
    """Return the texture `name` (h, w, 3) RGB; it depends on its name and the seed alone."""
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    if name in FILES:
        return photo(name)
    return desaturate(_PAINTERS[name.rsplit("_", 1)[0]](rng, name))


def framed(name: str, seed: int) -> Image:
    """Return photograph `name` as it hangs on a wall: with a margin of paper and a dark frame."""
    rng = np.random.default_rng([seed, zlib.crc32(name.encode()), 1])
    picture = photo(name) if name in FILES else paint(name, seed)
    edge = int(rng.integers(18, 44))
    paper = cv2.copyMakeBorder(picture, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=(236, 232, 222))
    dark = tuple(int(v) for v in rng.integers(30, 90, 1).repeat(3))
    return np.asarray(
        cv2.copyMakeBorder(paper, 12, 12, 12, 12, cv2.BORDER_CONSTANT, value=dark), dtype=np.uint8
    )


def _muted(rng: np.random.Generator) -> RGB:
    return _MUTED[int(rng.integers(len(_MUTED)))]


def _wood(rng: np.random.Generator, name: str) -> np.ndarray:
    base: RGB = (112, 82, 60) if name.endswith("dark") else (188, 158, 118)
    grain = cv2.resize(fractal(rng, SIZE, 64, 8, 6, 0.85), (SIZE, SIZE), interpolation=cv2.INTER_CUBIC)
    # Stretched along x: the grain of a board; the warp bends it around knots.
    warp = 14.0 * fractal(rng, SIZE, SIZE, 2, 3)
    rows, columns = np.mgrid[0:SIZE, 0:SIZE].astype(np.float32)
    grain = cv2.remap(
        grain, columns, rows + warp.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
    )
    fine = fractal(rng, SIZE, SIZE, 32, 4, 0.9)
    return tinted(1.0 + 0.16 * grain + 0.05 * fine, base)


def _fabric(rng: np.random.Generator, name: str) -> np.ndarray:
    cloth = tinted(1.0 + 0.07 * fractal(rng, SIZE, SIZE, 32, 5, 1.0), _muted(rng))
    if name.endswith("b"):
        for axis in (0, 1):
            at = 0
            while at < SIZE:
                wide = int(rng.integers(6, 40))
                stripe = (
                    (slice(at, at + wide), slice(None)) if axis == 0 else (slice(None), slice(at, at + wide))
                )
                cloth[stripe] = 0.65 * cloth[stripe] + 0.35 * np.array(_muted(rng))
                at += wide + int(rng.integers(20, 90))
    return cloth


def _weave(rng: np.random.Generator, name: str) -> np.ndarray:
    cells = rng.integers(0, len(_MUTED), (24, 24))
    colours = np.array(_MUTED)[cells].astype(np.float32)
    cloth = cv2.resize(colours, (SIZE, SIZE), interpolation=cv2.INTER_NEAREST)
    return np.asarray(cloth * (1.0 + 0.12 * fractal(rng, SIZE, SIZE, 32, 5, 0.9))[..., None])


def _books(rng: np.random.Generator, name: str) -> np.ndarray:
    shelf = np.full((SIZE, SIZE, 3), 40.0)
    x = 0
    while x < SIZE:
        wide = min(int(rng.integers(16, 46)), SIZE - x)
        top = int(rng.integers(0, 70))
        rgb = np.array(_muted(rng)) * float(rng.uniform(0.7, 1.15))
        shelf[top:, x : x + wide] = rgb
        shelf[top:, x : x + 2] *= 0.55
        shelf[top:, x + wide - 2 : x + wide] *= 0.7
        for _ in range(int(rng.integers(1, 5))):
            y = int(rng.integers(top + 10, SIZE - 60))
            tall = int(rng.integers(4, 50))
            shelf[y : y + tall, x + 3 : x + wide - 3] = np.array(_muted(rng)) * float(rng.uniform(0.6, 1.3))
        x += wide
    return np.asarray(shelf * (1.0 + 0.06 * fractal(rng, SIZE, SIZE, 32, 5, 0.9))[..., None])


def _drawers(rng: np.random.Generator, name: str) -> np.ndarray:
    front = _wood(rng, "dark" if rng.random() < 0.5 else "light")
    rows, columns = (int(v) for v in rng.integers(2, 5, 2))
    for i in range(rows):
        for j in range(max(1, columns - 1)):
            wide, tall = SIZE // max(1, columns - 1), SIZE // rows
            x, y = j * wide, i * tall
            front[y : y + tall, x : x + wide] *= float(rng.uniform(0.88, 1.1))
            cv2.rectangle(front, (x + 5, y + 5), (x + wide - 5, y + tall - 5), (38, 30, 26), 4)
            cv2.circle(front, (x + wide // 2, y + tall // 4), 9, (196, 190, 178), -1, cv2.LINE_AA)
            cv2.circle(front, (x + wide // 2 + 2, y + tall // 4 + 3), 9, (60, 56, 50), 2, cv2.LINE_AA)
    return front


def _poster(rng: np.random.Generator, name: str) -> np.ndarray:
    page = tinted(0.95 + 0.03 * fractal(rng, SIZE, SIZE), _muted(rng))
    for _ in range(int(rng.integers(8, 16))):
        colour = tuple(float(v) * rng.uniform(0.6, 1.25) for v in _muted(rng))
        x, y = (int(v) for v in rng.integers(0, SIZE, 2))
        size = int(rng.integers(20, 130))
        if rng.random() < 0.45:
            cv2.circle(page, (x, y), size // 2, colour, -1 if rng.random() < 0.7 else 8, cv2.LINE_AA)
        else:
            corners = np.array([x, y]) + rng.integers(-size, size, (int(rng.integers(3, 6)), 2))
            cv2.fillPoly(page, [corners.astype(np.int32)], colour, cv2.LINE_AA)
    names = sorted(FILES)
    for _ in range(2):
        part = photo(names[int(rng.integers(len(names)))])
        tall, wide = (int(v) for v in rng.integers(120, 280, 2))
        y, x = (int(v) for v in rng.integers(16, SIZE - 290, 2))
        page[y : y + tall, x : x + wide] = cv2.resize(part, (wide, tall), interpolation=cv2.INTER_AREA)
    for y in (SIZE - 100, SIZE - 62, SIZE - 32):
        _write(rng, page, y, 30 if y == SIZE - 100 else 18)
    return np.asarray(page * (1.0 + 0.03 * fractal(rng, SIZE, SIZE, 64, 4, 1.0))[..., None])


def _write(rng: np.random.Generator, page: np.ndarray, y: int, tall: int) -> None:
    """Put a line of made-up letters on a page: strokes on a grid of 3 by 3."""
    x, step = 24, tall // 3
    while x < SIZE - 40:
        strokes = rng.random((3, 3)) < 0.6
        for r in range(3):
            for c in range(3):
                if strokes[r, c]:
                    page[y + r * step : y + r * step + step, x + c * step // 2 : x + (c + 1) * step // 2] = (
                        36.0
                    )
        x += 2 * step + 3 + (tall // 2 if rng.random() < 0.2 else 0)


def _leaves(rng: np.random.Generator, name: str) -> np.ndarray:
    leaves = tinted(np.full((SIZE, SIZE), 0.7), (62, 78, 54))
    for _ in range(260):
        x, y = (int(v) for v in rng.integers(0, SIZE, 2))
        axes = (int(rng.integers(14, 46)), int(rng.integers(5, 16)))
        shade = float(rng.uniform(0.6, 1.5))
        colour = (78 * shade, 104 * shade, 66 * shade)
        cv2.ellipse(leaves, (x, y), axes, float(rng.uniform(0, 180)), 0, 360, colour, -1, cv2.LINE_AA)
    return leaves


def _clay(rng: np.random.Generator, name: str) -> np.ndarray:
    return tinted(1.0 + 0.12 * fractal(rng, SIZE, SIZE, 4, 7, 0.8), (168, 122, 96))


def _paint(rng: np.random.Generator, name: str) -> np.ndarray:
    return tinted(1.0 + 0.04 * fractal(rng, SIZE, SIZE, 4, 7, 0.8), (206, 204, 196))


def _crate(rng: np.random.Generator, name: str) -> np.ndarray:
    card = tinted(1.0 + 0.06 * fractal(rng, SIZE, SIZE, 4, 7, 0.8), (176, 146, 108))
    card[SIZE // 2 - 26 : SIZE // 2 + 26] *= 0.82
    for _ in range(5):
        x, y = (int(v) for v in rng.integers(30, SIZE - 170, 2))
        wide, tall = (int(v) for v in rng.integers(40, 140, 2))
        cv2.rectangle(card, (x, y), (x + wide, y + tall), (232, 228, 220), -1)
        for k in range(y + 10, y + tall - 8, 12):
            cv2.line(card, (x + 6, k), (x + int(wide * rng.uniform(0.4, 0.95)), k), (50, 48, 46), 3)
    return card


def _window(rng: np.random.Generator, name: str) -> np.ndarray:
    down = np.linspace(0.0, 1.0, SIZE, dtype=np.float32)[:, None]
    sky = tinted(1.0 + 0.0 * down * np.ones((1, SIZE)), (196, 214, 232)) + 30.0 * down[..., None]
    sky += 9.0 * fractal(rng, SIZE, SIZE, 3, 5)[..., None]
    trees = SIZE * (0.62 + 0.06 * fractal(rng, 2, SIZE, 1, 8, 0.7)[0])
    wood = tinted(1.0 + 0.22 * fractal(rng, SIZE, SIZE, 8, 6, 0.8), (96, 112, 84))
    view = np.where((np.arange(SIZE)[:, None] > trees)[..., None], wood, sky).astype(np.float32)
    view = np.asarray(cv2.GaussianBlur(view, (0, 0), 1.5), dtype=np.float32)
    for at in (6, SIZE // 2, SIZE - 7):
        cv2.line(view, (at, 0), (at, SIZE), (226, 222, 214), 16)
        cv2.line(view, (0, at), (SIZE, at), (226, 222, 214), 16)
        cv2.line(view, (at + 9, 0), (at + 9, SIZE), (120, 118, 114), 3)
    return view


def _door(rng: np.random.Generator, name: str) -> np.ndarray:
    door = _wood(rng, "light").transpose(1, 0, 2).copy()
    for x0, x1 in ((50, 236), (276, 462)):
        for y0, y1 in ((36, 220), (262, 476)):
            cv2.rectangle(door, (x0, y0), (x1, y1), (96, 78, 58), 6)
            cv2.rectangle(door, (x0 + 9, y0 + 9), (x1 + 2, y1 + 2), (222, 196, 158), 2)
    cv2.circle(door, (478, 262), 11, (70, 68, 66), -1, cv2.LINE_AA)
    return door


def _shade(rng: np.random.Generator, name: str) -> np.ndarray:
    return tinted(1.0 + 0.05 * fractal(rng, SIZE, SIZE, 16, 5, 0.9), (250, 240, 214))


_PAINTERS: dict[str, Callable[[np.random.Generator, str], np.ndarray]] = {
    "wood": _wood,
    "fabric": _fabric,
    "weave": _weave,
    "books": _books,
    "drawers": _drawers,
    "poster": _poster,
    "leaves": _leaves,
    "clay": _clay,
    "paint": _paint,
    "crate": _crate,
    "window": _window,
    "door": _door,
    "shade": _shade,
}
