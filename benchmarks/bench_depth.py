"""Time of a depth frame on one core: to a measurement while tracking, to blobs, the floor, plain OpenCV.

Run: python benchmarks/bench_depth.py [FRAMES]   (default 200 different frames, each timed once)

The frames are 640 x 480, of a drone alone and of a drone with a person, a box and a tray. The floor reads the
frame, compares it with the background's thresholds, and counts; nothing can do with less. The whole frame to
a measurement is the default method, `Locator.step`, on a flight it follows, with the health of the frame,
registration and half turn, its template learned from 120 frames of that drone. A camera whose `camera.toml`
has a lens needs it taken out of the depth before. Rows are the milliseconds of
one frame.
"""

import os

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1", NUMBA_NUM_THREADS="1")

import sys
import time

import cv2
import numpy as np
from numba import njit

from noctule.geometry import Pose
from noctule.localization.calibration.lens import Lens, straightener
from noctule.localization.locator import Locator
from noctule.localization.template import build_template
from noctule.messages import DepthFrame
from noctule.simulation.ceiling import CeilingSpec, DepthStage, ThingPose, manual_flight
from noctule.vision.depth import (
    ellipse,
    find_blobs,
    fits,
    hu_moments,
    learn_background,
    shape_distance,
)
from noctule.vision.depth.blobs import MIN_AREA

RATE = 30.0  # [Hz]
TURN = 20  # frames
LAP = 16.0  # [s], of the circle that is flown
STARTING = 15  # frames in which the locator finds the drone; not counted
TEACHING = 120  # frames of which the template is learned
LENS = Lens(0.1, -0.2, 0.001, 0.001)  # as strong as a depth camera's
LOCATE = "whole frame to measurement, tracking"


@njit(cache=True)
def count_foreground(depth, nearest):
    """Return how many pixels are foreground: one pass that reads and compares."""
    n = 0
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            n += (depth[v, u] > 0) & (depth[v, u] < nearest[v, u])
    return n


def plain_opencv(depth, background):
    """Do what `find_blobs` does with OpenCV and numpy alone; return the blobs' moments and mean points."""
    near = cv2.compare(depth, background.nearest, cv2.CMP_LT)
    mask = cv2.bitwise_and(near, cv2.compare(depth, 0, cv2.CMP_GT))
    n, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    found = []
    for k in range(1, n):
        left, top, width, height, area = stats[k]
        if area < MIN_AREA:
            continue
        window = np.s_[top : top + height, left : left + width]
        piece = labels[window] == k
        moments = cv2.moments(piece.view(np.uint8), binaryImage=True)
        v, u = np.nonzero(piece)
        z = depth[window][v, u].astype(np.float64)
        found.append((moments, ((u + left) @ z / area, (v + top) @ z / area, z.mean())))
    return found


def hu_path(depth, background, pattern):
    """Return the distance of every component's Hu moments to a pattern, with OpenCV as published."""
    return [
        shape_distance(pattern, cv2.HuMoments(moments).ravel())
        for moments, _ in plain_opencv(depth, background)
    ]


def hu_of_blobs(depth, background, camera, pattern):
    """Return the same distances, of the blobs of the compiled pass."""
    _, blobs = find_blobs(depth, background, camera)
    return [shape_distance(pattern, hu_moments(blob)) for blob in blobs]


def scenes(stage, n, crowded):
    """Yield n frames of a drone that circles, alone or among a person, a box and a tray."""
    for k in range(n):
        a = 2.0 * np.pi * k / (RATE * LAP)
        pose = Pose(np.array([0.08 + 0.5 * np.cos(a), 0.1 + 0.8 * np.sin(a), 1.2 + 0.3 * np.sin(3 * a)]), a)
        things = [
            ThingPose("person", 0.9 * np.cos(a + 2.0), 1.2 * np.sin(a + 2.0), a, walked=0.05 * k),
            ThingPose("box", -0.8, -0.6),
            ThingPose("tray", 0.9 * np.cos(a + 4.0), np.sin(a + 4.0), a, z=1.0),
        ]
        yield stage.frame(1000.0 + k / RATE, pose, things if crowded else ())


