"""Time of a whole tick, picture to command, over a flight, on one core, beside the floor of its tracking.

Run: python benchmarks/bench_tick.py [EXPERIMENT] [SEED]

The flight is flown once with the worker's matches as they come, and every observation is kept; then a fresh
pilot is handed the same observations and its step is timed. The floor is Lucas-Kanade forward and back of 60
points between the same pictures, and nothing else.
"""

import os

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1", NUMBA_NUM_THREADS="1")

import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from noctule.experiments import EXPERIMENTS
from noctule.flight import fly_mission, read_recording
from noctule.flight.replay import recorded_mission, recorded_path
from noctule.pilots import make_pilot
from noctule.vision.tracking import Pyramid, track


def row(name, times):
    """Print one line of the table."""
    median, p95 = np.percentile(times, [50, 95])
    print(f"{name:44s} {median:7.2f} {p95:7.2f} {max(times):7.2f}   {len(times)}")


def fresh_pilot(mission, path):
    """Return a pilot as the flight begins with it."""
    return make_pilot(mission.pilot, path, mission.limits.values(), 1.0 / mission.flight.rate_hz)


def timed_ticks(mission, path, ticks):
    """Return milliseconds per tick, the points in each, and the ticks at which the target changed."""
    pilot, times, points, targets = fresh_pilot(mission, path), [], [], []
    for tick in ticks:
        observation = tick.observation()
        started = time.perf_counter()
        decision = pilot.step(observation)
        times.append(1e3 * (time.perf_counter() - started))
        points.append(len(decision.diagnostics.points_current))
        targets.append(decision.diagnostics.target_index)
    changed = np.flatnonzero(np.diff(targets)) + 1
    # The new image's points are measured for the first time in the tick of the change or the one after it.
    return np.array(times), np.array(points), np.union1d(changed, np.minimum(changed + 1, len(times) - 1))


def greatest_step(ticks):
    """Return the greatest change of the sent linear velocity from one tick to the next [m/s]."""
    sent = np.array([tick.sent.as_array()[:3] for tick in ticks])
    return float(np.linalg.norm(np.diff(sent, axis=0), axis=1).max())


def floor(ticks):
    """Return milliseconds of tracking 60 points from each picture to the next."""
    pictures = [tick.observation().picture for tick in ticks]
    pictures = [p.pixels for p in pictures if p is not None][:120]
    p = np.stack(np.meshgrid(np.linspace(60, 790, 10), np.linspace(60, 420, 6)), axis=-1).reshape(-1, 2)
    previous, times = Pyramid.of(pictures[0]), []
    for pixels in pictures[1:]:
        started = time.perf_counter()
        current = Pyramid.of(pixels)
        track(previous, current, p)
        times.append(1e3 * (time.perf_counter() - started))
        previous = current
    return times


def main():
    """Fly, then time."""
    cv2.setNumThreads(1)
    name = sys.argv[1] if len(sys.argv) > 1 else "servo-5.2"
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    with tempfile.TemporaryDirectory() as folder:
        mission = EXPERIMENTS[name].mission(seed)
        lossy = fly_mission(mission, seed, Path(folder), progress=False)
        # Only exact pictures make the fresh pilot ask for the same matches at the same ticks.
        exact = mission.recording.model_copy(update={"lossless": True})
        mission = mission.model_copy(update={"recording": exact})
        result = fly_mission(mission, seed, Path(folder), progress=False)
        recording = read_recording(result.recording)
        mission, path, ticks = recorded_mission(recording), recorded_path(recording), recording.flown
        timed_ticks(mission, path, ticks[:60])  # compiles
        times, points, switches = timed_ticks(mission, path, ticks)
        print(f"{name}, seed {seed}: {result.summary['outcome']}; one core")
        print(f"{'[ms]':44s} {'median':>7s} {'p95':>7s} {'worst':>7s}   ticks")
        row("tick, picture to command", times)
        row("  of these, with 50 points or more", times[points >= 50])
        if len(switches):
            row("  of these, at a change of the image", times[switches])
        row("floor: 60 points, forward and back", floor(ticks))
        limit = mission.limits.values().acceleration / mission.flight.rate_hz
        print(f"greatest step of the command: {greatest_step(ticks):.4f} m/s, the limit is {limit:.4f}")
        factor = lossy.summary["realtime_factor"]
        print(f"the flight itself, rendered and recorded: {factor:.1f} times real time")


if __name__ == "__main__":
    main()
