"""The simulated room as a source of depth frames: empty, with a flight by hand, or one along a path."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from noctule.flight.depth_sources import DepthSource
from noctule.geometry import Array, Pose, wrap_angle
from noctule.messages import DepthFrame
from noctule.simulation.ceiling import (
    CeilingSpec,
    DepthStage,
    Motion,
    Walker,
    lab_room,
    manual_flight,
    things_at,
    walk_past,
)

Flight = Literal["none", "manual", "path", "stand"]
"""Nothing; a drone by hand all over the room, nose first; one along the paper's ellipse; one that stands."""

_SPEED = 0.3  # [m/s], along the path
_PASSES = 0.6  # [m], as near as the person comes to the path
_AHEAD = 0.8  # [s], sd: so far before a turn of its way the nose turns, and so long after it
_TURNING = 1.5  # [rad/s], by hand
_CATCH_UP = 0.3  # [s], time constant of the nose
_STREAMS: dict[Flight, int] = {"none": 0, "manual": 1, "path": 2, "stand": 3}
STAND = (0.0, 0.0, 1.2)  # [m], where the drone stands if nothing is said, on a pole that no camera sees


@dataclass(frozen=True, slots=True)
class Scene:
    """What the simulated camera sees; the same scene gives the same frames, bit for bit."""

    flight: Flight
    seed: int = 0  # draws the room, the sensor's errors and the flight by hand
    hull: bool = False
    markers: bool = False  # the drone wears them, and the camera gives colour
    person: bool = False
    seconds: float = 10.0
    at: tuple[float, float, float] = STAND  # [m], with "stand"

    @property
    def spec(self) -> CeilingSpec:
        """The camera and the drone's looks."""
        return CeilingSpec(hull=self.hull, markers=self.markers)

    def poses(self) -> list[tuple[float, Pose | None]]:
        """Return (stamp [s], true pose) of every frame."""
        rate = self.spec.rate_hz
        if self.flight == "manual":
            return list(_nose_first(manual_flight(self._own_seed, self.seconds, rate, self.spec)))
        stamps = [k / rate for k in range(math.floor(self.seconds * rate + 1e-9))]
        if self.flight == "none":
            return [(stamp, None) for stamp in stamps]
        if self.flight == "stand":
            # Turned by a quarter now and then, as `noctule calibrate offset` wants it.
            return [
                (t, Pose(np.array(self.at), wrap_angle(0.3 + math.pi / 2.0 * int(4.0 * t / self.seconds))))
                for t in stamps
            ]
        angles, lengths = _ellipse_lengths()
        return [(t, _on_ellipse(float(np.interp(_SPEED * t % lengths[-1], lengths, angles)))) for t in stamps]

    @property
    def _own_seed(self) -> int:
        # The room is of the seed alone; errors and flights differ between calibrating and flying.
        # The drone stands at several places one after the other: their errors differ too.
        place = [] if self.at == STAND else [round(1000.0 * v) % 2**32 for v in self.at]
        return int(np.random.SeedSequence([self.seed, _STREAMS[self.flight], *place]).generate_state(1)[0])

    def frames(self, wanted: Callable[[float], bool] | None = None) -> Iterator[DepthFrame]:
        """Draw the frames; with `wanted`, only those whose stamp [s] it accepts when their turn comes."""
        spec = self.spec
        stage = DepthStage(spec, self._own_seed, lab_room(self.seed))
        people: list[Motion] = [passer_by()] if self.person else []
        for stamp, pose in self.poses():
            if wanted is not None and not wanted(stamp):
                continue
            yield stage.frame(stamp, pose, things_at(people, stamp), spec.markers)


def simulated_source(scene: Scene) -> DepthSource:
    """Return the frames of a scene."""
    spec, poses = scene.spec, scene.poses()
    return DepthSource(
        f"simulated room {scene.seed}",
        scene.frames,
        len(poses),
        spec.camera,
        spec.camera.intrinsics,
        {stamp: pose for stamp, pose in poses if pose is not None},
        _said(poses[0][1]) if poses else None,
    )


def _said(pose: Pose | None) -> float | None:
    # Whoever holds the sticks knows how the drone was put down, by eye.
    return None if pose is None else round(pose.yaw / (math.pi / 4.0)) * (math.pi / 4.0)


def _nose_first(flight: Sequence[tuple[float, Pose]]) -> Iterator[tuple[float, Pose]]:
    """Yield a flight by hand with the nose along its way, by which a template's nose is told from its tail.

    The way, and with it the acceleration that it leans for, stays.
    """
    if len(flight) < 2:
        yield from flight
        return
    step = flight[1][0] - flight[0][0]
    velocity = np.gradient(np.array([pose.position[:2] for _, pose in flight]), step, axis=0)
    reach = math.ceil(3.0 * _AHEAD / step)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) * step / _AHEAD) ** 2)
    padded = np.pad(velocity, ((reach, reach), (0, 0)), mode="edge")
    vx, vy = (np.convolve(along, weights, "valid") for along in padded.T)
    way = np.arctan2(vy, vx)
    yaw = float(way[0])
    for (stamp, pose), wanted in zip(flight, way, strict=True):
        turn = wrap_angle(float(wanted) - yaw) * step / _CATCH_UP
        yaw += min(max(turn, -_TURNING * step), _TURNING * step)
        x, y, z = pose.R_world_body[:, 2]  # the thrust's direction
        forward, left = x * math.cos(yaw) + y * math.sin(yaw), y * math.cos(yaw) - x * math.sin(yaw)
        roll = math.atan2(-left, math.hypot(forward, z))
        yield stamp, Pose(pose.position, wrap_angle(yaw), roll, math.atan2(forward, z))


def passer_by() -> Walker:
    """Return a person who walks round an ellipse that comes within 0.6 m of the path."""
    path = np.array([_on_ellipse(angle).position for angle in np.linspace(0.0, 2.0 * math.pi, 181)])
    return walk_past(path, _PASSES, Walker((0.0, 0.0), (0.9, 0.6)))


def _on_ellipse(angle: float) -> Pose:
    """Return the pose of the paper's ellipse, heading along it."""
    c, s = math.cos(angle), math.sin(angle)
    position = np.array([0.08 + 0.5 * c, 0.1 + 0.8 * s, 1.2 + 0.12 * s])
    return Pose(position, wrap_angle(math.atan2(0.8 * c, -0.5 * s)))


def _ellipse_lengths() -> tuple[Array, Array]:
    angles = np.linspace(0.0, 2.0 * math.pi, 721)
    points = np.array([_on_ellipse(float(angle)).position for angle in angles])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return angles, np.concatenate([[0.0], np.cumsum(steps)])
