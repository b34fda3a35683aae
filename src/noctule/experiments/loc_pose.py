"""`loc-pose`: how true the pose of a single frame is, over poses spread through what the camera sees.

Each pose is approached for half a second by a drone that was never seen before, so that the track, the
prediction and the half turn are the locator's own; then the frame at the pose itself is judged. With a
person, that person steps in for the last frames, at 0.4 to 0.75 m from the drone's middle. The methods on
blobs are given the blob nearest to the drone and the turn nearest to the true one: their best case.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from noctule.experiments.ceiling import RATE, TaughtCamera, stamps, teach_camera
from noctule.geometry import Array, Pose, rot_z, wrap_angle
from noctule.localization.heading.method import HeadingMethod
from noctule.localization.heading.near import sighting_near
from noctule.localization.heading.pose import blob_position
from noctule.messages import DepthFrame
from noctule.simulation.ceiling import ThingPose, spread_poses

POSES = 500
APPROACH = 15  # frames, half a second
_NEAR_PERSON = (0.40, 0.75)  # [m], from the drone's middle to the person's
_PERSON_FRAMES = 4  # the last ones
_SPEED, _TURN = 0.2, math.radians(10.0)  # [m/s], [rad/s], of the approach

Progress = Callable[[int], None]
Row = tuple[Array, float, bool]
"""Error of the position (3,) [m] and of the yaw modulo the half turn [rad], and whether that is right."""

_NOTHING: Row = (np.full(3, np.nan), math.nan, False)


@dataclass(frozen=True, slots=True)
class Errors:
    """What one method measured at the poses, less what is true; a row of NaN where it measured nothing."""

    position: Array  # (n, 3) [m]
    yaw: Array  # (n,) [rad], modulo the half turn
    half_turn: Array  # (n,) 1 where the half turn is right too

    def figures(self, offset: Array | None = None) -> dict[str, float]:
        """Return the figures; positions less their mean where no `offset` (3,) was taken out before."""
        seen = np.isfinite(self.yaw)
        if not seen.any():
            return {"measured": 0.0}
        position, yaw = self.position[seen], self.yaw[seen]
        bias = position.mean(axis=0)
        centred = position - (bias if offset is None else 0.0)
        return {
            "measured": float(seen.mean()),
            "xy_rms_m": float(np.sqrt((centred[:, :2] ** 2).sum(axis=1).mean())),
            "xy_bias_m": float(np.hypot(*bias[:2])),
            "z_sd_m": float(position[:, 2].std()),
            "z_mean_m": float(bias[2]),
            "yaw_sd_deg": float(np.degrees(yaw.std())),
            "yaw_mean_deg": float(np.degrees(yaw.mean())),
            "yaw_worst_deg": float(np.degrees(np.abs(yaw).max())),
            "half_turn_right": float(self.half_turn[seen].mean()),
        }


def beside(rng: np.random.Generator, pose: Pose, hull: bool) -> ThingPose:
    """Draw a person beside the drone, turned so that their shoulders do not stick in it."""
    bearing, distance = float(rng.uniform(-math.pi, math.pi)), float(rng.uniform(*_NEAR_PERSON))
    turned = float(rng.uniform(-math.pi, math.pi))
    reach = 0.27 if hull else 0.24
    if distance < reach + 0.23:  # closer than half the shoulders' width: the person looks at it
        turned = bearing + math.pi
    x, y = pose.position[:2] + distance * np.array([math.cos(bearing), math.sin(bearing)])
    return ThingPose("person", float(x), float(y), wrap_angle(turned), look=int(rng.integers(4)))


def approach(rng: np.random.Generator, pose: Pose) -> list[Pose]:
    """Return the poses of the half second before, ending at `pose`."""
    way = rot_z(float(rng.uniform(-math.pi, math.pi)))[:, 0] * _SPEED
    turn = float(rng.choice([-_TURN, _TURN]))

    def at(t: float) -> Pose:
        return Pose(pose.position + t * way, wrap_angle(pose.yaw + t * turn), pose.roll, pose.pitch)

    return [at((k - APPROACH) / RATE) for k in range(APPROACH + 1)]


def measure_poses(
    seed: int, hull: bool, person: bool, poses: int = POSES, progress: Progress = lambda _: None
) -> dict[str, Any]:
    """Return the figures of one seed: the default method's at the top, the others' under "methods"."""
    taught = teach_camera(seed, hull, markers=True)
    rng = np.random.default_rng([seed, 7])
    targets = spread_poses(seed, poses, taught.stage.spec)
    methods = taught.headings
    rows: dict[str, list[Row]] = {m.name: [] for m in methods}
    tracked: list[Row] = []
    decided = 0
    begin = taught.stamp
    for number, pose in enumerate(targets):
        who = (beside(rng, pose, hull),) if person else ()
        locator, frame, located = taught.locator(), None, None
        for k, (stamp, at) in enumerate(zip(stamps(begin, APPROACH + 1), approach(rng, pose), strict=True)):
            last = k == APPROACH
            things = who if k > APPROACH - _PERSON_FRAMES else ()
            frame = taught.stage.frame(stamp, at, things, colour=last)
            located = locator.step(frame)
            if k == APPROACH - 1:
                decided += located.heading_certain
        begin += (APPROACH + 2) / RATE
        assert frame is not None
        assert located is not None
        found = located.measurement
        tracked.append(_NOTHING if found is None else _error(pose, found.position, found.yaw))
        for name, row in _blob_methods(taught, frame, pose, methods).items():
            rows[name].append(row)
        progress(number + 1)
    figures: dict[str, Any] = dict(_errors(tracked).figures(taught.offset))
    figures["half_turn_decided"] = decided / poses
    figures["methods"] = {name: _errors(of).figures() for name, of in rows.items()}
    return figures


def _blob_methods(
    taught: TaughtCamera, frame: DepthFrame, pose: Pose, methods: Sequence[HeadingMethod]
) -> Mapping[str, Row]:
    sighting = sighting_near(frame, pose.position, taught.background, taught.camera)
    if sighting is None:
        return dict.fromkeys((method.name for method in methods), _NOTHING)
    position = blob_position(sighting.blob, taught.camera)
    found = {}
    for method in methods:
        heading = method.measure(sighting, pose.yaw)
        found[method.name] = _NOTHING if heading is None else _error(pose, position, heading.yaw)
    return found


def _error(pose: Pose, position: Array, yaw: float) -> Row:
    off = wrap_angle(yaw - pose.yaw)
    half = math.remainder(off, math.pi)
    return position - pose.position, half, abs(off) < math.pi / 2.0


def _errors(rows: Sequence[Row]) -> Errors:
    return Errors(
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows]),
        np.array([float(row[2]) for row in rows]),
    )
