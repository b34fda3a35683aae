"""Where and how turned the drone is: its top view laid over what a frame shows.

"Register the drone's top view" of the design; takes the place of eq. (19) on a blob and of the ellipse (22)
to (24). Evidence is gathered in the axes of the predicted pose, tilt included, with a drone reading at its
own point; all of x, y and heading are refined at once by Gauss-Newton on it, where a parabola through the
scores of shifts and turns would take them one by one; height and tilt are those of the seen surface against
the template's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.geometry import Array, Pose, wrap_angle
from noctule.localization import placing
from noctule.localization.evidence import Evidence, gather
from noctule.localization.matcher import Fit, Matcher
from noctule.messages import DepthFrame

NEAR = np.radians(np.arange(-40.0, 41.0, 10.0))
"""Headings tried about the predicted one [rad]."""
ALL = np.radians(np.arange(0.0, 360.0, 10.0))
"""Headings tried where nothing is predicted [rad]."""

_GOOD = 0.75  # a ratio that needs no search
_FAR = 0.03  # [m], when the height was predicted worse than this the evidence is gathered again


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
    half_turn: float | None  # log-likelihood ratio against the half turn in this frame; None: not weighed


@dataclass(frozen=True, slots=True)
class Scene:
    """A frame, and what it is compared with."""

    depth: NDArray[np.uint16]  # (h, w) [mm]
    nearest: NDArray[np.uint16]  # (h, w) [mm], readings below are foreground
    camera: FixedCamera
    matcher: Matcher

    def view(self, pose: Pose, wide: bool = False) -> Evidence:
        """Gather the evidence around a supposed pose; `wide` to search it for the drone."""
        grid = self.matcher.wide if wide else self.matcher.grid
        return gather(self.depth, self.nearest, self.camera, pose, grid)


def align(
    matcher: Matcher, frame: DepthFrame, nearest: NDArray[np.uint16], camera: FixedCamera, near: Pose
) -> Registration:
    """Align the template to a frame near a supposed pose: for learning, where there is no track."""
    return register(Scene(frame.depth, nearest, camera, matcher), near, searched=True)


def register(
    scene: Scene,
    predicted: Pose,
    headings: Array = NEAR,
    reach: int = 1,
    searched: bool = False,
    weighed: bool = True,
) -> Registration:
    """Register the template around a predicted pose.

    It is refined from there; where that does not explain what is seen (or `searched`), `headings` [rad] about
    the predicted are tried, each over shifts of `reach` steps of 4 cm, and the best is refined. The half turn
    is `weighed` or left out.
    """
    matcher = scene.matcher
    view = scene.view(predicted)
    at, information = matcher.refine(view.share, view.trust, np.zeros(3))
    fit = matcher.assess(view, at)
    if searched or fit.score < _GOOD * fit.nominal or fit.nominal <= 0.0:
        around = scene.view(predicted, wide=True)
        starts, scores = matcher.search(around.share, around.trust, headings, reach)
        other = matcher.refine(around.share, around.trust, starts[int(np.argmax(scores))])
        other_fit = matcher.assess(around, other[0])
        if other_fit.score > fit.score:
            return _completed(scene, around, *other, other_fit, weighed)
    return _completed(scene, view, at, information, fit, weighed)


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
    best = min(found, key=lambda at: matcher.quarter_contrast(view, at))
    # Once more in its own axes, with the tilt that was not known.
    return register(scene, _moved(view, best, matcher.assess(view, best).surface))


def _completed(
    scene: Scene, view: Evidence, at: Array, information: Array, fit: Fit, weighed: bool
) -> Registration:
    """Return the answer with its height, which was perhaps predicted too badly to trust the rest."""
    matcher = scene.matcher
    pose = _moved(view, at, fit.surface)
    if abs(fit.surface[0]) > _FAR:
        # The rays that pass the body's height were placed at a wrong height.
        view = scene.view(pose)
        at, information = matcher.refine(view.share, view.trust, np.zeros(3))
        fit = matcher.assess(view, at)
        pose = _moved(view, at, fit.surface)
    return Registration(
        pose,
        placing.covariance(information, fit.cells, view.pose.yaw + float(at[2])),
        fit.score,
        fit.score / fit.nominal if fit.nominal > 0.0 else 0.0,
        min(fit.seen / (matcher.seen * _reached(scene.camera, view)), 1.0),
        fit.outline,
        fit.relief,
        matcher.against_half_turn(scene.depth, scene.nearest, scene.camera, pose) if weighed else None,
    )


def _reached(camera: FixedCamera, view: Evidence) -> float:
    """Return the share of a level plane's cells that readings can fall into, up to 1.

    Where pixels are farther apart than cells, a cell without a reading is not a cell that is hidden.
    """
    k = camera.intrinsics
    if view.distance <= 0.0:
        return 1.0
    a_cell = view.grid.cell / view.distance
    return min(k.fx * a_cell, 1.0) * min(k.fy * a_cell, 1.0)


def _moved(seen: Evidence, at: Array, surface: Array) -> Pose:
    """Return the pose that the supposed one becomes: x, y, heading in its axes, then height and slopes."""
    x, y, z, yaw, roll, pitch = placing.moved(seen.R_world_body, seen.pose.position, at, surface)
    return Pose(np.array([x, y, z]), wrap_angle(yaw), roll, pitch)
