import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from noctule.camera import PinholeCamera
from noctule.devices.protocols import DeviceError, StaleFrameError
from noctule.geometry import Pose
from noctule.messages import Command
from noctule.simulation import CameraSpec, ColumnSpec, RoomSpec, SimulatedWorld, VehicleSpec
from noctule.simulation.camera import PixelNoise
from noctule.simulation.engine import OpenGLError, mujoco
from noctule.simulation.renderer import Renderer, camera_pose

SMALL = CameraSpec(width=214, height=120, focal=127.5)
START = Pose(np.array([0.0, 0.0, 1.0]), 0.0)
COLUMN = ColumnSpec(x=1.4, y=0.0, width=0.05, depth=0.02, hue=0.6)


def dots(points: np.ndarray, radii: np.ndarray) -> mujoco.MjModel:
    """Small white balls in the dark."""
    spec = mujoco.MjSpec()
    spec.stat.extent = 1.0
    spec.visual.map.znear = 0.03
    spec.visual.headlight.ambient = [1.0, 1.0, 1.0]
    spec.visual.quality.offsamples = 0
    for point, radius in zip(points, radii, strict=True):
        ball = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=point)
        ball.size[0] = radius
        ball.rgba = [1.0, 1.0, 1.0, 1.0]
    return spec.compile()


CAMERAS = [
    CameraSpec().intrinsics,
    PinholeCamera(640, 360, 400.0, 420.0, 300.25, 190.5),
]


@pytest.mark.parametrize("camera", CAMERAS, ids=["centred", "off-centre, two focal lengths"])
@pytest.mark.parametrize("tilted", [False, True])
def test_a_known_point_is_drawn_where_the_pinhole_puts_it(camera: PinholeCamera, tilted: bool) -> None:
    body = Pose(np.array([0.4, -0.3, 1.1]), 0.7, 0.08 if tilted else 0.0, -0.06 if tilted else 0.0)
    R, t = camera_pose(body, np.array([0.09, 0.0, 0.0]), stabilised=not tilted)
    u = np.linspace(20, camera.width - 21, 5)
    v = np.linspace(20, camera.height - 21, 4)
    wanted = np.array([(a + 0.37, b - 0.21) for a in u for b in v])
    depths = np.linspace(1.5, 4.0, len(wanted))
    in_camera = np.column_stack([camera.normalise(wanted), np.ones(len(wanted))]) * depths[:, None]
    renderer = Renderer(dots(in_camera @ R.T + t, 0.014 * depths), camera)
    grey = renderer.draw(R, t)[..., 0]
    renderer.close()
    count, _, _, centres = cv2.connectedComponentsWithStats((grey > 100).astype(np.uint8))
    assert count - 1 == len(wanted)
    distance = np.linalg.norm(centres[1:, None] - wanted[None], axis=2)
    assert distance.min(axis=0).max() < 0.3
    # No half pixel of offset hides in the tolerance.
    nearest = centres[1:][distance.argmin(axis=0)]
    assert np.abs((nearest - wanted).mean(axis=0)).max() < 0.08


@pytest.fixture(scope="module")
def world() -> Iterator[SimulatedWorld]:
    with SimulatedWorld(RoomSpec(columns=(COLUMN,)), VehicleSpec(), SMALL, START, 0) as world:
        yield world


