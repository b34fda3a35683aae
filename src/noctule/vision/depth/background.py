"""The empty room as a depth camera sees it: what is nearer than that is foreground."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain, islice

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from noctule.settings import Settings
from noctule.vision.depth.errors import (
    EmptyBackgroundError,
    MovingBackgroundError,
    TooFewFramesError,
    check_depth,
)

Depth = NDArray[np.uint16]  # (height, width) [mm], 0 where there is no reading
Mask = NDArray[np.bool_]
Millimetres = NDArray[np.float32]

MIN_FRAMES = 10
_FIRST = 15  # frames whose median tells what stands still; 0.5 s
_WINDOW = 9  # [px], a change is believed where most pixels of such a window agree on it
_MIN_MOVED = 40  # [px], smaller changes are noise
_STRIDE, _TILE = 4, 8  # `fits` looks at every 4th pixel, in tiles of 8 x 8 of these


class BackgroundSettings(Settings):
    """How a background is learned."""

    step_at_1m: float = Field(
        default=2.85, ge=0.0, le=50.0, description="[mm], the sensor's depth step at 1 m; grows with z^2"
    )
    deviations: float = Field(
        default=4.0, ge=2.0, le=20.0, description="foreground is nearer by this many deviations"
    )
    min_share: float = Field(
        default=0.05, ge=0.0, le=1.0, description="a pixel is known when it had a reading in so many frames"
    )
    min_known: float = Field(
        default=0.3, ge=0.0, le=1.0, description="of the picture that must be known; less is refused"
    )


@dataclass(frozen=True, slots=True)
class Background:
    """The empty room, learned from valid readings only; a pixel is foreground iff 0 < depth < nearest."""

    mean: Millimetres  # (height, width) [mm], 0 where there never was a reading
    deviation: Millimetres  # (height, width) [mm], at least half the sensor's step there
    count: NDArray[np.int32]  # (height, width), readings
    nearest: Depth  # (height, width) [mm], depths below are foreground
    frames: int  # learned from
    deviations: float  # multiple of the deviation that a reading may differ by

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width [px]."""
        return self.nearest.shape[0], self.nearest.shape[1]

    def foreground(self, depth: Depth) -> Mask:
        """Return which pixels of a depth image are foreground; a pixel without a reading never is.

        Raises DepthFormatError for a frame of another size or type.
        """
        check_depth(depth, self.shape)
        return np.asarray((depth > 0) & (depth < self.nearest))


def deviation_floor(depth: Millimetres, step_at_1m: float) -> Millimetres:
    """Return the least deviation [mm] that readings at `depth` [mm] can be trusted to: half the depth step.

    A pixel may sit on one step while the background is learned and on the next one afterwards.
    """
    return np.asarray(np.maximum(0.5 * step_at_1m * (1e-3 * depth) ** 2, 1.0), dtype=np.float32)


