"""The template is learned without true poses: as sharp as with them, origin and axis where they belong."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
from localization_sightings import stage

from noctule.camera import CEILING_CAMERA
from noctule.errors import NoctuleError
from noctule.geometry import Pose, wrap_angle
from noctule.localization.learning import template as learning
from noctule.localization.learning.bootstrap import TemplateFlightError
from noctule.localization.learning.detectors import fit_detectors
from noctule.localization.learning.gauge import regauged, symmetry_axes
from noctule.localization.learning.template import (
    LearnedTemplate,
    TemplateConvergenceError,
    learn_template,
)
from noctule.localization.matcher import Matcher
from noctule.localization.template import build_template
from noctule.messages import DepthFrame
from noctule.simulation.ceiling import ThingPose
from noctule.simulation.ceiling.flights import manual_flight

FRAMES = 90


@cache
def flight(hull: bool) -> tuple[list[DepthFrame], list[Pose]]:
    room, _ = stage(hull)
    flown = manual_flight(7, FRAMES / 3.0, 6.0, room.spec)[::2]
    return [room.frame(600.0 + t, pose) for t, pose in flown], [pose for _, pose in flown]


@cache
def learned(hull: bool) -> LearnedTemplate:
    frames, poses = flight(hull)
    return learn_template(frames, stage(hull)[1], CEILING_CAMERA, poses[0].yaw + 0.4)


@cache
def from_truth(hull: bool):
    frames, poses = flight(hull)
    return build_template(list(zip(frames, poses, strict=True)), stage(hull)[1].nearest, CEILING_CAMERA)


def errors(result: LearnedTemplate, hull: bool) -> np.ndarray:
    """Errors of the aligned poses: x, y, z [m] and heading [rad], (n, 4)."""
    pairs = [(a, b) for a, b in zip(result.poses, flight(hull)[1], strict=True) if a is not None]
    return np.array([[*(a.position - b.position), wrap_angle(a.yaw - b.yaw)] for a, b in pairs])


@pytest.mark.parametrize(("hull", "heading_sd"), [(True, 0.6), (False, 1.3)])
def test_a_template_learned_without_true_poses_puts_every_frame_where_it_was(hull, heading_sd) -> None:
    found = errors(learned(hull), hull)
    assert learned(hull).frames_used > 0.9 * FRAMES
    assert np.abs(found[:, :3].mean(axis=0)).max() < 0.006
    assert found[:, :3].std(axis=0).max() < 0.006
    assert abs(np.degrees(found[:, 3].mean())) < 1.0
    assert np.degrees(found[:, 3].std()) < heading_sd


@pytest.mark.parametrize("hull", [True, False])
def test_it_is_as_sharp_as_one_learned_from_the_truth(hull) -> None:
    assert learned(hull).template.sharpness > 0.9 * from_truth(hull).sharpness
    apart = np.abs(learned(hull).template.probability - from_truth(hull).probability)
    assert apart.mean() < 0.03


@pytest.mark.parametrize("hull", [True, False])
def test_the_poses_settle_and_each_round_says_how_it_stands(hull) -> None:
    rounds = learned(hull).rounds
    assert rounds[-1].moved < rounds[0].moved
    assert rounds[-1].moved < 0.002
    assert rounds[-1].turned < np.radians(0.5)
    assert rounds[-1].used == learned(hull).frames_used


def test_rounds_are_told_as_they_come() -> None:
    frames, poses = flight(True)
    told: list[learning.Round] = []
    result = learn_template(frames, stage(True)[1], CEILING_CAMERA, poses[0].yaw, on_round=told.append)
    assert tuple(told) == result.rounds


def test_the_same_flight_gives_the_same_template() -> None:
    frames, poses = flight(True)
    again = learn_template(frames, stage(True)[1], CEILING_CAMERA, poses[0].yaw + 0.4)
    assert np.array_equal(again.template.probability, learned(True).template.probability)


@pytest.mark.parametrize("hull", [True, False])
def test_the_symmetry_finds_an_origin_and_an_axis_that_were_moved(hull) -> None:
    """Poses all off by the same amount in the body's axes: the frames cannot tell, the mirror can."""
    frames, poses = flight(hull)

    def axes_of(supposed) -> np.ndarray:
        samples = list(zip(frames, supposed, strict=True))
        return symmetry_axes(
            Matcher.of(build_template(samples, stage(hull)[1].nearest, CEILING_CAMERA, (-0.02,)))
        )

    rest = axes_of(poses)
    assert np.abs(rest[:2]).max() < 0.003
    assert abs(np.degrees(rest[2])) < 0.5
    supposed = [regauged(pose, np.array([0.012, -0.010, 0.06]), 0.0) for pose in poses]
    for _ in range(2):  # as the rounds of learning do
        axes = axes_of(supposed)
        supposed = [regauged(pose, axes, 0.0) for pose in supposed]
    off = np.array(
        [np.linalg.norm((a.position - b.position)[:2]) for a, b in zip(supposed, poses, strict=True)]
    )
    turned = np.array([wrap_angle(a.yaw - b.yaw) for a, b in zip(supposed, poses, strict=True)])
    assert off.max() < 0.003
    assert np.abs(np.degrees(turned)).max() < 0.6


