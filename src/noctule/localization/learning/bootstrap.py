"""First poses of a manual flight, from blobs alone: good enough to begin the learning of the template with.

A heading by shape is known up to a quarter or a half turn. Followed from frame to frame it is known up to one
such turn for the whole flight, which is then decided once: the quarter by the axis of the body over all
frames, the half by the heading at the start that the person said, or by where the drone flew (a person flies
mostly nose first). With the colour markers on nothing is left to decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from noctule.camera import FixedCamera
from noctule.errors import NoctuleError
from noctule.geometry import Array, Pose, wrap_angle
from noctule.localization.detection.detector import blob_surface, is_cut
from noctule.localization.detection.splinters import MIN_AREA, join_splinters, relabel
from noctule.localization.heading.markers import MarkerHeading
from noctule.localization.heading.method import HeadingMethod
from noctule.localization.heading.pose import blob_position
from noctule.localization.heading.shape import AXIS, HARMONIC
from noctule.localization.heading.sighting import Sighting
from noctule.localization.heading.turns import HALF_TURN, QUARTER_TURN, nearest_turn
from noctule.messages import DepthFrame
from noctule.vision.depth.background import Background
from noctule.vision.depth.blobs import find_blobs

MIN_FRAMES = 60  # that show the drone
_ENOUGH = 0.6  # share of the frames that must show both markers
_SURE = 5.0  # times its own error must the evidence for a turn be
_START = 0.5  # [s] of the flight that the heading at the start is taken from
_NEAR = np.radians(60.0)  # the heading at the start may be said so roughly
_SPEED = 0.15  # [m/s], below it the way flown has no direction
_AHEAD = 0.3  # mean cosine between nose and way that tells nose from tail
_WINDOW = 0.5  # [s], over which the way is measured

Anchor = Literal["markers", "start", "displacement"]


class TemplateFlightError(NoctuleError):
    """The manual flight does not show enough of the drone."""


class TurnUnknownError(NoctuleError):
    """What was seen does not tell which end of the drone is its nose."""


class StartHeadingError(NoctuleError):
    """The heading that was said does not fit what was seen."""


@dataclass(frozen=True, slots=True)
class FirstPoses:
    """Where the drone was, roughly: 1 to 2 cm, 1 to 8 degrees."""

    poses: tuple[Pose | None, ...]  # one for each frame, of the middle of the surface seen; None: not seen
    heading: str  # the method that the headings are from
    anchor: Anchor  # what told nose from tail


def first_poses(
    frames: Sequence[DepthFrame],
    background: Background,
    camera: FixedCamera,
    start_yaw: float | None = None,
) -> FirstPoses:
    """Return rough poses of the drone in the frames of a manual flight in an otherwise empty room.

    Parameters
    ----------
    frames
        In their order, five a second or more, with colour if the markers are on.
    start_yaw
        Heading in the first of them, to 60 deg [rad]: 0 for "the nose points to +x". Without it and without
        markers the way flown decides.

    Raises
    ------
    TemplateFlightError, TurnUnknownError, StartHeadingError
    """
    sightings = [drone_sighting(frame, background, camera) for frame in frames]
    where = [None if s is None else blob_position(s.blob, camera) for s in sightings]
    marked = _measured(sightings, MarkerHeading())
    seen = np.array([s is not None for s in sightings])
    if seen.any() and np.isfinite(marked).sum() >= _ENOUGH * seen.sum():
        return _assembled(where, marked, "markers", "markers")
    require_enough(int(seen.sum()), len(frames))
    yaw, method = _followed(sightings)
    stamps = np.array([frame.stamp for frame in frames])
    anchor: Anchor = "displacement" if start_yaw is None else "start"
    turned = _backwards(stamps, where, yaw) if start_yaw is None else _turned_at_start(stamps, yaw, start_yaw)
    return _assembled(where, yaw + (HALF_TURN if turned else 0.0), method, anchor)


def require_enough(seen: int, frames: int) -> None:
    """Raise TemplateFlightError unless the drone was seen in enough of the frames to learn from."""
    if seen < MIN_FRAMES:
        raise TemplateFlightError(
            f"template: {seen} of {frames} frames show the drone whole and its heading, at least "
            f"{MIN_FRAMES} are needed; fly longer, inside the camera's view"
        )


def drone_sighting(frame: DepthFrame, background: Background, camera: FixedCamera) -> Sighting | None:
    """Return the largest thing of a frame, its splinters joined; None if nothing is seen whole."""
    labels, blobs = find_blobs(frame.depth, background, camera.intrinsics, min_area=MIN_AREA)
    whole, parts = join_splinters(blobs, camera)
    if not whole:
        return None
    blob = max(whole, key=lambda b: blob_surface(b, camera))
    if is_cut(blob, camera):
        return None
    return Sighting(frame, relabel(labels, blobs, parts), blob, camera)


def _measured(sightings: Sequence[Sighting | None], method: HeadingMethod) -> Array:
    """Return headings (n,) [rad] as measured, NaN where there is none."""
    found = [None if s is None else method.measure(s, 0.0) for s in sightings]
    return np.array([np.nan if h is None else h.yaw for h in found])


def _followed(sightings: Sequence[Sighting | None]) -> tuple[Array, str]:
    """Return headings (n,) [rad], continuous and known up to half a turn in all, and the method."""
    along = _measured(sightings, AXIS)
    cross = _measured(sightings, HARMONIC)
    by_axis, by_cross = (follow(raw, period) for raw, period in ((along, HALF_TURN), (cross, QUARTER_TURN)))
    if _roughness(by_axis) <= _roughness(by_cross):
        return by_axis, AXIS.name
    # Of the two axes of a cross the body's is the one that the second harmonic prefers.
    agreement = np.cos(2.0 * (along - by_cross))
    agreement = agreement[np.isfinite(agreement)]
    mean, error = _mean_and_error(agreement)
    if abs(mean) < _SURE * error:
        raise TurnUnknownError(
            f"template: the drone looks alike from the front and from the side in {len(agreement)} frames "
            f"(agreement {mean:.2f} +- {error:.2f}); put the colour markers on, or fly for longer"
        )
    return by_cross + (QUARTER_TURN if mean < 0.0 else 0.0), HARMONIC.name


def follow(raw: Array, period: float) -> Array:
    """Return headings (n,) known up to `period` [rad] as one continuous sequence; NaN stays NaN."""
    followed = np.full(len(raw), np.nan)
    last = 0.0
    for i in np.flatnonzero(np.isfinite(raw)):
        last = followed[i] = nearest_turn(float(raw[i]), last, period)
    return followed


def _roughness(yaw: Array) -> float:
    """Return the median change of the turn from frame to frame [rad]: a drone turns smoothly."""
    steps = np.abs(np.diff(yaw[np.isfinite(yaw)], 2))
    return float(np.median(steps)) if len(steps) else np.inf


def _mean_and_error(values: Array) -> tuple[float, float]:
    # Neighbouring frames err alike: a tenth of them is counted.
    if len(values) < 2:
        return 0.0, 1.0
    return float(values.mean()), float(values.std() / np.sqrt(max(len(values) / 10.0, 1.0)))


def _turned_at_start(stamps: Array, yaw: Array, start_yaw: float) -> bool:
    """Return whether the tail is where the nose was said to be."""
    known = np.isfinite(yaw)
    if not known.any():
        return False
    seen = float(np.median(yaw[known & (stamps <= stamps[known][0] + _START)]))
    off = wrap_angle(seen - start_yaw)
    turned = abs(off) > QUARTER_TURN
    if abs(wrap_angle(off + HALF_TURN) if turned else off) > _NEAR:
        raise StartHeadingError(
            f"template: the nose was said to point to {np.degrees(start_yaw):.0f} deg at the start, but the "
            f"drone lies along {np.degrees(wrap_angle(seen)):.0f} or "
            f"{np.degrees(wrap_angle(seen + HALF_TURN)):.0f} deg; say its heading in the first frames"
        )
    return turned


def _backwards(stamps: Array, where: Sequence[Array | None], yaw: Array) -> bool:
    """Return whether the drone flew tail first, if that is its nose which `yaw` points to."""
    known = [i for i in range(len(where)) if where[i] is not None and np.isfinite(yaw[i])]
    cosines = []
    for a, i in enumerate(known):
        j = next((k for k in known[a:] if stamps[k] - stamps[i] >= _WINDOW), None)
        if j is None:
            break
        start, end = where[i], where[j]
        assert start is not None
        assert end is not None
        x, y, _ = (end - start) / (stamps[j] - stamps[i])
        if np.hypot(x, y) > _SPEED:
            cosines.append(np.cos(np.arctan2(y, x) - 0.5 * (yaw[i] + yaw[j])))
    mean, error = _mean_and_error(np.array(cosines))
    if abs(mean) < max(_AHEAD, _SURE * error):
        raise TurnUnknownError(
            "template: without markers the way flown does not tell nose from tail (mean cosine between nose "
            f"and way {mean:.2f}, at least {_AHEAD:g} is needed); fly nose first, or say the heading at the "
            "start"
        )
    return mean < 0.0


def _assembled(where: Sequence[Array | None], yaw: Array, heading: str, anchor: Anchor) -> FirstPoses:
    poses = tuple(
        None if x is None or not np.isfinite(psi) else Pose(x, wrap_angle(float(psi)))
        for x, psi in zip(where, yaw, strict=True)
    )
    return FirstPoses(poses, heading, anchor)
