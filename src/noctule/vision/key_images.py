"""Which frames of a flight become key images: enough motion, and neighbours that can be flown between.

Nothing is kept but the last key images and one candidate, so a video of any length, or a live camera, can be
walked through. The same frames give the same choice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.camera import PinholeCamera
from noctule.vision.features import Features, Pixels, detect, gray
from noctule.vision.links import Attitude, LinkQuality, match_link


@dataclass(frozen=True, slots=True)
class Frame:
    """A picture on the way along the path."""

    stamp: float  # [s]
    pixels: NDArray[np.uint8]  # (height, width, 3) RGB
    attitude: Attitude = (0.0, 0.0)  # roll, pitch [rad] as reported; 0 for a stabilised camera


@dataclass(frozen=True, slots=True)
class KeyFrame:
    """A frame that became a key image."""

    index: int  # among the frames that were walked through
    frame: Frame
    reason: str  # why this one
    link: LinkQuality | None = None  # with the key image before


@dataclass(frozen=True, slots=True)
class Choice:
    """What is wanted of the way from one key image to the next."""

    step: float = 0.12  # [mean depths], motion that is enough for a new key image
    turn: float = float(np.radians(12.0))  # [rad], a turn that is enough
    window: float = 0.12  # [s], of each such piece of time only the sharpest frame is looked at
    shared: int = 40  # points that neighbours should share
    fewest: int = 16  # points that they must share
    cells: int = 8  # parts of the picture, of 24, that the points should cover
    fewest_cells: int = 5  # and must
    patience: int = 4  # windows without any geometry, after which the way has a gap

    def grade(self, link: LinkQuality) -> int:
        """Return 2 for a good link, 1 for one that can be flown, 0 for none."""
        if not link.conditioned or link.shared < self.fewest or link.cells < self.fewest_cells:
            return 0
        return 2 if link.shared >= self.shared and link.cells >= self.cells else 1

    def motion(self, link: LinkQuality) -> float:
        """Return how far the link goes: 1 is enough for a new key image."""
        return max(link.baseline / self.step, abs(link.yaw) / self.turn)

    def why(self, link: LinkQuality) -> str:
        """Return what falls short of the wanted."""
        if link.reason:
            return link.reason
        if link.shared < self.shared:
            return f"{link.shared} shared points"
        if link.cells < self.cells:
            return f"points in {link.cells} of 24 parts of the picture"
        return "the motion cannot be told"


DEFAULT_CHOICE = Choice()


def sharpness(pixels: Pixels) -> float:
    """Return how sharp a picture is: the variance of its Laplacian over its own variance, of half size."""
    half = cv2.resize(gray(pixels), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).astype(np.float32)
    return float(cv2.Laplacian(half, cv2.CV_32F).var() / max(float(half.var()), 1.0))


@dataclass(frozen=True, slots=True)
class _Seen:
    """A frame with its features."""

    index: int
    frame: Frame
    features: Features
    sharp: float


@dataclass(frozen=True, slots=True)
class _Candidate:
    seen: _Seen
    link: LinkQuality
    grade: int
    motion: float


def _sharpest(
    frames: Iterable[Frame], window: float, note: Callable[[int, float], None]
) -> Iterator[tuple[int, Frame, float, bool]]:
    """Yield (index, frame, sharpness, whether it is the last) of each window; first and last frame always."""
    best: tuple[int, Frame, float] | None = None
    last: tuple[int, Frame, float] | None = None
    begin = 0.0
    for index, frame in enumerate(frames):
        note(index, frame.stamp)
        last = (index, frame, sharpness(frame.pixels))
        if index == 0:
            yield *last, False
            begin = frame.stamp
        elif best is None:
            best = last
        elif frame.stamp - begin >= window:
            yield *best, False
            best, begin = last, frame.stamp
        elif last[2] > best[2]:
            best = last
    if last is not None:
        yield *last, True


class _Walk:
    """Where the choice stands: the last key image, the one before, and the best frame since."""

    def __init__(self, camera: PinholeCamera, choice: Choice, kind: str, attitude_sd: float) -> None:
        self.camera, self.choice, self.kind, self.attitude_sd = camera, choice, kind, attitude_sd
        self.before: _Seen | None = None
        self.key: _Seen | None = None
        self.candidate: _Candidate | None = None
        self.lost = 0

    def see(self, index: int, frame: Frame, sharp: float) -> _Seen:
        return _Seen(index, frame, detect(frame.pixels, self.kind), sharp)

    def measured(self, ref: _Seen, seen: _Seen) -> _Candidate:
        link = match_link(
            ref.features,
            seen.features,
            self.camera,
            (ref.frame.attitude, seen.frame.attitude),
            self.attitude_sd,
        )
        return _Candidate(seen, link, self.choice.grade(link), self.choice.motion(link))

    def take(self, chosen: _Candidate, reason: str) -> KeyFrame:
        self.before, self.key, self.candidate, self.lost = self.key, chosen.seen, None, 0
        return KeyFrame(chosen.seen.index, chosen.seen.frame, reason, chosen.link)

    def go_on(self, seen: _Seen) -> Iterator[KeyFrame]:
        """Yield the key images that this frame settles: none, or the candidate before it, or itself."""
        assert self.key is not None
        now = self.measured(self.key, seen)
        best = self.candidate
        if best is not None:
            ripe, over = best.motion >= 1.0, now.motion > 1.25
            worse = now.grade < best.grade and (now.grade == 0 or best.motion >= 0.5)
            if worse or (ripe and over):
                yield self.take(best, "enough motion" if ripe else f"then {self.choice.why(now.link)}")
                now = self.measured(best.seen, seen)
        if now.grade == 0:
            self.lost += 1
            if self.lost >= self.choice.patience:
                yield self.take(now, f"gap: {self.choice.why(now.link)}")
            return
        self.lost = 0
        # Of the frames that went far enough the sharpest; before that the farthest.
        best = self.candidate
        if best is None or best.motion < 1.0 or seen.sharp > best.seen.sharp:
            self.candidate = now
        if now.motion > 1.25:
            yield self.take(self.candidate or now, "enough motion")


def choose_key_images(
    frames: Iterable[Frame],
    camera: PinholeCamera,
    choice: Choice = DEFAULT_CHOICE,
    *,
    kind: str = "sift",
    attitude_sd: float = 0.0,
    progress: Callable[[int, float], None] = lambda index, stamp: None,
) -> Iterator[KeyFrame]:
    """Yield the frames that become key images, in order; the first and the last frame always do.

    A frame becomes one when the camera has moved or turned enough since the last key image, or when to wait
    longer would leave too few, badly spread or ill-conditioned matches; of frames that will do the sharpest
    is taken. Where nothing matches any more the way has a gap: the key image says so in its reason, and
    whoever checks the path will refuse it.

    Parameters
    ----------
    frames
        In the order of time; read one by one, each once.
    attitude_sd
        Standard deviation [rad] of the roll and pitch that are left between two frames.
    progress
        Called with the index and stamp [s] of every frame.
    """
    walk = _Walk(camera, choice, kind, attitude_sd)
    held: KeyFrame | None = None  # the newest key image, which the last frame may replace
    for index, frame, sharp, last in _sharpest(frames, choice.window, progress):
        if walk.key is not None and index == walk.key.index:
            continue
        seen = walk.see(index, frame, sharp)
        if walk.key is None:
            walk.key = seen
            held = KeyFrame(index, frame, "first")
            continue
        for found in walk.go_on(seen):
            if held is not None:
                yield held
            held = found
        if last and walk.key.index != index:
            final = walk.measured(walk.key, seen)
            if walk.before is not None and final.motion < 0.5:
                # A hover at the end is no way to fly: the last frame stands for the key image beside it.
                instead = walk.measured(walk.before, seen)
                if instead.grade >= 1:
                    held, final = None, instead
            if held is not None:
                yield held
            held = KeyFrame(index, frame, "last", final.link)
        elif last and held is not None:
            held = replace(held, reason="last")
    if held is not None:
        yield held
