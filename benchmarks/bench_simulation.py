"""How fast the simulated room is, alone on the machine: `python benchmarks/bench_simulation.py`.

Prints milliseconds (median and 95th percentile) of each part of a 30 Hz tick at 856x480, and how many
times faster than real time a flight is that does nothing but look.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable

import numpy as np

from noctule.geometry import Pose
from noctule.messages import Command
from noctule.simulation import CameraSpec, ColumnSpec, RoomSpec, SimulatedWorld, VehicleSpec

TICKS = 300


def timed(samples: list[float], call: Callable[[], object]) -> None:
    """Append the milliseconds that `call` takes."""
    start = time.perf_counter()
    call()
    samples.append(1e3 * (time.perf_counter() - start))


def main() -> None:
    """Fly ten seconds and print the figures as JSON."""
    room = RoomSpec(
        columns=(ColumnSpec(x=0.9, y=1.0, diameter=0.11), ColumnSpec(x=2.9, y=-1.0, diameter=0.1))
    )
    parts: dict[str, list[float]] = {
        name: [] for name in ("make", "first_picture", "step", "picture", "truth")
    }
    start = Pose(np.array([0.0, 0.0, 1.0]), 0.0)
    begin = time.perf_counter()
    world = SimulatedWorld(room, VehicleSpec(gusts=0.5, attitude_sd=0.01), CameraSpec(), start, 0)
    parts["make"].append(1e3 * (time.perf_counter() - begin))
    with world, world.vehicle:
        world.camera.open()
        timed(parts["first_picture"], lambda: world.photograph(start))
        begin = time.perf_counter()
        for k in range(1, TICKS + 1):
            timed(parts["step"], lambda k=k: world.clock.sleep_until(k / 30.0))
            timed(parts["picture"], lambda: world.camera.read(0.0))
            timed(parts["truth"], world.referee.truth)
            world.vehicle.send(Command(0.3 * math.cos(k / 40.0), 0.0, 0.0, 0.3), 0.2)
        wall = time.perf_counter() - begin
    figures = {
        f"{name}_ms": {"median": round(float(np.median(v)), 3), "p95": round(float(np.percentile(v, 95)), 3)}
        for name, v in parts.items()
    }
    print(json.dumps({**figures, "times_real_time": round(TICKS / 30.0 / wall, 2)}, indent=2))


if __name__ == "__main__":
    main()
