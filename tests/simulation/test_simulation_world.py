import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.devices.protocols import Referee
from noctule.geometry import Pose
from noctule.messages import Command, FlightState, Truth
from noctule.simulation import (
    CameraSpec,
    ColumnSpec,
    FurnitureSpec,
    RoomSpec,
    SimulatedWorld,
    StartSpec,
    VehicleSpec,
    WorldSpec,
)

SMALL = CameraSpec(width=214, height=120, focal=127.5)
START = Pose(np.array([0.0, 0.0, 1.0]), 0.0)
BARE = RoomSpec(furniture=0, pictures=0, lamps=0)
ROUND = RoomSpec(furniture=0, pictures=0, lamps=0, columns=(ColumnSpec(x=1.0, y=0.5, diameter=0.11),))
BOX = RoomSpec(
    furniture=0, pictures=0, lamps=0, columns=(ColumnSpec(x=1.0, y=0.5, width=0.05, depth=0.02, yaw=0.3),)
)


def fly(seed: int, pictures: bool, model: str = "first_order") -> list:
    """Fly a second with everything that is random, and return all that came out."""
    vehicle = VehicleSpec(model=model, gusts=0.8, attitude_sd=0.01)
    seen = []
    with SimulatedWorld(RoomSpec(columns=ROUND.columns), vehicle, SMALL, START, seed) as world, world.vehicle:
        world.camera.open()
        for k in range(1, 16):
            world.clock.sleep_until(k / 30.0)
            state, truth = world.vehicle.state(), world.referee.truth()
            seen.append((state.roll, state.height, *state.v_body, *truth.pose.position, truth.clearance))
            world.vehicle.send(Command(0.4, 0.1 * math.sin(k), 0.0, 0.3), 0.2)
            if pictures:
                seen.append(world.camera.read(0.1).pixels.tobytes())
    return seen


def test_the_same_seed_gives_the_same_flight_bit_for_bit() -> None:
    assert fly(3, pictures=True) == fly(3, pictures=True)


def test_another_seed_gives_another_flight() -> None:
    assert fly(3, pictures=False) != fly(4, pictures=False)


def test_looking_does_not_change_the_flight() -> None:
    with_pictures = [entry for entry in fly(3, pictures=True) if isinstance(entry, tuple)]
    assert with_pictures == fly(3, pictures=False)


def test_the_models_fly_differently() -> None:
    assert fly(3, pictures=False) != fly(3, pictures=False, model="identified")


def test_the_rooms_seed_does_not_change_gusts_or_noise() -> None:
    def end(room: RoomSpec) -> np.ndarray:
        with SimulatedWorld(room, VehicleSpec(gusts=1.0), SMALL, START, 7) as world:
            world.clock.sleep_until(1.0)
            return world.referee.truth().pose.position

    assert np.array_equal(end(RoomSpec(seed=0)), end(RoomSpec(seed=1)))


def test_time_passes_only_when_someone_sleeps() -> None:
    with SimulatedWorld(BARE, VehicleSpec(), SMALL, START, 0) as world:
        assert world.clock.now() == 0.0
        world.clock.sleep_until(0.5)
        assert world.clock.now() == pytest.approx(0.5)
        world.clock.sleep_until(0.2)
        assert world.clock.now() == pytest.approx(0.5)


@given(st.lists(st.floats(0.0, 0.4), min_size=1, max_size=8))
@settings(max_examples=20, deadline=None)
def test_it_does_not_matter_in_how_many_naps_time_passes(naps: list) -> None:
    whole = SimulatedWorld(BARE, VehicleSpec(gusts=1.0), SMALL, START, 1)
    whole.clock.sleep_until(0.4)
    pieces = SimulatedWorld(BARE, VehicleSpec(gusts=1.0), SMALL, START, 1)
    for stamp in (*sorted(naps), 0.4):
        pieces.clock.sleep_until(stamp)
    assert np.array_equal(whole.referee.truth().pose.position, pieces.referee.truth().pose.position)


def test_ticks_of_a_thirtieth_of_a_second_never_slip() -> None:
    with SimulatedWorld(BARE, VehicleSpec(), SMALL, START, 0) as world:
        for k in range(1, 600):
            world.clock.sleep_until(k / 30.0)
            assert world.clock.now() == pytest.approx(k / 30.0, abs=1e-9)


