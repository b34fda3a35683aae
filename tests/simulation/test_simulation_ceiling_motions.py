"""Walkers, flights by hand and poses spread over the camera's view."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.camera import CEILING_CAMERA
from noctule.geometry import Array, Pose, wrap_angle
from noctule.simulation.ceiling import (
    CeilingSpec,
    DepthStage,
    Hiding,
    Motion,
    Standing,
    ThingPose,
    Walker,
    lab_room,
    manual_flight,
    spread_poses,
    things_at,
    walk_past,
    walk_through,
)
from noctule.simulation.ceiling.flights import HEIGHTS, RADIUS, NoViewError, heights, sees_whole
from noctule.simulation.ceiling.motions import gap
from noctule.simulation.ceiling.quadrotor import quadrotor
from noctule.simulation.ceiling.shapes import pack


def ellipse_path() -> Array:
    """Return the path of the paper's first experiment (n, 3) [m]."""
    theta = np.linspace(0.0, 2.0 * np.pi, 200)
    return np.column_stack(
        [0.08 + 0.5 * np.cos(theta), 0.1 + 0.8 * np.sin(theta), 1.2 + 0.12 * np.sin(theta)]
    )


walkers = st.builds(
    Walker,
    centre=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
    half_axes=st.tuples(st.floats(0.3, 1.5), st.floats(0.3, 1.5)),
    turn=st.floats(-3.0, 3.0),
    speed=st.floats(-1.5, 1.5).filter(lambda v: abs(v) > 0.1),
    start=st.floats(0.0, 5.0),
)


@settings(max_examples=50, deadline=None)
@given(walkers, st.floats(0.0, 60.0))
def test_a_walker_has_its_speed_and_looks_where_it_goes(walker: Walker, stamp: float) -> None:
    a, b = walker.at(stamp), walker.at(stamp + 0.05)
    way = np.array([b.x - a.x, b.y - a.y])
    assert np.linalg.norm(way) == pytest.approx(abs(walker.speed) * 0.05, rel=0.03)
    between = walker.at(stamp + 0.025).yaw
    assert abs(wrap_angle(math.atan2(way[1], way[0]) - between)) < 0.06
    assert b.walked - a.walked == pytest.approx(abs(walker.speed) * 0.05)


@settings(max_examples=50, deadline=None)
@given(walkers, st.floats(0.0, 60.0))
def test_a_walker_stays_on_its_ellipse(walker: Walker, stamp: float) -> None:
    pose = walker.at(stamp)
    c, s = math.cos(walker.turn), math.sin(walker.turn)
    x, y = pose.x - walker.centre[0], pose.y - walker.centre[1]
    a, b = walker.half_axes
    assert math.hypot((c * x + s * y) / a, (c * y - s * x) / b) == pytest.approx(1.0, abs=1e-9)


def test_a_walker_comes_round() -> None:
    walker = Walker((0.2, 0.1), (1.0, 1.0), speed=0.5, start=0.3)
    lap = 2.0 * math.pi / 0.5
    first, again = walker.at(1.0), walker.at(1.0 + lap)
    assert (again.x, again.y) == pytest.approx((first.x, first.y), abs=1e-3)


def test_a_walker_may_carry_anything() -> None:
    pose = Walker((0.0, 0.0), (1.0, 0.5), kind="tray", z=1.1, size=(0.5, 0.3, 0.02), look=2).at(0.0)
    assert pose == ThingPose("tray", 1.0, 0.0, math.pi / 2.0, 1.1, (0.5, 0.3, 0.02), 0.0, 2)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.3, 1.0), st.floats(-3.1, 3.1))
def test_a_walk_past_a_path_comes_as_near_as_it_is_told(distance: float, bearing: float) -> None:
    path = ellipse_path()
    walker = walk_past(path, distance, Walker((0.0, 0.0), (1.0, 0.5), look=3), bearing)
    assert gap(walker.edge(), path[:, :2]) == pytest.approx(distance, abs=1e-3)
    assert walker.look == 3
    toward = np.array(walker.centre) - path[:, :2].mean(axis=0)
    assert abs(wrap_angle(math.atan2(toward[1], toward[0]) - bearing)) < 1e-6


