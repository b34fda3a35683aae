"""Draws pictures in a thread of its own, so that the renderer works while the loop thinks."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from noctule.geometry import Pose

Pixels = NDArray[np.uint8]
Develop = Callable[[Pixels], Pixels]


class Eye(Protocol):
    """What draws, and is to be used from one thread only."""

    def draw_from(self, body: Pose) -> Pixels:
        """Return the picture (height, width, 3) RGB of the camera on a body at this pose."""
        ...

    def close(self) -> None:
        """Free it; idempotent."""
        ...


class Darkroom:
    """Makes the eye when the first picture is asked for: an OpenGL context belongs to one thread."""

    def __init__(self, make_eye: Callable[[], Eye]) -> None:
        self._make_eye = make_eye
        self._eye: Eye | None = None
        self._thread: ThreadPoolExecutor | None = None

    def begin(self, body: Pose, develop: Develop | None = None) -> Future[Pixels]:
        """Begin a picture; `develop` is what is done to it afterwards, in the same thread."""
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1, thread_name_prefix="noctule-darkroom")
        return self._thread.submit(self._draw, body, develop)

    def draw(self, body: Pose) -> Pixels:
        """Return a picture, waiting for it."""
        return self.begin(body).result()

    def _draw(self, body: Pose, develop: Develop | None) -> Pixels:
        if self._eye is None:
            self._eye = self._make_eye()
        pixels = self._eye.draw_from(body)
        return pixels if develop is None else develop(pixels)

    def close(self) -> None:
        """Drop what has not begun and free the eye; idempotent."""
        if self._thread is not None:
            self._thread.submit(self._free).result()
            self._thread.shutdown(wait=True)
            self._thread = None

    def _free(self) -> None:
        if self._eye is not None:
            self._eye.close()
            self._eye = None
