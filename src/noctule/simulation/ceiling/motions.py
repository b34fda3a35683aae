"""How things move about: functions of time, so that any frame can be drawn at any time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol

import numpy as np

from noctule.camera import CEILING_CAMERA
from noctule.geometry import Array, wrap_angle
from noctule.simulation.ceiling.shapes import Triple
from noctule.simulation.ceiling.things import SIZES, ThingKind, ThingPose

_POINTS = 721  # of an ellipse's table of arc lengths
_REACH = 20.0  # [m], from where a walker comes nearer
_TRIES, _EXACT = 200, 1e-4  # [m]
_AWAY = 1.5  # lengths of a board that is pushed in, from where it comes: out of a ceiling camera's picture
_EYE: Triple = tuple(CEILING_CAMERA.t_world_camera.tolist())


class Motion(Protocol):
    """Where a thing is at any time."""

    def at(self, stamp: float) -> ThingPose | None:
        """Return its pose at `stamp` [s]; None while it is not in the room."""
        ...


def things_at(motions: Sequence[Motion], stamp: float) -> list[ThingPose]:
    """Return the things that are in the room at `stamp` [s]."""
    return [thing for motion in motions if (thing := motion.at(stamp)) is not None]


@dataclass(frozen=True, slots=True)
class Standing:
    """A thing that stays where it is."""

    pose: ThingPose

    def at(self, stamp: float) -> ThingPose:
        """Return its pose."""
        return self.pose


@dataclass(frozen=True, slots=True)
class Walker:
    """A person, or a thing that is carried, on an ellipse at a constant speed, counterclockwise."""

    centre: tuple[float, float]  # [m], world
    half_axes: tuple[float, float]  # [m]
    turn: float = 0.0  # [rad], of the first axis from world x
    speed: float = 0.8  # [m/s], negative: clockwise
    start: float = 0.0  # [m], along the ellipse from the end of the first axis at time 0
    kind: ThingKind = "person"
    z: float = 0.0  # [m], its underside above the floor
    size: Triple | None = None  # [m]
    look: int = 0

    def at(self, stamp: float) -> ThingPose:
        """Return its pose at `stamp` [s]; it looks where it goes."""
        angles, lengths = _arc(*self.half_axes)
        walked = self.start + self.speed * stamp
        angle = float(np.interp(walked % lengths[-1], lengths, angles))
        (x,), (y,) = self._points(np.array([angle])).T
        a, b = self.half_axes
        ahead = math.atan2(b * math.cos(angle), -a * math.sin(angle)) + self.turn
        yaw = wrap_angle(ahead if self.speed >= 0.0 else ahead + math.pi)
        return ThingPose(
            self.kind, float(x), float(y), yaw, self.z, self.size, abs(self.speed) * stamp, self.look
        )

    def edge(self) -> Array:
        """Return points of the ellipse (n, 2) [m], for maps and distances."""
        return self._points(_arc(*self.half_axes)[0])

    def _points(self, angles: Array) -> Array:
        c, s = math.cos(self.turn), math.sin(self.turn)
        flat = np.column_stack([self.half_axes[0] * np.cos(angles), self.half_axes[1] * np.sin(angles)])
        return np.asarray(flat @ np.array([[c, s], [-s, c]]) + np.array(self.centre))


@dataclass(frozen=True, slots=True)
class Hiding:
    """A board that somebody holds between the ceiling camera and a place, and takes away again.

    It is level, its middle on the line from `place` to `eye`. It is there in full from `begin` for `seconds`;
    for `slide` before and after it is pushed in and pulled out along its length, from and to the side that
    `yaw` points to. The default size at the default height hides a drone anywhere on the paper's paths when
    `place` is their middle, and with them most of what the camera sees.
    """

    place: Triple  # [m], world, what is hidden
    begin: float  # [s]
    seconds: float  # [s]
    eye: Triple = _EYE  # [m], world, the camera
    share: float = 0.3  # of the way from the place to the camera, 0 to 1
    size: Triple = SIZES["board"]  # [m], length, width and thickness
    yaw: float = 0.0  # [rad], of its length
    slide: float = 1.0  # [s], 0: it appears and vanishes

    def at(self, stamp: float) -> ThingPose | None:
        """Return its pose at `stamp` [s]; None while it is not in the room."""
        early = max(self.begin - stamp, stamp - (self.begin + self.seconds), 0.0)
        if early > self.slide or (early == self.slide and early > 0.0):
            return None
        out = 0.0 if early == 0.0 else _AWAY * self.size[0] * early / self.slide
        x, y, z = (p + self.share * (e - p) for p, e in zip(self.place, self.eye, strict=True))
        x, y = x + out * math.cos(self.yaw), y + out * math.sin(self.yaw)
        return ThingPose("board", x, y, self.yaw, z - self.size[2] / 2.0, self.size)


@lru_cache(maxsize=64)
def _arc(a: float, b: float) -> tuple[Array, Array]:
    """Return (angles, arc lengths [m] up to them) along an ellipse, (n,) each."""
    angles = np.linspace(0.0, 2.0 * math.pi, _POINTS)
    points = np.column_stack([a * np.cos(angles), b * np.sin(angles)])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return angles, np.concatenate([[0.0], np.cumsum(steps)])


def walk_past(path: Array, distance: float, walker: Walker, bearing: float = 0.0) -> Walker:
    """Return `walker` on an ellipse of the same axes beside a path, its edge at `distance` [m] from it.

    `path` is (n, 2) or (n, 3) [m]; the ellipse lies from the path's middle toward `bearing` [rad], its second
    axis across it.
    """
    flat = path[:, :2]
    middle = flat.mean(axis=0)
    toward = np.array([math.cos(bearing), math.sin(bearing)])

    def beside(offset: float) -> Walker:
        x, y = (middle + offset * toward).tolist()
        return replace(walker, centre=(x, y), turn=bearing + math.pi / 2.0)

    # From far away inward, never by more than is left: so it stops at the first place that is as near.
    offset = _REACH
    for _ in range(_TRIES):
        left = gap(beside(offset).edge(), flat) - distance
        if left < _EXACT:
            break
        offset -= left
    return beside(offset)


def walk_through(place: tuple[float, float], stamp: float, walker: Walker) -> Walker:
    """Return `walker` with its ellipse moved so that it is at `place` [m] at `stamp` [s].

    A person 0.4 m from a drone at 1.2 m, toward the camera, hides about half of it and merges with the rest;
    nearer they touch.
    """
    now = walker.at(stamp)
    x, y = walker.centre
    return replace(walker, centre=(x + place[0] - now.x, y + place[1] - now.y))


def gap(a: Array, b: Array) -> float:
    """Return the least distance [m] between points (n, 2) and points (m, 2)."""
    return float(np.sqrt(((a[:, None, :] - b[None, :, :]) ** 2).sum(axis=2).min()))
