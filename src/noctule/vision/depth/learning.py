"""The background learned from frames of an empty room, and refused where something moved in it."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain, islice

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.vision.depth.background import (
    Background,
    BackgroundSettings,
    Depth,
    Mask,
    Millimetres,
    deviation_floor,
)
from noctule.vision.depth.errors import (
    EmptyBackgroundError,
    MovingBackgroundError,
    TooFewFramesError,
    check_depth,
)

MIN_FRAMES = 10
_FIRST = 15  # frames whose median tells what stands still; 0.5 s
_WINDOW = 9  # [px], a change is believed where most pixels of such a window agree on it
_MIN_MOVED = 40  # [px], smaller changes are noise


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
        moved = changed & (of > 0.5 * among) & (among > 0.3 * _WINDOW**2)
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
        check_depth(depth, first[0].shape[:2])
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
