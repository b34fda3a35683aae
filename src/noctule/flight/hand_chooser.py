"""The choice of key images beside a flight by hand: it takes longer than a tick, so it has a thread.

Frames and orders are worked off in their order and none is dropped, so the choice depends on nothing else:
where the thread falls behind, the flight waits for it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from enum import IntEnum

from noctule.flight.path_check import FARTHEST, WIDEST, link_fault
from noctule.vision.key_images import DEFAULT_CHOICE, Frame, KeyFrame, KeyImageWalk
from noctule.vision.links import LinkQuality

ASKED = "asked for by key"
_BACKLOG = 4  # frames
_SOON = 0.7  # of the way or turn that can be flown


class Reach(IntEnum):
    """Whether an image taken here could be reached from the newest key image."""

    LOST = 0
    SOON = 1  # soon it could not
    GOOD = 2


def reach_of(link: LinkQuality) -> Reach:
    """Judge a link as `noctule path check` would, and warn before it does."""
    if link_fault(link):
        return Reach.LOST
    far = link.baseline > _SOON * FARTHEST or abs(link.yaw) > _SOON * WIDEST
    return Reach.SOON if far or DEFAULT_CHOICE.grade(link) < 2 else Reach.GOOD


@dataclass(frozen=True, slots=True)
class Shared:
    """What the newest key image shares with what is seen now."""

    images: int = 0  # taken
    link: LinkQuality | None = None  # None before anything was compared
    news: str = ""  # the last thing that happened to the images

    @property
    def reach(self) -> Reach:
        """Whether the next image can be reached; good as long as nothing was compared."""
        return Reach.GOOD if self.link is None else reach_of(self.link)


class HandChooser:
    """Works a walk in a thread. Close it: that is also how one gets the key images."""

    def __init__(self, walk: KeyImageWalk) -> None:
        self._walk = walk
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="noctule-chooser")
        self._jobs: deque[Future[Shared]] = deque()
        self._shared = Shared()
        self._news = ""  # of the thread

    def look(self, frame: Frame) -> None:
        """Show a frame."""
        self._submit(lambda: self._looked(frame))

    def take(self) -> None:
        """Make the newest frame a key image."""
        self._submit(self._took)

    def undo(self) -> None:
        """Forget the newest key image."""
        self._submit(self._undid)

    def finish(self, with_last: bool) -> bool:
        """Take the last frame too where asked; whether what was taken makes a path."""

        def end() -> Shared:
            if with_last:
                self._walk.finish()
            done = worth_keeping(self._walk.taken)
            return self._told("" if done else "no path yet: take an image (space), or leave (esc)")

        self._submit(end)
        self._collect(0)
        return worth_keeping(self._walk.taken)

    def shared(self) -> Shared:
        """Return what is known by now; raises what went wrong in the thread."""
        while self._jobs and self._jobs[0].done():
            self._shared = self._jobs.popleft().result()
        return self._shared

    def close(self) -> tuple[KeyFrame, ...]:
        """End the thread when all is worked off; return the key images."""
        self._pool.shutdown(wait=True)
        return tuple(self._walk.taken)

    def _submit(self, job: Callable[[], Shared]) -> None:
        self._jobs.append(self._pool.submit(job))
        self._collect(_BACKLOG)

    def _collect(self, left: int) -> None:
        while len(self._jobs) > left:
            self._shared = self._jobs.popleft().result()

    def _told(self, news: str) -> Shared:
        self._news = news or self._news
        return Shared(len(self._walk.taken), self._walk.link, self._news)

    def _looked(self, frame: Frame) -> Shared:
        before = len(self._walk.taken)
        self._walk.look(frame)
        taken = self._walk.taken
        return self._told(f"image {len(taken) - 1} taken: {taken[-1].reason}" if len(taken) > before else "")

    def _took(self) -> Shared:
        key, number = self._walk.take(ASKED), len(self._walk.taken) - 1
        if key is None:
            return self._told("nothing new to take here")
        fault = link_fault(key.link) if key.link is not None else ""
        if fault:
            return self._told(f"image {number} taken, but not to be reached (u undoes it): {fault}")
        return self._told(f"image {number} taken")

    def _undid(self) -> Shared:
        if self._walk.undo() is None:
            return self._told("there is no image to undo")
        left = len(self._walk.taken)
        back = "go back toward the image before, or press space" if left else "press space to begin again"
        return self._told(f"image {left} undone; {back}" if self._walk.automatic else f"image {left} undone")


def worth_keeping(keys: Sequence[KeyFrame]) -> bool:
    """Whether key images make a path: two, or one that a person took."""
    return len(keys) >= 2 or any(key.reason == ASKED for key in keys)