def test_moving_the_origin_is_along_the_body_s_axes_and_keeps_the_tilt() -> None:
    pose = regauged(Pose(np.array([1.0, 2.0, 1.0]), np.pi / 2, 0.1, -0.05), np.array([0.02, 0.0, np.pi]), 0.3)
    expected = Pose(np.zeros(3), np.pi / 2, 0.1, -0.05).R_world_body[:, 0] * 0.02
    assert np.allclose(pose.position - expected, [1.0, 2.0, 1.3])
    assert pose.yaw == pytest.approx(-np.pi / 2)
    assert (pose.roll, pose.pitch) == (0.1, -0.05)


def test_the_height_is_what_was_said_of_the_surface() -> None:
    frames, poses = flight(True)
    deep = learn_template(frames, stage(True)[1], CEILING_CAMERA, poses[0].yaw, surface=0.05)
    lower = errors(learned(True), True)[:, 2].mean() - errors(deep, True)[:, 2].mean()
    assert lower == pytest.approx(0.03, abs=0.002)


def test_a_flight_that_hardly_shows_the_drone_is_refused() -> None:
    frames, poses = flight(True)
    with pytest.raises(TemplateFlightError) as caught:
        learn_template(frames[:40], stage(True)[1], CEILING_CAMERA, poses[0].yaw)
    assert str(caught.value) == (
        "template: 40 of 40 frames show the drone whole and its heading, at least 60 are needed; fly longer, "
        "inside the camera's view"
    )


@pytest.mark.parametrize("shown", [0, 8])
def test_too_few_frames_are_named_before_nose_and_tail(shown) -> None:
    frames = [*flight(True)[0][:shown], *(stage(True)[0].frame(900.0 + k, None) for k in range(3))]
    with pytest.raises(TemplateFlightError) as caught:
        learn_template(frames, stage(True)[1], CEILING_CAMERA)
    assert str(caught.value).startswith(f"template: {shown} of {shown + 3} frames show the drone whole")


def test_poses_that_do_not_settle_are_refused(monkeypatch) -> None:
    monkeypatch.setattr(learning, "MAX_ROUNDS", 1)
    frames, poses = flight(True)
    with pytest.raises(TemplateConvergenceError) as caught:
        learn_template(frames, stage(True)[1], CEILING_CAMERA, poses[0].yaw)
    text = re.sub(r"by [\d.]+ mm and [\d.]+ deg a round", "by A mm and B deg a round", str(caught.value))
    assert text == (
        "template: after 1 rounds the poses still move by A mm and B deg a round, 2.0 mm and 0.5 deg are "
        "allowed; fly longer, slower, and through all headings"
    )


def test_a_flight_that_shows_two_things_in_turn_is_refused() -> None:
    """A tray on a stick that is carried about after the drone has landed, turned as the drone was."""
    frames, poses = flight(True)
    room, background = stage(True)
    carried = [
        room.frame(800.0 + k, None, [ThingPose("tray", *pose.position[:2], yaw=pose.yaw, z=pose.position[2])])
        for k, pose in enumerate(poses)
    ]
    with pytest.raises(NoctuleError, match=r"^template: "):
        learn_template([*frames[:60], *carried[:60]], background, CEILING_CAMERA, poses[0].yaw)


def test_frames_that_do_not_fit_the_template_are_counted_in_the_refusal(monkeypatch) -> None:
    monkeypatch.setattr(learning, "_FIT", 5.0)
    frames, poses = flight(True)
    with pytest.raises(TemplateConvergenceError) as caught:
        learn_template(frames, stage(True)[1], CEILING_CAMERA, poses[0].yaw)
    assert str(caught.value) == (
        "template: after 1 rounds 0 of 90 frames show the same thing, at least 63 should; did the drone fly "
        "alone, and with the hull on or off all the time?"
    )


def test_detectors_are_fitted_from_frames() -> None:
    room, background = stage(True)
    flown = manual_flight(8, 40.0, 3.0, room.spec)
    frames = [room.frame(700.0 + t, pose) for t, pose in flown]
    detectors, samples = fit_detectors(frames, background, CEILING_CAMERA)
    assert len(samples) > 0.95 * len(frames)
    assert detectors.cubics.lowest == detectors.band.lowest
    assert 0.05 < detectors.band.smallest < np.median(samples.surface) < detectors.band.largest < 0.2
