"""Recorded ticks as the judge takes them."""

from types import SimpleNamespace

import numpy as np
import pytest

from noctule.flight.located_track import DOUBTS, NoTruthError, track_of
from noctule.geometry import Pose
from noctule.messages import Command, Decision, Doubt, PoseMeasurement, Truth, Whereabouts


def truth(stamp, contacts=()):
    return Truth(stamp, Pose(np.array([1.0, 2.0, 3.0]), 0.5), np.zeros(3), 1.0, contacts)


def where(stamp, **changes):
    known = {
        "stamp": stamp - 0.01,
        "position": np.array([1.1, 2.0, 3.0]),
        "yaw": 0.4,
        "velocity": np.zeros(4),
        "position_sd": 0.02,
        "yaw_sd": 0.01,
        "wanted": np.array([1.0, 2.1, 3.0, 0.6]),
        "path_time": stamp - 5.0,
        "s": 1.0,
        "holding": True,
    }
    return Whereabouts(**{**known, **changes})


def tick(stamp, whereabouts=None, contacts=(), asked=True, known=True):
    decision = Decision(Command(), "follow", whereabouts=whereabouts) if asked else None
    return SimpleNamespace(stamp=stamp, decision=decision, truth=truth(stamp, contacts) if known else None)


def test_a_tick_is_a_row():
    measured = PoseMeasurement(5.9, np.zeros(3), 0.0, np.eye(4), "registration")
    track = track_of([tick(6.0, where(6.0, doubt=Doubt.SLOW, measured=measured), ("person",))])
    assert track.stamps.tolist() == [6.0]
    assert track.true.tolist() == [[1.0, 2.0, 3.0, 0.5]]
    assert track.held.tolist() == [[1.1, 2.0, 3.0, 0.4]]
    assert track.held_at.tolist() == [5.99]
    assert track.position_sd.tolist() == [0.02]
    assert track.wanted.tolist() == [[1.0, 2.1, 3.0, 0.6]]
    assert track.path_time.tolist() == [1.0]
    assert track.holding.tolist() == [True]
    assert track.measured.tolist() == [True]
    assert track.touched.tolist() == [True]
    assert track.doubt.tolist() == [DOUBTS.index(Doubt.SLOW)]


def test_before_the_pilot_knows_where_it_is_nothing_is_held():
    track = track_of([tick(0.1), tick(6.0, where(6.0))])
    assert np.isnan(track.held[0]).all()
    assert np.isnan(track.path_time[0])
    assert not track.measured[0]
    assert track.doubt[0] == DOUBTS.index(Doubt.SURE)


def test_after_its_end_the_vehicle_lands_and_may_touch_the_floor_alone():
    ticks = [
        tick(6.0, where(6.0), ("floor",)),
        tick(6.1, asked=False, contacts=("floor",)),
        tick(6.2, asked=False, contacts=("floor", "wall_left")),
    ]
    track = track_of(ticks)
    assert track.touched.tolist() == [True, False, True]
    assert track.doubt.tolist()[1:] == [DOUBTS.index(Doubt.LAND)] * 2


@pytest.mark.parametrize("ticks", [[], [tick(0.1), tick(0.2, known=False)]])
def test_nobody_can_judge_a_flight_without_truth(ticks):
    with pytest.raises(NoTruthError) as error:
        track_of(ticks)
    assert str(error.value) == "flight: its recording holds no truth, expected one of a simulated flight"