def test_a_standing_thing_stays() -> None:
    box = ThingPose("box", 0.5, 0.5)
    assert Standing(box).at(0.0) is Standing(box).at(99.0) is box


def test_the_ball_about_the_body_holds_every_part() -> None:
    for hull in (False, True):
        rows = pack(list(quadrotor(hull, True)))
        for kind in (0, 1, 2):
            part = rows[rows[:, 0] == kind]
            side = {0: np.linalg.norm(part[:, 13:16], axis=1), 1: part[:, 13:16].max(axis=1)}.get(
                kind, np.hypot(part[:, 13], part[:, 15])
            )
            assert (np.linalg.norm(part[:, 1:4], axis=1) + side).max() <= RADIUS


def test_spread_poses_are_seen_whole_and_fill_the_volume() -> None:
    poses = spread_poses(0, 400)
    positions = np.array([pose.position for pose in poses])
    assert all(sees_whole(CEILING_CAMERA, x) for x in positions)
    assert positions[:, 2].min() == pytest.approx(HEIGHTS[0], abs=0.05)
    assert positions[:, 2].max() == pytest.approx(HEIGHTS[1], abs=0.05)
    # The view widens downward, so there is more room below.
    assert np.median(positions[:, 2]) < 1.1
    assert np.ptp(positions[:, :2], axis=0).min() > 1.8


def test_seen_whole_is_seen_whole() -> None:
    for pose in spread_poses(1, 50):
        ball = np.random.default_rng(0).normal(size=(200, 3))
        ball *= RADIUS / np.linalg.norm(ball, axis=1, keepdims=True)
        p = CEILING_CAMERA.project(pose.position + ball)
        assert (p > -0.5).all()
        assert (p < [639.5, 479.5]).all()
    assert not sees_whole(CEILING_CAMERA, np.array([0.1, 0.1, 3.0]))
    assert not sees_whole(CEILING_CAMERA, np.array([0.1, 0.1, 5.0]))


def test_headings_of_spread_poses_are_uniform_and_tilts_small() -> None:
    poses = spread_poses(2, 2000)
    counts = np.histogram([pose.yaw for pose in poses], 8, (-math.pi, math.pi))[0]
    assert counts.min() > 200
    assert np.std([pose.roll for pose in poses]) == pytest.approx(math.radians(2.5), rel=0.1)
    assert np.std([pose.pitch for pose in poses]) == pytest.approx(math.radians(2.5), rel=0.1)


def test_poses_and_flights_depend_on_their_seed() -> None:
    for make in (
        lambda seed: spread_poses(seed, 3),
        lambda seed: [p for _, p in manual_flight(seed, 1.0, 3.0)],
    ):
        one, same, other = (np.array([[*p.position, p.yaw] for p in make(seed)]) for seed in (0, 0, 1))
        assert np.array_equal(one, same)
        assert not np.allclose(one, other)


def flown(seed: int = 0) -> tuple[Array, Array, Array]:
    """Return stamps (n,), positions (n, 3) and (yaw, roll, pitch) (n, 3) of a minute's flight."""
    flight = manual_flight(seed, 60.0, 30.0)
    stamps, poses = zip(*flight, strict=True)
    angles = np.array([[p.yaw, p.roll, p.pitch] for p in poses])
    return np.array(stamps), np.array([p.position for p in poses]), angles


def test_a_flight_by_hand_has_its_length_and_rate() -> None:
    stamps, _, _ = flown()
    assert len(stamps) == 1800
    assert stamps == pytest.approx(np.arange(1800) / 30.0)


@pytest.mark.parametrize("seed", range(3))
def test_a_flight_by_hand_stays_in_view_and_shows_all_heights_and_headings(seed: int) -> None:
    _, positions, angles = flown(seed)
    assert all(sees_whole(CEILING_CAMERA, x) for x in positions[::5])
    assert positions[:, 2].min() < 0.65
    assert positions[:, 2].max() > 1.65
    assert np.ptp(positions[:, :2], axis=0).min() > 1.0
    assert (np.histogram(angles[:, 0], 8, (-math.pi, math.pi))[0] > 30).all()


