"""Learning the drone's top view from a manual flight, without anybody knowing its true poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.errors import NoctuleError
from noctule.geometry import Pose, wrap_angle
from noctule.localization.learning.bootstrap import MIN_FRAMES, Anchor, first_poses, require_enough
from noctule.localization.learning.gauge import regauged, symmetry_axes
from noctule.localization.matcher import Matcher
from noctule.localization.registration import align
from noctule.localization.template import PLANES, Template, build_template
from noctule.messages import DepthFrame
from noctule.vision.depth.background import Background

SURFACE = 0.02  # [m], the seen surface of a small quadrotor lies so far over its middle; calibrated later
MAX_ROUNDS = 12
_FIT = 0.6  # ratio of a registration from which a frame is learned from
_SEEN = 0.4  # of the template must be seen in such a frame; shadows and holes leave 0.6 to 0.8
_SETTLED = (0.002, np.radians(0.5))  # [m, rad], rms that poses may still move in a round; noise is 1.4 mm
_SHARE = 0.7  # of the frames must fit the template, once it had
_PATIENCE = 3  # rounds to become sharp
_EARLY_PLANES = (-0.02,)  # [m], as `PLANES`


class TemplateConvergenceError(NoctuleError):
    """The template does not become sharp: the frames do not show one and the same thing."""


@dataclass(frozen=True, slots=True)
class Round:
    """How learning stands after one round."""

    sharpness: float  # of the template
    used: int  # frames that it was learned from
    moved: float  # [m], rms change of the poses against the last round
    turned: float  # [rad], likewise


@dataclass(frozen=True, slots=True)
class LearnedTemplate:
    """The template, and where every frame's drone was by it."""

    template: Template
    rounds: tuple[Round, ...]
    poses: tuple[Pose | None, ...]  # one for each frame, of the body's origin; None: not learned from
    heading: str  # the method that the first headings were measured by
    anchor: Anchor  # what told nose from tail

    @property
    def frames_used(self) -> int:
        """How many frames the template was learned from."""
        return sum(pose is not None for pose in self.poses)


def learn_template(
    frames: Sequence[DepthFrame],
    background: Background,
    camera: FixedCamera,
    start_yaw: float | None = None,
    surface: float = SURFACE,
    on_round: Callable[[Round], None] = lambda _: None,
) -> LearnedTemplate:
    """Learn the top view from a manual flight in an otherwise empty room.

    First poses are those of `first_poses`. Then every frame is aligned to the template so far and the
    template learned again from the aligned frames, until the poses settle. Frames fix the template up to
    where its origin and axis are: these are put where the drone is symmetric, and the origin `surface` [m]
    below the mean of the surface seen, which a drone on the floor calibrates better.

    Parameters
    ----------
    frames
        In their order, five a second or more, with colour if the markers are on. They are read once a round.
    start_yaw
        As in `first_poses`.
    on_round
        Told of every round, for a progress bar; there are at most `MAX_ROUNDS`.

    Raises
    ------
    TemplateFlightError, TemplateConvergenceError, TemplateError; TurnUnknownError, StartHeadingError
    """
    first = first_poses(frames, background, camera, start_yaw)
    poses = list(first.poses)
    seen = sum(pose is not None for pose in poses)
    require_enough(seen, len(frames))
    nearest = background.nearest
    rounds: list[Round] = []
    template = build_template(_samples(frames, poses), nearest, camera, _EARLY_PLANES)
    while True:
        aligned = _aligned(template, surface, frames, nearest, camera, poses)
        used = sum(pose is not None for pose in aligned)
        if used < max(MIN_FRAMES, _SHARE * seen * (len(rounds) >= _PATIENCE)):
            expected = max(MIN_FRAMES, round(_SHARE * seen))
            raise TemplateConvergenceError(
                f"template: after {len(rounds) + 1} rounds {used} of {seen} frames show the same thing, at "
                f"least {expected} should; did the drone fly alone, and with the hull on or off all the time?"
            )
        moved, turned = _change(poses, aligned)
        poses = [old if new is None else new for old, new in zip(poses, aligned, strict=True)]
        settled = moved < _SETTLED[0] and turned < _SETTLED[1]
        # Which height rays end at matters only once the poses are good.
        planes = PLANES if settled else _EARLY_PLANES
        template = build_template(_samples(frames, aligned), nearest, camera, planes)
        rounds.append(Round(template.sharpness, used, moved, turned))
        on_round(rounds[-1])
        if settled:
            return LearnedTemplate(template, tuple(rounds), tuple(aligned), first.heading, first.anchor)
        if len(rounds) == MAX_ROUNDS:
            raise TemplateConvergenceError(
                f"template: after {MAX_ROUNDS} rounds the poses still move by {1e3 * moved:.1f} mm and "
                f"{np.degrees(turned):.1f} deg a round, {1e3 * _SETTLED[0]:.1f} mm and "
                f"{np.degrees(_SETTLED[1]):.1f} deg are allowed; fly longer, slower, and through all headings"
            )


def _samples(frames: Sequence[DepthFrame], poses: Sequence[Pose | None]) -> list[tuple[DepthFrame, Pose]]:
    return [(frame, pose) for frame, pose in zip(frames, poses, strict=True) if pose is not None]


def _aligned(
    template: Template,
    surface: float,
    frames: Sequence[DepthFrame],
    nearest: NDArray[np.uint16],
    camera: FixedCamera,
    poses: Sequence[Pose | None],
) -> list[Pose | None]:
    """Return the poses that lay the template over each frame, origin and axis where symmetry puts them."""
    matcher = Matcher.of(template)
    axes, up = symmetry_axes(matcher), template.surface - surface
    found: list[Pose | None] = []
    for frame, pose in zip(frames, poses, strict=True):
        if pose is None:
            found.append(None)
            continue
        answer = align(matcher, frame, nearest, camera, pose)
        fits = answer.ratio >= _FIT and answer.visible >= _SEEN
        found.append(regauged(answer.pose, axes, up) if fits else None)
    return found


def _change(before: Sequence[Pose | None], after: Sequence[Pose | None]) -> tuple[float, float]:
    """Return the rms distance [m] and turn [rad] between poses that are in both."""
    pairs = [(a, b) for a, b in zip(before, after, strict=True) if a is not None and b is not None]
    moved = [float(np.linalg.norm(b.position - a.position)) for a, b in pairs]
    turned = [wrap_angle(b.yaw - a.yaw) for a, b in pairs]
    return float(np.sqrt(np.mean(np.square(moved)))), float(np.sqrt(np.mean(np.square(turned))))
