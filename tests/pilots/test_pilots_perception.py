"""From pictures to views, on real photographs whose motion is known exactly."""

from dataclasses import replace

import numpy as np
import pytest
from pilots_pictures import CAMERA, Watcher, path_of, picture_of
from vision_photographs import HEIGHT, WIDTH, motion, moved, view

from noctule.camera import CameraMount, level_camera_rotation
from noctule.messages import ColumnBox, Picture
from noctule.pilots.law import Optics
from noctule.pilots.perception import match_key_image, safety_box
from noctule.pilots.settings import PilotSettings

NONE = np.empty((0, 2))


def off(seen, H):
    """Distances [px] of a view's points from where H takes the key image's."""
    return np.linalg.norm(seen.p_current - moved(H, seen.p_ref), axis=1)


def test_the_worker_finds_the_key_image_and_tells_picture_and_index():
    found = match_key_image(
        path_of("astronaut"), PilotSettings(), Picture(2.5, picture_of("astronaut", 9.0)), 0
    )
    assert (found.stamp, found.key_index, found.reason) == (2.5, 0, "")
    assert len(found.p_ref) >= 60
    error = np.linalg.norm(found.p_current - moved(motion(right=9.0), found.p_ref), axis=1)
    assert np.median(error) < 0.5


def test_the_worker_says_why_another_scene_is_not_the_key_image():
    found = match_key_image(path_of("astronaut"), PilotSettings(), Picture(0.0, picture_of("coffee")), 0)
    assert len(found.p_ref) == 0
    assert found.reason.endswith("14 are needed")


def test_a_match_in_an_older_picture_is_carried_to_the_newest_one():
    w = Watcher(path_of("astronaut"))
    w.show(picture_of("astronaut", 6.0))
    assert w.ask() == [0]
    asked = w.now
    for i in range(2, 5):
        assert w.show(picture_of("astronaut", 6.0 * i)) == {}
    seen = w.show(picture_of("astronaut", 30.0), w.match(stamp=asked))[0]
    assert seen.pose.stamp == w.now  # it is a view of the newest picture
    assert np.median(off(seen, motion(right=30.0))) < 0.5
    assert seen.estimate.t[0] == pytest.approx(30.0 / 510.0, abs=0.003)
    assert seen.epsilon_px == pytest.approx(30.0, abs=0.5)


def test_matched_points_are_followed_from_picture_to_picture():
    w = Watcher(path_of("astronaut"))
    w.begin(picture_of("astronaut"))
    for i in range(1, 6):
        seen = w.show(picture_of("astronaut", -5.0 * i, 2.0 * i))[0]
        assert np.median(off(seen, motion(right=-5.0 * i, down=2.0 * i))) < 0.5
    assert len(seen.p_ref) > 30


def test_only_points_inside_the_safety_box_of_the_key_image_are_followed():
    w = Watcher(path_of("astronaut"))
    w.begin(picture_of("astronaut"))
    p_ref = w.perception.tracks[0].p_ref
    assert safety_box(WIDTH, HEIGHT).contains(p_ref).all()
    assert not safety_box(WIDTH, HEIGHT).contains(w.match().p_ref).all()


def test_the_safety_box_leaves_the_same_margin_on_both_sides():
    box = safety_box(WIDTH, HEIGHT)
    assert box.left == pytest.approx(WIDTH - 1 - box.right)
    assert box.top == pytest.approx(HEIGHT - 1 - box.bottom)


def test_no_more_points_are_followed_than_the_settings_say():
    w = Watcher(path_of("astronaut"), max_points=30)
    w.begin(picture_of("astronaut"))
    assert len(w.perception.tracks[0]) == 30


def test_an_image_gets_no_more_points_than_its_share_and_they_are_spread():
    w = Watcher(path_of("astronaut"))
    w.show(picture_of("astronaut"))
    w.ask()
    w.show(picture_of("astronaut"), w.match(), share=20)
    p = w.perception.tracks[0].p
    assert 16 <= len(p) <= 20
    assert (np.ptp(p, axis=0) > [0.5 * WIDTH, 0.5 * HEIGHT]).all()


