"""Teaching by hand: a person flies the simulated vehicle by keys, and key images are taken on the way.

There is no terminal here: keys come from a function, and what the person is to see goes to another. The
flight depends on the keys and the seed alone: the same keys at the same times give the same path, bit for
bit. The person may be shown the truth; what is handed on is pictures, as with a remote control.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from noctule.devices.protocols import StaleFrameError
from noctule.flight.hand_chooser import HandChooser, Shared, worth_keeping
from noctule.flight.hand_controls import Bumper, Sticks
from noctule.flight.key_script import (
    FINISH,
    HOVER,
    INTERRUPT,
    LEAVE,
    STICKS,
    TAKE,
    UNDO,
    write_key_script,
)
from noctule.flight.mission import Mission
from noctule.flight.path_check import TILT_SD
from noctule.flight.rig import Rig
from noctule.flight.teach_video import Taken, TeachInputError, refuse_existing, save_keys
from noctule.geometry import Pose
from noctule.messages import Command, Picture, Truth, VehicleState
from noctule.simulation import SimulatedWorld
from noctule.vision.features import detect
from noctule.vision.key_images import Choice, Frame, KeyFrame, KeyImageWalk
from noctule.vision.links import match_link

PICTURES = 10.0  # [Hz], more than a person needs costs real time
CHOICE = Choice(window=0.2, gaps=False)
_LATE = 1.0  # [s], no picture is older

Pressed = Callable[[float], list[str]]
"""Returns the keys pressed until a flight time [s]; with a person at the keys it waits until then."""


class Ending(StrEnum):
    """How a flight by hand ended."""

    FINISHED = "finished"
    LEFT = "left"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True, slots=True)
class Status:
    """What a person at the keys is shown; none of it is flown on."""

    stamp: float  # [s] of flight
    pose: Pose  # the truth
    shared: Shared
    stopped_by: tuple[str, ...]  # what is in the way
    picture: Picture | None


@dataclass(frozen=True, slots=True)
class HandFlight:
    """What a flight by hand brought."""

    keys: tuple[KeyFrame, ...]
    truths: Mapping[float, Pose]  # by stamp of the frame, at its exposure
    presses: tuple[tuple[float, str], ...]
    ending: Ending
    error: BaseException | None = None  # what ended it, to be raised when the key images are safe


class _Flight:
    """One flight by hand. `step` is a tick."""

    def __init__(
        self, rig: Rig, chooser: HandChooser, bumper: Bumper, pressed: Pressed, automatic: bool
    ) -> None:
        self.rig, self.chooser, self.bumper, self.automatic = rig, chooser, bumper, automatic
        self.pressed, self.sticks = pressed, Sticks(bumper.limits)
        self.begin, self.tick = rig.clock.now(), 0
        self.previous = Command()
        self.picture: Picture | None = None
        self.past: deque[tuple[Truth, VehicleState]] = deque(maxlen=int(_LATE / bumper.dt) + 2)
        self.truths: dict[float, Pose] = {}
        self.presses: list[tuple[float, str]] = []
        self.ending: Ending | None = None

    def step(self) -> Status:
        self.tick += 1
        stamp = self.tick * self.bumper.dt
        keys = self.pressed(stamp)
        assert self.rig.referee is not None
        self.rig.clock.sleep_until(self.begin + stamp)
        truth = self.rig.referee.truth()
        self.past.append((truth, self.rig.vehicle.state()))
        self._look()
        for key in keys:
            if self.ending is None:
                self.presses.append((stamp, key))
                self._press(key, stamp)
        nu, stopped_by = self.bumper.command(self.sticks.wanted(stamp), self.previous, truth)
        self.previous = self.rig.vehicle.send(Command.from_array(nu), 10.0 * self.bumper.dt)
        touched = tuple(sorted({*stopped_by, *truth.contacts}))
        return Status(stamp, truth.pose, self.chooser.shared(), touched, self.picture)

    def _look(self) -> None:
        camera = self.rig.camera
        assert camera is not None
        with suppress(StaleFrameError):  # the first picture has not come yet
            picture = camera.latest(_LATE)
            if self.picture is None or picture.stamp > self.picture.stamp:
                self.picture = picture
                truth, state = min(self.past, key=lambda p: abs(p[0].stamp - picture.stamp))
                stabilised = camera.mount.stabilised
                attitude = (0.0, 0.0) if stabilised else (state.roll or 0.0, state.pitch or 0.0)
                self.truths[picture.stamp] = truth.pose
                self.chooser.look(Frame(picture.stamp, picture.pixels, attitude))

    def _press(self, key: str, stamp: float) -> None:
        if key in STICKS:
            self.sticks.press(key, stamp)
        elif key == HOVER:
            self.sticks.release()
        elif key == TAKE:
            self.chooser.take()
        elif key == UNDO:
            self.chooser.undo()
        elif key == FINISH and self.chooser.finish(self.automatic):
            self.ending = Ending.FINISHED
        elif key in (LEAVE, INTERRUPT):
            self.ending = Ending.LEFT if key == LEAVE else Ending.INTERRUPTED


def fly_by_hand(
    rig: Rig,
    walk: KeyImageWalk,
    bumper: Bumper,
    pressed: Pressed,
    show: Callable[[Status], None] = lambda status: None,
) -> HandFlight:
    """Fly by keys until enter, esc or Ctrl-C; the rig has a referee and hovers, its camera is open.

    Enter does not end a flight that took no path yet. What goes wrong ends the flight and stands in the
    result's `error`, for the caller to raise once the key images are safe.
    """
    chooser = HandChooser(walk)
    flight = _Flight(rig, chooser, bumper, pressed, walk.automatic)
    error: BaseException | None = None
    try:
        while flight.ending is None:
            show(flight.step())
    except BaseException as caught:
        error = caught
    keys = chooser.close()
    return HandFlight(keys, flight.truths, tuple(flight.presses), flight.ending or Ending.INTERRUPTED, error)


def teach_by_hand(
    mission: Mission,
    seed: int,
    folder: Path,
    pressed: Pressed,
    show: Callable[[Status], None] = lambda status: None,
    automatic: bool = True,
) -> tuple[tuple[Taken, ...], Ending]:
    """Have a path taught by keys in the room of a mission, without columns and in calm air.

    Whichever way the flight ends, what was taken is written into `folder`, and beside it the keys, as
    keys.txt. Without `automatic` only the person takes images. Returns the images and how it ended.

    Raises
    ------
    PathExistsError
        When there is a path in `folder` already.
    TeachInputError
        When nothing was taken.
    PathFolderError
        When the folder cannot be written.
    """
    refuse_existing(folder)
    room = mission.room.model_copy(update={"columns": (), "seed": seed})
    vehicle = mission.vehicle.model_copy(update={"gusts": 0.0, "pushes": (), "navdata": None})
    camera = mission.camera.model_copy(update={"rate": min(mission.camera.rate, PICTURES)})
    kind, dt = mission.pilot.features, 1.0 / mission.flight.rate_hz
    with SimulatedWorld(room, vehicle, camera, mission.start.pose(seed), seed) as world, world.vehicle:
        world.camera.open()
        view, mount = world.camera.intrinsics, world.camera.mount
        # The room is painted and code compiled before time begins to run.
        first = detect(world.photograph(mission.start.nominal).pixels, kind)
        match_link(first, first, view)
        walk = KeyImageWalk(view, CHOICE, kind, 0.0 if mount.stabilised else TILT_SD, automatic)
        lag = vehicle.lag + vehicle.command_latency
        bumper = Bumper(lambda pose: world.clearance(pose)[1], lag, mission.limits.values(), dt)
        rig = Rig(world.clock, world.vehicle, world.camera, world.referee)
        flight = fly_by_hand(rig, walk, bumper, pressed, show)
    taken: tuple[Taken, ...] = ()
    if worth_keeping(flight.keys):
        taken = save_keys(flight.keys, view, mount, folder, kind, flight.truths)
        with suppress(OSError):  # the path is written, and complete without it
            write_key_script(folder / "keys.txt", flight.presses)
    if flight.error is not None:
        raise flight.error
    if not taken:
        raise TeachInputError(
            "teaching: left before an image was taken on the way, so nothing was written; "
            "fly farther, or press space"
        )
    return taken, flight.ending
