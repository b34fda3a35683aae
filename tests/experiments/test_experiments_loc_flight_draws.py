"""What a seed draws for a located flight."""

import numpy as np
import pytest

from noctule.control.paths import loc_1, loc_2
from noctule.estimation.identification import VehicleModelSettings
from noctule.experiments.loc_flight_draws import PUSH, PUSH_TURN, draw_pushes, draw_walk, draw_wrong

TIMES = tuple(float(t) for t in range(200))


def test_pushes_come_when_they_are_wanted_as_strong_as_they_are_wanted():
    pushes = draw_pushes(3, TIMES)
    assert tuple(push.time_s for push in pushes) == TIMES
    a = np.array([push.acceleration_m_s2 for push in pushes])
    np.testing.assert_allclose(np.linalg.norm(a, axis=1), PUSH)
    assert {push.seconds for push in pushes} == {0.2}
    assert {push.yaw_rad_s2 for push in pushes} == {-PUSH_TURN, PUSH_TURN}


def test_pushes_go_every_way_and_mostly_sideways():
    a = np.array([push.acceleration_m_s2 for push in draw_pushes(3, TIMES)])
    assert np.abs(a.mean(axis=0)).max() < 1.0
    assert 0.1 < np.abs(a[:, 2]).mean() / np.abs(a[:, 0]).mean() < 0.6


def test_a_seed_pushes_and_walks_as_ever_and_another_one_otherwise():
    assert draw_pushes(3, TIMES) == draw_pushes(3, TIMES)
    assert draw_pushes(3, TIMES[:2]) == draw_pushes(3, TIMES)[:2]
    assert draw_pushes(3, TIMES) != draw_pushes(4, TIMES)
    assert draw_walk(3) == draw_walk(3)
    assert len({draw_walk(seed) for seed in range(20)}) == 20


@pytest.mark.parametrize("plan", [loc_1(), loc_2()])
def test_the_edge_of_the_walk_comes_to_6_decimetres_of_the_path(plan):
    for seed in (1, 2, 3):
        edge, flat = draw_walk(seed).walker(plan).edge(), plan.path.position[:, :2]
        gaps = np.linalg.norm(edge[:, None] - flat[None], axis=2)
        assert gaps.min() == pytest.approx(0.6, abs=1e-3)


def test_people_walk_round_either_way():
    assert {draw_walk(seed).speed for seed in range(20)} == {-0.8, 0.8}


def test_a_wrong_model_is_off_by_the_share_each_number_either_way():
    model = VehicleModelSettings(k=(3.0,) * 8, delay_s=0.1)
    wrong = draw_wrong(5, model, 0.3)
    assert sorted({round(k / 3.0, 9) for k in wrong.k}) == [0.7, 1.3]
    assert wrong.delay_s == 0.1
    assert draw_wrong(5, model, 0.0) == model
    assert draw_wrong(6, model, 0.3) != wrong
