"""The depth camera as a device: what every DepthCamera has to do, and what the simulated one shows."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from noctule.camera import CEILING_CAMERA, PinholeCamera
from noctule.devices.protocols import Clock, DepthCamera, DeviceError, StaleFrameError
from noctule.geometry import Pose
from noctule.messages import Command, DepthFrame
from noctule.simulation import CameraSpec, SimulatedWorld, VehicleSpec, WorldSpec
from noctule.simulation.ceiling import CeilingSpec, DepthStage, Standing, ThingPose, Walker, lab_room

START = Pose(np.array([0.1, 0.15, 1.2]), 0.4)
FRONT = CameraSpec(width=64, height=48, focal=40.0)
ROOM = lab_room(0)


def world(ceiling: CeilingSpec | None, seed: int = 0, **given: object) -> SimulatedWorld:
    return SimulatedWorld(ROOM, VehicleSpec(gusts=0.5), FRONT, START, seed, ceiling=ceiling, **given)  # type: ignore[arg-type]


@dataclass
class Rig:
    """A depth camera on the bench, not open, with the clock that moves it."""

    clock: Clock
    camera: DepthCamera
    frame: float  # [s] between frames
    latency: float  # [s] from exposure to delivery
    close: Callable[[], None]

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)


def _simulated() -> Rig:
    made = world(CeilingSpec())
    assert made.ceiling is not None
    return Rig(made.clock, made.ceiling, 1.0 / 30.0, 0.04, made.close)


RIGS = {"simulated": _simulated}


@pytest.fixture(params=sorted(RIGS))
def bench(request: pytest.FixtureRequest) -> Iterator[Rig]:
    rig = RIGS[request.param]()
    yield rig
    rig.close()


@pytest.fixture
def rig(bench: Rig) -> Iterator[Rig]:
    bench.camera.open()
    yield bench
    bench.camera.close()


def test_a_depth_camera_is_live_between_open_and_close(bench: Rig) -> None:
    assert not bench.camera.live
    bench.camera.open()
    assert bench.camera.live
    bench.camera.close()
    bench.camera.close()
    assert not bench.camera.live


def test_a_closed_depth_camera_shows_nothing(bench: Rig) -> None:
    with pytest.raises(DeviceError):
        bench.camera.read(0.1)
    with pytest.raises(DeviceError):
        bench.camera.latest(1.0)


def test_frames_fit_the_intrinsics_and_are_millimetres(rig: Rig) -> None:
    frame = rig.camera.read(1.0)
    camera = rig.camera.intrinsics
    assert isinstance(frame, DepthFrame)
    assert isinstance(camera, PinholeCamera)
    assert frame.depth.shape == (camera.height, camera.width)
    assert frame.depth.dtype == np.uint16
    assert 500 < np.median(frame.depth) < 8000


def test_reading_waits_for_a_frame_that_was_not_read_before(rig: Rig) -> None:
    stamps = [rig.camera.read(1.0).stamp for _ in range(5)]
    assert np.diff(stamps) == pytest.approx(rig.frame, abs=0.004)


def test_stamps_are_of_exposure_not_of_arrival(rig: Rig) -> None:
    rig.camera.read(1.0)
    frame = rig.camera.read(1.0)
    assert rig.clock.now() - frame.stamp == pytest.approx(rig.latency, abs=0.006)


def test_a_reader_that_was_away_gets_the_newest_frame(rig: Rig) -> None:
    rig.camera.read(1.0)
    rig.wait(0.5)
    assert rig.clock.now() - rig.camera.read(1.0).stamp <= rig.latency + rig.frame + 0.006


def test_peeking_shows_the_same_frame_again(rig: Rig) -> None:
    rig.wait(0.2)
    assert rig.camera.latest(0.2) is rig.camera.latest(0.2)


def test_a_reader_that_waits_too_short_is_told(rig: Rig) -> None:
    rig.wait(0.2)
    rig.camera.read(0.0)
    with pytest.raises(DeviceError):
        rig.camera.read(0.0)


def test_a_frame_older_than_allowed_is_refused(rig: Rig) -> None:
    rig.wait(0.2)
    with pytest.raises(StaleFrameError):
        rig.camera.latest(0.001)


def test_messages_of_the_simulated_depth_camera() -> None:
    with world(CeilingSpec()) as made:
        camera = made.ceiling
        assert camera is not None
        with pytest.raises(DeviceError, match=r"^simulated depth camera: not open; call open\(\) first$"):
            camera.read(0.1)
        camera.open()
        with pytest.raises(DeviceError) as caught:
            camera.read(0.0)
        assert str(caught.value) == (
            "simulated depth camera: no new picture in 0 s; expected one every 0.033 s: wait longer"
        )
        with pytest.raises(StaleFrameError) as other:
            camera.latest(0.1)
        assert str(other.value) == (
            "simulated depth camera: newest picture is inf s old, allowed are 0.100 s; "
            "is the clock running, and is the camera's latency below that?"
        )


def moved_world(ceiling: CeilingSpec | None, seed: int = 0, **given: object) -> SimulatedWorld:
    made = world(ceiling, seed, **given)
    made.vehicle.connect()
    if made.ceiling is not None:
        made.ceiling.open()
    return made


def advance(made: SimulatedWorld, ticks: int) -> list[Pose]:
    """Fly about for a while; return the true pose at every tick of 1/30 s."""
    poses = []
    for _ in range(ticks):
        made.vehicle.send(Command(0.3, 0.2, 0.1, 0.5), 0.2)
        made.clock.sleep_until(made.clock.now() + 1.0 / 30.0)
        poses.append(made.referee.truth().pose)
    return poses


def test_a_frame_shows_the_moment_of_its_exposure() -> None:
    walker = Walker((1.3, 0.2), (0.6, 0.4), speed=1.0)
    box = Standing(ThingPose("box", -0.5, 0.6))
    with moved_world(CeilingSpec(latency_s=0.1), motions=[walker, box]) as made:
        poses = advance(made, 15)
        assert made.ceiling is not None
        frame = made.ceiling.latest(0.5)
    assert frame.stamp == pytest.approx(12 / 30)
    # The world's fifth random stream is the ceiling camera's.
    seed = int(np.random.SeedSequence(0).spawn(5)[4].generate_state(1)[0])
    stage = DepthStage(CeilingSpec(latency_s=0.1), seed, ROOM)
    stamp = frame.stamp
    things = [walker.at(stamp), box.at(stamp)]
    assert np.array_equal(frame.depth, stage.frame(stamp, poses[11], things).depth)
    assert not np.array_equal(frame.depth, stage.frame(stamp, poses[14], things).depth)
    assert not np.array_equal(frame.depth, stage.frame(stamp, poses[11], [walker.at(0.5), box.at(0.5)]).depth)


def test_frames_come_at_the_cameras_rate_and_latency() -> None:
    with moved_world(CeilingSpec(rate_hz=15.0, latency_s=0.12)) as made:
        assert made.ceiling is not None
        stamps = []
        for _ in range(6):
            frame = made.ceiling.read(1.0)
            stamps.append(frame.stamp)
            assert made.clock.now() - frame.stamp == pytest.approx(0.12, abs=1 / 300)
        assert stamps == pytest.approx(np.arange(6) / 15.0, abs=1 / 300)


def test_the_intrinsics_are_the_specs() -> None:
    with world(CeilingSpec()) as made:
        assert made.ceiling is not None
        assert made.ceiling.intrinsics == CEILING_CAMERA.intrinsics


def test_frames_cannot_be_written_to() -> None:
    with moved_world(CeilingSpec(colour=True)) as made:
        assert made.ceiling is not None
        frame = made.ceiling.read(1.0)
        assert frame.colour is not None
        assert frame.colour.shape == (480, 640, 3)
        for pixels in (frame.depth, frame.colour):
            with pytest.raises(ValueError, match="read-only"):
                pixels[0, 0] = 1


def frames(every: int, seed: int = 0) -> list[DepthFrame]:
    read = []
    with moved_world(CeilingSpec(), seed) as made:
        assert made.ceiling is not None
        for k in range(1, 13):
            advance(made, 1)
            if k > 2 and k % every == 0:
                read.append(made.ceiling.read(0.0))
    return read


def test_reading_less_often_changes_no_frame() -> None:
    often, seldom = frames(1), frames(6)
    assert seldom[-1].stamp == often[-1].stamp
    assert np.array_equal(seldom[-1].depth, often[-1].depth)


def test_the_same_seed_gives_the_same_frames_and_another_does_not() -> None:
    one, same, other = frames(6), frames(6), frames(6, seed=1)
    assert all(np.array_equal(a.depth, b.depth) for a, b in zip(one, same, strict=True))
    assert not np.array_equal(one[0].depth, other[0].depth)


def test_a_camera_above_changes_nothing_of_the_flight_or_of_the_front_camera() -> None:
    def flight(ceiling: CeilingSpec | None) -> tuple[list[Pose], np.ndarray, np.ndarray]:
        with moved_world(ceiling, 3) as made:
            made.camera.open()
            poses = advance(made, 20)
            if made.ceiling is not None:
                made.ceiling.read(0.0)
            reports = made.vehicle.state()
            assert reports.v_body is not None
            photo = made.photograph(START, noisy=True).pixels
            return poses, np.append(made.camera.read(0.0).pixels, photo), reports.v_body

    bare, above = flight(None), flight(CeilingSpec(colour=True))
    for a, b in zip(bare[0], above[0], strict=True):
        assert np.array_equal(a.position, b.position)
        assert (a.yaw, a.roll, a.pitch) == (b.yaw, b.roll, b.pitch)
    assert np.array_equal(bare[1], above[1])
    assert np.array_equal(bare[2], above[2])


def test_without_a_ceiling_there_is_no_depth_camera() -> None:
    with SimulatedWorld.from_spec(WorldSpec(camera=FRONT)) as made:
        assert made.ceiling is None
    with SimulatedWorld.from_spec(WorldSpec(camera=FRONT), ceiling=CeilingSpec()) as made:
        assert made.ceiling is not None


def test_who_holds_the_depth_camera_cannot_reach_the_truth() -> None:
    with world(CeilingSpec()) as made:
        assert made.ceiling is not None
        names = [name for name in vars(made.ceiling) if not name.startswith("_Stream__")]
        assert not any("aircraft" in name or "shutter" in name or "source" in name for name in names)


def test_the_quadrotor_in_the_frame_is_where_the_referee_says() -> None:
    with moved_world(CeilingSpec(hull=True, latency_s=0.0)) as made:
        advance(made, 30)
        assert made.ceiling is not None
        frame = made.ceiling.read(0.1)
        truth = made.referee.truth()
    assert frame.stamp == pytest.approx(truth.stamp, abs=1 / 300)
    v, u = np.nonzero(frame.depth)
    points = CEILING_CAMERA.to_world(np.column_stack([u, v]), frame.depth[v, u] / 1000.0)
    ours = points[np.abs(points[:, 2] - truth.pose.position[2]) < 0.1]
    ours = ours[np.linalg.norm(ours[:, :2] - truth.pose.position[:2], axis=1) < 0.6]
    assert len(ours) > 1500
    assert ours[:, :2].mean(axis=0) == pytest.approx(truth.pose.position[:2], abs=0.03)
