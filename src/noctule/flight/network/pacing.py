"""What was recorded or made up, handed out when it is due on the clock that all nodes share.

That clock is the machine's time of day: `time.time`, kept alike on several machines by chrony or PTP. Stamps
of a device are of the machine's monotonic clock and are taken over to it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import TypeVar

from noctule.flight.network.process import Nothing
from noctule.messages import DepthFrame

Item = TypeVar("Item")
TOO_LATE = 1.0  # [s], what is due for longer is left out, as a camera would that nobody looked at


@dataclass(frozen=True, slots=True)
class Schedule:
    """Which moment of a recording is which on the shared clock."""

    begin: float  # [s], shared clock
    first: float = 0.0  # [s], the recording's stamp at that moment

    def shared(self, stamp: float) -> float:
        """Return a recorded stamp on the shared clock [s]."""
        return self.begin + (stamp - self.first)


def paced(
    due: Iterable[tuple[float, Iterable[Item]]],
    stop: threading.Event,
    clock: Callable[[], float] = time.time,
) -> Iterator[Item | Nothing]:
    """Yield the items of each entry when its time [s] has come; for those too late, that they were."""
    for at, items in due:
        if stop.wait(max(0.0, at - clock())):
            return
        late = clock() - at
        if late <= TOO_LATE:
            yield from items
        else:
            yield Nothing(f"{late:.1f} s late, left out")


def paced_frames(
    frames: Iterable[DepthFrame],
    schedule: Callable[[float], Schedule],
    stop: threading.Event,
    clock: Callable[[], float] = time.time,
) -> Iterator[DepthFrame | Nothing]:
    """Yield recorded frames when they are due, their stamps on the shared clock.

    `schedule` is asked once, with the first stamp [s].
    """
    frames = iter(frames)
    head = next(frames, None)
    if head is None:
        return
    when = schedule(head.stamp)
    shared = (replace(frame, stamp=when.shared(frame.stamp)) for frame in chain([head], frames))
    yield from paced(((frame.stamp, (frame,)) for frame in shared), stop, clock)


def live_frames(frames: Iterable[DepthFrame], stop: threading.Event) -> Iterator[DepthFrame]:
    """Yield frames of a device, their stamps on the shared clock."""
    offset = time.time() - time.monotonic()
    for frame in frames:
        if stop.is_set():
            return
        yield replace(frame, stamp=frame.stamp + offset)
