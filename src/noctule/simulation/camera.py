"""The simulated camera as the flight loop sees it: the `Camera` protocol."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.camera import CameraMount, PinholeCamera
from noctule.geometry import Pose
from noctule.messages import Picture
from noctule.simulation.aircraft import Aircraft
from noctule.simulation.darkroom import Darkroom, Pixels
from noctule.simulation.dynamics import STEPS_PER_SECOND
from noctule.simulation.spec import CameraSpec
from noctule.simulation.stream import Exposures, Stream

NOISE_BANK = 1 << 22  # values; each picture takes a run of it at a place of its own
READER_GONE = 0.2  # [s]: when no picture was read for this long, none is begun before it is asked for


class Shutter:
    """Notes the pose at every exposure and has the picture drawn.

    While pictures are being read each is begun at its exposure, so that it is ready at its delivery; nobody
    reading, nothing is drawn. Either way a picture shows the moment of its exposure.
    """

    def __init__(
        self, spec: CameraSpec, aircraft: Aircraft, darkroom: Darkroom, seed: np.random.SeedSequence
    ) -> None:
        self._aircraft = aircraft
        self._darkroom = darkroom
        self._noise = PixelNoise(spec.noise, seed)
        self._exposures: Exposures[Pose] = Exposures(spec.rate, spec.latency)
        self._drawn: tuple[int, Picture] | None = None
        self._begun: dict[int, Future[Pixels]] = {}
        self._last_read = -math.inf  # [s]

    def step(self) -> None:
        """Expose when it is time; call it at every step, the first one at time 0."""
        exposed = self._exposures.step(self._aircraft.steps, lambda: self._aircraft.pose)
        if exposed is not None and self._aircraft.now - self._last_read < READER_GONE:
            self._begin(*exposed)

    @property
    def newest(self) -> tuple[int, float] | None:
        """(number, stamp) of the newest picture that has been delivered."""
        newest = self._exposures.newest
        return None if newest is None else (newest[0], newest[1] / STEPS_PER_SECOND)

    def picture(self) -> Picture:
        """Return the newest delivered picture; call it only where there is one."""
        assert self._exposures.newest is not None
        number, step, pose = self._exposures.newest
        self._last_read = self._aircraft.now
        if self._drawn is None or self._drawn[0] != number:
            pixels = self._begin(number, pose).result()
            pixels.setflags(write=False)
            self._begun = {n: future for n, future in self._begun.items() if n > number}
            self._drawn = (number, Picture(step / STEPS_PER_SECOND, pixels))
        return self._drawn[1]

    def _begin(self, number: int, pose: Pose) -> Future[Pixels]:
        if number not in self._begun:
            self._begun[number] = self._darkroom.begin(pose, partial(self._noise.add, number=number))
        return self._begun[number]


class PixelNoise:
    """Gaussian noise that depends on the picture's number only, not on which pictures are drawn."""

    def __init__(self, sd: float, seed: np.random.SeedSequence) -> None:
        self._sd = sd
        self._entropy = seed.generate_state(4)
        self._bank: tuple[Pixels, Pixels] | None = None  # what is added and what is taken away

    def add(self, pixels: NDArray[np.uint8], number: int) -> NDArray[np.uint8]:
        """Return the picture with the noise of picture `number`, cut to 0 to 255."""
        if self._sd == 0.0:
            return pixels
        more, less = self._banks(pixels.size)
        offset = int(np.random.default_rng([*self._entropy, number]).integers(len(more) - pixels.size))
        run = slice(offset, offset + pixels.size)
        # One of the two is 0 everywhere, so adding and taking away saturate like one signed addition.
        brighter = cv2.add(pixels, more[run].reshape(pixels.shape))
        return np.asarray(cv2.subtract(brighter, less[run].reshape(pixels.shape)), dtype=np.uint8)

    def _banks(self, size: int) -> tuple[Pixels, Pixels]:
        if self._bank is None or len(self._bank[0]) <= size:
            values = np.random.default_rng(self._entropy).standard_normal(NOISE_BANK, dtype=np.float32)
            rounded = np.clip(np.rint(self._sd * values), -255, 255).astype(np.int16)
            if size >= NOISE_BANK:
                rounded = np.resize(rounded, size + 1)
            more, less = np.maximum(rounded, 0), np.maximum(-rounded, 0)
            self._bank = more.astype(np.uint8), less.astype(np.uint8)
        return self._bank


class SimulatedCamera(Stream[Picture]):
    """Implements `noctule.devices.protocols.Camera` in a simulated world."""

    def __init__(
        self,
        spec: CameraSpec,
        shutter: Shutter,
        now: Callable[[], float],
        sleep_until: Callable[[float], None],
    ) -> None:
        super().__init__("simulated camera", spec.rate, shutter, now, sleep_until)
        self._spec = spec

    @property
    def intrinsics(self) -> PinholeCamera:
        """The pinhole."""
        return self._spec.intrinsics

    @property
    def mount(self) -> CameraMount:
        """How it sits on the body."""
        return self._spec.mount
