"""Calibration with the depth of the simulated sensor: its steps, holes, shadows, and things in the room."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from localization_boards import floor_picture

from noctule.camera import CEILING_CAMERA
from noctule.geometry import rot_z
from noctule.localization.calibration.board import Board, find_board
from noctule.localization.calibration.extrinsics import BoardPlace, locate_camera
from noctule.localization.calibration.extrinsics_judgement import (
    check_depth,
    extrinsics_faults,
    fit_floor,
    floor_plane,
)
from noctule.localization.calibration.floor import Plane
from noctule.simulation.ceiling import CeilingSpec, DepthStage

LARGE = Board(square=0.14, marker=0.105)
K = CEILING_CAMERA.intrinsics
PLACES = [BoardPlace(), BoardPlace(-0.5, -0.3, 0.5), BoardPlace(0.2, -0.8, 1.0)]


@pytest.fixture(scope="module")
def depth():
    return DepthStage(CeilingSpec(), 3).frame(0.0, None).depth


def seen(place):
    origin = place.to_world(np.zeros((1, 3)))[0]
    picture = floor_picture(CEILING_CAMERA, rot_z(place.heading), origin, board=LARGE)
    return find_board(LARGE, picture, "a.png")


def off(found):
    turn, _ = cv2.Rodrigues(found.camera.R_world_camera @ CEILING_CAMERA.R_world_camera.T)
    step = found.camera.t_world_camera - CEILING_CAMERA.t_world_camera
    return float(np.degrees(np.linalg.norm(turn))), float(np.linalg.norm(step))


@pytest.mark.parametrize("place", PLACES)
def test_one_picture_with_the_sensors_depth_places_the_camera_to_a_centimetre(depth, place):
    view = seen(place)
    alone = locate_camera([view], [place], K)
    checks = check_depth(alone, LARGE, [depth])
    assert [check.what for check in checks] == ["board", "floor"]
    helped = locate_camera([view], [place], K, floor=checks[-1].fit.plane)
    angle, distance = off(helped)
    assert angle < 0.15
    assert distance < 0.010
    assert extrinsics_faults(helped, checks) == []


def test_the_floor_is_found_between_the_things_that_stand_on_it(depth):
    found = locate_camera([seen(PLACES[0])], PLACES[:1], K)
    fit = fit_floor(depth, K, floor_plane(found))
    R = CEILING_CAMERA.R_world_camera
    truth = Plane.through(R.T, -R.T @ CEILING_CAMERA.t_world_camera)
    assert np.degrees(fit.plane.angle_to(truth)) < 0.1
    assert fit.plane.distance == pytest.approx(truth.distance, abs=0.003)


def test_depth_in_another_unit_is_refused(depth):
    found = locate_camera([seen(PLACES[0])], PLACES[:1], K)
    tenths = (depth // 10).astype(np.uint16)
    lines = extrinsics_faults(found, check_depth(found, LARGE, [tenths]))
    assert any("by depth they are 0.100 times that" in line for line in lines)


def test_a_camera_whose_depth_is_two_per_cent_off_is_refused_and_one_per_cent_is_not(depth):
    found = locate_camera([seen(PLACES[1])], PLACES[1:2], K)
    near = (depth * 0.99).round().astype(np.uint16)
    far = (depth * 1.02).round().astype(np.uint16)
    assert extrinsics_faults(found, check_depth(found, LARGE, [near])) == []
    lines = extrinsics_faults(found, check_depth(found, LARGE, [far]))
    assert len(lines) == 2
    assert [" ".join(line.split()[2:4]) for line in lines] == ["the board", "the floor"]
