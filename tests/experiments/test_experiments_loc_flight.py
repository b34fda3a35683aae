"""loc-1 to loc-3: what is flown, that it can be flown, and how flights are judged together."""

import math

import numpy as np
import pytest

from noctule.control.paths import loc_1, loc_2, loc_3
from noctule.experiments.loc_flight import BEGIN, LOC_FLIGHTS, SECONDS, LocFlightOptions
from noctule.experiments.loc_flight_outcome import OUTCOMES
from noctule.experiments.loc_flight_run import course_of, judged, pooled
from noctule.flight import fly_mission
from noctule.flight.mission import Mission, MissionFileError

PLANS = {"loc-1": loc_1, "loc-2": loc_2, "loc-3": loc_3}
PUSHES = {"loc-1": (43, 48, 53, 58, 63), "loc-2": (50, 55, 60, 65), "loc-3": (18, 30, 60, 72)}
STOPS = {"loc-1": (40.0, 70.0), "loc-2": (40.0, 70.0), "loc-3": (40.0, 52.0)}


def mission(name="loc-3", seed=3, **options):
    return LOC_FLIGHTS[name].mission(seed, LocFlightOptions(**options))


@pytest.mark.parametrize("name", LOC_FLIGHTS)
def test_the_path_is_the_designs(name):
    found, expected = mission(name).space_plan(), PLANS[name]()
    np.testing.assert_array_equal(found.path.position, expected.path.position)
    assert found.timed == expected.timed
    assert found.heading == expected.heading
    assert found.laps is None
    assert found.profile.at(0.0)[0] == pytest.approx(0.3)
    assert mission(name).located.end_after_s == SECONDS == 82.0


@pytest.mark.parametrize("name", LOC_FLIGHTS)
def test_pushes_and_stops_come_at_the_designs_times_of_the_path(name):
    course = course_of(mission(name))
    # The pilot's first tick is one 30th of a second after the flight's clock starts.
    np.testing.assert_allclose(np.array(course.pushes) - 1.0 / 30.0 - BEGIN, PUSHES[name])
    assert course.stops == (STOPS[name],)
    assert course.seconds == 82.0


@pytest.mark.parametrize("name", LOC_FLIGHTS)
def test_it_starts_about_where_the_path_begins_and_heads_as_the_path_does(name):
    one = mission(name)
    start, plan = one.start.nominal, one.space_plan()
    np.testing.assert_allclose(start.position, plan.path.position[0], atol=1e-9)
    tangent = plan.path.tangent[0]
    along = math.atan2(tangent[1], tangent[0])
    assert start.yaw == pytest.approx(along if name == "loc-1" else 0.0, abs=1e-6)
    assert 0.0 < np.linalg.norm(one.start.pose(3).position - start.position) < 0.1


def test_the_vehicle_is_the_designs():
    one = mission()
    vehicle = one.vehicle
    assert (vehicle.model, vehicle.gusts, vehicle.command_latency) == ("identified", 0.6, 0.02)
    assert vehicle.navdata is not None
    assert (vehicle.navdata.soonest, vehicle.navdata.latest) == (0.042, 0.09)
    assert vehicle.limits == one.limits
    assert (one.limits.forward, one.limits.yaw_rate, one.limits.acceleration) == (1.0, 1.5, 5.0)
    assert one.ceiling.latency_s == 0.04
    assert one.known_vehicle.delay_s == 0.02


def test_a_seed_draws_room_start_pushes_and_walk():
    one, other = mission(seed=3), mission(seed=4)
    assert mission(seed=3) == one
    assert one.room != other.room
    assert one.start.pose(3).yaw != other.start.pose(4).yaw
    assert one.vehicle.pushes != other.vehicle.pushes
    assert one.people != other.people
    assert one.space_path == other.space_path


def test_options_change_what_they_say_and_nothing_else():
    plain = mission()
    alone, hull = mission(alone=True), mission(hull=True)
    assert alone == plain.model_copy(update={"people": ()})
    assert hull.ceiling.hull
    assert hull == plain.model_copy(update={"ceiling": hull.ceiling})
    first = mission(model="first_order")
    assert first == plain.model_copy(update={"vehicle": first.vehicle})
    assert first.vehicle == plain.vehicle.model_copy(update={"model": "first_order"})