def test_a_world_may_begin_on_the_floor() -> None:
    with SimulatedWorld(BARE, VehicleSpec(), SMALL, START, 0, start_flying=False) as world, world.vehicle:
        assert world.vehicle.state().flight_state is FlightState.LANDED
        assert world.referee.truth().contacts == ("floor",)


def test_a_world_is_made_of_its_description() -> None:
    spec = WorldSpec(room=BARE, camera=SMALL, start=StartSpec(x=0.5, y=-0.2, z=0.8, yaw=0.4), seed=3)
    with SimulatedWorld.from_spec(spec) as world:
        pose = world.referee.truth().pose
        assert np.allclose(pose.position, [0.5, -0.2, 0.8])
        assert pose.yaw == pytest.approx(0.4)
        assert world.camera.intrinsics == SMALL.intrinsics


def test_closing_a_world_twice_is_allowed() -> None:
    world = SimulatedWorld(BARE, VehicleSpec(), SMALL, START, 0)
    world.close()
    world.close()


def test_the_referee_is_one_and_tells_the_truth() -> None:
    with SimulatedWorld(ROUND, VehicleSpec(), SMALL, START, 0) as world, world.vehicle:
        assert isinstance(world.referee, Referee)
        world.vehicle.send(Command(forward=0.5), 5.0)
        world.clock.sleep_until(2.0)
        truth = world.referee.truth()
        assert isinstance(truth, Truth)
        assert truth.stamp == pytest.approx(2.0)
        assert truth.v_world == pytest.approx([0.5, 0.0, 0.0], abs=0.01)
        later = world.clock.now() + 0.5
        world.clock.sleep_until(later)
        moved = world.referee.truth().pose.position - truth.pose.position
        assert moved == pytest.approx([0.25, 0.0, 0.0], abs=0.005)


def test_only_the_referee_knows_the_truth() -> None:
    with SimulatedWorld(BARE, VehicleSpec(), SMALL, START, 0) as world:
        for device in (world.vehicle, world.camera, world.clock):
            assert not isinstance(device, Referee)
            for name in vars(device):
                public = not name.startswith("_")
                assert not public, f"{type(device).__name__}.{name}"
            for name in ("truth", "pose", "aircraft", "motion", "world", "clearance"):
                assert not hasattr(device, name)


@given(x=st.floats(-0.5, 0.6), y=st.floats(-0.8, 0.2), z=st.floats(0.3, 1.8))
@settings(max_examples=60, deadline=None)
def test_the_clearance_to_a_round_column_is_exact(x: float, y: float, z: float) -> None:
    with SimulatedWorld(ROUND, VehicleSpec(), SMALL, START, 0) as world:
        distance, _ = world.clearance(Pose(np.array([x, y, z]), 0.0))
    assert distance == pytest.approx(math.hypot(1.0 - x, 0.5 - y) - 0.2 - 0.055, abs=1e-3)


@given(angle=st.floats(-3.1, 3.1), away=st.floats(0.3, 1.5))
@settings(max_examples=60, deadline=None)
def test_the_clearance_to_a_turned_box_is_exact(angle: float, away: float) -> None:
    at = np.array([1.0 + away * math.cos(angle), 0.5 + away * math.sin(angle)])
    with SimulatedWorld(BOX, VehicleSpec(), SMALL, START, 0) as world:
        distance, _ = world.clearance(Pose(np.array([*at, 1.0]), 0.0))
    local = np.array([[math.cos(0.3), math.sin(0.3)], [-math.sin(0.3), math.cos(0.3)]]) @ (at - [1.0, 0.5])
    outside = np.maximum(np.abs(local) - [0.01, 0.025], 0.0)
    assert distance == pytest.approx(np.linalg.norm(outside) - 0.2, abs=1e-3)


def test_above_a_low_column_the_clearance_is_vertical() -> None:
    room = RoomSpec(
        furniture=0, pictures=0, lamps=0, columns=(ColumnSpec(x=0.0, y=0.0, diameter=0.2, height=0.5),)
    )
    with SimulatedWorld(room, VehicleSpec(), SMALL, START, 0) as world:
        assert world.clearance(START)[0] == pytest.approx(1.0 - 0.06 - 0.5, abs=1e-4)


