"""Rays against parts: depths are those of the analytic surfaces."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.camera import CEILING_CAMERA, PinholeCamera
from noctule.geometry import Array, rot_x, rot_y, rot_z
from noctule.simulation.ceiling.casting import Canvas
from noctule.simulation.ceiling.shapes import COLUMNS, OPACITY, Part, Shape, along, moved, pack

SMALL = PinholeCamera(64, 48, 50.0, 52.0, 30.3, 24.7)  # neither square nor centred
SOLID = np.zeros((48, 64), np.uint16)

angles = st.floats(-3.0, 3.0)


def cast(*parts: Part, camera: PinholeCamera = SMALL) -> tuple[Canvas, Array]:
    """Return the canvas and the depths (height, width), nan where nothing was hit."""
    canvas = Canvas(camera)
    canvas.cast(pack(list(parts)), np.zeros((camera.height, camera.width), np.uint16))
    n = canvas.nearness.astype(np.float64)
    return canvas, np.where(n > 0.0, 1.0 / np.where(n > 0.0, n, 1.0), np.nan)


def rays(camera: PinholeCamera = SMALL) -> Array:
    """Return the ray of every pixel (height, width, 3), z = 1."""
    v, u = np.mgrid[: camera.height, : camera.width]
    m = camera.normalise(np.column_stack([u.ravel(), v.ravel()]))
    return np.hstack([m, np.ones((len(m), 1))]).reshape(camera.height, camera.width, 3)


def test_a_wall_across_the_axis_has_one_depth_everywhere() -> None:
    _, z = cast(Part(Shape.BOX, (0.0, 0.0, 2.1), (5.0, 5.0, 0.1)))
    assert z == pytest.approx(np.full((48, 64), 2.0), abs=1e-6)


def test_a_tilted_plane_has_the_depth_of_its_equation() -> None:
    R = rot_x(0.3) @ rot_y(-0.2)
    _, z = cast(Part(Shape.BOX, (0.0, 0.0, 2.0), (9.0, 9.0, 1e-6), R))
    normal = R[:, 2]
    expected = normal[2] * 2.0 / (rays() @ normal)
    assert z == pytest.approx(expected, abs=1e-5)


def test_the_floor_under_the_published_camera_is_exact_to_a_tenth_of_a_millimetre() -> None:
    pinhole, R = CEILING_CAMERA.intrinsics, CEILING_CAMERA.R_world_camera
    floor = pack([Part(Shape.BOX, (0.0, 0.0, -0.1), (20.0, 20.0, 0.1))])
    canvas = Canvas(pinhole)
    canvas.cast(moved(floor, R.T, -R.T @ CEILING_CAMERA.t_world_camera), np.zeros((480, 640), np.uint16))
    v, u = np.mgrid[:480:7, :640:7]
    p = np.column_stack([u.ravel(), v.ravel()])
    points = CEILING_CAMERA.to_world(p, 1.0 / canvas.nearness[p[:, 1], p[:, 0]])
    assert np.abs(points[:, 2]).max() < 1e-4


@settings(max_examples=30, deadline=None)
@given(angles, angles, st.floats(0.05, 0.4), st.floats(0.05, 0.4), st.floats(0.05, 0.4))
def test_hits_lie_on_the_surface_of_a_turned_ellipsoid(
    a: float, b: float, hx: float, hy: float, hz: float
) -> None:
    R, centre = rot_z(a) @ rot_x(b), np.array([0.1, -0.05, 1.7])
    canvas, z = cast(Part(Shape.ELLIPSOID, tuple(centre), (hx, hy, hz), R))
    hit = canvas.owner == 0
    assert hit.any()
    local = (rays()[hit] * z[hit][:, None] - centre) @ R / [hx, hy, hz]
    assert np.linalg.norm(local, axis=1) == pytest.approx(1.0, abs=1e-3)


@settings(max_examples=12, deadline=None)
@given(angles, angles, st.floats(0.0, 0.7))
def test_hits_on_a_turned_ring_lie_on_its_surface_and_before_its_other_points(
    a: float, b: float, share: float
) -> None:
    R, centre, outer, half = rot_z(a) @ rot_x(b), np.array([0.05, 0.1, 1.5]), 0.4, 0.1
    inner = share * outer
    canvas, z = cast(Part(Shape.TUBE, tuple(centre), (outer, outer, half), R, inner=inner))
    ray = rays()

    def inside(t: Array) -> np.ndarray:
        local = (ray * t[..., None] - centre) @ R
        r = np.hypot(local[..., 0], local[..., 1])
        return (r <= outer) & (r >= inner) & (np.abs(local[..., 2]) <= half)

    # Walking along the rays: the first place inside, to 2 mm, is where it was hit.
    first = np.full(z.shape, np.nan)
    for t in np.arange(1.0, 2.1, 0.002):
        first = np.where(np.isnan(first) & inside(np.full(z.shape, t)), t, first)
    walked = ~np.isnan(first)
    assert (canvas.owner[walked] == 0).all()
    # A ring's far inside may be nearer than the walk's step resolves at grazing rays: compare the most.
    assert np.mean(np.abs(first[walked] - z[walked]) < 0.0025) > 0.98
    assert np.nanmin(first - z) > -1e-3


def test_through_a_rings_hole_one_sees_what_is_behind() -> None:
    ring = Part(Shape.TUBE, (0.0, 0.0, 1.0), (0.3, 0.3, 0.02), inner=0.2)
    canvas, z = cast(ring, Part(Shape.BOX, (0.0, 0.0, 3.1), (9.0, 9.0, 0.1)))
    v, u = round(SMALL.cy), round(SMALL.cx)
    assert z[v, u] == pytest.approx(3.0, abs=1e-5)
    assert z[v, u + 13] == pytest.approx(0.98, abs=1e-5)
    assert canvas.owner[v, u] == 1
    assert canvas.owner[v, u + 13] == 0


@settings(max_examples=20, deadline=None)
@given(st.permutations(range(4)))
def test_the_nearest_surface_is_seen_in_whatever_order_things_are_drawn(order: list[int]) -> None:
    parts = [
        Part(Shape.BOX, (0.0, 0.0, 2.0), (0.5, 0.1, 0.1)),
        Part(Shape.ELLIPSOID, (0.1, 0.0, 1.8), (0.2, 0.2, 0.2)),
        Part(Shape.TUBE, (-0.2, 0.1, 1.9), (0.15, 0.15, 0.3)),
        Part(Shape.BOX, (0.0, 0.0, 2.6), (3.0, 3.0, 0.1)),
    ]
    _, z = cast(*(parts[i] for i in order))
    _, expected = cast(*parts)
    assert np.array_equal(z, expected)


def test_a_small_part_far_aside_is_drawn_where_it_projects() -> None:
    centre = np.array([[0.5, -0.4, 1.9]])
    canvas, _ = cast(Part(Shape.ELLIPSOID, tuple(centre[0]), (0.05, 0.05, 0.05)))
    v, u = np.nonzero(canvas.owner == 0)
    assert [u.mean(), v.mean()] == pytest.approx(SMALL.project(centre)[0], abs=0.5)


def test_what_is_behind_the_eye_or_outside_the_picture_is_not_drawn() -> None:
    canvas, _ = cast(
        Part(Shape.BOX, (0.0, 0.0, -2.0), (0.5, 0.5, 0.5)),
        Part(Shape.ELLIPSOID, (9.0, 0.0, 2.0), (0.5, 0.5, 0.5)),
    )
    assert (canvas.owner == -1).all()
    assert (canvas.nearness == 0.0).all()


def test_a_part_that_reaches_past_the_eye_is_still_seen() -> None:
    # A long beam beside the eye, from behind it to ahead of it.
    canvas, z = cast(Part(Shape.BOX, (0.3, 0.0, 1.0), (0.05, 0.05, 2.0)))
    hit = canvas.owner == 0
    assert hit.any()
    x = rays()[hit][:, 0] * z[hit]
    assert x == pytest.approx(np.full(len(x), 0.25), abs=1e-4)  # its side that faces the eye


def test_opacity_is_the_share_of_rays_that_come_back() -> None:
    canvas = Canvas(SMALL)
    chance = np.random.default_rng(0).integers(0, 65536, (48, 64), dtype=np.uint16)
    canvas.cast(pack([Part(Shape.BOX, (0.0, 0.0, 2.0), (9.0, 9.0, 0.1), opacity=0.3)]), chance)
    assert (canvas.owner == 0).mean() == pytest.approx(0.3, abs=0.03)


def test_an_echo_is_reflectance_times_the_cosine_of_incidence() -> None:
    canvas, _ = cast(Part(Shape.BOX, (0.0, 0.0, 2.0), (9.0, 9.0, 1e-6), rot_x(0.6), reflectance=0.4))
    normal, ray = rot_x(0.6)[:, 2], rays()
    cosine = np.abs(ray @ normal) / np.linalg.norm(ray, axis=2)
    assert canvas.echo == pytest.approx(0.4 * cosine, abs=1e-5)


def test_spans_cover_all_that_was_drawn_and_start_empty_again() -> None:
    canvas = Canvas(SMALL)
    canvas.copy_from(Canvas(SMALL))
    canvas.cast(pack([Part(Shape.TUBE, (0.1, 0.1, 2.0), (0.2, 0.2, 0.2), rot_y(1.0))]), SOLID)
    v, u = np.nonzero(canvas.owner == 0)
    assert (u >= canvas.spans[v, 0]).all()
    assert (u < canvas.spans[v, 1]).all()
    assert (canvas.spans[:, 0] < canvas.spans[:, 1]).sum() < 30  # far from all rows
    canvas.copy_from(Canvas(SMALL))
    assert (canvas.spans[:, 0] >= canvas.spans[:, 1]).all()
    assert (canvas.owner == -1).all()


def test_rows_hold_what_a_part_says() -> None:
    row = pack(
        [Part(Shape.TUBE, (1.0, 2.0, 3.0), (0.1, 0.1, 0.2), inner=0.05, opacity=0.25, reflectance=0.4)]
    )[0]
    assert row.shape == (COLUMNS,)
    assert row[:4] == pytest.approx([2.0, 1.0, 2.0, 3.0])
    assert row[4:13] == pytest.approx(np.eye(3).ravel())
    assert row[13:19] == pytest.approx([0.1, 0.1, 0.2, 0.05, 0.25, 0.4])
    assert row[OPACITY] == 0.25


@settings(max_examples=30, deadline=None)
@given(angles, angles, angles)
def test_moving_there_and_back_changes_nothing(a: float, b: float, c: float) -> None:
    rows = pack([Part(Shape.BOX, (0.1, -0.2, 0.3), (0.1, 0.2, 0.3), rot_y(c))])
    R, t = rot_z(a) @ rot_x(b), np.array([a, b, c])
    assert moved(moved(rows, R, t), R.T, -R.T @ t) == pytest.approx(rows, abs=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.tuples(angles, angles, angles), st.tuples(angles, angles, angles))
def test_along_turns_z_to_the_way_from_start_to_end(
    start: tuple[float, float, float], end: tuple[float, float, float]
) -> None:
    length = math.dist(start, end)
    if length < 1e-3:
        return
    middle, R, half = along(start, end)
    assert half == pytest.approx(length / 2.0)
    assert np.array(middle) + R @ [0.0, 0.0, half] == pytest.approx(np.array(end), abs=1e-9)
    assert R.T @ R == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(R) == pytest.approx(1.0)
