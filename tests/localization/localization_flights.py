"""A learned template and a background of the ray caster's room, made once for all tests."""

from __future__ import annotations

from functools import cache

import numpy as np
from localization_rays import DRONE, Thing, cast, small_camera

from noctule.geometry import Pose
from noctule.localization.located import LocatorSettings
from noctule.localization.locator import Locator
from noctule.localization.matcher import Matcher
from noctule.localization.registration import Scene
from noctule.localization.template import Template, build_template
from noctule.messages import DepthFrame
from noctule.vision.depth.background import Background
from noctule.vision.depth.learning import learn_background

CAMERA = small_camera(0.75)
HOME = Pose(np.array([0.1, 0.1, 1.2]), 0.4)


def random_pose(rng: np.random.Generator, tilt: float = 0.04) -> Pose:
    position = np.array([rng.uniform(-0.4, 0.5), rng.uniform(-0.6, 0.7), rng.uniform(0.9, 1.5)])
    roll, pitch = rng.normal(0.0, tilt, 2)
    return Pose(position, rng.uniform(-np.pi, np.pi), float(roll), float(pitch))


@cache
def background() -> Background:
    return learn_background([cast(CAMERA, seed=i).depth for i in range(12)])


@cache
def template() -> Template:
    rng = np.random.default_rng(7)
    poses = [random_pose(rng) for _ in range(50)]
    samples = [(cast(CAMERA, (Thing(p, DRONE),), seed=100 + i), p) for i, p in enumerate(poses)]
    return build_template(samples, background().nearest, CAMERA)


@cache
def matcher() -> Matcher:
    return Matcher.of(template())


def scene(*things: Thing, seed: int | None = 0) -> Scene:
    return Scene(cast(CAMERA, things, seed=seed).depth, background().nearest, CAMERA, matcher())


def drone(pose: Pose) -> Thing:
    return Thing(pose, DRONE)


def frame(k: int, *things: Thing) -> DepthFrame:
    return cast(CAMERA, things, stamp=k / 30.0, seed=1000 + k)


def locator(settings: LocatorSettings | None = None) -> Locator:
    return Locator(CAMERA, background(), template(), settings=settings)