def test_the_hull_tilts_with_the_vehicle() -> None:
    room = RoomSpec(
        furniture=0, pictures=0, lamps=0, columns=(ColumnSpec(x=0.0, y=0.0, diameter=0.6, height=0.5),)
    )
    with SimulatedWorld(room, VehicleSpec(), SMALL, START, 0) as world:
        tilted, _ = world.clearance(Pose(START.position, 0.0, 0.2, 0.0))
    expected = 1.0 - 0.5 - 0.06 * math.cos(0.2) - 0.2 * math.sin(0.2)
    assert tilted == pytest.approx(expected, abs=2e-3)


def test_inside_a_column_the_clearance_is_negative_and_the_column_is_named() -> None:
    with SimulatedWorld(ROUND, VehicleSpec(), SMALL, START, 0) as world:
        distance, contacts = world.clearance(Pose(np.array([0.9, 0.5, 1.0]), 0.0))
    assert distance < 0.0
    assert contacts == ("column_0",)


def test_walls_floor_and_ceiling_touch_but_do_not_count_as_clearance() -> None:
    with SimulatedWorld(ROUND, VehicleSpec(), SMALL, START, 0) as world:
        for at, name in (
            ((7.4, 0.0, 1.0), "wall_front"),
            ((-2.9, 0.0, 1.0), "wall_back"),
            ((0.0, 3.4, 1.0), "wall_left"),
            ((0.0, -3.4, 1.0), "wall_right"),
            ((0.0, 0.0, 0.05), "floor"),
            ((0.0, 0.0, 2.96), "ceiling"),
        ):
            distance, contacts = world.clearance(Pose(np.array(at), 0.0))
            assert contacts == (name,)
            assert distance > 0.5
        assert world.clearance(START)[1] == ()


def test_an_empty_room_has_endless_clearance() -> None:
    with SimulatedWorld(BARE, VehicleSpec(), SMALL, START, 0) as world:
        assert world.clearance(START) == (math.inf, ())


def test_furniture_and_persons_count() -> None:
    person = FurnitureSpec(kind="person", x=1.0, y=0.0, width=0.5, depth=0.4, height=1.8)
    with SimulatedWorld(
        RoomSpec(furniture=(person,), pictures=0, lamps=0), VehicleSpec(), SMALL, START, 0
    ) as world:
        distance, _ = world.clearance(START)
        assert distance == pytest.approx(1.0 - 0.2 - 0.2, abs=1e-3)
        assert world.clearance(Pose(np.array([0.7, 0.0, 1.0]), 0.0))[1] == ("person_0",)


@pytest.mark.parametrize("seed", range(3))
def test_the_pruned_search_finds_the_nearest_solid(seed: int) -> None:
    room = RoomSpec(seed=seed, columns=ROUND.columns)
    rng = np.random.default_rng(seed)
    with SimulatedWorld(room, VehicleSpec(), SMALL, START, 0) as world:
        check = world._clearance
        for _ in range(20):
            pose = Pose(rng.uniform([-2.5, -3.0, 0.3], [7.0, 3.0, 2.5]), float(rng.uniform(-3, 3)))
            nearest, _ = check.measure(pose)
            bounds, check._reach = check._reach, check._reach + 1e3
            assert check.measure(pose)[0] == pytest.approx(nearest, abs=1e-9)
            check._reach = bounds


def test_the_experiments_fly_clear_of_the_furniture() -> None:
    angles = np.linspace(-math.pi / 2, math.pi / 2, 12)
    arc = np.column_stack([2.0 + 0.589 * np.cos(angles), 0.589 + 0.589 * np.sin(angles)])
    line = np.column_stack([np.linspace(0.0, 4.5, 20), np.linspace(0.0, 0.5, 20)])
    for seed in range(5):
        with SimulatedWorld(RoomSpec(seed=seed), VehicleSpec(), SMALL, START, 0) as world:
            for at in (*line, *arc):
                assert world.clearance(Pose(np.array([*at, 1.0]), 0.0))[0] > 0.6
