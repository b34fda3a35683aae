"""Key images: enough motion, good links between neighbours, sharp frames, in one pass."""

from __future__ import annotations

import re
from itertools import count as counted
from itertools import pairwise

import cv2
import numpy as np
import pytest

from noctule.camera import PinholeCamera
from noctule.geometry import rot_y
from noctule.vision.key_images import Choice, Frame, KeyImageWalk, choose_key_images, sharpness

CAMERA = PinholeCamera.centred(320, 240, 200.0)


def panorama(seed: int) -> np.ndarray:
    """Blobs of many sizes on a wall that is seen from 100 px x 100 px pieces of an angle."""
    rng = np.random.default_rng(seed)
    wall = np.full((500, 1400, 3), 90, dtype=np.uint8)
    for _ in range(1900):
        centre = tuple(int(v) for v in rng.integers(0, (1400, 500)))
        colour = tuple(int(v) for v in rng.integers(0, 255, 3))
        cv2.circle(wall, centre, int(rng.integers(2, 12)), colour, -1, cv2.LINE_AA)
    return wall


WALL = panorama(1)
WALL_CAMERA = np.array([[200.0, 0.0, 700.0], [0.0, 200.0, 250.0], [0.0, 0.0, 1.0]])


def turned(degrees: float, wall: np.ndarray = WALL) -> np.ndarray:
    """The wall from a camera that has turned on the spot."""
    H = CAMERA.K @ rot_y(np.radians(degrees)) @ np.linalg.inv(WALL_CAMERA)
    return cv2.warpPerspective(wall, H, (320, 240), flags=cv2.INTER_LINEAR)


def pan(angles, rate: float = 10.0) -> list[Frame]:
    return [Frame(i / rate, turned(a)) for i, a in enumerate(angles)]


def chosen(frames, choice: Choice | None = None, **options):
    return list(choose_key_images(frames, CAMERA, choice or Choice(window=0.05), **options))


def test_a_camera_that_turns_gives_a_key_image_after_each_enough_of_turn():
    angles = np.arange(0.0, 45.1, 1.5)
    keys = chosen(pan(angles))
    steps = np.diff([angles[key.index] for key in keys])
    assert keys[0].reason == "first"
    assert [key.reason for key in keys[1:-1]] == ["enough motion"] * (len(keys) - 2)
    assert (steps[:-1] >= 11.9).all()
    assert (steps <= 16.6).all()
    for key, step in zip(keys[1:], steps, strict=True):
        assert abs(np.degrees(key.link.yaw)) == pytest.approx(step, abs=0.3)


def test_the_first_and_the_last_frame_are_always_key_images():
    for count in (2, 3, 7):
        keys = chosen(pan(np.linspace(0.0, 5.0, count)))
        assert [key.index for key in keys] == [0, count - 1]
        assert keys[-1].reason == "last"


def test_one_frame_is_one_key_image_and_none_is_none():
    assert [key.index for key in chosen(pan([0.0]))] == [0]
    assert chosen([]) == []


def test_a_hover_at_the_end_does_not_leave_two_images_of_one_place():
    angles = [*np.arange(0.0, 14.0, 1.5), 15.4, *[15.5] * 8]
    keys = chosen(pan(angles))
    assert keys[-1].index == len(angles) - 1
    assert all(abs(np.degrees(key.link.yaw)) > 6.0 for key in keys[1:])


def test_blurred_frames_are_passed_over():
    angles = np.arange(0.0, 40.0, 1.0)
    frames = pan(angles)
    blurred = [Frame(f.stamp, cv2.blur(f.pixels, (9, 1))) if i % 3 else f for i, f in enumerate(frames)]
    keys = chosen(blurred, Choice(window=0.25))
    assert all(key.index % 3 == 0 for key in keys[1:-1])
    assert len(keys) >= 4


def test_a_picture_is_sharper_than_its_blurred_copy_whatever_its_contrast():
    sharp = turned(0.0)
    assert sharpness(sharp) > 2.0 * sharpness(cv2.GaussianBlur(sharp, (0, 0), 2.0))
    dim = (0.4 * sharp).astype(np.uint8)
    assert sharpness(dim) == pytest.approx(sharpness(sharp), rel=0.1)


def test_before_too_little_is_shared_a_key_image_is_taken_though_the_motion_is_not_enough():
    angles = np.arange(0.0, 30.1, 2.0)
    lazy = Choice(turn=10.0, step=10.0, window=0.05, shared=0)
    assert len(chosen(pan(angles), lazy)) == 2
    (first, *_) = chosen(pan([0.0, 10.0]), lazy)[1:]
    many = first.link.shared
    keys = chosen(pan(angles), Choice(turn=np.radians(14.0), step=10.0, window=0.05, shared=many))
    assert angles[keys[1].index] < 14.0
    assert keys[1].link.shared >= many
    fewer = int(re.fullmatch(r"then (\d+) shared points", keys[1].reason)[1])
    assert fewer < many


def test_a_cut_to_another_place_is_a_gap_and_the_key_image_says_so():
    other = panorama(9)
    frames = pan(np.arange(0.0, 8.0, 2.0))
    frames += [Frame(0.4 + 0.1 * i, turned(2.0 * i, other)) for i in range(9)]
    keys = chosen(frames)
    (gap,) = [key for key in keys if key.reason.startswith("gap: ")]
    assert gap.index >= 4
    before = keys[keys.index(gap) - 1]
    assert before.index == 3  # the last one before the cut is kept


def test_a_single_spoilt_frame_is_no_gap():
    frames = pan(np.arange(0.0, 20.0, 2.0))
    frames[4] = Frame(frames[4].stamp, np.zeros_like(frames[4].pixels))
    keys = chosen(frames)
    assert 4 not in [key.index for key in keys]
    assert not any(key.reason.startswith("gap") for key in keys)