def test_key_images_that_are_no_longer_wanted_are_dropped():
    w = Watcher(path_of("astronaut", "coffee"))
    w.begin(picture_of("astronaut"))
    assert set(w.show(picture_of("astronaut"), wanted=(0, 1))) == {0}
    assert w.show(picture_of("astronaut"), wanted=(1, 2)) == {}
    assert w.perception.tracks == {}


def test_a_match_that_comes_when_it_is_no_longer_wanted_or_was_never_asked_for_is_ignored():
    w = Watcher(path_of("astronaut", "coffee"))
    w.show(picture_of("astronaut"))
    assert w.show(picture_of("astronaut"), w.match()) == {}  # never asked for
    w.ask()
    assert w.show(picture_of("astronaut"), w.match(), wanted=(1,)) == {}


def test_points_of_another_place_are_dropped_after_a_while_and_never_used():
    w = Watcher(path_of("astronaut"))
    w.begin(picture_of("astronaut"))
    tracks = w.perception.tracks[0]
    wrong = tracks.p_ref.copy()
    wrong[:5] += [35.0, -25.0]
    w.perception.tracks[0] = replace(tracks, p_ref=wrong)
    sizes = []
    for _ in range(7):
        seen = w.show(picture_of("astronaut"))[0]
        assert off(seen, np.eye(3)).max() < 10.0
        sizes.append(len(w.perception.tracks[0]))
    assert sizes[0] > sizes[-1]
    assert not (np.linalg.norm(w.perception.tracks[0].p_ref[:, None] - wrong[:5], axis=2) < 1e-9).any()


def test_too_few_points_are_no_view():
    w = Watcher(path_of("astronaut"))
    w.begin(picture_of("astronaut"))
    w.perception.tracks[0] = w.perception.tracks[0].kept(np.arange(len(w.perception.tracks[0])) < 15)
    assert w.show(picture_of("astronaut")) == {}


def test_without_a_picture_there_is_no_view_and_nothing_is_lost():
    w = Watcher(path_of("astronaut"))
    w.begin(picture_of("astronaut"))
    stamp = w.perception.picture_stamp
    assert w.show(None) == {}
    assert w.perception.picture_stamp == stamp
    assert 0 in w.show(picture_of("astronaut"))


def test_a_view_is_fresh_only_when_points_of_a_new_match_joined():
    w = Watcher(path_of("astronaut"))
    assert w.begin(picture_of("astronaut"))[0].fresh
    assert not w.show(picture_of("astronaut"))[0].fresh
    w.tick += 30
    w.show(picture_of("astronaut"))
    assert w.ask() == [0]
    assert w.show(picture_of("astronaut"), w.match())[0].fresh
    assert not w.show(picture_of("astronaut"))[0].fresh


def test_a_match_without_success_is_kept_as_its_reason_until_one_succeeds():
    w = Watcher(path_of("astronaut"))
    w.show(picture_of("coffee"))
    w.ask()
    assert w.show(picture_of("coffee"), w.match()) == {}
    assert w.perception.reasons[0].endswith("14 are needed")
    w.tick += 30
    w.begin(picture_of("astronaut"))
    assert w.perception.reasons[0] == ""


def tilted(roll, pitch):
    """The homography from the levelled camera's picture to that of a camera tilted with the body."""
    K = CAMERA.K
    return K @ level_camera_rotation(roll, pitch).T @ np.linalg.inv(K)


def seen_tilted(stabilised, roll, pitch):
    w = Watcher(path_of("astronaut", stabilised=stabilised))
    level = picture_of("astronaut")
    w.show(level)
    w.ask()
    asked = w.now
    H = tilted(roll, pitch)
    seen = w.show(view("astronaut", H, seed=3), w.match(stamp=asked), roll=roll, pitch=pitch)
    return seen[0], H


def test_the_tilt_of_a_camera_that_is_not_stabilised_is_taken_out():
    seen, H = seen_tilted(False, np.radians(2.0), np.radians(-3.0))
    assert np.median(off(seen, H)) < 0.5
    assert np.linalg.norm(seen.estimate.t) < 0.004
    assert abs(seen.estimate.yaw) < np.radians(0.15)
    # What a stabilised camera would have made of the same picture.
    assert np.linalg.norm(seen_tilted(True, np.radians(2.0), np.radians(-3.0))[0].estimate.t) > 0.03


