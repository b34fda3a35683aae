"""The frames of a source as the camera of a site sees them: shown on a bar, sifted, counted."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.camera import FixedCamera
    from noctule.flight.depth_sources import DepthSource
    from noctule.localization.health import Sieve
    from noctule.localization.site import SiteCamera
    from noctule.messages import DepthFrame
    from noctule.vision.depth.background import Background


class OtherCameraError(NoctuleError):
    """A source whose camera is not the site's."""


@dataclass(frozen=True, slots=True)
class Stream:
    """The frames of a source, seen by the camera of a site; those that cannot be used are left out."""

    source: DepthSource
    camera: SiteCamera
    sieve: Sieve

    def frames(self, label: str) -> Iterator[DepthFrame]:
        """Yield the sound frames, with a progress bar."""
        from noctule.localization.site import straightened
        from noctule.reports.progress import with_progress

        shown = with_progress(self.source.frames(), label, total=self.source.count)
        yield from self.sieve.through(straightened(shown, self.camera))

    @contextmanager
    def judged(self) -> Iterator[None]:
        """Blame what cannot be learned on unusable frames, where there were many."""
        try:
            yield
        except NoctuleError:
            self.sieve.require_sound(self.source.name)
            raise
        self.sieve.require_sound(self.source.name)

    @property
    def used(self) -> str:
        """How many frames of what were used, in words."""
        bad = self.sieve.reasons
        left_out = ", ".join(f"{count} left out: {name}" for name, count in bad.most_common())
        used = f"{self.sieve.seen - bad.total()} frames of {self.source.name}"
        return f"{used} ({left_out})" if left_out else used

    def counts(self) -> dict[str, Any]:
        """Return what was seen."""
        return {"frames": self.sieve.seen, "unusable": dict(self.sieve.reasons)}


def require_same_camera(source: DepthSource, camera: FixedCamera) -> None:
    """Raise OtherCameraError unless the source's camera, where it is known, is the site's."""
    if source.intrinsics is None:
        return
    for name in ("width", "height", "fx", "fy", "cx", "cy"):
        theirs, ours = getattr(source.intrinsics, name), getattr(camera.intrinsics, name)
        if abs(theirs - ours) > 0.1:
            raise OtherCameraError(
                f"{source.name}: its camera has {name} {theirs:g} px, the site's camera.toml says {ours:g}; "
                "give the site of that camera"
            )


def open_stream(source: DepthSource, camera: SiteCamera, background: Background | None = None) -> Stream:
    """Return the stream of a source; raises OtherCameraError."""
    from noctule.localization.health import Expected, FrameHealth, Sieve, check_frame

    require_same_camera(source, camera.camera)
    own = camera.camera.intrinsics
    if background is not None:
        return Stream(source, camera, Sieve(FrameHealth(own, background).check))
    expected = Expected.over_floor(camera.camera)
    return Stream(source, camera, Sieve(lambda frame: check_frame(frame, expected)))


def thinned(frames: Iterable[DepthFrame], every: float) -> Iterator[DepthFrame]:
    """Yield a frame `every` so many seconds: neighbours say the same, and all of them fill the memory."""
    last = -math.inf
    for frame in frames:
        if not 0.0 <= frame.stamp - last < every - 1e-6:
            last = frame.stamp
            yield frame


@contextmanager
def spinner(label: str) -> Iterator[Callable[[str], None]]:
    """Show that something is being worked out; silent when standard error is no terminal."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda said: None
        return
    with console.status(label) as status:
        yield lambda said: status.update(f"{label}: {said}")