def learn(stage, background):
    """Return the drone's template, from true poses: here only the time matters."""
    flight = manual_flight(0, TEACHING / 6.0, 6.0, CeilingSpec(hull=stage.spec.hull))
    samples = [(stage.frame(100.0 + stamp, pose), pose) for stamp, pose in flight]
    return build_template(samples, background.nearest, stage.camera)


def measure(passes, frames):
    """Return the milliseconds of each pass on each frame, (passes, frames).

    A pass sees every frame once, just copied, as it comes from a driver: of a frame that was timed before the
    processor foresees the branches. The passes take turns every few frames. The first frames, in which the
    locator starts, are not counted.
    """
    taken = np.empty((len(passes), len(frames)))
    for first in range(0, len(frames), TURN):
        for j, run in enumerate(passes.values()):
            for i in range(first, min(first + TURN, len(frames))):
                frame = DepthFrame(frames[i].stamp, frames[i].depth.copy())
                started = time.perf_counter()
                run(frame)
                taken[j, i] = 1e3 * (time.perf_counter() - started)
    return taken[:, STARTING:]


def passes_over(background, camera, pattern):
    """Return what is timed, by name."""
    straight = straightener(camera, LENS)
    return {
        "before it, where a lens is taken out": lambda f: straight.depth(f.depth),
        "floor: read, compare, count": lambda f: count_foreground(f.depth, background.nearest),
        "blobs, one compiled pass": lambda f: find_blobs(f.depth, background, camera),
        "  and their ellipses": lambda f: [ellipse(b) for b in find_blobs(f.depth, background, camera)[1]],
        "  and their Hu moments, matched": lambda f: hu_of_blobs(f.depth, background, camera, pattern),
        "plain OpenCV": lambda f: plain_opencv(f.depth, background),
        "  and Hu moments, matched": lambda f: hu_path(f.depth, background, pattern),
        "does the background still fit": lambda f: fits(background, f.depth),
    }


class Tracking:
    """`Locator.step`, and how many frames gave a measurement."""

    def __init__(self, locator):
        """Take a locator that has seen nothing."""
        self.locator, self.measured = locator, 0

    def __call__(self, frame):
        """Look at the next frame."""
        self.measured += self.locator.step(frame).measurement is not None


def main():
    """Learn the empty room, then print a table for each scene."""
    cv2.setNumThreads(1)
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    for hull in (False, True):
        stage = DepthStage(CeilingSpec(hull=hull), 0)
        camera = stage.camera.intrinsics
        empty = [stage.frame(k / RATE, None).depth for k in range(60)]
        started = time.perf_counter()
        background = learn_background(empty)
        learning = 1e3 * (time.perf_counter() - started) / len(empty)
        template = learn(stage, background)
        alone = next(scenes(stage, 1, crowded=False)).depth
        pattern = hu_moments(max(find_blobs(alone, background, camera)[1], key=lambda blob: blob.area))
        for crowded in (False, True):
            frames = list(scenes(stage, n + STARTING, crowded))
            tracking = Tracking(Locator(stage.camera, background, template))
            passes = {LOCATE: tracking, **passes_over(background, camera, pattern)}
            taken = measure(passes, frames)
            print(f"drone {'with' if hull else 'without'} hull, {'among others' if crowded else 'alone'}")
            print(f"{'[ms]':40s} {'median':>8s} {'p95':>8s} {'least':>8s}   frames")
            for name, times in zip(passes, taken, strict=True):
                median, p95 = np.percentile(times, [50, 95])
                print(f"{name:40s} {median:8.3f} {p95:8.3f} {times.min():8.3f}   {len(times)}")
            print(f"measured in {tracking.measured} of {len(frames)} frames\n")
        print(f"learning the background: {learning:.1f} ms a frame\n")


if __name__ == "__main__":
    main()
