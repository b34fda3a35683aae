"""How near the hull is to what moves, against points all over the things' surfaces."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.geometry import Array, Pose
from noctule.simulation import CameraSpec, RoomSpec, SimulatedWorld, VehicleSpec
from noctule.simulation.ceiling import CeilingSpec, Hiding, Motion, Standing, ThingPose, Walker, lab_room
from noctule.simulation.ceiling.nearness import ThingDistance
from noctule.simulation.ceiling.shapes import Shape
from noctule.simulation.ceiling.things import ThingKind, thing_rows

RADIUS, HALF = 0.2, 0.06
HULL = ThingDistance(RADIUS, HALF)
FRONT = CameraSpec(width=64, height=48, focal=40.0)
BARE = RoomSpec(furniture=0, pictures=0, lamps=0)


def surface(thing: ThingPose) -> Array:
    """Return points (n, 3) [m] of all its parts, world."""
    rng = np.random.default_rng(0)
    points = []
    for row in thing_rows(thing):
        unit = rng.standard_normal((3000, 3))
        norm = np.abs(unit).max(axis=1) if row[0] == Shape.BOX else np.linalg.norm(unit, axis=1)
        points.append(row[1:4] + (unit / norm[:, None] * row[13:16]) @ row[4:13].reshape(3, 3).T)
    return np.vstack(points)


def nearest_point(pose: Pose, points: Array) -> float:
    """Return the distance [m] of points to the hull, 0 for those inside."""
    inside = (points - pose.position) @ pose.R_world_body
    beside = np.maximum(np.hypot(inside[:, 0], inside[:, 1]) - RADIUS, 0.0)
    above = np.maximum(np.abs(inside[:, 2]) - HALF, 0.0)
    return float(np.hypot(beside, above).min())


places = st.builds(
    lambda x, y, z, yaw, roll, pitch: Pose(np.array([x, y, z]), yaw, roll, pitch),
    *(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.floats(0.3, 2.2)),
    *(st.floats(-3.0, 3.0), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)),
)
people = st.builds(
    lambda yaw, walked: ThingPose("person", 0.1, -0.1, yaw, walked=walked),
    st.floats(-3.0, 3.0),
    st.floats(0.0, 1.4),
)


@settings(max_examples=40, deadline=None)
@given(places, people)
def test_a_person_is_as_near_as_is_said(pose: Pose, person: ThingPose) -> None:
    said, true = HULL.measure(pose, person), nearest_point(pose, surface(person))
    assert max(said, 0.0) == pytest.approx(true, abs=0.02)


@pytest.mark.parametrize("kind", ["box", "tray", "chair", "board"])
@settings(max_examples=20, deadline=None)
@given(place=places, yaw=st.floats(-3.0, 3.0), z=st.floats(0.0, 1.5))
def test_other_things_are_as_near_as_is_said(kind: ThingKind, place: Pose, yaw: float, z: float) -> None:
    thing = ThingPose(kind, 0.1, -0.1, yaw, z)
    said, true = HULL.measure(place, thing), nearest_point(place, surface(thing))
    # Points are some centimetres apart on a board; within, the hull may hold none.
    assert true - 0.09 < max(said, 0.0) < true + 0.005


def test_the_distance_to_a_box_is_exact_beside_above_and_round_the_edge() -> None:
    box = ThingPose("box", 1.0, 0.0, size=(0.4, 0.2, 1.0))

    def away(x: float, y: float, z: float) -> float:
        return HULL.measure(Pose(np.array([x, y, z]), 0.7), box)

    assert away(0.0, 0.0, 0.5) == pytest.approx(0.8 - RADIUS, abs=1e-4)
    assert away(1.0, 0.0, 1.5) == pytest.approx(0.5 - HALF, abs=1e-4)
    assert away(0.5, -0.5, 0.5) == pytest.approx(math.hypot(0.3, 0.4) - RADIUS, abs=1e-4)
    assert away(0.5, 0.0, 1.16) == pytest.approx(math.hypot(0.1, 0.1), abs=1e-4)


def test_inside_a_thing_the_distance_is_negative() -> None:
    box = ThingPose("box", 0.0, 0.0, size=(2.0, 2.0, 2.0))
    assert HULL.measure(Pose(np.array([0.0, 0.0, 1.0]), 0.0), box) == pytest.approx(-1.06, abs=1e-3)
    beside = Pose(np.array([1.1, 0.0, 1.0]), 0.0)
    assert HULL.measure(beside, box) == pytest.approx(-0.1, abs=1e-3)


def test_a_tilted_hull_reaches_farther_down() -> None:
    box = ThingPose("box", 0.0, 0.0, size=(2.0, 2.0, 0.5))
    for roll in (0.0, 0.2):
        pose = Pose(np.array([0.0, 0.0, 1.0]), 0.3, roll)
        reach = RADIUS * math.sin(roll) + HALF * math.cos(roll)
        assert HULL.measure(pose, box) == pytest.approx(0.5 - reach, abs=1e-4)


def test_what_was_measured_before_does_not_matter() -> None:
    pose, person = Pose(np.array([0.5, 0.3, 1.2]), 0.3), ThingPose("person", 0.0, 0.0)
    fresh = ThingDistance(RADIUS, HALF).measure(pose, person)
    for thing in (ThingPose("chair", 0.5, 0.2), ThingPose("board", 3.0, 0.0, z=2.0)):
        HULL.measure(pose, thing)
    assert HULL.measure(pose, person) == fresh


def world(room: RoomSpec, motions: Sequence[Motion], ceiling: CeilingSpec | None = None) -> SimulatedWorld:
    start = Pose(np.array([0.0, 0.0, 1.2]), 0.0)
    return SimulatedWorld(room, VehicleSpec(), FRONT, start, 0, ceiling=ceiling, motions=motions)


def test_the_referee_knows_how_near_a_walking_person_is() -> None:
    walker = Walker((0.0, 0.0), (1.0, 1.0), speed=0.5)
    with world(BARE, [walker]) as made:
        made.clock.sleep_until(2.0)
        truth = made.referee.truth()
    expected = HULL.measure(truth.pose, walker.at(2.0))
    assert truth.clearance == pytest.approx(expected)
    assert 0.4 < truth.clearance < 0.75
    assert truth.contacts == ()


def test_who_is_touched_is_named() -> None:
    people: list[Motion] = [
        Standing(ThingPose("box", 2.0, 2.0)),
        Standing(ThingPose("person", 0.3, 0.0)),
        Standing(ThingPose("tray", 0.0, 0.0, z=1.15)),
    ]
    with world(BARE, people, CeilingSpec()) as made:
        truth = made.referee.truth()
    assert truth.contacts == ("moving_person_1", "moving_tray_2")
    assert truth.clearance < 0.0


def test_a_board_counts_only_while_it_is_held() -> None:
    # Right above the hull's top, at 1.26 m.
    board = Hiding((0.0, 0.0, 1.2), 0.1, 0.2, eye=(0.0, 0.0, 1.27), share=1.0, slide=0.0)
    found = []
    with world(BARE, [board]) as made:
        for stamp in (0.05, 0.2, 0.4):
            made.clock.sleep_until(stamp)
            found.append(made.referee.truth())
    assert [truth.contacts for truth in found] == [(), ("moving_board_0",), ()]
    assert found[0].clearance == found[2].clearance == math.inf


def test_what_stands_still_counts_as_before_and_the_nearest_of_all_is_told() -> None:
    far: list[Motion] = [Standing(ThingPose("box", 40.0, 0.0))]
    near: list[Motion] = [Standing(ThingPose("box", 0.6, 0.0, size=(0.2, 0.2, 1.8)))]
    with world(lab_room(0), []) as made, world(lab_room(0), far) as other, world(lab_room(0), near) as third:
        assert made.referee.truth().clearance == other.referee.truth().clearance
        assert third.referee.truth().clearance == pytest.approx(0.3, abs=1e-4)
        assert third.clearance(third.referee.truth().pose)[0] == made.referee.truth().clearance


def test_motions_do_not_change_the_flight() -> None:
    ends = []
    for motions in ([], [Walker((0.0, 0.0), (1.0, 1.0))]):
        with world(BARE, motions) as made:
            made.clock.sleep_until(1.0)
            ends.append(made.referee.truth().pose.position.tolist())
    assert ends[0] == ends[1]
