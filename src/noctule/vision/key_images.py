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
    gaps: bool = True  # whether a key image is taken then, and at an end that leads nowhere; else never

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
class _Shown:
    """A frame that was walked past."""

    index: int
    frame: Frame
    sharp: float


@dataclass(frozen=True, slots=True)
class _Seen:
    """A frame that was looked at."""

    shown: _Shown
    features: Features

    @property
    def index(self) -> int:
        return self.shown.index


@dataclass(frozen=True, slots=True)
class _Candidate:
    seen: _Seen
    link: LinkQuality
    grade: int
    motion: float


class KeyImageWalk:
    """Chooses key images while the frames come: show it each with `look`, what became one is in `taken`.

    A person may `take` the newest frame and `undo` the newest key image; after that, nothing is taken until
    the camera is back within half a step of the key image before, or the person takes one. Not `automatic`:
    only what the person takes. `link` is what the newest key image shares with the frame looked at last.
    """

    def __init__(
        self,
        camera: PinholeCamera,
        choice: Choice = DEFAULT_CHOICE,
        kind: str = "sift",
        attitude_sd: float = 0.0,
        automatic: bool = True,
    ) -> None:
        self.camera, self.choice, self.kind, self.attitude_sd = camera, choice, kind, attitude_sd
        self.automatic, self.waiting = automatic, False
        self.taken: list[KeyFrame] = []
        self.link: LinkQuality | None = None
        self._keys: list[_Seen] = []  # those of `taken`
        self._candidate: _Candidate | None = None  # the best frame since
        self._asked = False  # the newest key image was taken by a person
        self._lost = 0
        self._count = 0
        self._newest: _Shown | None = None
        self._best: _Shown | None = None  # of this window
        self._begin = 0.0  # [s] of the window

    def look(self, frame: Frame) -> None:
        """Walk past a frame; of each window only the sharpest is looked at."""
        shown = _Shown(self._count, frame, sharpness(frame.pixels))
        self._count += 1
        self._newest = shown
        if shown.index == 0:
            self._begin = frame.stamp
            if self.automatic:
                self._add(self._see(shown), "first", None)
        elif self._best is None:
            self._best = shown
        elif frame.stamp - self._begin >= self.choice.window:
            best, self._best, self._begin = self._best, shown, frame.stamp
            if self._keys:
                self._go_on(self._see(best))
        elif shown.sharp > self._best.sharp:
            self._best = shown

    def take(self, reason: str) -> KeyFrame | None:
        """Make the newest frame a key image; None where it is one, or where there is no frame."""
        shown = self._newest
        if shown is None or (self._keys and shown.index == self._keys[-1].index):
            return None
        seen = self._see(shown)
        link = self._measured(self._keys[-1], seen).link if self._keys else None
        self._add(seen, reason, link)
        self._asked, self.waiting, self._best, self._begin = True, False, None, shown.frame.stamp
        return self.taken[-1]

    def undo(self) -> KeyFrame | None:
        """Forget the newest key image and return it; None where there is none."""
        if not self.taken:
            return None
        self._keys.pop()
        self._candidate, self._best, self.link, self._lost = None, None, None, 0
        self.waiting = True
        return self.taken.pop()

    def release(self) -> list[KeyFrame]:
        """Hand over the key images that the walk needs no more, to keep memory small."""
        done, self.taken = self.taken[:-1], self.taken[-1:]  # the last frame may replace the newest
        self._keys = self._keys[-2:]
        return done

    def finish(self) -> None:
        """Make the last frame a key image, as the end of the path; one that a person took beside it stays."""
        shown = self._newest
        if not self._keys or shown is None or shown.index == self._keys[-1].index:
            return
        seen = self._see(shown)
        self._go_on(seen)
        if self.waiting or not self.automatic:
            return
        if self._keys[-1].index == seen.index:
            self.taken[-1] = replace(self.taken[-1], reason="last")
            return
        final = self._measured(self._keys[-1], seen)
        if final.motion < 0.5 and self._asked:
            return
        nowhere = final.grade == 0 or (len(self._keys) == 1 and final.motion < 0.25)
        if nowhere and not self.choice.gaps:
            return
        if len(self._keys) > 1 and final.motion < 0.5:
            # A hover at the end is no way to fly: the last frame stands for the key image beside it.
            instead = self._measured(self._keys[-2], seen)
            if instead.grade >= 1:
                self._keys.pop()
                self.taken.pop()
                final = instead
        self._add(seen, "last", final.link)

    def _see(self, shown: _Shown) -> _Seen:
        return _Seen(shown, detect(shown.frame.pixels, self.kind))

    def _measured(self, ref: _Seen, seen: _Seen) -> _Candidate:
        attitudes = (ref.shown.frame.attitude, seen.shown.frame.attitude)
        link = match_link(ref.features, seen.features, self.camera, attitudes, self.attitude_sd)
        return _Candidate(seen, link, self.choice.grade(link), self.choice.motion(link))

    def _add(self, seen: _Seen, reason: str, link: LinkQuality | None) -> None:
        self._keys.append(seen)
        self.taken.append(KeyFrame(seen.index, seen.shown.frame, reason, link))
        self._candidate, self.link, self._lost, self._asked = None, None, 0, False

    def _go_on(self, seen: _Seen) -> None:
        """Add the key images that this frame settles: none, or the candidate before it, or itself."""
        now = self._measured(self._keys[-1], seen)
        self.link = now.link
        self.waiting = self.waiting and (now.grade == 0 or now.motion >= 0.5)
        if self.waiting or not self.automatic:
            return
        best = self._candidate
        if best is not None:
            ripe, over = best.motion >= 1.0, now.motion > 1.25
            worse = now.grade < best.grade and (now.grade == 0 or best.motion >= 0.5)
            if worse or (ripe and over):
                self._add(
                    best.seen, "enough motion" if ripe else f"then {self.choice.why(now.link)}", best.link
                )
                now = self._measured(best.seen, seen)
                self.link = now.link
        if now.grade == 0:
            self._lost += 1
            if self._lost >= self.choice.patience and self.choice.gaps:
                self._add(seen, f"gap: {self.choice.why(now.link)}", now.link)
            return
        self._lost = 0
        # Of the frames that went far enough the sharpest; before that the farthest.
        best = self._candidate
        if best is None or best.motion < 1.0 or seen.shown.sharp > best.seen.shown.sharp:
            best = self._candidate = now
        if now.motion > 1.25:
            self._add(best.seen, "enough motion", best.link)


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
    walk = KeyImageWalk(camera, choice, kind, attitude_sd)
    for index, frame in enumerate(frames):
        progress(index, frame.stamp)
        walk.look(frame)
        yield from walk.release()
    walk.finish()
    yield from walk.taken
