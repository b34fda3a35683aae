"""The homographies between neighbouring images are estimated once for each link."""

import numpy as np
import pytest
from pilots_cloud import CAMERA, MOUNT, cloud, pixels

from noctule.pilots import link_estimates as module
from noctule.pilots.factory import link_estimates, link_geometries
from noctule.pilots.neighbours import Neighbours
from noctule.pilots.route import unroll
from noctule.pilots.visual_path import KeyImage, KeyLink, VisualPath
from noctule.vision.features import Features

NOTHING = Features(np.empty((0, 2)), np.empty((0, 2)), "sift")
PLACES = (([0.0, 0.0, 1.0], 0.0), ([0.4, 0.0, 1.0], 0.0), ([0.0, 0.02, 1.0], 0.0))


@pytest.fixture
def counted(monkeypatch):
    """The calls of the estimator."""
    calls = []
    right = module.estimate_homography

    def estimate(*args, **options):
        calls.append(args)
        return right(*args, **options)

    monkeypatch.setattr(module, "estimate_homography", estimate)
    return calls


@pytest.fixture
def path():
    seen = [pixels(cloud(80), *place) for place in PLACES]
    links = tuple(KeyLink(seen[k], seen[k + 1]) for k in range(2))
    images = tuple(KeyImage(f"{k}", np.zeros((2, 2, 3), dtype=np.uint8), NOTHING) for k in range(3))
    return VisualPath(CAMERA, MOUNT, images, links)


def test_all_who_ask_for_a_link_share_one_estimate_each_way(counted, path):
    links = link_estimates(path, 0.0)
    link_geometries(links)
    Neighbours(links).turn(0)
    Neighbours(links).turn(1)
    assert len(counted) == 4


def test_a_route_that_flies_a_link_often_estimates_it_once(counted, path):
    there_and_back = unroll(path, (0, 1, 0, 1, 0, 1))
    link_geometries(link_estimates(there_and_back, 0.0))
    assert len(counted) == 4


def test_onward_and_back_undo_each_other(path):
    links = link_estimates(path, 0.0)
    assert links.onward(0).yaw == pytest.approx(-links.back(0).yaw, abs=1e-3)
    assert links.onward(0).t[2] < 0 < links.onward(1).t[2]  # what is ahead comes nearer, then goes away
    assert links.back(0).t[2] > 0


def test_every_method_has_its_own_estimate(counted, path):
    links = link_estimates(path, 0.0)
    assert links.back(0, "generic").method != links.back(0).method
    assert len(counted) == 2