def test_a_flight_by_hand_is_smooth_and_slow() -> None:
    _, positions, angles = flown()
    v = np.diff(positions, axis=0) * 30.0
    a = np.diff(v, axis=0) * 30.0
    assert 0.15 < np.linalg.norm(v, axis=1).mean() < np.linalg.norm(v, axis=1).max() < 1.3
    assert np.linalg.norm(a, axis=1).max() < 2.5
    assert np.abs(np.diff(a, axis=0)).max() < 0.4
    assert np.abs(np.diff(np.unwrap(angles[:, 0]))).max() * 30.0 < 1.5


def test_a_flight_by_hand_leans_as_its_accelerations_need() -> None:
    _, positions, angles = flown()
    a = np.diff(positions, 2, axis=0) * 900.0
    yaw, roll, pitch = angles[1:-1].T
    forward = a[:, 0] * np.cos(yaw) + a[:, 1] * np.sin(yaw)
    left = a[:, 1] * np.cos(yaw) - a[:, 0] * np.sin(yaw)
    # Nose down to gain speed, right side down to go to the right.
    assert np.abs(pitch - forward / 9.81).max() < 0.02
    assert np.abs(roll + left / 9.81).max() < 0.02


def test_no_flight_meets_the_labs_furniture() -> None:
    clear = lab_room(0).keep_clear
    for seed in range(3):
        xy = np.array([p.position[:2] for _, p in manual_flight(seed, 60.0, 3.0)])
        xy = np.vstack([xy, [p.position[:2] for p in spread_poses(seed, 300)]])
        low = np.array([clear.x_min - clear.margin, clear.y_min - clear.margin])
        high = np.array([clear.x_max + clear.margin, clear.y_max + clear.margin])
        assert (xy - RADIUS > low).all()
        assert (xy + RADIUS < high).all()


def test_below_a_low_ceiling_the_hand_flies_lower() -> None:
    assert heights(CeilingSpec().camera) == HEIGHTS
    low = CeilingSpec(x_m=0.0, y_m=0.0, z_m=2.4, pitch_deg=0.0, roll_deg=0.0)
    bottom, top = heights(low.camera)
    assert bottom == HEIGHTS[0]
    # A quadrotor and 0.1 m around it fill the picture 1.04 m below the camera.
    assert 1.2 < top < 1.5
    places = [p.position for _, p in manual_flight(0, 60.0, 3.0, low)]
    places += [p.position for p in spread_poses(0, 300, low)]
    assert all(sees_whole(low.camera, x) for x in places)
    assert max(x[2] for x in places) > top - 0.1


def test_a_camera_that_sees_no_quadrotor_is_refused() -> None:
    with pytest.raises(NoViewError) as caught:
        spread_poses(0, 1, CeilingSpec(z_m=0.9))
    assert str(caught.value) == (
        "ceiling camera at (0.24, -0.78, 0.90) m: it has no room in view for a whole quadrotor "
        "to fly 0.4 to 0.8 m above the floor; hang it higher or point it down"
    )
    with pytest.raises(NoViewError):
        manual_flight(0, 1.0, 30.0, CeilingSpec(pitch_deg=80.0))


HIDDEN = Hiding((0.08, 0.1, 1.2), begin=10.0, seconds=5.0)


def visible(stage: DepthStage, drone: Pose, motions: list[Motion], stamp: float) -> int:
    """Return how many pixels show the drone [px]."""
    things = things_at(motions, stamp)
    return int((stage.exact(drone, things) != stage.exact(None, things)).sum())


