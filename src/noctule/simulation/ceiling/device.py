"""The simulated depth camera as the flight loop sees it: the `DepthCamera` protocol."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from noctule.camera import PinholeCamera
from noctule.geometry import Pose
from noctule.messages import DepthFrame
from noctule.simulation.aircraft import Aircraft
from noctule.simulation.ceiling.motions import Motion, things_at
from noctule.simulation.ceiling.spec import CeilingSpec
from noctule.simulation.ceiling.stage import DepthStage
from noctule.simulation.dynamics import STEPS_PER_SECOND
from noctule.simulation.spec import RoomSpec
from noctule.simulation.stream import Exposures, Stream


class DepthShutter:
    """Notes the pose at every exposure; a frame is drawn when it is asked for, as it was then."""

    def __init__(
        self,
        spec: CeilingSpec,
        aircraft: Aircraft,
        room: RoomSpec,
        motions: tuple[Motion, ...],
        seed: np.random.SeedSequence,
    ) -> None:
        self._spec = spec
        self._aircraft = aircraft
        self._room = room
        self._motions = motions
        self._seed = int(seed.generate_state(1)[0])
        self._exposures: Exposures[Pose] = Exposures(spec.rate_hz, spec.latency_s)
        self._stages: dict[bool, DepthStage] = {}  # by whether the camera was bumped
        self._drawn: tuple[int, DepthFrame] | None = None

    def step(self) -> None:
        """Expose when it is time; call it at every step, the first one at time 0."""
        self._exposures.step(self._aircraft.steps, lambda: self._aircraft.pose)

    @property
    def newest(self) -> tuple[int, float] | None:
        """(number, stamp) of the newest frame that has been delivered."""
        newest = self._exposures.newest
        return None if newest is None else (newest[0], newest[1] / STEPS_PER_SECOND)

    def picture(self) -> DepthFrame:
        """Return the newest delivered frame; call it only where there is one."""
        assert self._exposures.newest is not None
        number, step, pose = self._exposures.newest
        if self._drawn is None or self._drawn[0] != number:
            stamp = step / STEPS_PER_SECOND
            frame = self._stage_at(stamp).frame(
                stamp, pose, things_at(self._motions, stamp), self._spec.colour
            )
            if frame.colour is not None:
                frame.colour.setflags(write=False)
            self._drawn = (number, frame)
        return self._drawn[1]

    def _stage_at(self, stamp: float) -> DepthStage:
        """Return the stage as the camera hangs at `stamp` [s]."""
        spec = self._spec.at(stamp)
        bumped = spec is not self._spec
        if bumped not in self._stages:
            self._stages[bumped] = DepthStage(spec, self._seed, self._room)
        return self._stages[bumped]


class SimulatedDepthCamera(Stream[DepthFrame]):
    """Implements `noctule.devices.protocols.DepthCamera` in a simulated world."""

    def __init__(
        self,
        spec: CeilingSpec,
        shutter: DepthShutter,
        now: Callable[[], float],
        sleep_until: Callable[[float], None],
    ) -> None:
        super().__init__("simulated depth camera", spec.rate_hz, shutter, now, sleep_until)
        self._spec = spec

    @property
    def intrinsics(self) -> PinholeCamera:
        """The pinhole of the depth image, which the colour image is registered to."""
        return self._spec.camera.intrinsics
