"""Experiments 5.1 and 5.2: the missions are those of the design, and one of them is really flown."""

import math

import numpy as np
import pytest

from noctule.experiments.servo import EXPERIMENTS
from noctule.flight import fly_mission
from noctule.messages import Limits
from noctule.simulation import SimulatedWorld

SEEDS = range(40)
BOTH = pytest.mark.parametrize("name", ["servo-5.1", "servo-5.2"])


def missions(name, **options):
    return [EXPERIMENTS[name].mission(seed, **options) for seed in SEEDS]


@BOTH
def test_the_vehicle_the_camera_and_the_limits_are_those_of_the_design(name):
    mission = EXPERIMENTS[name].mission(3)
    expected = Limits(0.6, 0.6, 0.5, 0.8, 1.0, 2.0)
    assert mission.limits.values() == expected
    assert mission.vehicle.limits.values() == expected
    assert mission.vehicle.model == "first_order"
    assert mission.vehicle.lag == 0.3
    assert (mission.vehicle.hull_diameter, mission.vehicle.hull_height) == (0.4, 0.12)
    assert mission.camera.latency == pytest.approx(1.0 / 30.0)  # one frame
    assert (mission.camera.rate, mission.flight.rate_hz) == (30.0, 30.0)
    assert (mission.camera.width, mission.camera.height, mission.camera.focal) == (856, 480, 510.0)
    assert mission.camera.ahead == 0.09
    assert mission.vehicle.gusts > 0.0


@BOTH
def test_the_start_is_drawn_around_a_hover_one_metre_high(name):
    starts = [mission.start.pose(seed) for seed, mission in zip(SEEDS, missions(name), strict=True)]
    off = np.array([start.position for start in starts]) - [0.0, 0.0, 1.0]
    turns = np.degrees([start.yaw for start in starts])
    assert np.abs(off).max() <= 0.05
    assert np.abs(turns).max() <= 3.0
    # And uses that room.
    assert (np.ptp(off, axis=0) > 0.08).all()
    assert np.ptp(turns) > 4.5


def test_5_1_is_one_target_and_one_thin_column():
    drawn = missions("servo-5.1")
    assert {mission.path.poses for mission in drawn} == {((1.5, 0.0, 0.5, 0.0),)}
    columns = [mission.room.columns for mission in drawn]
    assert all(len(found) == 1 for found in columns)
    for (column,) in columns:
        assert (column.x, column.width, column.depth, column.diameter) == (0.95, 0.05, 0.02, None)
    y = np.array([column.y for (column,) in columns])
    assert np.abs(y).max() <= 0.08
    assert y.min() < -0.05
    assert y.max() > 0.05


def test_5_2_is_four_targets_and_two_columns_on_opposite_sides():
    drawn = missions("servo-5.2")
    for mission in drawn:
        poses = mission.path.poses
        assert poses[:3] == ((1.5, 0.0, 1.0, 0.0), (2.0, 0.0, 1.0, 0.0), (3.5, 0.0, 1.0, 0.0))
        assert poses[3][:3] == (4.5, 0.5, 0.5)
        round_one, thin = mission.room.columns
        assert (round_one.x, round_one.diameter) == (0.9, 0.11)
        assert (thin.x, thin.width, thin.depth, thin.diameter) == (2.9, 0.05, 0.02, None)
        assert thin.y == -round_one.y
    y = np.array([mission.room.columns[0].y for mission in drawn])
    assert np.abs(y).max() <= 0.06
    assert y.min() < -0.04
    assert y.max() > 0.04
    assert {mission.path.poses[3][3] for mission in drawn} == {-30.0, 30.0}


@BOTH
def test_the_columns_of_a_seed_have_one_colour_and_the_pilot_knows_it(name):
    drawn = missions(name)
    for mission in drawn:
        hues = {column.hue for column in mission.room.columns}
        assert [360.0 * hue for hue in hues] == [mission.pilot.column_hue_deg]
    assert np.ptp([mission.pilot.column_hue_deg for mission in drawn]) > 300.0


@BOTH
def test_the_room_is_drawn_from_the_seed_too(name):
    assert [mission.room.seed for mission in missions(name)] == list(SEEDS)
    assert [mission.flight.seed for mission in missions(name)] == list(SEEDS)


@BOTH
def test_a_seed_is_one_mission_and_another_seed_another(name):
    experiment = EXPERIMENTS[name]
    assert experiment.mission(7) == experiment.mission(7)
    assert len({mission.model_dump_json() for mission in missions(name)}) == len(SEEDS)


@BOTH
def test_both_laws_fly_the_same_mission(name):
    ours, theirs = (EXPERIMENTS[name].mission(5, law=law) for law in ("noctule", "published"))
    assert (ours.pilot.law, theirs.pilot.law) == ("noctule", "published")
    assert ours.model_dump(exclude={"pilot": {"law"}}) == theirs.model_dump(exclude={"pilot": {"law"}})


def test_the_published_thresholds_are_the_papers():
    one, four = (EXPERIMENTS[name].mission(0, law="published").pilot.published for name in EXPERIMENTS)
    assert one.epsilon_last_px == 6.0
    assert (four.epsilon_intermediate_px, four.epsilon_last_px) == (12.0, 7.0)


@BOTH
def test_an_attitude_error_is_that_of_the_camera_the_vehicle_and_the_pilot(name):
    calm = EXPERIMENTS[name].mission(2)
    assert calm.camera.stabilised
    assert (calm.vehicle.attitude_sd, calm.pilot.attitude_sd_deg) == (0.0, 0.0)
    rough = EXPERIMENTS[name].mission(2, attitude_sd_deg=0.5)
    assert not rough.camera.stabilised
    assert rough.vehicle.attitude_sd == pytest.approx(math.radians(0.5))
    assert rough.pilot.attitude_sd_deg == 0.5
    # Nothing else is another.
    assert (rough.room, rough.path, rough.start) == (calm.room, calm.path, calm.start)


def test_experiments_are_found_by_the_name_they_carry():
    for name, experiment in EXPERIMENTS.items():
        assert experiment.name == name
        assert experiment.mission(0).name == name
        assert experiment.mission(0).description == experiment.title


def test_at_the_start_of_every_seed_nothing_is_touched():
    for name in EXPERIMENTS:
        mission = EXPERIMENTS[name].mission(1)
        start = mission.start.pose(1)
        with SimulatedWorld(mission.room, mission.vehicle, mission.camera, start, 1) as world:
            truth = world.referee.truth()
        assert truth.contacts == ()
        assert 0.3 < truth.clearance < 1.0  # the first column stands ahead


def test_a_rendered_flight_of_5_1_is_reached_and_keeps_clear(tmp_path):
    flown = fly_mission(EXPERIMENTS["servo-5.1"].mission(11), None, tmp_path, progress=False).summary
    assert flown["outcome"] == "reached"
    assert flown["position_error_m"] <= 0.03
    assert flown["yaw_error_deg"] <= 0.5
    assert flown["min_clearance_m"] >= 0.10
    assert flown["max_command_step"]["linear"] <= 1.0 / 30.0
    assert flown["max_command_step"]["angular"] <= 2.0 / 30.0
