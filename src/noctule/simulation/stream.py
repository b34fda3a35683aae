"""What simulated cameras share: when pictures are exposed and delivered, and how they are read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from noctule.devices.protocols import DeviceError, StaleFrameError
from noctule.simulation.dynamics import STEPS_PER_SECOND

SLACK = 1e-9  # [s], stamps are multiples of 1/300 s

Noted = TypeVar("Noted")
Shown = TypeVar("Shown")
Shown_co = TypeVar("Shown_co", covariant=True)


class Exposures(Generic[Noted]):
    """Notes something at every exposure and hands it on when the picture is delivered.

    Parameters
    ----------
    rate : pictures a second
    latency : from exposure to delivery [s]
    """

    def __init__(self, rate: float, latency: float) -> None:
        self._rate = rate
        self._latency = round(latency * STEPS_PER_SECOND)
        self._count = 0
        self._due = 0  # step of the next exposure
        self._waiting: list[tuple[int, int, Noted]] = []
        self.newest: tuple[int, int, Noted] | None = None
        """(number, step of exposure, what was noted) of the newest that has been delivered."""

    def step(self, step: int, note: Callable[[], Noted]) -> tuple[int, Noted] | None:
        """Expose and deliver when it is time; return (number, what was noted) when it exposes.

        Call it at every step of 1/300 s, the first one 0.
        """
        exposed = None
        if step >= self._due:
            exposed = (self._count, note())
            self._waiting.append((exposed[0], step, exposed[1]))
            self._count += 1
            self._due = round(self._count * STEPS_PER_SECOND / self._rate)
        while self._waiting and self._waiting[0][1] + self._latency <= step:
            self.newest = self._waiting.pop(0)
        return exposed


class Source(Protocol[Shown_co]):
    """Where a stream's pictures come from."""

    @property
    def newest(self) -> tuple[int, float] | None:
        """(number, stamp [s]) of the newest picture that has been delivered."""
        ...

    def picture(self) -> Shown_co:
        """Return the newest delivered picture; called only where there is one."""
        ...


class Stream(Generic[Shown]):
    """Opening, closing and reading, as `noctule.devices.protocols.Camera` and `DepthCamera` have it."""

    def __init__(
        self,
        name: str,
        rate: float,
        source: Source[Shown],
        now: Callable[[], float],
        sleep_until: Callable[[float], None],
    ) -> None:
        self._name = name
        self._rate = rate
        self.__source = source  # it knows the truth, which nobody who holds a camera is to reach
        self._now = now
        self._sleep_until = sleep_until
        self._open = False
        self._read = -1

    @property
    def live(self) -> bool:
        """Whether it is open."""
        return self._open

    def open(self) -> None:
        """Start the stream."""
        self._open = True

    def close(self) -> None:
        """Stop the stream."""
        self._open = False

    def read(self, timeout: float) -> Shown:
        """Wait up to `timeout` [s] for a picture not read before; simulated time passes while it waits.

        With a timeout of 0 time stands still and only what is already there is returned.
        """
        self._check_open()
        deadline = self._now() + timeout
        while True:
            newest = self.__source.newest
            if newest is not None and newest[0] > self._read:
                self._read = newest[0]
                return self.__source.picture()
            if self._now() + SLACK >= deadline:
                raise DeviceError(
                    f"{self._name}: no new picture in {timeout:g} s; "
                    f"expected one every {1.0 / self._rate:.3f} s: wait longer"
                )
            self._sleep_until(min(deadline, self._now() + 1.0 / STEPS_PER_SECOND))

    def latest(self, max_age: float) -> Shown:
        """Peek at the newest picture; raises StaleFrameError when its age is above `max_age` [s]."""
        self._check_open()
        newest = self.__source.newest
        age = float("inf") if newest is None else self._now() - newest[1]
        if age > max_age + SLACK:
            raise StaleFrameError(
                f"{self._name}: newest picture is {age:.3f} s old, allowed are {max_age:.3f} s; "
                "is the clock running, and is the camera's latency below that?"
            )
        return self.__source.picture()

    def _check_open(self) -> None:
        if not self._open:
            raise DeviceError(f"{self._name}: not open; call open() first")