def test_a_board_hides_a_drone_whole_anywhere_on_the_papers_paths() -> None:
    stage = DepthStage(CeilingSpec(hull=True), 0)
    for theta in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
        c, s = math.cos(theta), math.sin(theta)
        for x in ((0.08 + 0.5 * c, 0.1 + 0.8 * s, 1.2 + 0.12 * s), (0.08 + 0.9 * s * c, 0.1 + 0.8 * s, 1.3)):
            drone = Pose(np.array(x), theta)
            assert visible(stage, drone, [], 12.0) > 2000
            assert visible(stage, drone, [HIDDEN], 12.0) == 0


def test_a_board_is_there_from_its_begin_for_its_seconds() -> None:
    stage, drone = DepthStage(CeilingSpec(), 0), Pose(np.array([0.08, 0.1, 1.2]), 0.0)
    seen = {t: visible(stage, drone, [HIDDEN], t) for t in (9.0, 10.0, 12.5, 15.0, 16.0)}
    assert seen == {9.0: seen[9.0], 10.0: 0, 12.5: 0, 15.0: 0, 16.0: seen[9.0]}
    assert seen[9.0] > 1000


def test_a_board_is_pushed_in_and_pulled_out_and_else_it_is_not_in_the_room() -> None:
    assert HIDDEN.at(8.9) is None
    assert HIDDEN.at(9.0) is None
    coming, going = HIDDEN.at(9.5), HIDDEN.at(15.5)
    there = HIDDEN.at(10.0)
    assert coming == going != there
    assert coming is not None
    assert there is not None
    assert coming.x - there.x == pytest.approx(1.5 * 1.4 / 2.0)
    assert (coming.y, coming.z, coming.yaw) == (there.y, there.z, there.yaw)
    assert HIDDEN.at(16.0) is None


def test_a_board_without_a_slide_appears_and_vanishes() -> None:
    sudden = Hiding((0.0, 0.0, 1.0), 1.0, 2.0, slide=0.0)
    assert [sudden.at(t) is not None for t in (0.999, 1.0, 3.0, 3.001)] == [False, True, True, False]


def test_a_board_comes_in_from_out_of_the_picture() -> None:
    stage = DepthStage(CeilingSpec(), 0)
    just_come = things_at([HIDDEN], 9.01)
    assert len(just_come) == 1
    np.testing.assert_array_equal(stage.exact(None, just_come), stage.exact(None))


@given(st.floats(0.1, 0.9), st.floats(-3.0, 3.0))
def test_a_boards_middle_is_between_the_place_and_the_camera(share: float, yaw: float) -> None:
    place, eye = np.array([0.4, -0.3, 1.1]), CEILING_CAMERA.t_world_camera
    board = Hiding((0.4, -0.3, 1.1), 0.0, 1.0, share=share, yaw=yaw).at(0.5)
    assert board is not None
    middle = np.array([board.x, board.y, board.z + 0.01])
    np.testing.assert_allclose(middle, place + share * (eye - place), atol=1e-12)


def test_only_things_that_are_in_the_room_are_listed() -> None:
    chair = Standing(ThingPose("chair", 1.0, 1.0))
    assert things_at([HIDDEN, chair], 0.0) == [chair.pose]
    assert [thing.kind for thing in things_at([HIDDEN, chair], 12.0)] == ["board", "chair"]


@given(walkers, st.floats(0.0, 60.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_a_walker_is_at_the_place_at_the_time(walker: Walker, stamp: float, x: float, y: float) -> None:
    there = walk_through((x, y), stamp, walker).at(stamp)
    assert (there.x, there.y) == pytest.approx((x, y), abs=1e-9)
    assert there.yaw == walker.at(stamp).yaw


def test_a_person_between_the_camera_and_the_drone_hides_some_of_it() -> None:
    stage, drone = DepthStage(CeilingSpec(), 0), Pose(np.array([0.08, 0.9, 1.2]), 0.0)
    x, y = drone.position[:2] + 0.5 * np.array([0.09, -0.99])  # toward the camera
    walker = walk_through((x, y), 3.0, Walker((0.0, 0.0), (0.9, 0.6)))
    free = visible(stage, drone, [], 3.0)
    assert 0 < visible(stage, drone, [walker], 3.0) < 0.9 * free
    assert visible(stage, drone, [walker], 4.5) == free