def test_a_quick_turn_between_match_and_picture_is_foreseen_by_the_odometry():
    # 12 deg to the left between the two pictures: the points move right by 108 px.
    w = Watcher(path_of("astronaut"))
    w.show(picture_of("astronaut"), yaw=0.0)
    w.ask()
    asked = w.now
    turn = np.radians(12.0)
    c, s = np.cos(turn), np.sin(turn)
    H = CAMERA.K @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]) @ np.linalg.inv(CAMERA.K)
    seen = w.show(view("astronaut", H, seed=4), w.match(stamp=asked), yaw=turn)[0]
    assert np.median(off(seen, H)) < 0.6
    assert seen.estimate.yaw == pytest.approx(turn, abs=np.radians(0.3))


def test_drift_is_taken_out_where_the_picture_looks_like_the_key_image():
    w = Watcher(path_of("astronaut"))
    w.begin(picture_of("astronaut"))
    tracks = w.perception.tracks[0]
    w.perception.tracks[0] = replace(tracks, p=tracks.p + np.array([1.5, -1.0]))
    for _ in range(4):
        seen = w.show(picture_of("astronaut"))[0]
    assert np.median(off(seen, np.eye(3))) < 0.3


def test_the_same_pictures_give_the_same_views_bit_for_bit():
    def run():
        w = Watcher(path_of("astronaut"))
        w.begin(picture_of("astronaut"))
        return [w.show(picture_of("astronaut", -5.0 * i, 2.0 * i))[0] for i in range(1, 4)]

    for a, b in zip(run(), run(), strict=True):
        assert (a.p_current == b.p_current).all()
        assert (a.estimate.H == b.estimate.H).all()
        assert (a.estimate.covariance == b.estimate.covariance).all()


def box(left, right, row=240.0):
    return ColumnBox(left, 0.0, right, 479.0, np.array([left, row]), np.array([right, row]))


def optics(stabilised=True):
    return Optics(CAMERA, CameraMount(stabilised=stabilised))


def test_edges_are_bearings_positive_to_the_left():
    left, right = optics().edges((box(CAMERA.cx - 51.0, CAMERA.cx + 51.0),), 0.0, 0.0)[0]
    assert left == pytest.approx(np.arctan(0.1))
    assert right == pytest.approx(-np.arctan(0.1))


def test_an_edge_at_the_border_of_the_picture_is_not_the_columns():
    right, left = box(0.0, 40.0), box(800.0, WIDTH - 1.0)
    cut_left, cut_right = optics().edges((right, left), 0.0, 0.0)
    assert [edge is None for edge in cut_left] == [True, False]
    assert [edge is None for edge in cut_right] == [False, True]
    assert optics().edges((box(0.0, WIDTH - 1.0),), 0.0, 0.0) == [(None, None)]
    whole = optics().edges((box(2.0, WIDTH - 3.0),), 0.0, 0.0)[0]
    assert None not in whole


def test_edges_are_those_of_the_levelled_camera():
    roll, pitch = np.radians(3.0), np.radians(-2.0)
    level = np.array([[300.0, 240.0], [330.0, 240.0]])
    p = moved(tilted(roll, pitch), level)
    column = ColumnBox(*p[0], *p[1], p[0], p[1])
    expected = [-np.arctan(x) for x in CAMERA.normalise(level)[:, 0]]
    assert optics(False).edges((column,), roll, pitch)[0] == pytest.approx(expected)
    assert optics(True).edges((column,), roll, pitch)[0] != pytest.approx(expected, abs=1e-3)


def test_a_method_that_cannot_tell_outliers_flies_on_all_points():
    w = Watcher(path_of("astronaut"), method="generic")
    w.begin(picture_of("astronaut", 20.0))
    tracks = w.perception.tracks[0]
    wrong = tracks.p_ref.copy()
    wrong[:5] += [35.0, -25.0]
    w.perception.tracks[0] = replace(tracks, p_ref=wrong)
    for _ in range(8):
        seen = w.show(picture_of("astronaut", 20.0))[0]
    assert (off(seen, motion(right=20.0)) > 30.0).sum() == 5
