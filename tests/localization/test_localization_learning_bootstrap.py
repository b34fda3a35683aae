"""First poses of a manual flight: which end is the nose is decided once, by evidence, or not at all."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from localization_sightings import stage

from noctule.camera import CEILING_CAMERA
from noctule.geometry import Pose, wrap_angle
from noctule.localization.heading.turns import HALF_TURN, QUARTER_TURN
from noctule.localization.learning import bootstrap
from noctule.localization.learning.bootstrap import (
    StartHeadingError,
    TurnUnknownError,
    drone_sighting,
    first_poses,
    follow,
)
from noctule.messages import DepthFrame
from noctule.simulation.ceiling import CeilingSpec, DepthStage, ThingPose
from noctule.vision.depth.learning import learn_background

RATE = 6.0  # [1/s]


def circle(n: int, nose: float = 0.0) -> list[Pose]:
    """A flight on a circle, climbing and descending, the nose turned by `nose` from the way flown."""
    t = np.arange(n) / RATE
    phi = 0.9 * t + 0.4
    z = 1.1 + 0.4 * np.sin(0.5 * t)
    return [
        Pose(np.array([0.1 + 0.4 * np.cos(a), 0.1 + 0.4 * np.sin(a), h]), wrap_angle(a + np.pi / 2 + nose))
        for a, h in zip(phi, z, strict=True)
    ]


@cache
def filmed(hull: bool, nose: float = 0.0, n: int = 70) -> tuple[list[DepthFrame], list[Pose]]:
    poses = circle(n, nose)
    return [stage(hull)[0].frame(300.0 + i / RATE, pose) for i, pose in enumerate(poses)], poses


def learned(hull: bool, nose: float, start_yaw: float | None):
    return first_poses(filmed(hull, nose)[0], stage(hull)[1], CEILING_CAMERA, start_yaw)


def worst_turn(first, poses) -> float:
    """Largest error of a heading [deg]."""
    pairs = [(a, b) for a, b in zip(first.poses, poses, strict=True) if a is not None]
    assert len(pairs) > 0.9 * len(poses)
    return max(abs(np.degrees(wrap_angle(a.yaw - b.yaw))) for a, b in pairs)


@pytest.mark.parametrize(("hull", "method", "worst"), [(True, "harmonic", 6.0), (False, "axis", 25.0)])
def test_flown_nose_first_the_way_tells_nose_from_tail(hull, method, worst) -> None:
    first = learned(hull, 0.0, None)
    assert (first.heading, first.anchor) == (method, "displacement")
    assert worst_turn(first, filmed(hull)[1]) < worst
    off = [
        np.linalg.norm(a.position - b.position)
        for a, b in zip(first.poses, filmed(hull)[1], strict=True)
        if a
    ]
    assert max(off) < 0.06


@pytest.mark.parametrize("nose", [0.0, 2.0, np.pi])
@pytest.mark.parametrize("hull", [True, False])
def test_a_heading_said_roughly_at_the_start_decides_whatever_way_it_flies(hull, nose) -> None:
    frames_and_poses = filmed(hull, nose)
    said = frames_and_poses[1][0].yaw + np.radians(30.0)
    first = learned(hull, nose, said)
    assert first.anchor == "start"
    assert worst_turn(first, frames_and_poses[1]) < 25.0


def test_markers_are_believed_where_they_are_on() -> None:
    marked = DepthStage(CeilingSpec(hull=False, markers=True), 0)
    background = learn_background(marked.frame(i / 30.0, None).depth for i in range(20))
    poses = circle(12, 2.5)
    frames = [marked.frame(400.0 + i, pose, colour=True) for i, pose in enumerate(poses)]
    first = first_poses(frames, background, CEILING_CAMERA)
    assert (first.heading, first.anchor) == ("markers", "markers")
    assert worst_turn(first, poses) < 8.0


def test_flown_sideways_without_a_heading_at_the_start_it_is_refused() -> None:
    with pytest.raises(TurnUnknownError) as caught:
        learned(True, np.pi / 2, None)
    text = str(caught.value)
    assert text.startswith(
        "template: without markers the way flown does not tell nose from tail (mean cosine between nose "
        "and way "
    )
    assert text.endswith("at least 0.3 is needed); fly nose first, or say the heading at the start")


def test_a_heading_at_the_start_across_the_drone_is_refused() -> None:
    start = filmed(False)[1][0].yaw
    with pytest.raises(StartHeadingError) as caught:
        learned(False, 0.0, start + QUARTER_TURN)
    text = str(caught.value)
    said = np.degrees(start + QUARTER_TURN)
    assert text.startswith(
        f"template: the nose was said to point to {said:.0f} deg at the start, but the drone lies along "
    )
    assert text.endswith("deg; say its heading in the first frames")


def test_frames_without_a_drone_have_no_pose() -> None:
    room, background = stage(True)
    frames, _ = filmed(True)
    empty = [room.frame(900.0 + i, None) for i in range(3)]
    first = first_poses([*frames[:30], *empty, *frames[30:]], background, CEILING_CAMERA)
    assert [pose is None for pose in first.poses[30:33]] == [True] * 3
    assert sum(pose is None for pose in first.poses) <= 5
    assert drone_sighting(empty[0], background, CEILING_CAMERA) is None


def test_a_thing_cut_by_the_border_is_no_sighting() -> None:
    room, background = stage(True)
    x = CEILING_CAMERA.to_world(np.array([[2.0, 240.0]]), np.array([2.0]))[0]
    frame = room.frame(950.0, None, (ThingPose("box", x[0], x[1], size=(0.6, 0.6, float(x[2]))),))
    assert drone_sighting(frame, background, CEILING_CAMERA) is None


@given(
    st.lists(st.floats(-0.6, 0.6), min_size=2, max_size=100),
    st.sampled_from([QUARTER_TURN, HALF_TURN]),
    st.sets(st.integers(0, 99)),
)
def test_following_leaves_one_turn_open_for_the_whole_flight(steps, period, gaps) -> None:
    """Where frames are missing the heading goes on, as long as it turned by less than half a period."""
    true = np.cumsum(steps)
    missing = {i for i in gaps if i % 3 == 1 and i < len(true)}  # never two in a row
    raw = np.array([np.nan if i in missing else (a + 0.3) % period for i, a in enumerate(true)])
    slow = true * (period / HALF_TURN) * 0.6  # turns less than half a period over two frames
    raw = np.where(np.isnan(raw), np.nan, (slow + 0.3) % period)
    followed = follow(raw, period)
    assert (np.isnan(followed) == np.isnan(raw)).all()
    known = np.isfinite(raw)
    open_turns = (followed - slow - 0.3)[known] / period
    assert np.allclose(open_turns, open_turns[0], atol=1e-9)
    assert open_turns[0] == pytest.approx(round(open_turns[0]), abs=1e-9)


def test_a_cross_whose_axes_look_alike_is_refused(monkeypatch) -> None:
    monkeypatch.setattr(bootstrap, "_SURE", 1e3)  # nothing is as sure as that
    with pytest.raises(TurnUnknownError) as caught:
        learned(True, 0.0, 0.0)
    text = re.sub(r"-?\d\.\d\d", "X", re.sub(r"in \d+ frames", "in N frames", str(caught.value)))
    assert text == (
        "template: the drone looks alike from the front and from the side in N frames (agreement X +- X); "
        "put the colour markers on, or fly for longer"
    )
