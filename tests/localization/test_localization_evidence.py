"""What readings say of cells: the compiled passes against a plain one, and what is never evidence."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from localization_flights import CAMERA, HOME, background, drone, random_pose
from localization_rays import PERSON, TRAY, Thing, cast

from noctule.geometry import Pose
from noctule.localization.evidence import FULL, Evidence, Grid, gather
from noctule.localization.gathering import BAND, BELOW, rotation

GRID = Grid(0.01, 60, -0.045)
ANGLES = st.floats(-math.pi, math.pi)
TILTS = st.floats(-0.4, 0.4)
SEEDS = st.integers(0, 10_000)


def look(depth: np.ndarray, pose: Pose, grid: Grid = GRID) -> Evidence:
    return gather(depth, background().nearest, CAMERA, pose, grid)


def seen(*things: Thing, seed: int | None = 1) -> np.ndarray:
    return cast(CAMERA, things, seed=seed).depth


def plainly(depth: np.ndarray, pose: Pose, grid: Grid = GRID) -> list[np.ndarray]:
    """Drone, free and height of every reading of the whole picture, one rule after the other."""
    k = CAMERA.intrinsics
    v, u = (a.ravel() for a in np.mgrid[0 : k.height, 0 : k.width])
    z, near = depth.ravel() / 1000.0, depth.ravel() < background().nearest.ravel()
    ray = np.column_stack([k.normalise(np.column_stack([u, v])), np.ones(len(u))])
    R = pose.R_world_body.T @ CAMERA.R_world_camera
    t = pose.R_world_body.T @ (CAMERA.t_world_camera - pose.position)
    ray = ray @ R.T
    over = t[2] + z * ray[:, 2] - grid.plane
    is_drone = near & (np.abs(over) < BAND)
    crossing = (grid.plane - t[2]) / ray[:, 2]
    too_near_the_floor = (over > -BAND) & (1000.0 * crossing >= background().nearest.ravel())
    is_free = ~is_drone & (over < BAND) & ~(near & (over > -BELOW)) & ~too_near_the_floor
    d = np.where(is_drone, z, crossing)
    ij = np.floor((t + d[:, None] * ray)[:, :2] / grid.cell + 0.5 * grid.n).astype(int)
    inside = (depth.ravel() > 0) & (ij >= 0).all(axis=1) & (ij < grid.n).all(axis=1)
    area = -(d**2) / ray[:, 2] / (grid.cell**2 * k.fx * k.fy)
    maps = [np.zeros((grid.n, grid.n)) for _ in range(3)]
    for out, which, what in zip(
        maps, (is_drone, is_free, is_drone), (area, area, area * (over + grid.plane)), strict=True
    ):
        np.add.at(out, tuple(ij[which & inside].T), what[which & inside])
    return maps


@settings(deadline=None)  # the first call compiles
@given(ANGLES, TILTS, TILTS)
def test_the_compiled_rotation_is_that_of_a_pose(yaw, roll, pitch):
    expected = Pose(np.zeros(3), yaw, roll, pitch).R_world_body
    np.testing.assert_allclose(rotation(yaw, roll, pitch), expected, atol=1e-14)


@pytest.mark.parametrize("seed", range(6))
def test_every_reading_around_the_body_is_counted_as_one_at_a_time(seed):
    pose = random_pose(np.random.default_rng(seed), tilt=0.08)
    person = Thing(Pose(np.array([pose.position[0] + 0.5, pose.position[1], 0.0]), 0.3), PERSON)
    depth = seen(drone(pose), person, seed=seed)
    got = look(depth, pose)
    inner = (slice(4, -4), slice(4, -4))  # at the rim the sides of other things may be left out
    for fast, plain in zip((got.drone, got.free, got.height), plainly(depth, pose), strict=True):
        # single precision seldom puts a reading at a border into the next cell
        assert (np.abs(fast - plain)[inner] > 1e-3).mean() < 0.003
        assert fast[inner].sum() == pytest.approx(plain[inner].sum(), rel=1e-3)


def test_of_a_near_body_some_rows_are_read_for_all():
    pose = Pose(np.array([0.0, 0.1, 2.5]), 0.7, 0.03, -0.02)
    depth = seen(drone(pose), seed=None)
    got = look(depth, pose)
    for fast, plain in zip((got.drone, got.free), plainly(depth, pose)[:2], strict=True):
        a, b = (m.reshape(6, 10, 6, 10).mean(axis=(1, 3))[1:-1, 1:-1] for m in (fast, plain))
        np.testing.assert_allclose(a, b, atol=0.1)


@pytest.mark.parametrize("z", [0.5, 1.2, 1.8])
def test_a_level_surface_covers_its_cells_once_at_any_height(z):
    pose = Pose(np.array([0.1, 0.1, z]), 0.0)
    got = look(seen(Thing(pose, TRAY), seed=None), pose, Grid(0.02, 20, 0.0))
    assert got.drone[2:18, 2:18].mean() == pytest.approx(1.0, abs=0.05)
    assert got.free[2:18, 2:18].sum() == 0.0


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.floats(0.05, 0.95))
def test_a_reading_that_is_missing_only_takes_evidence_away(seed, share):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng)
    depth = seen(drone(pose), seed=seed)
    holes = np.where(rng.random(depth.shape) < share, 0, depth).astype(np.uint16)
    whole, less = look(depth, pose), look(holes, pose)
    assert (less.drone <= whole.drone + 1e-4).all()
    assert (less.free <= whole.free + 1e-4).all()
    assert less.drone.sum() + less.free.sum() < whole.drone.sum() + whole.free.sum()


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_whatever_is_seen_shares_and_trust_are_shares(seed):
    rng = np.random.default_rng(seed)
    depth = rng.integers(0, 4000, (360, 480)).astype(np.uint16)
    got = look(depth, random_pose(rng, tilt=0.3))
    assert got.share.min() >= 0.0
    assert got.share.max() <= 1.0
    np.testing.assert_allclose(got.share, np.minimum(got.drone / FULL, 1.0), rtol=1e-6)
    np.testing.assert_array_equal(got.trust, np.where(got.drone > 0.0, 1.0, np.minimum(got.free, 1.0)))
    assert (got.height[got.drone == 0.0] == 0.0).all()
    assert np.isfinite(got.height).all()


@pytest.mark.parametrize(
    ("below", "drone_seen", "free_seen"), [(0.05, True, False), (0.3, False, False), (0.7, False, True)]
)
def test_a_thing_below_is_drone_near_it_nothing_further_down_and_free_well_below(
    below, drone_seen, free_seen
):
    tray = Thing(Pose(HOME.position - np.array([0.0, 0.0, below]), 0.0), TRAY)
    got = look(seen(tray, seed=None), Pose(HOME.position, 0.0), Grid(0.02, 10, 0.0))
    assert (got.drone.sum() > 50.0) == drone_seen
    assert (got.free.sum() > 50.0) == free_seen
    assert got.drone.sum() == 0.0 or got.free.sum() == 0.0


@pytest.mark.parametrize(
    "position", [[0.0, 0.0, 3.9], [0.1, 0.1, 3.41], [0.1, 6.0, 1.2], [-9.0, 0.0, 0.5]], ids=str
)
def test_a_body_that_the_camera_cannot_see_has_no_evidence(position):
    got = look(seen(), Pose(np.array(position), 0.3))
    assert got.drone.sum() == 0.0
    assert got.free.sum() == 0.0
    assert got.trust.sum() == 0.0


def test_at_the_edge_of_the_picture_only_the_part_inside_is_seen():
    k = CAMERA.intrinsics
    edge = CAMERA.to_world(np.array([[k.width - 1.0, k.cy]]), np.array([2.0]))[0]
    got = look(seen(seed=None), Pose(edge, 0.0))
    assert 0.25 < np.minimum(got.free, 1.0).mean() < 0.75


def test_the_distance_is_along_the_axis_of_the_camera():
    got = look(seen(), HOME)
    assert got.distance == pytest.approx(CAMERA.to_camera(HOME.position[None])[0, 2], abs=0.02)


@pytest.mark.parametrize("turn", [0.5, 1.6, -2.2])
def test_evidence_turns_with_the_supposed_heading(turn):
    depth = seen(drone(HOME), seed=None)
    for pose in (HOME, replace(HOME, yaw=HOME.yaw + turn)):
        got = look(depth, pose)
        at = np.argwhere(got.drone > 0.5).mean(axis=0) - 0.5 * (GRID.n - 1)
        c, s = math.cos(pose.yaw), math.sin(pose.yaw)
        world = np.array([c * at[0] - s * at[1], s * at[0] + c * at[1]]) * GRID.cell
        expected = 0.01 * np.array([math.cos(HOME.yaw), math.sin(HOME.yaw)])  # the nose is longer
        np.testing.assert_allclose(world, expected, atol=0.008)


def test_gathering_leaves_the_frame_alone_and_answers_the_same():
    depth = seen(drone(HOME))
    before = depth.copy()
    a, b = look(depth, HOME), look(depth, HOME)
    np.testing.assert_array_equal(depth, before)
    for name in ("drone", "free", "height", "share", "trust"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
