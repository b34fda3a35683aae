"""What every Vehicle and Camera has to do; each implementation adds itself to RIGS."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from noctule.camera import PinholeCamera
from noctule.devices.protocols import Camera, Clock, DeviceError, InputKind, StaleFrameError, Vehicle
from noctule.geometry import Pose
from noctule.messages import Command, FlightState
from noctule.simulation import CameraSpec, KeepClear, RoomSpec, SimulatedWorld, VehicleSpec


@dataclass
class Rig:
    """An implementation on the bench: on the floor, not connected, with the clock that moves it."""

    clock: Clock
    vehicle: Vehicle
    camera: Camera
    frame: float  # [s] between pictures
    latency: float  # [s] from exposure to delivery
    close: Callable[[], None]

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)

    def fly(self, height: float = 1.0) -> None:
        self.vehicle.arm()
        self.vehicle.takeoff(height)
        for _ in range(200):
            self.wait(0.1)
            if self.vehicle.state().flight_state is FlightState.FLYING:
                return
        raise AssertionError("it never said that it flies")


def _simulated() -> Rig:
    room = RoomSpec(size=(6.0, 4.0, 3.0), furniture=0, pictures=0, keep_clear=KeepClear(margin=0.0))
    start = Pose(np.zeros(3), 0.0)
    spec = CameraSpec(width=64, height=48, focal=40.0)
    world = SimulatedWorld(room, VehicleSpec(), spec, start, 0, start_flying=False)
    return Rig(world.clock, world.vehicle, world.camera, 1.0 / 30.0, 1.0 / 30.0, world.close)


RIGS = {"simulated": _simulated}


@pytest.fixture(params=sorted(RIGS))
def bench(request: pytest.FixtureRequest) -> Iterator[Rig]:
    rig = RIGS[request.param]()
    yield rig
    rig.close()


@pytest.fixture
def rig(bench: Rig) -> Iterator[Rig]:
    with bench.vehicle:
        bench.camera.open()
        yield bench
        bench.camera.close()


def test_the_protocols_are_met_by_name(bench: Rig) -> None:
    vehicle: Vehicle = bench.vehicle
    camera: Camera = bench.camera
    for name in ("connect", "close", "arm", "takeoff", "land", "emergency", "send", "state"):
        assert callable(getattr(vehicle, name))
    for name in ("open", "close", "read", "latest"):
        assert callable(getattr(camera, name))


def test_a_vehicle_declares_its_input_and_limits(bench: Rig) -> None:
    can = bench.vehicle.capabilities
    assert isinstance(can.input_kind, InputKind)
    assert np.all(can.limits.speeds > 0.0)
    assert can.limits.acceleration > 0.0


def test_with_connects_and_closes(bench: Rig) -> None:
    with bench.vehicle as vehicle:
        assert vehicle is bench.vehicle
        assert vehicle.state().flight_state is FlightState.LANDED
    with pytest.raises(DeviceError):
        bench.vehicle.state()


def test_closing_and_connecting_twice_is_allowed(bench: Rig) -> None:
    bench.vehicle.close()
    bench.vehicle.connect()
    bench.vehicle.connect()
    bench.vehicle.state()
    bench.vehicle.close()
    bench.vehicle.close()


def test_a_closed_vehicle_takes_no_command(bench: Rig) -> None:
    with pytest.raises(DeviceError):
        bench.vehicle.send(Command(), 0.2)
    with pytest.raises(DeviceError):
        bench.vehicle.takeoff(1.0)


def test_takeoff_needs_arming(rig: Rig) -> None:
    with pytest.raises(DeviceError):
        rig.vehicle.takeoff(1.0)
    assert rig.vehicle.state().flight_state is FlightState.LANDED


def test_takeoff_returns_at_once_and_ends_in_hover_at_the_height(rig: Rig) -> None:
    rig.vehicle.arm()
    before = rig.clock.now()
    rig.vehicle.takeoff(1.2)
    assert rig.clock.now() - before < 0.1
    assert rig.vehicle.state().flight_state is FlightState.TAKING_OFF
    rig.vehicle.emergency()


def test_takeoff_reaches_its_height(rig: Rig) -> None:
    rig.fly(1.2)
    rig.wait(1.0)
    height = rig.vehicle.state().height
    assert height is None or abs(height - 1.2) < 0.1


def test_landing_ends_on_the_floor_and_landing_again_changes_nothing(rig: Rig) -> None:
    rig.fly()
    rig.vehicle.land()
    assert rig.vehicle.state().flight_state is FlightState.LANDING
    rig.wait(10.0)
    assert rig.vehicle.state().flight_state is FlightState.LANDED
    rig.vehicle.land()
    rig.wait(0.2)
    assert rig.vehicle.state().flight_state is FlightState.LANDED


def test_send_returns_a_command_within_the_limits_as_it_is(rig: Rig) -> None:
    rig.fly()
    command = Command(0.2, -0.1, 0.05, 0.3)
    assert rig.vehicle.send(command, 0.2) == command


def test_send_returns_what_was_really_sent(rig: Rig) -> None:
    rig.fly()
    limits = rig.vehicle.capabilities.limits
    sent = rig.vehicle.send(Command(99.0, -99.0, 99.0, -99.0), 0.2)
    assert np.all(np.abs(sent.as_array()) <= limits.speeds + 1e-12)
    assert sent.forward > 0.0 > sent.left


def test_nothing_is_sent_while_landed(rig: Rig) -> None:
    assert rig.vehicle.send(Command(0.3), 0.2) == Command()
    rig.wait(0.5)
    assert rig.vehicle.state().flight_state is FlightState.LANDED


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_command_that_is_no_number_is_refused(rig: Rig, bad: float) -> None:
    rig.fly()
    with pytest.raises(DeviceError):
        rig.vehicle.send(Command(forward=bad), 0.2)


@pytest.mark.parametrize("valid_for", [0.0, -1.0, float("nan")])
def test_a_command_that_is_never_valid_is_refused(rig: Rig, valid_for: float) -> None:
    rig.fly()
    with pytest.raises(DeviceError):
        rig.vehicle.send(Command(), valid_for)


def test_a_velocity_is_flown(rig: Rig) -> None:
    rig.fly()
    for _ in range(60):
        rig.vehicle.send(Command(forward=0.3), 0.2)
        rig.wait(1.0 / 30.0)
    velocity = rig.vehicle.state().v_body
    if not rig.vehicle.capabilities.reports_velocity:
        pytest.skip("this vehicle does not report its velocity")
    assert velocity is not None
    assert np.allclose(velocity, [0.3, 0.0, 0.0], atol=0.12)


def test_an_expired_command_becomes_hover_then_landing(rig: Rig) -> None:
    rig.fly()
    for _ in range(30):
        rig.vehicle.send(Command(forward=0.4), 0.2)
        rig.wait(1.0 / 30.0)
    rig.wait(1.7)
    state = rig.vehicle.state()
    assert state.flight_state is FlightState.FLYING
    assert state.v_body is None or abs(state.v_body[0]) < 0.12
    rig.wait(20.0)
    assert rig.vehicle.state().flight_state is FlightState.LANDED


def test_a_new_command_ends_the_hover_of_an_expired_one(rig: Rig) -> None:
    rig.fly()
    rig.vehicle.send(Command(forward=0.4), 0.1)
    rig.wait(0.5)
    for _ in range(180):
        rig.vehicle.send(Command(up=0.01), 0.1)
        rig.wait(1.0 / 30.0)
    assert rig.vehicle.state().flight_state is FlightState.FLYING


def test_emergency_is_idempotent_and_works_in_any_state(rig: Rig) -> None:
    rig.vehicle.emergency()
    rig.vehicle.emergency()
    assert rig.vehicle.state().flight_state is FlightState.EMERGENCY


def test_emergency_in_the_air_ignores_every_later_command(rig: Rig) -> None:
    rig.fly()
    rig.vehicle.emergency()
    assert rig.vehicle.send(Command(up=0.3), 0.5) == Command()
    rig.vehicle.land()
    rig.wait(3.0)
    state = rig.vehicle.state()
    assert state.flight_state is FlightState.EMERGENCY
    assert state.height is None or state.height < 0.2
    with pytest.raises(DeviceError):
        rig.vehicle.takeoff(1.0)


def test_emergency_works_on_a_closed_vehicle(bench: Rig) -> None:
    bench.vehicle.emergency()


def test_reports_are_stamped_with_the_flights_clock_and_grow(rig: Rig) -> None:
    rig.fly()
    stamps = []
    for _ in range(10):
        rig.wait(0.1)
        stamps.append(rig.vehicle.state().stamp)
        assert 0.0 <= rig.clock.now() - stamps[-1] <= 0.1
    assert np.all(np.diff(stamps) > 0.0)


def test_a_camera_tells_its_pinhole_and_mount(bench: Rig) -> None:
    assert isinstance(bench.camera.intrinsics, PinholeCamera)
    assert bench.camera.mount.t_body_camera.shape == (3,)


def test_a_camera_is_live_between_open_and_close(bench: Rig) -> None:
    assert not bench.camera.live
    bench.camera.open()
    assert bench.camera.live
    bench.camera.close()
    bench.camera.close()
    assert not bench.camera.live
    with pytest.raises(DeviceError):
        bench.camera.latest(10.0)
    with pytest.raises(DeviceError):
        bench.camera.read(0.1)


def test_pictures_have_the_size_of_the_pinhole(rig: Rig) -> None:
    picture = rig.camera.read(1.0)
    pinhole = rig.camera.intrinsics
    assert picture.pixels.shape == (pinhole.height, pinhole.width, 3)
    assert picture.pixels.dtype == np.uint8


def test_read_gives_every_picture_once(rig: Rig) -> None:
    stamps = [rig.camera.read(1.0).stamp for _ in range(8)]
    assert np.all(np.diff(stamps) > 0.0)
    assert np.allclose(np.diff(stamps), rig.frame, atol=0.2 * rig.frame)


def test_read_waits_no_longer_than_its_timeout(rig: Rig) -> None:
    rig.camera.read(1.0)
    before = rig.clock.now()
    with pytest.raises(DeviceError):
        rig.camera.read(0.3 * rig.frame)
    assert rig.clock.now() - before <= 0.5 * rig.frame


def test_the_newest_picture_wins(rig: Rig) -> None:
    rig.camera.read(1.0)
    rig.wait(10 * rig.frame)
    picture = rig.camera.read(1.0)
    assert rig.clock.now() - picture.stamp < 2.5 * rig.frame


def test_latest_peeks_and_does_not_take(rig: Rig) -> None:
    rig.wait(5 * rig.frame)
    first = rig.camera.latest(1.0)
    assert rig.camera.latest(1.0).stamp == first.stamp
    assert rig.camera.read(1.0).stamp == first.stamp


def test_latest_refuses_a_picture_that_is_too_old(rig: Rig) -> None:
    rig.wait(5 * rig.frame)
    with pytest.raises(StaleFrameError):
        rig.camera.latest(0.5 * rig.latency)


def test_a_stamp_is_that_of_the_exposure(rig: Rig) -> None:
    rig.wait(5 * rig.frame)
    age = rig.clock.now() - rig.camera.latest(1.0).stamp
    assert age >= rig.latency - 1e-9
