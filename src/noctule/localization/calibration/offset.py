"""The constant error of a position measurement: from a drone that stands on the floor at known places.

A depth camera sees the top of the drone, and a template has its own middle: what is measured is 25 to 30 mm
off in height, and some millimetres in x and y. Seen from aside it is off along the ray too
(`placing.slanted`): places below the camera and aside of it tell that from what is constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from noctule.camera import FixedCamera
from noctule.errors import NoctuleError
from noctule.geometry import Array
from noctule.localization.placing import slanted
from noctule.messages import PoseMeasurement

FEWEST = 30  # measurements at a place, a second's
LARGEST_SCATTER = 0.015  # [m], sd of an axis
LARGEST_MOVE = 0.006  # [m], between the first and the last third of the measurements
LARGEST_OFFSET = 0.15
"""[m], along each axis. Of it 0.03 is a template's and a sensor's, and the rest a camera's pose: one that is
accepted is known to 15 mm and 0.3 degrees (sd), which at 5 m is 30 mm; three sd of both are 0.10. More than
that is no constant error: a place that was typed or measured wrongly, or another place of the camera."""
LARGEST_DISAGREEMENT = 0.020  # [m], between the offsets of two places
LEAST_SPREAD = 0.3  # of the cubed slopes of the rays to the places, so that the slant is told to some mm
LARGEST_SLANT = 0.04  # [m]; a drone's is 0.01, more is a place that was measured wrongly
_MARGIN = 0.4  # [m], as near as a drone that is seen whole comes to the picture's edges
_REACH, _STEP = 5.0, 0.1  # [m], around the camera where the next place is looked for
_AXES = "xyz"


class TooFewMeasurementsError(NoctuleError):
    """Too few measurements of a standing drone."""


class MovedDroneError(NoctuleError):
    """A drone that did not stand still."""


class ScatterError(NoctuleError):
    """Measurements that scatter too much to take their mean."""


class PlacesDisagreeError(NoctuleError):
    """Places whose offsets differ: then the error is not constant, and the camera's pose is at fault."""


class LargeOffsetError(NoctuleError):
    """An offset that no template, sensor and camera's pose have: a place is wrong."""


class SlantError(NoctuleError):
    """A slant that no drone has."""


@dataclass(frozen=True, slots=True)
class Standing:
    """What was measured while a drone stood at one place."""

    true: Array  # (3,) [m], world, of the body's origin; nan where it is not known
    measured: Array  # (n, 3) [m], world, in the order of time
    name: str = ""  # for messages


@dataclass(frozen=True, slots=True)
class Offset:
    """What is measured minus what is true."""

    bias: Array  # (3,) [m], world; 0 along axes where no true place was known
    scatter: Array  # (3,) [m], sd of one measurement
    disagreement: Array  # (3,) [m], largest minus smallest offset of the places, 0 for one place
    places: int
    slant: float = 0.0  # [m], as in `placing.slanted`
    told: bool = False  # whether the places tell the slant; where they do not, it is the one from before
    left: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (places, 3) [m], without bias and slant


def on_floor(hull_height: float, x: float = np.nan, y: float = np.nan) -> Array:
    """Return the place (3,) [m] of the origin of a drone that stands on the floor.

    The origin is the middle of the hull, `hull_height` [m]; leave out x and y where they are not known.
    """
    return np.array([x, y, hull_height / 2.0])


def measure_offset(standings: Sequence[Standing], eye: Array | None = None, slant: float = 0.0) -> Offset:
    """Return the offset of the measurements at one or more places, located without offset and slant.

    With `eye` (3,) [m], the camera's place, the slant is told from what is constant, if the places are seen
    from sides that differ enough; otherwise `slant` [m], that from before, is taken off.

    Raises
    ------
    TooFewMeasurementsError, MovedDroneError, ScatterError
        When the measurements at a place (named by its number, from 1) cannot be averaged.
    PlacesDisagreeError
        When the offsets at the places differ.
    SlantError
        When what would make the places agree is more than any drone's slant.
    LargeOffsetError
        When the offset is too large for a constant error, as `check_offset` says.
    """
    if not standings:
        raise TooFewMeasurementsError("offset: no place is given, expected a drone standing at one or more")
    for number, standing in enumerate(standings, start=1):
        named = f" ({standing.name})" if standing.name else ""
        check_measured(standing.measured, f"offset: place {number}{named}")
    offsets = np.array([standing.measured.mean(axis=0) - standing.true for standing in standings])
    scatter = np.sqrt(np.mean([standing.measured.var(axis=0, ddof=1) for standing in standings], axis=0))
    found = None
    if eye is None:
        slant = 0.0
    else:
        seen = _seen(standings, eye)
        found = _slant(offsets, seen)
        slant = slant if found is None else found
        offsets = offsets - slant * seen
    bias, disagreement = np.zeros(3), np.zeros(3)
    for axis in range(3):
        known = offsets[np.isfinite(offsets[:, axis]), axis]
        if len(known):
            bias[axis], disagreement[axis] = known.mean(), np.ptp(known)
    worst = int(np.argmax(disagreement))
    if disagreement[worst] > LARGEST_DISAGREEMENT:
        each = ", ".join(f"{1000 * offset:+.0f}" for offset in offsets[:, worst])
        raise PlacesDisagreeError(
            f"offset: the places disagree along {_AXES[worst]} ({each} mm), expected to agree within "
            f"{1000 * LARGEST_DISAGREEMENT:.0f} mm; measure the places again, or calibrate again where the "
            "camera hangs"
        )
    if found is not None and abs(found) > LARGEST_SLANT:
        raise SlantError(
            f"offset: the places agree with a slant of {1000 * found:+.0f} mm, expected "
            f"{1000 * LARGEST_SLANT:.0f} mm or less; measure the places again, or calibrate again where the "
            "camera hangs"
        )
    check_offset(bias)
    return Offset(bias, scatter, disagreement, len(standings), slant, found is not None, offsets - bias)


