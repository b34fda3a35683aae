"""Frames that cannot be used: each has a named reason, and none ends a flight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from noctule.camera import FixedCamera, PinholeCamera
from noctule.localization.health import (
    Expected,
    FrameHealth,
    Sieve,
    UnusableFramesError,
    check_camera,
    check_frame,
    name_of,
)
from noctule.messages import DepthFrame
from noctule.vision.depth.background import Background

CAMERA = PinholeCamera.centred(320, 240, 264.0)
HEIGHT = 3000.0  # [mm]


def floor(tilt: float = 0.0, noise: int = 0) -> np.ndarray:
    """The floor below a camera that looks down, turned by `tilt` [rad] about its x axis."""
    v = (np.arange(240) - CAMERA.cy) / CAMERA.fy
    row = HEIGHT / (np.cos(tilt) + v * np.sin(tilt))
    depth = np.repeat(row[:, None], 320, axis=1)
    depth += np.random.default_rng(noise).normal(0.0, 6.0, depth.shape)
    return np.rint(depth).astype(np.uint16)


def learned() -> Background:
    """The level floor, as it is learned from many frames."""
    shape = (240, 320)
    mean = np.full(shape, HEIGHT, np.float32)
    nearest = np.full(shape, HEIGHT - 48, np.uint16)
    return Background(mean, np.full(shape, 12.0, np.float32), np.full(shape, 90, np.int32), nearest, 90, 4.0)


def check(depth: np.ndarray, background: Background | None = None) -> str:
    return check_frame(DepthFrame(0.0, depth), Expected.of(CAMERA, background))


ROOMS = [None, learned()]


@pytest.mark.parametrize("background", ROOMS)
def test_a_sound_frame_has_no_reason(background):
    assert check(floor(), background) == ""
    near = floor()
    near[:, :200] = 900  # a person fills most of the picture
    assert check(near, background) == ""
    holes = floor()
    holes[:, :220] = 0
    assert check(holes, background) == ""


@pytest.mark.parametrize("background", ROOMS)
def test_another_resolution_is_named_with_both(background):
    assert check(floor()[::2, ::2], background) == (
        "wrong resolution: found 160x120 px, expected 320x240 px; set the camera to that, or calibrate it "
        "again as it is"
    )
    assert check(floor()[..., None].repeat(3, axis=2), background) == (
        "wrong resolution: found 320x240 px of 3 channels, expected one channel of 16 bits; give the depth "
        "itself, in millimetres, not a picture of it"
    )


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_metres_as_real_numbers_are_named(kind):
    metres = (floor() / 1000.0).astype(kind)
    metres[0, :4] = np.nan, np.inf, -np.inf, 0.0
    assert check(metres) == (
        f"wrong unit: found {np.dtype(kind)}, expected uint16 millimetres; these look like metres, have the "
        "camera send millimetres"
    )


@pytest.mark.parametrize("kind", [np.float32, np.int32, np.uint8, np.bool_])
def test_other_types_are_named(kind):
    depth = floor().astype(kind)
    assert check(depth) == (
        f"wrong unit: found {np.dtype(kind)}, expected uint16 millimetres; have the camera send these"
    )


UNITS = [
    (1e-3, 3, "metres", "metres or centimetres"),
    (0.1, 300, "centimetres", "metres or centimetres"),
    (5.0, 15000, "fifths of a millimetre", "tenths or fifths of a millimetre"),
    (10.0, 30000, "tenths of a millimetre", "tenths or fifths of a millimetre"),
]


@pytest.mark.parametrize(("factor", "usual", "unit", "guess"), UNITS)
def test_whole_numbers_in_another_unit_are_named_by_it(factor, usual, unit, guess):
    depth = np.full((240, 320), HEIGHT * factor).astype(np.uint16)
    assert check(depth, learned()) == (
        f"wrong unit: the usual depth is {usual}, expected about 3000 as in the background [mm]; these look "
        f"like {unit}, have the camera send millimetres"
    )
    assert check(depth) == (
        f"wrong unit: the usual depth is {usual}, expected 500 to 12000 [mm]; these look like {guess}, have "
        "the camera send millimetres"
    )


@pytest.mark.parametrize(
    ("factor", "usual", "unit"), [*(row[:3] for row in UNITS), (0.2, 600, "millimetres divided by five")]
)
def test_before_the_room_is_learned_the_floor_tells_the_unit_and_the_scale(factor, usual, unit):
    hanging = FixedCamera(CAMERA, np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, HEIGHT / 1000.0]))
    depth = np.full((240, 320), HEIGHT * factor).astype(np.uint16)
    assert check_frame(DepthFrame(0.0, depth), Expected.over_floor(hanging)) == (
        f"wrong unit: the usual depth is {usual}, expected about 3000 as far as the floor is [mm]; these "
        f"look like {unit}, have the camera send millimetres, or give the --scale of the folder's images"
    )


def test_a_camera_that_sees_no_floor_expects_none_and_a_room_of_shelves_is_no_unit():
    level = FixedCamera(CAMERA, np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([0.0, 0.0, 1.5]))
    assert Expected.over_floor(level).usual is None
    down = FixedCamera(CAMERA, np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, HEIGHT / 1000.0]))
    shelves = np.full((240, 320), 1200, np.uint16)
    assert check_frame(DepthFrame(0.0, shelves), Expected.over_floor(down)) == ""


@given(factor=st.floats(0.25, 3.0))
def test_no_room_is_taken_for_another_unit_because_much_in_it_moved(factor):
    depth = np.full((240, 320), HEIGHT * factor).astype(np.uint16)
    assert check(depth, learned()) == ""


@pytest.mark.parametrize("background", ROOMS)
def test_nothing_and_next_to_nothing_are_told_apart(background):
    dark = np.zeros((240, 320), np.uint16)
    assert check(dark, background) == (
        "all zero: no pixel has a depth; is the sensor's projector on and its lens free?"
    )
    dark[3, 5] = 2500  # between the pixels that are looked at
    assert name_of(check(dark, background)) == "too few readings"
    bright = floor()
    bright[:, 32:] = 0
    assert check(bright, background) == (
        "too few readings: 10 % of the picture has a depth, expected at least 20 %; is the lens free, and no "
        "sunlight in the room?"
    )


def test_where_the_background_knows_little_little_is_enough():
    part = replace(learned(), count=np.where(np.arange(320) < 64, 90, 0).repeat(240).reshape(320, 240).T)
    depth = floor()
    depth[:, 40:] = 0
    assert check(depth, part) == ""
    assert name_of(check(depth)) == "too few readings"


shapes = st.tuples(st.integers(0, 3), st.integers(0, 3)) | st.sampled_from([(240, 320), (240, 320, 1), (5,)])
kinds = st.sampled_from([np.uint16, np.float32, np.uint8, np.int64, np.bool_])


@given(depth=arrays.arrays(kinds, shapes), background=st.sampled_from(ROOMS))
def test_no_frame_whatever_it_is_raises(depth, background):
    reason = check(depth, background)
    assert "\n" not in reason
    if background is not None:
        FrameHealth(CAMERA, background).check(DepthFrame(0.0, depth))


def test_a_camera_that_hangs_where_it_hung_fits_whoever_walks_below_it():
    for noise in range(5):
        assert check_camera(DepthFrame(0.0, floor(noise=noise)), learned()) == ""
    crowded = floor()
    crowded[40:200, 30:160] = 1300
    crowded[150:240, 200:300] = 2600
    assert check_camera(DepthFrame(0.0, crowded), learned()) == ""


@pytest.mark.parametrize("tilt", [np.radians(a) for a in (-8.0, -2.0, 2.0, 8.0)])
def test_a_camera_that_was_tilted_by_two_degrees_is_named(tilt):
    reason = check_camera(DepthFrame(0.0, floor(tilt)), learned())
    assert name_of(reason) == "moved camera"
    share = reason.split(": ", 1)[1].split(" %")[0]
    assert reason == (
        f"moved camera: {share} % of the background that can be seen is where it was learned, expected at "
        "least 70 %; put the camera back, or calibrate it and learn the background again"
    )


def test_a_board_before_the_camera_is_not_taken_for_a_moved_camera():
    covered = floor()
    covered[:, 20:] = np.minimum(covered[:, 20:], 1500)
    share = 100 * 18 / 20  # of every 16th column
    assert check_camera(DepthFrame(0.0, covered), learned()) == (
        f"covered view: {share:.0f} % of what the camera sees is far nearer than the empty room, expected at "
        "most 60 %; clear its view"
    )


def test_a_camera_that_sank_is_moved_and_not_covered():
    assert name_of(check_camera(DepthFrame(0.0, floor() - np.uint16(100)), learned())) == "moved camera"


def test_the_camera_is_looked_after_twice_a_second_and_forgiven_at_once():
    health = FrameHealth(CAMERA, learned())
    tilted, level = floor(np.radians(3.0)), floor()
    told = [
        name_of(health.check(DepthFrame(stamp, depth)))
        for stamp, depth in [
            (0.0, level),
            (0.1, tilted),  # not looked at yet
            (0.5, tilted),
            (0.6, tilted),
            (0.7, level),  # looked at, because the last one did not fit
            (0.8, tilted),
            (1.3, tilted),
        ]
    ]
    assert told == ["", "", "moved camera", "moved camera", "", "", "moved camera"]


def test_time_that_runs_backwards_is_looked_at_too():
    health = FrameHealth(CAMERA, learned())
    assert health.check(DepthFrame(100.0, floor())) == ""
    assert name_of(health.check(DepthFrame(1.0, floor(np.radians(3.0))))) == "moved camera"


def test_a_bad_frame_does_not_count_as_a_look_at_the_camera():
    health = FrameHealth(CAMERA, learned())
    assert name_of(health.check(DepthFrame(0.0, floor() * 0))) == "all zero"
    assert name_of(health.check(DepthFrame(0.1, floor(np.radians(3.0))))) == "moved camera"


def test_a_sieve_lets_sound_frames_through_and_counts_the_others_by_name():
    sieve = Sieve(lambda frame: check_frame(frame, Expected.of(CAMERA)))
    frames = [DepthFrame(k / 30, floor()) for k in range(10)]
    frames[2] = DepthFrame(frames[2].stamp, frames[2].depth * 0)
    passed = list(sieve.through(frames))
    assert [frame.stamp for frame in passed] == [f.stamp for k, f in enumerate(frames) if k != 2]
    assert (sieve.seen, dict(sieve.reasons)) == (10, {"all zero": 1})
    sieve.require_sound("recording x")  # a tenth may be bad


def test_a_stream_of_which_a_fifth_is_bad_is_refused_with_the_commonest_reason():
    sieve = Sieve(lambda frame: check_frame(frame, Expected.of(CAMERA)))
    bad = [floor() * 0, floor()[::2], floor()[::2]]
    list(sieve.through(DepthFrame(0.0, depth) for depth in [floor()] * 12 + bad))
    with pytest.raises(UnusableFramesError) as caught:
        sieve.require_sound("recording x")
    assert str(caught.value) == (
        "recording x: 3 of 15 frames cannot be used: wrong resolution: found 320x120 px, expected 320x240 "
        "px; set the camera to that, or calibrate it again as it is"
    )


def test_nothing_seen_is_nothing_bad():
    Sieve(lambda frame: "").require_sound("recording x")
