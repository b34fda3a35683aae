"""Time of the vision of one tick and of a new key image, on one core, at 856 x 480 with 60 points.

Run: python benchmarks/bench_tracking.py
"""

import os

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")

import time

import cv2
import numpy as np
import skimage.data

from noctule.camera import PinholeCamera
from noctule.vision.columns import ColumnColour, detect_columns
from noctule.vision.features import detect
from noctule.vision.matching import match_robust, spread
from noctule.vision.tracking import Pyramid, align, track

WIDTH, HEIGHT = 856, 480


def pictures():
    """Return a photograph with a red column in it, and the same a little nearer."""
    photograph = cv2.resize(skimage.data.astronaut(), (WIDTH, WIDTH), interpolation=cv2.INTER_CUBIC)
    first = np.ascontiguousarray(photograph[180 : 180 + HEIGHT])
    first[30:450, 400:420] = (200, 30, 30)
    H = np.array([[1.01, 0.0, 1.0], [0.0, 1.01, -3.0], [0.0, 0.0, 1.0]])
    return first, cv2.warpPerspective(first, H, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)


def timed(name, work, repeat):
    """Print median, 95th percentile and least time [ms]; the first call, which may compile, stands apart."""
    started = time.perf_counter()
    work()
    cold = 1e3 * (time.perf_counter() - started)
    taken = np.empty(repeat)
    for i in range(repeat):
        started = time.perf_counter()
        work()
        taken[i] = 1e3 * (time.perf_counter() - started)
    median, p95 = np.percentile(taken, [50, 95])
    print(f"{name:34s} median {median:7.2f}  p95 {p95:7.2f}  least {taken.min():7.2f}  first {cold:7.1f} ms")


def main():
    cv2.setNumThreads(1)
    camera = PinholeCamera.centred(WIDTH, HEIGHT, 510.0)
    first, second = pictures()
    ref, current = detect(first), detect(second)
    p = ref.p[spread(ref.p, WIDTH, HEIGHT, 60)]
    previous = Pyramid.of(first)
    p_now, _ = track(previous, Pyramid.of(second), p)
    print(f"{WIDTH} x {HEIGHT}, {len(p)} points, {len(ref)} features, one core")
    timed("track, forward and back", lambda: track(previous, Pyramid.of(second), p), 200)
    timed("align to a key image", lambda: align(previous, Pyramid.of(second), p, p_now), 200)
    timed("columns, one colour", lambda: detect_columns(first, ColumnColour()), 200)
    timed("features, sift", lambda: detect(second), 30)
    timed("features, orb", lambda: detect(second, "orb"), 30)
    timed("match, robust", lambda: match_robust(ref, current, camera), 30)
    timed("spread, 60 of all", lambda: spread(ref.p, WIDTH, HEIGHT, 60), 50)


if __name__ == "__main__":
    main()