def _median(stack: NDArray[np.int32]) -> tuple[Millimetres, Mask]:
    """Return the lower median over the first axis of what is not negative, and where there is anything."""
    stack = np.where(stack < 0, np.iinfo(np.int32).max, stack)
    stack.sort(axis=0)
    n = (stack < np.iinfo(np.int32).max).sum(axis=0)
    middle = np.take_along_axis(stack, (np.maximum(n - 1, 0) // 2)[None], axis=0)[0]
    return np.where(n > 0, middle, 0).astype(np.float32), n > 0


def _usual(frames: list[Depth]) -> tuple[Millimetres, Millimetres, Mask]:
    """Return the median of the valid readings, their spread, and where there is one at all.

    The spread is that of the differences from frame to frame: a glossy surface that never reads the same
    has a large one, one before which somebody stood for some of the frames has not.
    """
    z = np.stack(frames).astype(np.int32)
    valid = z > 0
    usual, known = _median(np.where(valid, z, -1))
    difference, _ = _median(np.where(valid[1:] & valid[:-1], np.abs(np.diff(z, axis=0)), -1))
    return usual, difference * np.float32(1.4826 / np.sqrt(2.0)), known


class _Motion:
    """Finds what differs from the first half second by more than noise, in more than single pixels."""

    def __init__(self, first: list[Depth], settings: BackgroundSettings) -> None:
        self.usual, spread, self.known = _usual(first)
        floor = deviation_floor(self.usual, settings.step_at_1m)
        self.allowed = settings.deviations * np.maximum(spread, floor)
        self.union = np.zeros(self.usual.shape, dtype=np.bool_)
        self.frames: list[int] = []
        self.area = 0

    def look(self, index: int, depth: Depth) -> Mask | None:
        """Return the pixels in and around what moved in this frame, None when nothing did."""
        judged = self.known & (depth > 0)
        changed = judged & (np.abs(depth - self.usual) > self.allowed)
        if np.count_nonzero(changed) < _MIN_MOVED:
            return None
        # Edges and holes that flicker are a pixel or two wide: they lose the vote of their window.
        of, among = (
            cv2.boxFilter(mask.astype(np.float32), -1, (_WINDOW, _WINDOW), normalize=False, borderType=0)
            for mask in (changed, judged)
        )
        moved = changed & (of > 0.6 * among) & (among > 0.3 * _WINDOW**2)
        area = int(np.count_nonzero(moved))
        if area < _MIN_MOVED:
            return None
        self.area = max(self.area, area)
        self.union |= moved
        self.frames.append(index)
        return np.asarray(cv2.dilate(moved.view(np.uint8), np.ones((_WINDOW, _WINDOW), np.uint8)) > 0)

    def refuse(self, frames: int) -> None:
        """Raise MovingBackgroundError if something moved; a single frame is a fault of the sensor."""
        if len(self.frames) > 1:
            v, u = np.nonzero(self.union)
            box = (int(u.min()), int(v.min()), int(u.max()), int(v.max()))
            raise MovingBackgroundError(box, self.area, self.frames, frames)


def learn_background(frames: Iterable[Depth], settings: BackgroundSettings | None = None) -> Background:
    """Learn the empty room from depth images (height, width) [mm], read once, one after the other.

    Mean and deviation are of the valid readings of each pixel (Welford), where the paper averages all. A
    pixel with too few readings takes the threshold of the nearest thing beside it, ring by ring inward: in a
    hole of the floor a drone is foreground, while a table that shines through at times is not.

    Raises DepthFormatError, TooFewFramesError, EmptyBackgroundError, MovingBackgroundError.
    """
    settings = settings or BackgroundSettings()
    source = iter(frames)
    first = list(islice(source, _FIRST))
    for depth in first:
        check_depth(depth, first[0].shape)
    if len(first) < MIN_FRAMES:
        raise TooFewFramesError(
            f"background: found {len(first)} depth frames, expected at least {MIN_FRAMES}, better "
            "300 (10 s); record for longer, or check that the camera delivers frames"
        )
    shape = first[0].shape
    motion = _Motion(first, settings)
    mean, squares = np.zeros(shape), np.zeros(shape)
    count = np.zeros(shape, dtype=np.int32)
    lowest = np.full(shape, np.iinfo(np.uint16).max, dtype=np.uint16)
    total = 0
    for total, depth in enumerate(chain(first, source), start=1):
        check_depth(depth, shape)
        use = depth > 0
        moved = motion.look(total - 1, depth)
        if moved is not None:
            use &= ~moved
        count += use
        away = np.where(use, depth - mean, 0.0)
        mean += away / np.maximum(count, 1)
        squares += away * np.where(use, depth - mean, 0.0)
        np.minimum(lowest, depth, out=lowest, where=use)
    motion.refuse(total)
    return _background(mean, squares, count, lowest, total, settings)


def _background(
    mean: NDArray[np.float64],
    squares: NDArray[np.float64],
    count: NDArray[np.int32],
    lowest: Depth,
    frames: int,
    settings: BackgroundSettings,
) -> Background:
    known = count >= max(1.0, settings.min_share * frames)
    if known.mean() < settings.min_known:
        raise EmptyBackgroundError(
            f"background: {100.0 * known.mean():.0f} % of the picture has depth readings, expected at least "
            f"{100.0 * settings.min_known:.0f} %; is the sensor's projector on, and the floor in its range?"
        )
    mean_mm = mean.astype(np.float32)
    spread = np.sqrt(squares / np.maximum(count - 1, 1)).astype(np.float32)
    deviation = np.maximum(spread, deviation_floor(mean_mm, settings.step_at_1m))
    # At an edge that flickers between two depths the deviation is large, but nothing came nearer than the
    # nearer of them; a single false reading is caught by the deviation.
    near = lowest.astype(np.float32)
    near -= settings.deviations * deviation_floor(near, settings.step_at_1m)
    nearest = np.ceil(np.maximum(mean_mm - settings.deviations * deviation, near))
    threshold = np.where(known, np.clip(nearest, 0, 65534), 65535).astype(np.uint16)
    return Background(mean_mm, deviation, count, _fill(threshold, known), frames, settings.deviations)


def _fill(nearest: Depth, known: Mask) -> Depth:
    """Give unknown pixels the least threshold around them, ring by ring."""
    filled, unknown = nearest.copy(), ~known
    while unknown.any():
        grown = cv2.erode(filled, np.ones((3, 3), np.uint8))
        ring = unknown & (grown < np.iinfo(np.uint16).max)
        filled[ring] = grown[ring]
        unknown &= ~ring
    return filled


def fits(background: Background, depth: Depth) -> float:
    """Return the share of the visible background that is where it was learned, 0 to 1.

    Judged in tiles of 32 x 32 pixels, by the mean difference of their readings, which shows a turn of the
    camera of less than a degree where single readings cannot. A tile that is mostly foreground (a person, a
    drone) has no say, but at least a quarter of the picture must have one. What the camera cannot see,
    it cannot tell: a camera that moved sideways over a bare level floor fits.

    Raises DepthFormatError for a frame of another size or type.
    """
    check_depth(depth, background.shape)
    z = depth[::_STRIDE, ::_STRIDE].astype(np.float32)
    mean, deviation = background.mean[::_STRIDE, ::_STRIDE], background.deviation[::_STRIDE, ::_STRIDE]
    known = background.count[::_STRIDE, ::_STRIDE] >= 0.5 * background.frames
    away = z - mean
    judged = known & (z > 0)
    near = judged & (away < -background.deviations * deviation)
    far = judged & (away > background.deviations * deviation)
    inside = judged & ~near & ~far
    n_known, n, n_near, n_far, n_inside = (_tiles(m) for m in (known, judged, near, far, inside))
    drift = np.abs(_tiles(np.where(inside, away, 0.0))) / np.maximum(n_inside, 1.0)
    allowed = _tiles(np.where(inside, deviation, 0.0)) / np.maximum(n_inside, 1.0)
    background_there = n_known >= 0.25 * _TILE**2
    sees = background_there & (n >= 0.25 * _TILE**2) & (n_near < 0.5 * n)
    agrees = sees & (n_far <= 0.2 * n) & (n_inside > 0) & (drift <= allowed)
    at_least = max(1.0, 0.25 * float(np.count_nonzero(background_there)))
    return float(np.count_nonzero(agrees)) / max(float(np.count_nonzero(sees)), at_least)


def _tiles(values: NDArray[np.generic]) -> NDArray[np.float64]:
    """Return the sums over tiles; what is left over at the right and bottom edge is not counted."""
    rows, columns = values.shape[0] // _TILE, values.shape[1] // _TILE
    whole = values[: rows * _TILE, : columns * _TILE].reshape(rows, _TILE, columns, _TILE)
    return np.asarray(whole.sum(axis=(1, 3), dtype=np.float64))
