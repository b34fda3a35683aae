"""What the sensor makes of exact depths: steps, noise, shadows, holes, limits."""

from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from noctule.camera import CEILING_CAMERA, PinholeCamera
from noctule.simulation.ceiling import CeilingSpec, DepthSensorSpec
from noctule.simulation.ceiling.casting import Canvas
from noctule.simulation.ceiling.sensor import BORDER, DepthSensor
from noctule.simulation.ceiling.shapes import Part, Shape, pack

PERFECT = DepthSensorSpec(noise_steps=0.0, sideways_px=0.0, edge_holes=0.0, dropouts=0.0, least_echo=0.0)
CAMERA = PinholeCamera(320, 120, 527.0, 527.0, 159.5, 59.5)
WALL = Part(Shape.BOX, (0.0, 0.0, 3.1), (9.0, 9.0, 0.1))
BOARD = Part(Shape.BOX, (0.0, 0.0, 1.51), (0.15, 0.1, 0.01))  # its face at 1.5 m


@lru_cache(maxsize=16)
def sensor_with(seed: int, errors: frozenset[tuple[str, float]]) -> DepthSensor:
    spec = CeilingSpec(sensor=PERFECT.model_copy(update=dict(errors)))
    return DepthSensor(CAMERA, spec, np.random.SeedSequence(seed))


def sensed(*parts: Part, number: int = 0, seed: int = 0, **errors: float) -> tuple[np.ndarray, Canvas]:
    """Return (depth [mm], canvas) of a sensor that is perfect but for `errors`."""
    sensor = sensor_with(seed, frozenset(errors.items()))
    canvas = Canvas(CAMERA)
    canvas.cast(pack(list(parts)), np.zeros((120, 320), np.uint16))
    loss = np.full((120, 320), 65535, np.uint16)
    sensor.lose(canvas, loss)
    return sensor.sense(number, canvas, loss), canvas


def wall(z: float) -> Part:
    return Part(Shape.BOX, (0.0, 0.0, z + 0.1), (9.0, 9.0, 0.1))


def steps_about(z: float) -> float:
    """Return the mean difference [m] between neighbouring depths that occur within 8 % of `z`."""
    slope = Part(Shape.BOX, (0.0, 0.0, z), (9.0, 9.0, 1e-6), np.array(rotation_about_y(0.25)))
    depth, _ = sensed(slope)
    values = np.unique(depth[(depth > 920 * z) & (depth < 1080 * z)])
    return float(np.diff(values).mean() / 1000.0)


def rotation_about_y(angle: float) -> list[list[float]]:
    c, s = np.cos(angle), np.sin(angle)
    return [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]


def test_depth_steps_grow_with_depth_squared() -> None:
    for z in (1.5, 2.5, 4.0):
        assert steps_about(z) == pytest.approx(2.87e-3 * z * z, rel=0.05)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.6, 7.5))
def test_without_noise_a_depth_is_within_half_a_step(z: float) -> None:
    depth, _ = sensed(wall(z))
    assert abs(depth[60, 160] / 1000.0 - z) <= 0.5 * 2.87e-3 * z * z * 1.05 + 0.0006


def test_spread_is_that_measured_for_the_first_kinect() -> None:
    # Khoshelham and Elberink (2012): sd 1.4 mm x (depth [m])^2.
    for z in (1.7, 3.3):
        depth = np.stack([sensed(wall(z), number=k, noise_steps=0.4)[0] for k in range(20)]) / 1000.0
        assert depth.std(axis=0).mean() == pytest.approx(1.4e-3 * z * z, rel=0.12)


def test_a_flat_wall_is_flat_to_millimetres_after_averaging() -> None:
    mean = np.mean([sensed(wall(3.3), number=k, noise_steps=0.4)[0] for k in range(200)], axis=0)
    assert np.abs(mean - 3300.0).max() < 8.0
    assert mean.std() < 2.0
    assert abs(mean.mean() - 3300.0) < 1.0