def test_frames_are_read_one_by_one_and_key_images_come_out_on_the_way():
    read = []

    def frames():
        for i, angle in enumerate(np.arange(0.0, 60.0, 2.0)):
            read.append(i)
            yield Frame(0.1 * i, turned(angle))

    keys = choose_key_images(frames(), CAMERA, Choice(window=0.05))
    next(keys), next(keys)
    assert len(read) < 20


def test_progress_hears_of_every_frame():
    heard = []
    frames = pan(np.arange(0.0, 6.0, 1.0))
    chosen(frames, Choice(window=0.25), progress=lambda index, stamp: heard.append((index, stamp)))
    assert heard == [(i, frame.stamp) for i, frame in enumerate(frames)]


def test_the_same_frames_give_the_same_choice():
    frames = pan(np.linspace(0.0, 30.0, 16))
    first, second = chosen(frames), chosen(frames)
    assert [(k.index, k.reason, k.link) for k in first] == [(k.index, k.reason, k.link) for k in second]
    assert all(a.index < b.index for a, b in pairwise(first))


TICKS = counted()


def walked(angles, automatic: bool = True, gaps: bool = False) -> KeyImageWalk:
    walk = KeyImageWalk(CAMERA, Choice(window=0.05, gaps=gaps), automatic=automatic)
    return onward(walk, angles)


def onward(walk: KeyImageWalk, angles) -> KeyImageWalk:
    for angle in angles:
        walk.look(Frame(0.1 * next(TICKS), turned(angle)))
    return walk


def test_a_walk_shows_what_it_took_and_what_the_newest_key_image_shares_with_now():
    walk = walked(np.arange(0.0, 10.0, 2.0))
    assert [key.reason for key in walk.taken] == ["first"]
    assert abs(np.degrees(walk.link.yaw)) == pytest.approx(6.0, abs=0.5)  # the window before is compared
    onward(walk, np.arange(10.0, 24.0, 2.0))
    assert [key.reason for key in walk.taken] == ["first", "enough motion"]


def test_a_person_takes_the_newest_frame_once():
    walk = walked([0.0, 2.0, 4.0])
    assert walk.take("asked").frame.pixels is walk.taken[-1].frame.pixels
    assert np.array_equal(walk.taken[-1].frame.pixels, turned(4.0))
    assert walk.taken[-1].link.shared >= 40
    assert walk.take("asked") is None
    assert [key.reason for key in walk.taken] == ["first", "asked"]


def test_without_a_frame_there_is_nothing_to_take_or_undo_or_finish():
    walk = KeyImageWalk(CAMERA)
    walk.finish()
    assert (walk.take("asked"), walk.undo(), walk.taken) == (None, None, [])


def test_a_walk_that_is_not_automatic_takes_nothing_by_itself():
    walk = walked(np.arange(0.0, 30.0, 2.0), automatic=False)
    walk.finish()
    assert (walk.taken, walk.link) == ([], None)
    walk.take("asked")
    onward(walk, np.arange(30.0, 50.0, 2.0))
    walk.finish()
    assert len(walk.taken) == 1
    assert abs(np.degrees(walk.link.yaw)) == pytest.approx(18.0, abs=2.1)


def test_after_undo_nothing_is_taken_until_the_camera_was_back():
    walk = walked(np.arange(0.0, 20.0, 2.0))
    assert [key.reason for key in walk.taken] == ["first", "enough motion"]
    undone = walk.undo()
    assert undone.reason == "enough motion"
    onward(walk, np.arange(16.0, 22.0, 2.0))
    walk.finish()
    assert (len(walk.taken), walk.waiting) == (1, True)
    onward(walk, np.arange(20.0, -0.1, -2.0))
    assert not walk.waiting
    onward(walk, np.arange(0.0, -20.0, -2.0))
    assert [key.reason for key in walk.taken] == ["first", "enough motion"]
    assert walk.taken[-1].link.yaw * undone.link.yaw < 0.0  # the other way


def test_after_undo_a_person_goes_on_from_here():
    walk = walked(np.arange(0.0, 20.0, 2.0))
    walk.undo()
    walk.take("asked")
    onward(walk, np.arange(18.0, 40.0, 2.0))
    assert [key.reason for key in walk.taken] == ["first", "asked", "enough motion"]


def test_when_all_is_undone_the_path_begins_where_a_person_says():
    walk = walked([0.0, 2.0])
    walk.undo()
    onward(walk, np.arange(2.0, 30.0, 2.0))
    assert walk.taken == []
    walk.take("asked")
    assert [(key.reason, key.link) for key in walk.taken] == [("asked", None)]


def test_an_image_that_a_person_took_at_the_end_stays_the_last():
    walk = walked(np.arange(0.0, 10.0, 2.0))
    walk.take("asked")
    onward(walk, [8.0, 8.5, 9.0])
    walk.finish()
    assert [key.reason for key in walk.taken] == ["first", "asked"]


def test_where_gaps_are_not_taken_the_walk_waits_for_something_that_matches():
    walk = walked([0.0, 3.0, *[120.0 + i for i in range(12)]])
    walk.finish()
    assert not any(key.reason.startswith("gap") for key in walk.taken)
    assert all(
        np.array_equal(k.frame.pixels, turned(a)) for k, a in zip(walk.taken, (0.0, 3.0), strict=False)
    )
    assert walk.link.shared < 16


def test_where_gaps_are_not_taken_a_hover_at_the_start_makes_no_path():
    assert [key.reason for key in chosen(pan([0.0] * 4))] == ["first", "last"]
    walk = walked([0.0] * 4)
    walk.finish()
    assert [key.reason for key in walk.taken] == ["first"]