def plausible(bias: Array) -> bool:
    """Return whether an offset (3,) [m] can be the constant error of positions; nan and inf cannot."""
    return bool((np.abs(bias) <= LARGEST_OFFSET).all())


def check_offset(bias: Array) -> None:
    """Raise LargeOffsetError unless an offset (3,) [m] is plausible."""
    if not plausible(bias):
        x, y, z = (f"{1e3 * float(b):+z.0f}" for b in bias)
        raise LargeOffsetError(
            f"offset: measured minus true is x {x}, y {y}, z {z} mm, expected {1e3 * LARGEST_OFFSET:.0f} mm "
            "or less along each (25 to 30 mm are usual); check where the drone stood (--at and --height, or "
            "the file of places: metres, and their signs), and where camera.toml says that the camera hangs"
        )


def next_place(standings: Sequence[Standing], camera: FixedCamera) -> Array | None:
    """Return the place (3,) [m] that tells most of the slant beside those there are.

    It is as high as they are on the mean, and seen whole; None where the camera sees no such place.
    """
    eye = camera.t_world_camera
    height = float(np.mean([standing.measured[:, 2].mean() for standing in standings]))
    steps = np.arange(-_REACH, _REACH, _STEP)
    x, y = (np.round((eye[axis] + steps) / _STEP) * _STEP for axis in range(2))
    places = np.array([[a, b, height] for a in x for b in y])
    places = places[camera.inside(places) >= _MARGIN]
    if not len(places):
        return None
    rays = np.array([slanted(1.0, eye, place) for place in places])
    # A place adds to the spread of the others as the square of its distance from their mean.
    gains = np.linalg.norm(rays - _seen(standings, eye).mean(axis=0), axis=1)
    return np.asarray(places[int(np.argmax(gains))])


def corrected(measurement: PoseMeasurement, bias: Array) -> PoseMeasurement:
    """Return the measurement without the offset `bias` (3,) [m]."""
    return replace(measurement, position=measurement.position - bias)


def _seen(standings: Sequence[Standing], eye: Array) -> Array:
    """Return what a slant of 1 m does to each place, (n, 3)."""
    return np.array([slanted(1.0, eye, standing.measured.mean(axis=0)) for standing in standings])


def _slant(offsets: Array, seen: Array) -> float | None:
    """Return the slant [m] that explains offsets (n, 3) beside a bias, None where they do not tell it.

    `seen` (n, 3) is what 1 m does.
    """
    known = np.isfinite(offsets[:, :2])
    drawn, found = np.where(known, seen[:, :2], np.nan), np.where(known, offsets[:, :2], np.nan)
    count = np.maximum(known.sum(axis=0), 1)
    drawn = drawn - np.nansum(drawn, axis=0) / count
    spread = float(np.nansum(drawn**2))
    return float(np.nansum(drawn * found)) / spread if spread >= LEAST_SPREAD**2 else None


def check_measured(measured: Array, name: str) -> None:
    """Raise unless the measurements (n, 3) [m] at a place, of this name for messages, can be averaged.

    Raises TooFewMeasurementsError, MovedDroneError, ScatterError.
    """
    if len(measured) < FEWEST:
        raise TooFewMeasurementsError(
            f"{name}: the drone was measured {len(measured)} times, expected {FEWEST} or more; let it stand "
            "there for some seconds, in sight of the camera"
        )
    scatter = measured.std(axis=0, ddof=1)
    third = len(measured) // 3
    # Between means of thirds noise alone makes a difference too.
    move = np.abs(measured[-third:].mean(axis=0) - measured[:third].mean(axis=0))
    noise = 4.0 * _within(measured) * np.sqrt(2.0 / third)
    worst = int(np.argmax(move))
    if move[worst] > max(LARGEST_MOVE, float(noise[worst])):
        raise MovedDroneError(
            f"{name}: the drone moved by {1000 * move[worst]:.0f} mm along {_AXES[worst]}, expected "
            f"{1000 * LARGEST_MOVE:.0f} mm or less; let it stand still, motors off"
        )
    worst = int(np.argmax(scatter))
    if scatter[worst] > LARGEST_SCATTER:
        raise ScatterError(
            f"{name}: measurements scatter by {1000 * scatter[worst]:.0f} mm (sd) along {_AXES[worst]}, "
            f"expected {1000 * LARGEST_SCATTER:.0f} mm or less; is the drone alone, whole in the picture, "
            "and its template its own?"
        )


def _within(measured: Array) -> Array:
    """Return the noise (3,) [m] from neighbours in time, which a slow motion does not enlarge."""
    return np.asarray(np.diff(measured, axis=0).std(axis=0) / np.sqrt(2.0))