def columns_of_colour(pixels: np.ndarray) -> np.ndarray:
    hsv = cv2.cvtColor(pixels, cv2.COLOR_RGB2HSV)
    mask = (hsv[..., 1] > 180) & (hsv[..., 2] > 60)
    return np.flatnonzero(mask[len(mask) // 2])


def test_a_column_is_the_only_saturated_thing_and_stands_where_it_should(world: SimulatedWorld) -> None:
    pixels = world.photograph(START).pixels
    found = columns_of_colour(pixels)
    front = 1.4 - 0.01 - 0.09
    expected = SMALL.intrinsics.cx + np.array([-1, 1]) * SMALL.focal * 0.025 / front
    assert found.min() == pytest.approx(expected[0], abs=1.0)
    assert found.max() == pytest.approx(expected[1], abs=1.0)
    assert len(found) == found.max() - found.min() + 1


def test_left_in_the_world_is_left_in_the_picture(world: SimulatedWorld) -> None:
    here = columns_of_colour(world.photograph(START).pixels).mean()
    from_the_right = columns_of_colour(world.photograph(Pose(np.array([0.0, -0.2, 1.0]), 0.0)).pixels).mean()
    turned_left = columns_of_colour(world.photograph(Pose(START.position, 0.2)).pixels).mean()
    assert from_the_right < here < turned_left


def test_a_stabilised_camera_sees_no_tilt(world: SimulatedWorld) -> None:
    tilted = Pose(START.position, 0.0, 0.1, -0.1)
    assert np.array_equal(world.photograph(tilted).pixels, world.photograph(START).pixels)


def test_a_camera_that_is_not_stabilised_sees_the_tilt() -> None:
    R, _ = camera_pose(Pose(np.zeros(3), 0.0, 0.0, 0.1), np.zeros(3), stabilised=False)
    # The nose is down: the optical axis points below the horizon.
    assert R[:, 2] == pytest.approx([np.cos(0.1), 0.0, -np.sin(0.1)])
    R, _ = camera_pose(Pose(np.zeros(3), 0.0, 0.1, 0.0), np.zeros(3), stabilised=False)
    # The right side is lowered: the picture's right points down.
    assert R[:, 0] == pytest.approx([0.0, -np.cos(0.1), -np.sin(0.1)])


def test_views_have_features_in_every_direction(world: SimulatedWorld) -> None:
    orb = cv2.ORB_create(500, fastThreshold=8)
    for yaw in np.arange(0.0, 6.2, 0.7):
        pixels = world.photograph(Pose(np.array([0.5, 0.4, 1.0]), float(yaw))).pixels
        assert len(orb.detect(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY))) > 80, yaw


def test_the_same_room_looks_the_same_in_another_world(world: SimulatedWorld) -> None:
    with SimulatedWorld(RoomSpec(columns=(COLUMN,)), VehicleSpec(), SMALL, START, 5) as other:
        assert np.array_equal(other.photograph(START).pixels, world.photograph(START).pixels)


def test_two_worlds_draw_in_turns(world: SimulatedWorld) -> None:
    first = world.photograph(START).pixels
    with SimulatedWorld(RoomSpec(seed=1), VehicleSpec(), SMALL, START, 0) as other:
        between = other.photograph(START).pixels
        assert np.array_equal(world.photograph(START).pixels, first)
        assert np.array_equal(other.photograph(START).pixels, between)
    assert np.array_equal(world.photograph(START).pixels, first)
    assert not np.array_equal(first, between)


def quiet(spec: CameraSpec = SMALL, **camera: float) -> SimulatedWorld:
    settings = spec.model_copy(update={"noise": 0.0, **camera})
    world = SimulatedWorld(RoomSpec(columns=(COLUMN,)), VehicleSpec(), settings, START, 0)
    world.vehicle.connect()
    world.camera.open()
    return world


def test_a_picture_shows_the_moment_of_its_exposure_however_late_it_is_read() -> None:
    with quiet(latency=0.1) as world:
        poses = []
        for k in range(1, 16):
            world.vehicle.send(Command(forward=0.5, yaw_rate=0.3), 0.2)
            world.clock.sleep_until(k / 30.0)
            poses.append(world.referee.truth().pose)
        # Delivered three frames after its exposure.
        picture = world.camera.latest(0.5)
        assert picture.stamp == pytest.approx(12 / 30)
        assert np.array_equal(picture.pixels, world.photograph(poses[11]).pixels)
        assert not np.array_equal(picture.pixels, world.photograph(poses[14]).pixels)


def test_pictures_come_at_the_cameras_rate_and_latency() -> None:
    with quiet(rate=20.0, latency=0.12) as world:
        stamps = []
        for _ in range(12):
            picture = world.camera.read(1.0)
            stamps.append(picture.stamp)
            assert world.clock.now() - picture.stamp == pytest.approx(0.12, abs=1 / 300)
        assert np.allclose(stamps, np.arange(12) / 20.0, atol=1 / 300)


def test_no_picture_is_there_before_the_first_latency() -> None:
    with quiet() as world:
        with pytest.raises(StaleFrameError) as caught:
            world.camera.latest(0.3)
        assert str(caught.value) == (
            "simulated camera: newest picture is inf s old, allowed are 0.300 s; "
            "is the clock running, and is the camera's latency below that?"
        )
        with pytest.raises(DeviceError) as other:
            world.camera.read(0.0)
        assert str(other.value) == (
            "simulated camera: no new picture in 0 s; expected one every 0.033 s: wait longer"
        )
        world.camera.close()
        with pytest.raises(DeviceError, match=r"^simulated camera: not open; call open\(\) first$"):
            world.camera.latest(1.0)


def test_a_picture_cannot_be_written_to() -> None:
    with quiet(noise=1.0) as world:
        picture = world.camera.read(1.0)
        with pytest.raises(ValueError, match="read-only"):
            picture.pixels[0, 0, 0] = 1


def test_reading_less_often_changes_no_picture() -> None:
    def last(every: int) -> np.ndarray:
        with quiet(noise=2.0) as world:
            for k in range(1, 13):
                world.clock.sleep_until(k / 30.0)
                if k % every == 0:
                    picture = world.camera.read(0.0)
            return picture.pixels

    assert np.array_equal(last(1), last(4))


def test_pixel_noise_has_its_strength_and_differs_from_picture_to_picture() -> None:
    noise = PixelNoise(3.0, np.random.SeedSequence(0))
    flat = np.full((120, 214, 3), 128, np.uint8)
    one, two = noise.add(flat, 0).astype(float), noise.add(flat, 1).astype(float)
    assert (one - 128).std() == pytest.approx(3.0, rel=0.05)
    assert abs((one - 128).mean()) < 0.1
    assert abs(np.corrcoef(one.ravel(), two.ravel())[0, 1]) < 0.05


def test_pixel_noise_saturates_and_does_not_wrap() -> None:
    noise = PixelNoise(5.0, np.random.SeedSequence(0))
    assert noise.add(np.full((60, 60, 3), 255, np.uint8), 0).min() > 200
    assert noise.add(np.zeros((60, 60, 3), np.uint8), 0).max() < 55


def test_no_noise_leaves_the_picture_alone() -> None:
    picture = np.zeros((4, 4, 3), np.uint8)
    assert PixelNoise(0.0, np.random.SeedSequence(0)).add(picture, 0) is picture


def test_photographs_may_carry_noise(world: SimulatedWorld) -> None:
    clean = world.photograph(START).pixels.astype(int)
    noisy = world.photograph(START, noisy=True).pixels.astype(int)
    assert 0.5 < (noisy - clean).std() < 3.0


ADVICE = "install it, on Debian or Ubuntu: apt-get install libegl1 libgl1-mesa-dri libgles2"


def test_a_renderer_that_cannot_start_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*args: object, **kwargs: object) -> None:
        raise ImportError("Cannot initialize a EGL device display.\n It is odd.")

    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.setattr(mujoco, "Renderer", broken)
    with pytest.raises(OpenGLError) as caught:
        Renderer(dots(np.zeros((1, 3)), np.array([0.1])), SMALL.intrinsics)
    assert str(caught.value) == (
        "simulation: OpenGL cannot draw (MUJOCO_GL=egl): Cannot initialize a EGL device display. It is odd.; "
        + ADVICE
    )


def test_missing_opengl_libraries_are_told_in_one_line_when_the_room_is_imported(tmp_path: Path) -> None:
    (tmp_path / "mujoco.py").write_text("None.eglQueryString\n")
    code = (
        "from noctule.errors import NoctuleError\n"
        "try:\n    import noctule.simulation\n"
        "except NoctuleError as error:\n    print(error)\n"
    )
    environment = {k: v for k, v in os.environ.items() if k != "MUJOCO_GL"} | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    gl = "egl" if sys.platform == "linux" else ""
    assert done.stdout == (
        f"simulation: OpenGL cannot draw (MUJOCO_GL={gl}): "
        f"'NoneType' object has no attribute 'eglQueryString'; {ADVICE}\n"
    )
    assert done.stderr == ""
