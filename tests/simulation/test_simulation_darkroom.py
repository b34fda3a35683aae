import threading

import numpy as np
import pytest

from noctule.geometry import Pose
from noctule.messages import Command
from noctule.simulation import CameraSpec, RoomSpec, SimulatedWorld, VehicleSpec
from noctule.simulation.darkroom import Darkroom

HERE = Pose(np.array([0.0, 0.0, 1.0]), 0.0)
PLAIN = RoomSpec(furniture=0, pictures=0, lamps=0)
SMALL = CameraSpec(width=64, height=48, focal=40.0)


class FakeEye:
    def __init__(self, log):
        self.log = log

    def draw_from(self, body):
        self.log.append((threading.current_thread().name, float(body.position[0])))
        return np.full((4, 4, 3), 7, dtype=np.uint8)

    def close(self):
        self.log.append((threading.current_thread().name, "closed"))


def test_everything_that_touches_the_eye_happens_in_one_thread_of_its_own():
    log = []
    darkroom = Darkroom(lambda: FakeEye(log))
    darkroom.draw(HERE)
    assert (darkroom.begin(HERE, lambda pixels: pixels + 1).result() == 8).all()
    darkroom.close()
    assert len({thread for thread, _ in log}) == 1
    assert threading.current_thread().name not in {thread for thread, _ in log}
    assert log[-1][1] == "closed"


def test_an_eye_that_is_never_used_is_never_made():
    made = []
    darkroom = Darkroom(lambda: made.append(1))
    darkroom.close()
    darkroom.close()
    assert made == []


def test_an_error_of_the_eye_reaches_the_reader():
    def broken():
        raise OSError("no library")

    with pytest.raises(OSError, match="no library"):
        Darkroom(broken).draw(HERE)


def fly(read_at):
    """Return the pictures read at the given ticks of one second of flight, by tick."""
    pictures = {}
    with SimulatedWorld(PLAIN, VehicleSpec(gusts=0.5), SMALL, HERE, 3) as world, world.vehicle:
        world.camera.open()
        for tick in range(1, 31):
            world.clock.sleep_until(tick / 30.0)
            world.vehicle.send(Command(forward=0.3, yaw_rate=0.2), 0.2)
            if tick in read_at:
                pictures[tick] = world.camera.latest(0.1)
    return pictures


def test_pictures_begun_at_exposure_are_those_drawn_when_asked_for():
    every, seldom = fly(range(1, 31)), fly({12, 30})
    for tick, picture in seldom.items():
        assert picture.stamp == every[tick].stamp
        assert np.array_equal(picture.pixels, every[tick].pixels)


def test_nothing_is_drawn_while_nobody_reads(monkeypatch):
    drawn = []
    monkeypatch.setattr(Darkroom, "begin", lambda *a, **k: drawn.append(1))
    fly(())
    assert drawn == []
