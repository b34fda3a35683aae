from dataclasses import replace

import numpy as np
import pytest
from pilots_cloud import CAMERA, OPTICS, cloud, pixels

from noctule.camera import CameraMount
from noctule.pilots.link_estimates import LinkEstimates
from noctule.pilots.neighbours import Neighbours
from noctule.pilots.visual_path import KeyImage, KeyLink, VisualPath
from noctule.vision.features import Features
from noctule.vision.homography import HomographyEstimate

TURN = np.radians(16.0)
POINTS = cloud()
HERE, AHEAD = (np.array([0.0, 0.0, 1.0]), 0.0), (np.array([0.2, 0.05, 1.0]), TURN)


def key_image(name):
    return KeyImage(
        name, np.zeros((2, 2, 3), dtype=np.uint8), Features(np.empty((0, 2)), np.empty((0, 2)), "sift")
    )


def neighbours(n=None):
    p_ref, p_next = pixels(POINTS, *HERE), pixels(POINTS, *AHEAD)
    link = KeyLink(p_ref[:n], p_next[:n])
    path = VisualPath(CAMERA, CameraMount(), (key_image("a"), key_image("b")), (link,))
    return Neighbours(LinkEstimates(path, OPTICS, 0.0))


def answer(yaw, *others):
    base = HomographyEstimate(np.eye(3), "upright", 1.0, np.ones(30, dtype=bool), yaw=yaw)
    return replace(base, alternatives=tuple(answer(other) for other in others))


def never():
    raise AssertionError("it was not to begin again")


def test_the_turn_between_two_images_is_that_of_their_shared_points():
    assert neighbours().turn(0) == pytest.approx(TURN, abs=np.radians(0.1))


def test_an_answer_that_agrees_is_taken_as_it_is():
    right = answer(0.1 - TURN)
    assert neighbours().choose(1, right, 0.1, never) is right


def test_of_two_answers_the_one_that_agrees_is_taken():
    wrong = answer(0.1 - TURN + np.radians(5.0), 0.1 - TURN)
    chosen = neighbours().choose(1, wrong, 0.1, never)
    assert chosen.yaw == pytest.approx(0.1 - TURN)
    assert chosen.alternatives == ()


def test_a_start_in_the_wrong_minimum_is_begun_again():
    wrong, right = answer(0.1 - TURN + np.radians(5.0)), answer(0.1 - TURN)
    assert neighbours().choose(1, wrong, 0.1, lambda: right).yaw == right.yaw


def test_no_answer_is_better_than_a_wrong_one_but_not_for_ever():
    n, wrong = neighbours(), answer(0.1 - TURN + np.radians(5.0))
    answers = [n.choose(1, wrong, 0.1, lambda: None) for _ in range(70)]
    assert answers[0] is None
    assert answers[59] is None
    assert answers[-1] is wrong


def test_a_link_of_few_points_decides_nothing():
    n, wrong = neighbours(30), answer(1.0)
    assert n.turn(0) is None
    assert n.choose(1, wrong, 0.1, never) is wrong