def test_a_board_hides_the_whole_path_from_20_s_on():
    (board,) = mission(hide=5.0).ceiling.boards
    assert board.begin_s == pytest.approx(1.0 / 30.0 + BEGIN + 20.0)
    assert board.seconds == 5.0
    assert board.place == (0.08, 0.1, 1.2)


def test_a_wrong_model_is_the_pilots_not_the_vehicles():
    plain, wrong = mission(), mission(wrong_model=0.3)
    assert wrong.vehicle == plain.vehicle
    off = np.array(wrong.known_vehicle.k) / np.array(plain.known_vehicle.k)
    assert sorted({round(float(share), 9) for share in off}) == [0.7, 1.3]


def test_a_delay_is_the_vehicles_and_known_to_the_pilot():
    late = mission(command_delay=0.2)
    assert late.vehicle.command_latency == 0.2
    assert late.known_vehicle.delay_s == 0.2


def test_beyond_what_was_shown_stable_is_only_flown_when_asked():
    with pytest.raises(MissionFileError, match=r"commands take effect after 0\.40 s"):
        mission(command_delay=0.4)
    late = mission(command_delay=0.4, beyond=True)
    assert late.located.follower.cascade.longest_delay_s == 0.4
    assert mission(beyond=True).located == mission().located


def test_what_is_flown_can_be_written_down_and_read_again():
    one = mission(hide=2.0, wrong_model=0.2)
    assert Mission.model_validate_json(one.model_dump_json()) == one


def test_means_and_extremes_of_flights_and_the_shares_of_their_outcomes():
    runs = [
        {"seed": 1, "outcome": "completed", "hover_rms_m": 0.01, "recovery_s": {"max": 0.5}},
        {"seed": 2, "outcome": "fence", "hover_rms_m": 0.03, "recovery_s": {"max": 0.7}},
        {"seed": 3, "outcome": "aborted", "hover_rms_m": None},
    ]
    found = pooled(runs)
    assert found["summary"]["hover_rms_m"] == pytest.approx(0.02)
    assert found["most"] == {"hover_rms_m": 0.03, "recovery_s": {"max": 0.7}}
    assert found["least"] == {"hover_rms_m": 0.01, "recovery_s": {"max": 0.5}}
    shares = {name: share for name, share in found["summary"]["outcome"].items() if share}
    assert shares == {name: pytest.approx(1.0 / 3.0) for name in ("completed", "fence", "aborted")}
    assert set(found["summary"]["outcome"]) == set(OUTCOMES)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Fly the first seconds of loc-1; it is pushed after 3 s of the path."""
    one = mission("loc-1", 5, seconds=6.0)
    (push, *_) = one.vehicle.pushes
    sooner = push.model_copy(update={"time_s": 1.0 / 30.0 + BEGIN + 3.0})
    one = one.model_copy(update={"vehicle": one.vehicle.model_copy(update={"pushes": (sooner,)})})
    return fly_mission(one, 5, tmp_path_factory.mktemp("loc-1"), progress=False).summary


def test_a_short_flight_keeps_to_the_path_and_comes_back_after_a_push(flown):
    found = judged(flown)
    assert found["outcome"] == "completed", found
    assert found["seed"] == 5
    assert found["cross_track_mean_m"] < 0.05
    assert found["heading_p95_deg"] < 8.0
    assert 0.1 < found["recovery_s"]["max"] < 1.5
    assert found["position_rms_m"] < 0.02
    assert abs(found["yaw_mean_deg"]) < 2.0
    assert found["slips"] == 0
    assert found["lost_s"] == 0.0
    assert found["hover_rms_m"] is None  # it ends before the stop
    assert found["recording"] == flown["recording"]


def test_what_belongs_to_visual_paths_is_not_told(flown):
    assert "epsilon_px" in flown
    assert not {"epsilon_px", "laps", "position_error_m", "cross_track_max"} & set(judged(flown))


def test_commands_that_are_long_on_their_way_still_fly(tmp_path):
    # Longer than a command is valid, and than a hand could steer with.
    late = mission("loc-1", 5, seconds=5.0, command_delay=0.3)
    found = judged(fly_mission(late, 5, tmp_path, progress=False).summary)
    assert found["outcome"] == "completed", found
    assert found["cross_track_mean_m"] < 0.05