def test_neighbours_share_their_noise() -> None:
    depth = sensed(wall(2.0), noise_steps=1.0)[0].astype(float)
    depth -= depth.mean()
    near = (depth[:, 1:] * depth[:, :-1]).mean() / depth.var()
    far = (depth[:, 40:] * depth[:, :-40]).mean() / depth.var()
    assert near > 0.35
    assert abs(far) < 0.08


def test_noise_of_two_frames_is_independent() -> None:
    a, b = (sensed(wall(2.0), number=k, noise_steps=1.0)[0].astype(float) for k in (0, 1))
    assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 0.05


def test_the_same_number_and_seed_give_the_same_frame_and_others_do_not() -> None:
    rough = {"noise_steps": 0.4, "sideways_px": 0.7, "edge_holes": 0.35, "dropouts": 0.01, "least_echo": 0.01}
    first = sensed(WALL, BOARD, number=7, seed=3, **rough)[0]
    assert np.array_equal(first, sensed(WALL, BOARD, number=7, seed=3, **rough)[0])
    assert not np.array_equal(first, sensed(WALL, BOARD, number=8, seed=3, **rough)[0])
    assert not np.array_equal(first, sensed(WALL, BOARD, number=7, seed=4, **rough)[0])


def test_a_near_board_throws_its_shadow_to_the_left_and_nowhere_else() -> None:
    depth, canvas = sensed(WALL, BOARD)
    v, u = np.nonzero(canvas.owner == 1)
    left, right, top, bottom = u.min(), u.max(), v.min(), v.max()
    hole = depth == 0
    # As wide as the difference of the disparities, 527 px x 0.075 m x (1 / 1.5 m - 1 / 3 m).
    assert hole[(top + bottom) // 2].sum() == pytest.approx(13.2, abs=1.5)
    columns = np.nonzero(hole.any(axis=0))[0]
    assert columns.max() < left
    assert columns.min() >= left - 15
    assert not hole[:, right + 1 :].any()
    assert not hole[: top - 1].any()
    assert not hole[bottom + 2 :].any()


def test_a_thin_pole_throws_a_shadow_that_does_not_touch_it() -> None:
    # The projector sees the wall between a pole and its shadow.
    depth, canvas = sensed(WALL, Part(Shape.BOX, (0.0, 0.0, 1.505), (0.005, 0.5, 0.005)))
    pole = np.nonzero(canvas.owner[60] == 1)[0]
    hole = np.nonzero(depth[60] == 0)[0]
    assert 0 < len(hole) <= len(pole) + 2
    assert hole.max() < pole.min() - 5


def test_a_tilted_surface_throws_no_shadow_on_itself() -> None:
    depth, _ = sensed(Part(Shape.BOX, (0.0, 0.0, 2.0), (9.0, 9.0, 1e-6), np.array(rotation_about_y(-0.9))))
    assert (depth > 0).all()


def test_without_a_baseline_there_are_no_shadows() -> None:
    depth, _ = sensed(WALL, BOARD, baseline_m=0.0)
    assert (depth > 0).all()


def test_holes_open_at_edges_and_nowhere_else() -> None:
    depth, canvas = sensed(WALL, BOARD, edge_holes=0.5)
    v, u = np.nonzero(canvas.owner == 1)
    right, middle = u.max(), slice(v.min() + 5, v.max() - 5)
    at_edge = depth[middle, right - 1 : right + 3] == 0
    assert at_edge.mean() == pytest.approx(0.5, abs=0.12)
    assert not (depth[middle, u.min() + 4 : right - 3] == 0).any()
    assert not (depth[:, right + 5 :] == 0).any()


def test_edges_are_displaced_by_about_a_pixel() -> None:
    spread = []
    for number in range(40):
        depth, canvas = sensed(WALL, BOARD, number=number, sideways_px=0.7)
        near = (depth > 0) & (depth < 2000)
        v, u = np.nonzero(canvas.owner == 1)
        rows = near[v.min() + 4 : v.max() - 4, 160:]
        spread.append(rows.sum(axis=1))
    spread = np.concatenate(spread)
    assert 0.4 < spread.std() < 1.1
    assert abs(spread.mean() - (u.max() + 1 - 160)) < 0.6


def test_dropouts_have_their_share_everywhere() -> None:
    depth, _ = sensed(wall(2.0), dropouts=0.03)
    assert (depth == 0).mean() == pytest.approx(0.03, abs=0.006)
    assert (depth[:, :BORDER] == 0).mean() < 0.15


@pytest.mark.parametrize(("reflectance", "angle"), [(0.02, 0.0), (0.5, 1.54)])
def test_dark_and_grazing_surfaces_send_nothing_back(reflectance: float, angle: float) -> None:
    R = np.array(rotation_about_y(angle))
    dark = Part(Shape.BOX, (0.0, 0.0, 2.5), (0.3, 0.3, 1e-6), R, reflectance=reflectance)
    depth, canvas = sensed(dark, least_echo=0.008)
    seen = canvas.owner == 0
    assert seen.any()
    assert (depth[seen] == 0).mean() > 0.75
    bright, _ = sensed(Part(Shape.BOX, (0.0, 0.0, 2.5), (0.3, 0.3, 1e-6), reflectance=0.5), least_echo=0.008)
    assert (bright[50:70, 150:170] > 0).mean() > 0.97


def test_half_is_lost_at_the_least_echo() -> None:
    depth, _ = sensed(Part(Shape.BOX, (0.0, 0.0, 2.1), (9.0, 9.0, 0.1), reflectance=0.4), least_echo=0.1)
    assert (depth[50:70, 150:170] == 0).mean() == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize(
    ("z", "seen"), [(0.3, False), (0.49, False), (0.52, True), (7.8, True), (8.5, False)]
)
def test_there_is_no_depth_nearer_or_farther_than_the_range(z: float, seen: bool) -> None:
    depth, _ = sensed(wall(z))
    assert (depth > 0).all() if seen else (depth == 0).all()


def test_depths_are_unsigned_millimetres() -> None:
    depth, _ = sensed(wall(2.0))
    assert depth.dtype == np.uint16
    assert depth.shape == (120, 320)


def test_nothing_in_the_room_is_no_depth() -> None:
    assert (sensed()[0] == 0).all()


def test_the_default_camera_is_the_published_one() -> None:
    camera = CeilingSpec().camera
    assert camera.intrinsics == CEILING_CAMERA.intrinsics
    assert camera.R_world_camera == pytest.approx(CEILING_CAMERA.R_world_camera, abs=1e-12)
    assert camera.t_world_camera == pytest.approx(CEILING_CAMERA.t_world_camera, abs=1e-12)


def test_angles_of_the_mounting_turn_the_camera_as_they_say() -> None:
    down = CeilingSpec(yaw_deg=0.0, pitch_deg=0.0, roll_deg=0.0).camera.R_world_camera
    assert down[:, 2] == pytest.approx([0.0, 0.0, -1.0])
    assert -down[:, 1] == pytest.approx([1.0, 0.0, 0.0])  # the picture's top
    turned = CeilingSpec(yaw_deg=90.0, pitch_deg=0.0, roll_deg=0.0).camera.R_world_camera
    assert -turned[:, 1] == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)
    behind = CeilingSpec(yaw_deg=0.0, pitch_deg=20.0, roll_deg=0.0).camera.R_world_camera
    assert behind[0, 2] < 0.0
    assert behind[1, 2] == pytest.approx(0.0, abs=1e-12)
    left = CeilingSpec(yaw_deg=0.0, pitch_deg=0.0, roll_deg=20.0).camera.R_world_camera
    assert left[1, 2] > 0.0


def test_keys_that_do_not_exist_are_refused() -> None:
    with pytest.raises(ValidationError, match="Extra inputs are not permitted"):
        CeilingSpec.model_validate({"rate": 30.0})
