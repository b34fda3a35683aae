"""Where and how turned the drone is: its top view laid over what a frame shows.

"Register the drone's top view" of the design; takes the place of eq. (19) on a blob and of the ellipse (22) to
(24). Evidence is gathered in the axes of the predicted pose, tilt included, with a drone reading at its own point;
all of x, y and heading are refined at once by Gauss-Newton on it, where a parabola through the scores of shifts
and turns would take them one by one; height and tilt are those of the seen surface against the template's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.geometry import Array, Pose, rot_x, rot_y, rot_z, wrap_angle
from noctule.localization import scoring
from noctule.localization.evidence import Evidence, Map, gather
from noctule.localization.matcher import SURFACE_SD, Matcher, Seen
from noctule.messages import DepthFrame

NEAR = np.radians(np.arange(-40.0, 41.0, 10.0))
"""Headings tried about the predicted one [rad]."""
ALL = np.radians(np.arange(0.0, 360.0, 10.0))
"""Headings tried where nothing is predicted [rad]."""

_GOOD = 0.75  # a ratio that needs no search
_FAR = 0.03  # [m], when the height was predicted worse than this the evidence is gathered again
_INFLATION = 3.0  # neighbouring cells err together: the curvature promises too much
_FLOOR_SD = np.array([0.0015, 0.0015, 0.0012, 0.003])  # [m, m, m, rad], what differs with the view


@dataclass(frozen=True, slots=True)
class Registration:
    """The best pose near the predicted one, and how good it is; nothing here says that it is the drone."""

    pose: Pose  # of the body's origin, world
    covariance: Array  # (4, 4), of x, y, z [m] and yaw [rad]
    score: float  # sum of log-likelihood ratios
    ratio: float  # score over what the seen cells would give if the pose were right; 1 is usual
    visible: float  # share of the template that was seen, drone or free
    outline: float  # misfit of the outline, per cell seen
    relief: float  # misfit of the surface, per cell seen; about a half is usual, 4.5 the most
    half_turn: float  # by how much the half turn fits worse; a third is usual, negative: it fits better


@dataclass(frozen=True, slots=True)
class _View:
    """Evidence around a supposed pose."""

    evidence: Evidence
    share: Map
    trust: Map

    @property
    def seen(self) -> Seen:
        """Share, trust, drone and height of the cells."""
        return self.share, self.trust, self.evidence.drone, self.evidence.height


@dataclass(frozen=True, slots=True)
class Scene:
    """A frame, and what it is compared with."""

    depth: NDArray[np.uint16]  # (h, w) [mm]
    nearest: NDArray[np.uint16]  # (h, w) [mm], readings below are foreground
    camera: FixedCamera
    matcher: Matcher

    def view(self, pose: Pose) -> _View:
        """Gather the evidence around a supposed pose."""
        evidence = gather(self.depth, self.nearest, self.camera, pose, self.matcher.grid)
        share, trust = np.empty_like(evidence.drone), np.empty_like(evidence.drone)
        scoring.shares(evidence.drone, evidence.free, scoring.FULL, share, trust)
        return _View(evidence, share, trust)


def align(
    matcher: Matcher, frame: DepthFrame, nearest: NDArray[np.uint16], camera: FixedCamera, near: Pose
) -> Registration:
    """Align the template to a frame near a supposed pose: for learning, where there is no track."""
    return register(Scene(frame.depth, nearest, camera, matcher), near, searched=True)


def register(
    scene: Scene, predicted: Pose, headings: Array = NEAR, reach: int = 1, searched: bool = False
) -> Registration:
    """Register the template around a predicted pose.

    It is refined from there; where that does not explain what is seen (or `searched`), `headings` [rad] about the
    predicted are tried, each over shifts of `reach` steps of 4 cm, and the best is refined.
    """
    matcher = scene.matcher
    view = scene.view(predicted)
    at, information = matcher.refine(view.share, view.trust, np.zeros(3))
    if searched or _ratio(matcher, view, at) < _GOOD:
        starts, scores = matcher.search(view.share, view.trust, headings, reach)
        other, other_information = matcher.refine(view.share, view.trust, starts[int(np.argmax(scores))])
        if _score(matcher, view, other) > _score(matcher, view, at):
            at, information = other, other_information
    return _completed(scene, view, at, information)


def acquire(scene: Scene, position: Array, reach: int = 3) -> Registration:
    """Register the template around a supposed position (3,) [m] with any heading."""
    matcher = scene.matcher
    view = scene.view(Pose(position, 0.0))
    starts, scores = matcher.search(view.share, view.trust, ALL, reach)
    first = int(np.argmax(scores))
    # Blocks of 4 cm leave open which quarter turn is best: all four are refined.
    quarter = len(ALL) // 4
    found = [
        matcher.refine(view.share, view.trust, starts[(first + k * quarter) % len(ALL)])[0] for k in range(4)
    ]
    best = max(found, key=lambda at: _score(matcher, view, at))
    # Once more in its own axes, with the tilt that was not known.
    return register(scene, _moved(view.evidence.pose, best, _surface(matcher, view, best)[0]))


def _completed(scene: Scene, view: _View, at: Array, information: Array) -> Registration:
    """Return the answer with its height, which was perhaps predicted too badly to trust the rest."""
    matcher = scene.matcher
    surface, cells = _surface(matcher, view, at)
    pose = _moved(view.evidence.pose, at, surface)
    if abs(surface[0]) > _FAR:
        # The rays that pass the body's height were placed at a wrong height.
        view = scene.view(pose)
        at, information = matcher.refine(view.share, view.trust, np.zeros(3))
        surface, cells = _surface(matcher, view, at)
        pose = _moved(view.evidence.pose, at, surface)
    score, nominal, seen = matcher.judge(view.share, view.trust, at)
    return Registration(
        pose,
        covariance(information, cells, view.evidence.pose.yaw + float(at[2])),
        score,
        score / nominal if nominal > 0.0 else 0.0,
        min(seen / matcher.seen, 1.0),
        *matcher.misfits(view.seen, at, surface, view.evidence.distance),
        _half_turn(matcher, view, at, surface),
    )


def _score(matcher: Matcher, view: _View, at: Array) -> float:
    return matcher.judge(view.share, view.trust, at)[0]


def _ratio(matcher: Matcher, view: _View, at: Array) -> float:
    score, nominal, _ = matcher.judge(view.share, view.trust, at)
    return score / nominal if nominal > 0.0 else 0.0


def _surface(matcher: Matcher, view: _View, at: Array) -> tuple[Array, float]:
    return matcher.surface(view.evidence.drone, view.evidence.height, at)


def _half_turn(matcher: Matcher, view: _View, at: Array, surface: Array) -> float:
    """Return by how much the half turn fits worse than `at`, over what it would if all were seen."""
    if matcher.half_turn <= 0.0:
        return 0.0
    turned, _ = matcher.refine(view.share, view.trust, at + np.array([0.0, 0.0, math.pi]))
    other = _surface(matcher, view, turned)[0]
    distance = view.evidence.distance
    here = matcher.contrast(view.seen, at, surface, distance)
    return (matcher.contrast(view.seen, turned, other, distance) - here) / matcher.half_turn


def _moved(pose: Pose, at: Array, surface: Array) -> Pose:
    """Return the pose that a supposed one becomes: x, y, heading in its axes, then height and slopes."""
    wx, wy = float(surface[2]), -float(surface[1])  # small rotations about the template's x and y
    R = pose.R_world_body @ rot_z(float(at[2])) @ rot_y(wy) @ rot_x(wx)
    position = pose.position + pose.R_world_body @ np.array([at[0], at[1], surface[0]])
    yaw = math.atan2(R[1, 0], R[0, 0])
    pitch = -math.asin(min(1.0, max(-1.0, R[2, 0])))
    return Pose(position, wrap_angle(yaw), math.atan2(R[2, 1], R[2, 2]), pitch)


def covariance(information: Array, cells: float, yaw: float) -> Array:
    """Return the covariance (4, 4) of x, y, z [m] and yaw [rad] in the world.

    From the curvature (3, 3) in body axes of the fit of the edges, and the cells that gave the height.
    """
    P = np.linalg.inv(information + np.diag([1.0, 1.0, 1e-2])) * _INFLATION
    turn = rot_z(yaw)
    P = turn @ P @ turn.T
    out = np.zeros((4, 4))
    keep = np.array([0, 1, 3])
    out[np.ix_(keep, keep)] = P
    out[2, 2] = SURFACE_SD**2 / (1.0 + 0.1 * cells)
    return out + np.diag(_FLOOR_SD**2)
