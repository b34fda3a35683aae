"""A camera that stands in the room: pixels with depth to the world and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.camera import CEILING_CAMERA, FixedCamera, PinholeCamera


def test_the_published_camera_hangs_where_the_errata_say() -> None:
    assert np.allclose(CEILING_CAMERA.t_world_camera, [0.241, -0.778, 3.321], atol=5e-4)
    tilt = np.degrees(np.arccos(-CEILING_CAMERA.R_world_camera[2, 2]))
    assert abs(tilt - 16.6) < 0.05


def test_its_rotation_is_a_rotation_though_the_printed_one_is_rounded() -> None:
    R = CEILING_CAMERA.R_world_camera
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.isclose(np.linalg.det(R), 1.0)


@given(st.floats(0, 639), st.floats(0, 479), st.floats(0.5, 6.0))
def test_a_pixel_taken_to_the_world_projects_back_onto_itself(u: float, v: float, z: float) -> None:
    p = np.array([[u, v]])
    x_world = CEILING_CAMERA.to_world(p, np.array([z]))
    assert np.allclose(CEILING_CAMERA.project(x_world), p, atol=1e-9)
    assert np.isclose(CEILING_CAMERA.to_camera(x_world)[0, 2], z)


def test_the_floor_below_the_room_s_middle_is_seen_near_the_picture_s_centre() -> None:
    p = CEILING_CAMERA.project(np.array([[0.1, 0.1, 0.0], [0.1, 0.1, 1.2]]))
    assert (np.abs(p - [320, 240]) < 120).all()


def test_distances_inside_of_the_picture_are_those_to_its_edges():
    k = PinholeCamera.centred(640, 480, 500.0)
    camera = FixedCamera(k, np.eye(3), np.zeros(3))
    slope = 320.0 / 500.0  # of the plane through the right edge
    on_edge = np.array([2.0 * slope, 0.0, 2.0])
    inward = np.array([-1.0, 0.0, slope]) / np.hypot(1.0, slope)
    points = np.array([on_edge, on_edge + 0.2 * inward, on_edge - 0.3 * inward, [0.0, 0.0, -1.0]])
    inside = camera.inside(points)
    assert inside[:3] == pytest.approx([0.0, 0.2, -0.3], abs=1e-12)
    assert inside[3] < 0.0
