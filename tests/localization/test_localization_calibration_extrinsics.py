"""Where a camera hangs: recovered to millimetres, and refused where board and depth disagree."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from localization_boards import BOARD, floor_depth, floor_picture

from noctule.camera import CEILING_CAMERA, PinholeCamera
from noctule.geometry import rot_x, rot_z
from noctule.localization.calibration.board import Board, BoardView, find_board
from noctule.localization.calibration.extrinsics import (
    BoardPlace,
    NoPoseError,
    ViewSizeError,
    locate_camera,
)
from noctule.localization.calibration.extrinsics_judgement import (
    DepthSizeError,
    PlaneCheck,
    PoorExtrinsicsError,
    check_depth,
    extrinsics_faults,
    fit_floor,
    floor_plane,
    require_sound_pose,
)
from noctule.localization.calibration.floor import Plane, PlaneFit, fit_plane, inside_outline
from noctule.localization.calibration.lens import Lens
from noctule.localization.calibration.pose_fit import (
    Corners,
    WorldInCamera,
    refine,
    system,
)

LARGE = Board(square=0.14, marker=0.105)
K = CEILING_CAMERA.intrinsics
PLACES = [BoardPlace(), BoardPlace(-0.8, -0.4, 1.0), BoardPlace(0.5, -1.0, -2.0)]


def seen(place, board=LARGE, camera=CEILING_CAMERA, seed=0, **options):
    origin = place.to_world(np.zeros((1, 3)))[0]
    picture = floor_picture(camera, rot_z(place.heading), origin, board=board, seed=seed, **options)
    return find_board(board, picture, f"{seed}.png")


def with_board(depth, place, board=LARGE, camera=CEILING_CAMERA, seed=1):
    """A depth image of the floor with a board of some thickness on it."""
    face = floor_depth(camera, height=place.height, noise=0.012, seed=seed)
    on_board = inside_outline(camera.project(place.to_world(board.outline)), camera.intrinsics)
    return np.where(on_board, face, depth)


def off(found, camera=CEILING_CAMERA):
    """Rotation [deg] and distance [m] between the pose found and the true one."""
    turn, _ = cv2.Rodrigues(found.camera.R_world_camera @ camera.R_world_camera.T)
    return np.degrees(np.linalg.norm(turn)), np.linalg.norm(
        found.camera.t_world_camera - camera.t_world_camera
    )


@pytest.fixture(scope="module")
def floor():
    return floor_depth(CEILING_CAMERA, noise=0.012)


@pytest.fixture(scope="module")
def views():
    return [seen(place, seed=k) for k, place in enumerate(PLACES)]


@pytest.fixture(scope="module")
def found(views):
    return locate_camera(views, PLACES, K)


def test_a_board_at_three_places_gives_the_pose_to_millimetres(found):
    angle, distance = off(found)
    assert angle < 0.1
    assert distance < 0.005
    assert found.residual < 0.2
    assert extrinsics_faults(found) == []
    assert require_sound_pose(found) is found


def test_the_truth_lies_within_the_deviations_told(found):
    angle, _ = off(found)
    assert np.radians(angle) < 4.0 * found.sd_angle
    error = np.abs(found.camera.t_world_camera - CEILING_CAMERA.t_world_camera)
    assert (error < 4.0 * found.sd_position).all()
    assert np.linalg.norm(found.sd_position) < 0.006


def test_depth_of_the_floor_makes_one_picture_enough(floor):
    place = BoardPlace(0.3, -0.6, 2.0, 0.01)
    view = seen(place, board=BOARD)
    alone = locate_camera([view], [place], K)
    checks = check_depth(alone, BOARD, [with_board(floor, place, BOARD)])
    assert [check.what for check in checks] == ["board", "floor"]
    helped = locate_camera([view], [place], K, floor=checks[1].fit.plane)
    assert off(helped)[0] < 0.25
    assert off(helped)[1] < 0.010
    assert off(helped)[1] < off(alone)[1]
    assert helped.sd_angle < 0.6 * alone.sd_angle
    assert extrinsics_faults(helped, checks) == []
    # Without it the same picture is refused: the board is small and far.
    assert extrinsics_faults(alone)[-1].endswith("; lay the board at more places, or use a larger one")


def test_thickness_and_place_of_the_board_are_taken_into_account(floor):
    place = BoardPlace(-0.2, 0.1, -0.7, 0.03)
    view = seen(place)
    right = locate_camera([view], [place], K)
    assert off(right)[1] < 0.02
    flat = locate_camera([view], [replace(place, height=0.0)], K)
    lower = right.camera.t_world_camera[2] - flat.camera.t_world_camera[2]
    assert lower == pytest.approx(0.03, abs=1e-6)
    board, whole = check_depth(right, LARGE, [with_board(floor, place)])
    assert whole.distance - board.distance == pytest.approx(0.03, abs=0.004)
    assert abs(board.farther) < 0.006
    assert abs(whole.farther) < 0.006


def test_the_lens_is_taken_out_first():
    lens = Lens(-0.1, 0.03)
    views = [seen(place, seed=k, lens=lens) for k, place in enumerate(PLACES)]
    right, wrong = (locate_camera(views, PLACES, K, one) for one in (lens, Lens()))
    assert off(right)[1] < 0.006
    assert off(wrong)[1] > 0.02
    assert wrong.residual > 3.0 * right.residual


def test_intrinsics_less_certain_make_the_pose_less_certain(views, found):
    unsure = locate_camera(views, PLACES, K, camera_sd=np.array([3.0, 3.0, 2.0, 2.0]))
    assert (unsure.sd_position > found.sd_position).all()
    # A focal length 0.6 % off is a distance 0.6 % off.
    assert unsure.sd_position[2] == pytest.approx(3.3 * 3.0 / 528.0, rel=0.5)
    np.testing.assert_array_equal(unsure.camera.t_world_camera, found.camera.t_world_camera)


def test_a_stray_corner_does_not_pull_the_pose(views, found):
    p = views[0].p.copy()
    p[3] += 3.0
    strayed = locate_camera([replace(views[0], p=p), *views[1:]], PLACES, K)
    assert len(strayed.views[0].p) == len(p) - 1
    assert np.linalg.norm(strayed.camera.t_world_camera - found.camera.t_world_camera) < 0.002


def test_squares_of_another_size_are_told_by_depth(floor):
    place = BoardPlace()
    wrong = Board(square=0.147, marker=0.11025)
    view = replace(seen(place), x_board=seen(place).x_board * 1.05)
    found = locate_camera([view], [place], K)
    checks = check_depth(found, wrong, [floor])
    line = extrinsics_faults(found, checks)[-1]
    floor_check = checks[-1]
    by_corners, by_depth = floor_check.distance, floor_check.distance + floor_check.farther
    assert by_depth / by_corners == pytest.approx(1.0 / 1.05, abs=0.004)
    assert line == (
        f"picture 0.png: the floor is {by_corners:.3f} m away by the board's corners, {by_depth:.3f} m by "
        f"depth, expected to agree within {15.0 * by_corners:.0f} mm; are the board's squares as large as "
        f"you said? by depth they are {by_depth / by_corners:.3f} times that"
    )
    with pytest.raises(PoorExtrinsicsError):
        require_sound_pose(found, checks)


def test_a_board_that_leans_on_something_is_told_by_depth(floor):
    tilted = rot_x(np.radians(6.0))
    view = find_board(LARGE, floor_picture(CEILING_CAMERA, tilted, [0.0, -0.5, 0.0], board=LARGE), "a.png")
    place = BoardPlace(0.0, -0.5)
    found = locate_camera([view], [place], K)
    (line,) = [one for one in extrinsics_faults(found, check_depth(found, LARGE, [floor])) if "r by" in one]
    assert line.startswith("picture a.png: the floor by depth is tilted by ")
    assert line.endswith(
        " deg against the board's corners, expected 1.5 deg or less; does the board lie flat on the floor, "
        "and is the depth image registered to the picture?"
    )
    angle = float(line.split("tilted by ")[1].split(" deg")[0])
    assert angle == pytest.approx(6.0, abs=1.0)


def check(what, farther=0.0, angle=0.0):
    plane = Plane(np.array([0.0, 0.0, -1.0]), 3.0)
    return PlaneCheck(what, "a.png", PlaneFit(plane, 9000, 0.01), 3.0, farther, np.radians(angle))


def test_every_disagreement_is_a_line_of_its_own(found):
    small = [check("board", 0.044, 2.9), check("floor", -0.044, 1.4)]
    assert extrinsics_faults(found, small) == []
    assert extrinsics_faults(found, [check("board", 0.06, 4.0)]) == [
        "picture a.png: the board is 3.000 m away by the board's corners, 3.060 m by depth, expected to "
        "agree within 45 mm; are the board's squares as large as you said? by depth they are 1.020 "
        "times that",
        "picture a.png: the board by depth is tilted by 4.0 deg against the board's corners, expected 3 deg "
        "or less; does the board lie flat on the floor, and is the depth image registered to the picture?",
    ]


def test_a_poor_fit_is_told_with_its_worst_picture(found):
    bad = (found.residuals[0], found.residuals[1] + 3.0, found.residuals[2])
    poor = replace(found, residuals=bad)
    (line,) = extrinsics_faults(poor)
    assert line == (
        f"extrinsics: the residual is {poor.residual:.2f} px rms, expected 1 px or less, worst in 1.png; is "
        "the board flat, and where you said that it lies?"
    )


def test_a_place_that_was_not_where_the_board_lay_is_told(views):
    wrong = [PLACES[0], PLACES[1], replace(PLACES[2], x=0.7)]
    answer = locate_camera(views, wrong, K)
    assert extrinsics_faults(answer)[0].startswith("extrinsics: the residual is ")


def test_two_poses_that_fit_alike_are_told(found):
    poor = replace(found, other_residual=1.5 * found.residual)
    assert extrinsics_faults(poor) == [
        f"extrinsics: two poses fit the corners ({found.residual:.2f} and {1.5 * found.residual:.2f} px); "
        "give the depth image with --depth, lay the board nearer, or use a larger one"
    ]


def test_a_pose_hardly_known_is_told(found):
    poor = replace(found, sd_position=np.array([0.03, 0.0, 0.04]), sd_angle=np.radians(0.62))
    assert extrinsics_faults(poor) == [
        "extrinsics: the pose is known to 50 mm and 0.62 deg only (sd), expected 15 mm and 0.30 deg or less; "
        "lay the board at more places, or use a larger one"
    ]


def test_a_small_board_far_away_has_a_second_pose_that_depth_rejects(floor):
    place = BoardPlace()
    view = seen(place, board=BOARD)
    alone = locate_camera([view], [place], K)
    assert alone.residual < alone.other_residual < 6.0 * alone.residual
    # Even where the corners alone are mistaken, depth is not.
    rng = np.random.default_rng(5)
    noisy = replace(view, p=view.p + rng.normal(0.0, 1.0, view.p.shape))
    fit = fit_floor(floor, K, floor_plane(alone))
    helped = locate_camera([noisy], [place], K, floor=fit.plane)
    assert helped.other_residual == np.inf
    assert off(helped)[0] < 1.5


def test_a_picture_of_another_size_is_refused(views):
    with pytest.raises(ViewSizeError) as told:
        locate_camera(views[:1], PLACES[:1], PinholeCamera.centred(1280, 960, 1000.0))
    assert str(told.value) == (
        "picture 0.png: it is 640x480 px, the intrinsics are for 1280x960 px; take it with the camera as it "
        "was calibrated"
    )


def test_a_board_seen_from_behind_has_no_pose(views):
    mirrored = replace(views[0], x_board=views[0].x_board * np.array([-1.0, 1.0, 1.0]))
    with pytest.raises(NoPoseError) as told:
        locate_camera([mirrored], PLACES[:1], K)
    assert str(told.value) == (
        "picture 0.png: no pose of the camera explains its corners; are board and intrinsics those of this "
        "camera?"
    )


def test_depth_of_another_size_is_refused(found):
    with pytest.raises(DepthSizeError) as told:
        check_depth(found, LARGE, [np.zeros((240, 320), dtype=np.uint16), None, None])
    assert str(told.value) == (
        "depth image of 0.png: it is 320x240 px, the picture 640x480 px; expected depth registered to the "
        "picture"
    )


def test_no_depth_is_nothing_to_compare_with(found):
    assert check_depth(found, LARGE, [None, None, None]) == []
    assert check_depth(found, LARGE, [np.zeros((480, 640), dtype=np.uint16), None, None]) == []


def test_the_jacobian_is_that_of_finite_differences(found):
    pose = WorldInCamera(CEILING_CAMERA.R_world_camera.T, np.array([0.2, 0.1, 3.4]))
    x = PLACES[1].to_world(LARGE.outline)
    corners = Corners(x, np.zeros((4, 2)))
    plane = Plane(np.array([0.1, 0.2, -np.sqrt(0.95)]), 3.2)
    value, J = system(pose, corners, K, plane, 0.3)
    numeric = np.zeros_like(J)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-6
        moved = WorldInCamera(cv2.Rodrigues(step[:3])[0] @ pose.R, pose.t + step[3:])
        numeric[:, k] = -(system(moved, corners, K, plane, 0.3)[0] - value) / 1e-6
    np.testing.assert_allclose(J, numeric, rtol=1e-3, atol=1e-2)


def test_the_fit_ends_at_a_minimum(found, views):
    x = np.concatenate([place.to_world(v.x_board) for place, v in zip(PLACES, views, strict=True)])
    corners = Corners(x, np.concatenate([view.p for view in views]))
    start = WorldInCamera(CEILING_CAMERA.R_world_camera.T, np.array([0.0, 0.0, 3.0]))
    pose = refine(start, corners, K, None, 0.1)
    residuals, J = system(pose, corners, K, None, 0.1)
    assert np.abs(J.T @ residuals).max() < 1e-3 * np.linalg.norm(J) * np.linalg.norm(residuals)


def test_a_plane_is_fitted_through_noise_and_things_that_stand_on_it():
    depth = floor_depth(CEILING_CAMERA, noise=0.012)
    depth[100:200, 100:200] = 2500
    depth[300:400] = 0
    fit = fit_plane(depth, K, np.ones(depth.shape, dtype=bool))
    truth = Plane.through(
        CEILING_CAMERA.R_world_camera.T, -CEILING_CAMERA.R_world_camera.T @ CEILING_CAMERA.t_world_camera
    )
    assert np.degrees(fit.plane.angle_to(truth)) < 0.1
    assert fit.plane.distance == pytest.approx(3.321, abs=0.004)
    assert fit.scatter == pytest.approx(0.016, abs=0.006)


def test_too_few_readings_are_no_plane():
    depth = np.zeros((480, 640), dtype=np.uint16)
    depth[:10, :10] = 3000
    assert fit_plane(depth, K, np.ones(depth.shape, dtype=bool)) is None
    noise = np.random.default_rng(0).integers(500, 9000, (480, 640)).astype(np.uint16)
    assert fit_plane(noise, K, inside_outline(np.array([[0, 0], [15, 0], [15, 14], [0, 14]]), K)) is None


def test_a_plane_knows_its_depth_and_its_parallels():
    plane = Plane.through(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 2.0]))
    np.testing.assert_allclose(plane.depth_at(np.array([[0.3, 0.1], [0.0, 0.0]])), 2.0)
    assert plane.lowered(0.5).depth_at(np.zeros((1, 2)))[0] == pytest.approx(2.5)
    tilted = Plane(rot_x(0.2) @ plane.normal, 2.0)
    assert plane.angle_to(tilted) == pytest.approx(0.2)
    assert isinstance(plane.depth_at(np.zeros((3, 2))), np.ndarray)


def test_the_same_pictures_give_the_same_pose_bit_for_bit(views, found):
    again = locate_camera([BoardView(v.name, v.size, v.p, v.x_board, v.edge_width) for v in views], PLACES, K)
    np.testing.assert_array_equal(again.camera.R_world_camera, found.camera.R_world_camera)
    np.testing.assert_array_equal(again.camera.t_world_camera, found.camera.t_world_camera)
