"""Where and how turned the drone is: its top view laid over what a frame shows.

"Register the drone's top view" of the design; takes the place of eq. (19) on a blob and of the ellipse (22)
to (24). Evidence is gathered in the axes of the predicted pose, tilt included, with a drone reading at its
own point; all of x, y and heading are refined at once by Gauss-Newton on it, where a parabola through the
scores of shifts and turns would take them one by one; height and tilt are those of the seen surface against
the template's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.geometry import Array, Pose, rot_z, wrap_angle
from noctule.localization import fitting, scoring
from noctule.localization.evidence import Evidence, Map, gather
from noctule.localization.matcher import SURFACE_SD, Matcher, Seen
from noctule.messages import DepthFrame

NEAR = np.radians(np.arange(-40.0, 41.0, 10.0))
"""Headings tried about the predicted one [rad]."""
ALL = np.radians(np.arange(0.0, 360.0, 10.0))
"""Headings tried where nothing is predicted [rad]."""

_GOOD = 0.75  # a ratio that needs no search
_TURNED_STEPS = 2  # of the refinement of the half turn, which starts where the template says
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

    def view(self, pose: Pose, wide: bool = False) -> _View:
        """Gather the evidence around a supposed pose; `wide` to search it for the drone."""
        grid = self.matcher.wide if wide else self.matcher.grid
        evidence = gather(self.depth, self.nearest, self.camera, pose, grid)
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

    It is refined from there; where that does not explain what is seen (or `searched`), `headings` [rad] about
    the predicted are tried, each over shifts of `reach` steps of 4 cm, and the best is refined.
    """
    matcher = scene.matcher
    view = scene.view(predicted)
    at, information = matcher.refine(view.share, view.trust, np.zeros(3))
    judged = matcher.judge(view.share, view.trust, at)
    if searched or judged[0] < _GOOD * judged[1] or judged[1] <= 0.0:
        around = scene.view(predicted, wide=True)
        starts, scores = matcher.search(around.share, around.trust, headings, reach)
        other = matcher.refine(around.share, around.trust, starts[int(np.argmax(scores))])
        rejudged = matcher.judge(around.share, around.trust, other[0])
        if rejudged[0] > judged[0]:
            return _completed(scene, around, *other, rejudged)
    return _completed(scene, view, at, information, judged)


def acquire(scene: Scene, position: Array, reach: int = 3) -> Registration:
    """Register the template around a supposed position (3,) [m] with any heading."""
    matcher = scene.matcher
    view = scene.view(Pose(position, 0.0), wide=True)
    starts, scores = matcher.search(view.share, view.trust, ALL, reach)
    first = int(np.argmax(scores))
    # Blocks of 4 cm leave open which quarter turn is best, and all four score alike with a hull: what tells
    # them apart decides.
    quarter = len(ALL) // 4
    found = [
        matcher.refine(view.share, view.trust, starts[(first + k * quarter) % len(ALL)])[0] for k in range(4)
    ]
    distance = view.evidence.distance

    def misfit(at: Array) -> float:
        return matcher.contrast(view.seen, at, _surface(matcher, view, at)[0], distance, quarters=True)

    best = min(found, key=misfit)
    # Once more in its own axes, with the tilt that was not known.
    return register(scene, _moved(view.evidence, best, _surface(matcher, view, best)[0]))


def _completed(
    scene: Scene, view: _View, at: Array, information: Array, judged: tuple[float, float, float]
) -> Registration:
    """Return the answer with its height, which was perhaps predicted too badly to trust the rest."""
    matcher = scene.matcher
    surface, cells = _surface(matcher, view, at)
    pose = _moved(view.evidence, at, surface)
    if abs(surface[0]) > _FAR:
        # The rays that pass the body's height were placed at a wrong height.
        view = scene.view(pose)
        at, information = matcher.refine(view.share, view.trust, np.zeros(3))
        surface, cells = _surface(matcher, view, at)
        pose = _moved(view.evidence, at, surface)
        judged = matcher.judge(view.share, view.trust, at)
    score, nominal, seen = judged
    return Registration(
        pose,
        covariance(information, cells, view.evidence.pose.yaw + float(at[2])),
        score,
        score / nominal if nominal > 0.0 else 0.0,
        min(seen / matcher.seen, 1.0),
        *matcher.misfits(view.seen, at, surface, view.evidence.distance, seen),
        _half_turn(matcher, view, at, surface),
    )


def _surface(matcher: Matcher, view: _View, at: Array) -> tuple[Array, float]:
    return matcher.surface(view.evidence.drone, view.evidence.height, at)


def _half_turn(matcher: Matcher, view: _View, at: Array, surface: Array) -> float:
    """Return by how much the half turn fits worse than `at`, over what it would if all were seen."""
    if matcher.half_turn <= 0.0:
        return 0.0
    c, s = math.cos(at[2]), math.sin(at[2])
    x, y, heading = (float(value) for value in matcher.turned)
    start = np.array([at[0] + c * x - s * y, at[1] + s * x + c * y, at[2] + heading])
    turned, _ = matcher.refine(view.share, view.trust, start, _TURNED_STEPS)
    other = _surface(matcher, view, turned)[0]
    distance = view.evidence.distance
    here = matcher.contrast(view.seen, at, surface, distance)
    return (matcher.contrast(view.seen, turned, other, distance) - here) / matcher.half_turn


def _moved(evidence: Evidence, at: Array, surface: Array) -> Pose:
    """Return the pose that the supposed one becomes: x, y, heading in its axes, then height and slopes."""
    x, y, z, yaw, roll, pitch = fitting.moved(evidence.R_world_body, evidence.pose.position, at, surface)
    return Pose(np.array([x, y, z]), wrap_angle(yaw), roll, pitch)


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
