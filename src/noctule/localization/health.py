"""Which depth frames cannot be used, and why: a reason with a name, never an exception in flight."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera, PinholeCamera
from noctule.compiled import compiled
from noctule.errors import NoctuleError
from noctule.messages import DepthFrame
from noctule.vision.depth.background import Background, fits

MIN_VALID = 0.2  # of the pixels in which the background has readings; without one, of all
MIN_FIT = 0.7  # of the background that can be seen; a camera tilted by one degree stays below
_STRIDE = 16  # every 16th pixel of every 16th row tells
_NEAREST, _FARTHEST = 500.0, 12_000.0  # [mm], no room's usual depth lies outside
_UNITS = {1e-3: "metres", 0.1: "centimetres", 5.0: "fifths of a millimetre", 10.0: "tenths of a millimetre"}
_SCALED = {**_UNITS, 0.2: "millimetres divided by five"}  # before a room is learned: no view is covered yet
_NEAR = 1.5  # a usual depth within this factor of the room's in another unit is in that unit
_LOOK_EVERY = 0.5  # [s], how often the camera is looked after

MOVED = "moved camera"
COVERED = "covered view"
MOST_COVERED = 0.6  # of the readings that may be far before the room: people and boxes cover less
_FAR_BEFORE = 300.0  # [mm]; a camera hangs lower by less
MOST_UNUSABLE = 0.2  # of the frames that something is learned from


class UnusableFramesError(NoctuleError):
    """Frames that nothing can be learned from."""


@dataclass(frozen=True, slots=True)
class Expected:
    """What frames of a camera look like."""

    width: int  # [px]
    height: int  # [px]
    known: NDArray[np.bool_]  # where the background has readings, every 16th pixel of every 16th row
    usual: float | None  # [mm], the median depth of background or floor; None where neither is known
    learned: bool = False  # whether that is the background's

    @classmethod
    def of(cls, camera: PinholeCamera, background: Background | None = None) -> Expected:
        """Return what to expect of a camera, and of the room where its background is known."""
        if background is None:
            known = np.ones((camera.height, camera.width), dtype=np.bool_)[::_STRIDE, ::_STRIDE]
            return cls(camera.width, camera.height, known, None)
        known = background.count[::_STRIDE, ::_STRIDE] > 0
        usual = float(np.median(background.mean[::_STRIDE, ::_STRIDE][known])) if known.any() else None
        return cls(camera.width, camera.height, known, usual, learned=True)

    @classmethod
    def over_floor(cls, camera: FixedCamera) -> Expected:
        """Return what to expect of a camera that hangs in a room whose background is not known yet."""
        k = camera.intrinsics
        blank = cls.of(k)
        v, u = np.nonzero(blank.known)
        rays = np.column_stack([k.normalise(np.column_stack([u, v]) * float(_STRIDE)), np.ones(len(u))])
        falls = -(rays @ camera.R_world_camera[2])  # [m] for a metre along the axis
        floor = np.where(falls > 0.0, 1000.0 * camera.t_world_camera[2] / np.maximum(falls, 1e-9), np.inf)
        usual = float(np.median(floor))
        return replace(blank, usual=usual if _NEAREST <= usual <= _FARTHEST else None)


def check_frame(frame: DepthFrame, expected: Expected) -> str:
    """Return why a frame cannot be used, "name: what was found, expected, to do", or "" when it can.

    The names are wrong resolution, wrong unit, all zero, too few readings. Never raises.
    """
    depth = frame.depth
    if depth.ndim != 2:
        found = f"an array of {depth.ndim} axes"
        if depth.ndim == 3:
            found = f"{depth.shape[1]}x{depth.shape[0]} px of {depth.shape[2]} channels"
        return (
            f"wrong resolution: found {found}, expected one channel of 16 bits; give the depth itself, in "
            "millimetres, not a picture of it"
        )
    height, width = depth.shape
    if (width, height) != (expected.width, expected.height):
        return (
            f"wrong resolution: found {width}x{height} px, expected {expected.width}x{expected.height} px; "
            "set the camera to that, or calibrate it again as it is"
        )
    if depth.dtype != np.uint16:
        return _other_type(depth)
    readings, known, most, usual = _look(depth, expected.known)
    if not readings and not depth.any():
        return "all zero: no pixel has a depth; is the sensor's projector on and its lens free?"
    share = known / max(most, 1)
    if share < MIN_VALID:
        return (
            f"too few readings: {100.0 * share:.0f} % of the picture has a depth, expected at least "
            f"{100.0 * MIN_VALID:.0f} %; is the lens free, and no sunlight in the room?"
        )
    return _other_unit(usual, expected)


@compiled
def _look(depth: NDArray[np.uint16], known: NDArray[np.bool_]) -> tuple[int, int, int, float]:
    """Return how many of the pixels that tell have a reading, where the background has one, and its own.

    And the median of the readings [mm], 0 without any.
    """
    readings = np.empty(known.size, np.uint16)
    count, both, most = 0, 0, 0
    for i in range(known.shape[0]):
        for j in range(known.shape[1]):
            reading = depth[i * _STRIDE, j * _STRIDE]
            most += known[i, j]
            if reading > 0:
                readings[count] = reading
                count += 1
                both += known[i, j]
    return count, both, most, np.median(readings[:count]) if count else 0.0


def _other_type(depth: NDArray[Any]) -> str:
    found = f"wrong unit: found {depth.dtype}, expected uint16 millimetres"
    if np.issubdtype(depth.dtype, np.floating):
        real = depth[np.isfinite(depth) & (depth > 0.0)]
        if real.size and float(np.median(real)) < _NEAREST:
            return found + "; these look like metres, have the camera send millimetres"
    return found + "; have the camera send these"


def _other_unit(usual: float, expected: Expected) -> str:
    room = expected.usual
    if room is not None:
        where = "in the background" if expected.learned else "far as the floor is"
        for per_millimetre, unit in (_UNITS if expected.learned else _SCALED).items():
            meant = room * per_millimetre
            if meant / _NEAR - 1.0 < usual < meant * _NEAR + 1.0:
                reason = _unit_reason(usual, unit, f"about {room:.0f} as {where}")
                return reason if expected.learned else reason + ", or give the --scale of the folder's images"
        if expected.learned:
            return ""
    if usual < _NEAREST:
        return _unit_reason(usual, "metres or centimetres", f"{_NEAREST:.0f} to {_FARTHEST:.0f}")
    if usual > _FARTHEST:
        return _unit_reason(usual, "tenths or fifths of a millimetre", f"{_NEAREST:.0f} to {_FARTHEST:.0f}")
    return ""


def _unit_reason(usual: float, unit: str, expected: str) -> str:
    return (
        f"wrong unit: the usual depth is {usual:.0f}, expected {expected} [mm]; these look like {unit}, have "
        "the camera send millimetres"
    )


def check_camera(frame: DepthFrame, background: Background) -> str:
    """Return why the background no longer fits a frame that `check_frame` found sound, "" when it does.

    One frame tells, because what moves about in the room has no say. A camera that turned about the
    vertical or moved sideways over a bare level floor sees the same, and is not found. Where most of the
    room is hidden by something nearer, nothing can be said of where the camera hangs.
    """
    fit = fits(background, frame.depth)
    if fit >= MIN_FIT:
        return ""
    before = frame.depth[::_STRIDE, ::_STRIDE] < background.mean[::_STRIDE, ::_STRIDE] - _FAR_BEFORE
    seen = frame.depth[::_STRIDE, ::_STRIDE] > 0
    covered = float(np.count_nonzero(before & seen)) / max(int(np.count_nonzero(seen)), 1)
    if covered > MOST_COVERED:
        return (
            f"{COVERED}: {100.0 * covered:.0f} % of what the camera sees is far nearer than the empty room, "
            f"expected at most {100.0 * MOST_COVERED:.0f} %; clear its view"
        )
    return (
        f"{MOVED}: {100.0 * fit:.0f} % of the background that can be seen is where it was learned, expected "
        f"at least {100.0 * MIN_FIT:.0f} %; put the camera back, or calibrate it and learn the "
        "background again"
    )


class FrameHealth:
    """Checks the frames of a stream: each by itself, and twice a second whether the camera still hangs there.

    While it does not, every frame is looked at, so that the first that fits again is used.
    """

    def __init__(self, camera: PinholeCamera, background: Background) -> None:
        self._background = background
        self._expected = Expected.of(camera, background)
        self._looked = -math.inf  # [s]
        self._moved = ""

    def check(self, frame: DepthFrame) -> str:
        """Return why a frame cannot be used, "" when it can; never raises."""
        reason = check_frame(frame, self._expected)
        if reason:
            return reason
        if self._moved or not 0.0 <= frame.stamp - self._looked < _LOOK_EVERY:
            self._looked = frame.stamp
            self._moved = check_camera(frame, self._background)
        return self._moved


class Sieve:
    """Lets the sound frames of a stream through, and counts the others by the names of their reasons."""

    def __init__(self, check: Callable[[DepthFrame], str]) -> None:
        self._check = check
        self.seen = 0
        self.reasons: Counter[str] = Counter()
        self._first: dict[str, str] = {}  # a whole reason of each name

    def through(self, frames: Iterable[DepthFrame]) -> Iterator[DepthFrame]:
        """Yield the sound frames."""
        for frame in frames:
            self.seen += 1
            reason = self._check(frame)
            if not reason:
                yield frame
                continue
            self.reasons[name_of(reason)] += 1
            self._first.setdefault(name_of(reason), reason)

    def require_sound(self, source: str) -> None:
        """Raise UnusableFramesError when a fifth or more of the frames that were seen could not be used."""
        bad = self.reasons.total()
        if bad and bad >= MOST_UNUSABLE * self.seen:
            name, _ = self.reasons.most_common(1)[0]
            raise UnusableFramesError(
                f"{source}: {bad} of {self.seen} frames cannot be used: {self._first[name]}"
            )


def name_of(reason: str) -> str:
    """Return the name of a reason: what stands before its first colon."""
    return reason.split(":", 1)[0]
