"""Intrinsics: the truth is recovered, and a poor set of pictures is refused with what to retake."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import cv2
import numpy as np
import pytest
from localization_boards import BOARD, CAMERA, CAREFUL, held, photograph

from noctule.camera import PinholeCamera
from noctule.flight.footage import read_camera
from noctule.localization.calibration.board import find_board
from noctule.localization.calibration.camera_files import (
    CameraIntrinsics,
    load_intrinsics,
    save_intrinsics,
)
from noctule.localization.calibration.intrinsics import (
    LeftOut,
    PictureSizesError,
    TooFewPicturesError,
    calibrate_intrinsics,
    coverage,
)
from noctule.localization.calibration.judgement import (
    PoorIntrinsicsError,
    intrinsics_faults,
    require_sound,
)
from noctule.localization.calibration.lens import Lens, straightener
from noctule.messages import DepthFrame

BENT = Lens(-0.12, 0.05, 0.001, -0.0008)


def views(poses, names=None, **options):
    names = names or [f"{k:02}.png" for k in range(len(poses))]
    return [
        find_board(BOARD, photograph(*held(*pose), seed=k, **options), name)
        for k, (pose, name) in enumerate(zip(poses, names, strict=True))
    ]


@pytest.fixture(scope="module")
def sharp():
    return views(CAREFUL)


@pytest.fixture(scope="module")
def found(sharp):
    return calibrate_intrinsics(sharp)


@pytest.fixture(scope="module")
def bent():
    return calibrate_intrinsics(views(CAREFUL, lens=BENT))


def test_the_focal_length_is_found_to_two_thousandths_and_the_centre_to_a_pixel(found):
    np.testing.assert_allclose(found.camera.focal, CAMERA.focal, rtol=0.002)
    np.testing.assert_allclose(found.camera.centre, CAMERA.centre, atol=1.0)
    assert found.residual < 0.1
    assert (found.camera.width, found.camera.height) == (640, 480)
    assert found.lens.largest_shift(found.camera) < 0.5
    assert intrinsics_faults(found) == []
    assert require_sound(found) is found


def test_the_lens_is_found_beside_them(bent):
    np.testing.assert_allclose(bent.camera.focal, CAMERA.focal, rtol=0.002)
    np.testing.assert_allclose(bent.camera.centre, CAMERA.centre, atol=1.0)
    assert BENT.largest_shift(CAMERA) > 15.0
    u, v = np.meshgrid(np.linspace(60, 580, 9), np.linspace(60, 420, 7))
    p = np.column_stack([u.ravel(), v.ravel()])
    np.testing.assert_allclose(
        bent.camera.normalise(bent.lens.straighten(p, bent.camera)),
        CAMERA.normalise(BENT.straighten(p, CAMERA)),
        atol=1.0 / CAMERA.fx,
    )
    assert intrinsics_faults(bent) == []


def test_the_truth_lies_within_the_deviations_told(found, bent):
    for one in (found, bent):
        off = np.array([*(one.camera.focal - CAMERA.focal), *(one.camera.centre - CAMERA.centre)])
        assert (np.abs(off) < 4.0 * one.sd).all()
        assert (one.sd < 1.0).all()


def test_boards_are_where_they_were_held(found):
    for one in found.used:
        R, t = held(*CAREFUL[int(one.view.name[:2])])
        np.testing.assert_allclose(one.t_camera_board, t, atol=0.003)
        np.testing.assert_allclose(one.R_camera_board, R, atol=0.01)
        assert one.tilt == pytest.approx(np.arccos(abs(R[2, 2])), abs=0.01)


def test_a_stray_corner_costs_itself_and_not_its_picture(found, sharp):
    assert found.left_out == ()
    assert sum(len(one.view.p) for one in found.used) == sum(len(view.p) for view in sharp) - 1


def test_a_blurred_picture_is_left_out_and_named(sharp):
    (blurred,) = views(CAREFUL[:1], ["blurred.png"], blur=2.5)
    answer = calibrate_intrinsics([*sharp, blurred])
    assert [str(one) for one in answer.left_out] == [
        f"picture blurred.png: left out: blurred, its edges are {blurred.edge_width:.1f} px wide, expected "
        "4.5 or less; retake it with board and camera still"
    ]
    assert len(answer.used) == len(sharp)


def test_a_bent_board_is_left_out_and_named(sharp):
    curved = replace(sharp[0], name="curved.png", p=sharp[0].p + 40.0 * (sharp[0].x_board[:, :2] - 0.3) ** 2)
    answer = calibrate_intrinsics([*sharp[1:], curved])
    (left,) = answer.left_out
    assert left.name == "curved.png"
    assert left.reason.startswith("its residual is ")
    assert left.reason.endswith("; retake it with a flat board that nobody moves")
    np.testing.assert_allclose(answer.camera.focal, CAMERA.focal, rtol=0.002)


def test_too_few_pictures_are_refused_with_every_one_that_is_no_good(sharp):
    with pytest.raises(TooFewPicturesError) as told:
        calibrate_intrinsics(sharp[:6], [LeftOut("a.png", "no board is seen")])
    assert str(told.value).splitlines() == [
        "calibration: 6 of 7 pictures can be used, expected 8 or more; take more, 15 to 20 do well",
        "picture a.png: left out: no board is seen",
    ]
    with pytest.raises(TooFewPicturesError):
        calibrate_intrinsics([])


def test_pictures_of_two_sizes_are_refused(sharp):
    other = replace(sharp[3], name="small.png", size=(320, 240))
    with pytest.raises(PictureSizesError) as told:
        calibrate_intrinsics([*sharp[:3], other, *sharp[4:]])
    assert str(told.value) == (
        "calibration: picture small.png is 320x240 px, most are 640x480 px; expected pictures of one camera "
        "at one size, not cropped"
    )


@pytest.mark.parametrize("tilt", [(0, 0), (2, -1), (30, 0)])
def test_boards_all_at_one_angle_do_not_tell_the_focal_length(tilt):
    answer = calibrate_intrinsics(views([(*tilt, *pose[2:]) for pose in CAREFUL]))
    (line,) = [one for one in intrinsics_faults(answer) if "focal" in one]
    share = float((answer.sd[:2] / answer.camera.focal).max())
    known = f"known to {share:.1%} only (sd)" if share < 1.0 else "not known at all"
    assert line == (
        f"calibration: the focal length is {known}, expected 0.3% or less; the boards were all seen at "
        "nearly the same angle; retake every other one (00.png, 02.png, 04.png, 06.png, 08.png, 10.png and 1 "
        "more) with the board tilted by 30 to 45 degrees, some to the left, some right, up and down"
    )
    with pytest.raises(PoorIntrinsicsError):
        require_sound(answer)


@pytest.mark.parametrize("most", [4.0, 8.0])
def test_little_tilt_gives_a_deviation_that_is_honest(most):
    rng = np.random.default_rng(1)
    poses = [(*rng.uniform(-most, most, 2), *pose[2:]) for pose in CAREFUL]
    answer = calibrate_intrinsics(views(poses))
    assert intrinsics_faults(answer) != []
    assert abs(answer.camera.fx - CAMERA.fx) < 4.0 * answer.sd[0]


def test_a_part_of_the_picture_without_boards_is_named():
    poses = [(*pose[:3], (170 + 0.2 * pose[3][0], pose[3][1]), 1.3) for pose in CAREFUL]
    answer = calibrate_intrinsics(views(poses))
    assert (coverage(answer)[:, 6:] == 0).all()
    assert intrinsics_faults(answer)[0] == (
        "calibration: the board was hardly ever in the upper right and lower right of the picture; take two "
        "more pictures with it there, up to the border"
    )


def test_little_of_the_picture_covered_is_told(found):
    u, v = np.meshgrid([100, 180, 420, 500], [60, 140, 340, 420])
    p = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    one = replace(found.used[0], view=replace(found.used[0].view, p=p), residuals=np.zeros((16, 2)))
    assert intrinsics_faults(replace(found, used=(one,))) == [
        "calibration: the boards cover 33% of the picture, expected 50% or more; take more pictures, nearer, "
        "and towards the borders"
    ]


def test_a_large_residual_is_told_with_the_worst_pictures(found):
    worse = tuple(
        replace(one, residuals=np.full((len(one.view.p), 2), 0.6 + 0.1 * k))
        for k, one in enumerate(found.used)
    )
    (line,) = intrinsics_faults(replace(found, used=worse))
    names = ", ".join(f"{k}.png ({np.sqrt(2.0) * (0.6 + 0.1 * k):.2f} px)" for k in (12, 11, 10))
    total = replace(found, used=worse).residual
    assert line == (
        f"calibration: the residual is {total:.2f} px rms, expected 0.5 px or less; is the board flat and "
        f"stiff? the worst to retake: {names}"
    )


def test_a_focal_length_or_centre_hardly_known_is_told(found):
    (line,) = intrinsics_faults(replace(found, sd=np.array([6.0, 6.0, 9.0, 9.0])))
    assert line == (
        "calibration: the focal length is known to 1.1% only (sd), expected 0.3% or less; take twice as many "
        "pictures, with the board nearer and tilted more"
    )
    (line,) = intrinsics_faults(replace(found, sd=np.array([0.3, 0.3, 5.0, 1.0])))
    assert line == (
        "calibration: the principal point is known to 5.0 px only (sd), expected 3.8 px or less; take more "
        "pictures, some with the board turned by 90 degrees, tilted left, right, up and down"
    )


def test_a_refusal_names_what_was_left_out_too(found):
    poor = replace(found, sd=np.full(4, np.inf), left_out=(LeftOut("a.png", "no board is seen"),))
    with pytest.raises(PoorIntrinsicsError) as told:
        require_sound(poor)
    lines = str(told.value).splitlines()
    assert lines[0].startswith("calibration: the focal length is not known at all, expected 0.3% or less; ")
    assert lines[1:] == ["picture a.png: left out: no board is seen"]


def test_noctule_teach_reads_the_camera_file(tmp_path, bent):
    save_intrinsics(tmp_path, CameraIntrinsics(bent.camera, bent.lens, bent.sd))
    assert read_camera(tmp_path / "teach-camera.toml").intrinsics == bent.camera
    back = load_intrinsics(tmp_path)
    assert (back.camera, back.lens) == (bent.camera, bent.lens)
    np.testing.assert_array_equal(back.sd, bent.sd)
    assert tomllib.loads((tmp_path / "intrinsics.toml").read_text())["format"] == 1


def test_intrinsics_that_were_never_found_are_asked_for(tmp_path):
    from noctule.localization.site_files import SiteFileError

    with pytest.raises(SiteFileError) as told:
        load_intrinsics(tmp_path)
    assert str(told.value) == (
        f"site file {tmp_path}/intrinsics.toml: is missing; find them with `noctule calibrate camera "
        "PICTURES`"
    )


def test_a_picture_without_distortion_is_what_a_pinhole_takes():
    pose = held(25, -20, 10, (330, 230), 0.9)
    straight = straightener(CAMERA, BENT).picture(photograph(*pose, lens=BENT, noise=0.0))
    view = find_board(BOARD, straight, "a.png")
    R, t = pose
    assert np.abs(view.p - CAMERA.project(view.x_board @ R.T + t)).max() < 0.3


def test_depth_without_distortion_holds_no_reading_that_was_not_taken():
    depth = np.full((480, 640), 3000, dtype=np.uint16)
    depth[:, 320:] = 1000
    depth[100:120] = 0
    straight = straightener(CAMERA, BENT).depth(depth)
    assert set(np.unique(straight)) == {0, 1000, 3000}
    assert straight.dtype == np.uint16
    # Barrel distortion: the corners of the picture come from further inside.
    assert (straightener(CAMERA, Lens(0.3)).depth(depth)[0, 0], straight[0, 0]) == (0, 3000)


def test_a_frame_without_colour_stays_without():
    depth = np.full((480, 640), 3000, dtype=np.uint16)
    line = straightener(CAMERA, BENT)
    assert line.frame(DepthFrame(1.5, depth)).colour is None
    colour = np.full((480, 640, 3), 7, dtype=np.uint8)
    frame = line.frame(DepthFrame(1.5, depth, colour))
    assert (frame.stamp, frame.colour.shape) == (1.5, (480, 640, 3))


def test_no_lens_changes_nothing():
    depth = np.random.default_rng(0).integers(0, 4000, (480, 640)).astype(np.uint16)
    np.testing.assert_array_equal(straightener(CAMERA, Lens()).depth(depth), depth)
    assert Lens().largest_shift(CAMERA) == pytest.approx(0.0, abs=1e-9)
    p = np.array([[3.0, 4.0]])
    assert Lens().straighten(p, CAMERA) is p


def test_straightening_undoes_opencvs_distortion():
    m = np.random.default_rng(2).uniform(-0.4, 0.4, (50, 2))
    x = np.column_stack([m, np.ones(50)])
    bent, _ = cv2.projectPoints(x.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), CAMERA.K, BENT.coefficients)
    camera = PinholeCamera(640, 480, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    np.testing.assert_allclose(BENT.straighten(bent.reshape(-1, 2), camera), CAMERA.to_pixels(m), atol=0.01)


def test_the_same_pictures_give_the_same_digits_even_where_they_tell_little():
    frontal = views([(0, 0, *pose[2:]) for pose in CAREFUL])
    threads = cv2.getNumThreads()
    first, second = (calibrate_intrinsics(frontal) for _ in range(2))
    assert first.camera == second.camera
    np.testing.assert_array_equal(first.sd, second.sd)
    assert cv2.getNumThreads() == threads
