"""`loc-detection`: section 6.1 of Santos et al., with company: a person, a box and a tray beside the drone.

A drone flown by hand, a person who walks about, a box that is pushed over the floor and a tray of the drone's
size that is carried. In every frame each method says which blobs, or which place, are the drone. A frame is
judged when the drone can be seen apart: whole inside the picture, not hidden, and its outline touching no
other thing's.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.experiments.ceiling import RATE, TaughtCamera, stamps, teach_camera
from noctule.geometry import Array, Pose
from noctule.localization.detection.detector import Detector
from noctule.localization.detection.splinters import MIN_AREA
from noctule.localization.heading.pose import blob_position
from noctule.messages import DepthFrame
from noctule.simulation.ceiling import Motion, ThingPose, Walker, manual_flight, things_at
from noctule.vision.depth import find_blobs

FRAMES = 1200
_TIMED = 200  # frames for Fig. 12
_BATCH = 30  # frames that are drawn before they are looked at: drawing empties the caches, and is not timed
METHODS = ("cubics", "band", "hu", "tracked")
_NEAR = 0.15  # [m], what is accepted within this of the drone is the drone
_APART = 3  # [px] between outlines
_VISIBLE = 0.95  # share of its outline that nothing hides
_CARRIED = (0.9, 1.2)  # [m], heights of the tray

Progress = Callable[[int], None]


@dataclass(slots=True)
class Tally:
    """What one method said, frame by frame."""

    right: list[int] = field(default_factory=list)  # acceptances of the drone, one at most is expected
    wrong: list[int] = field(default_factory=list)  # acceptances of something else
    times: list[float] = field(default_factory=list)  # [s]

    def add(self, positions: Sequence[Array], drone: Array, seconds: float) -> None:
        """Take what was accepted in a frame, as positions (3,) [m]."""
        near = [float(np.linalg.norm(p[:2] - drone[:2])) < _NEAR for p in positions]
        self.right.append(sum(near))
        self.wrong.append(len(near) - sum(near))
        self.times.append(seconds)

    def figures(self, apart: NDArray[np.bool_]) -> dict[str, float]:
        """Return the figures; `apart` (n,) are the frames in which the drone can be seen apart."""
        right, wrong = np.array(self.right), np.array(self.wrong)
        only = (right == 1) & (wrong == 0)
        return {
            "detected": float((right[apart] > 0).mean()),
            "false_per_frame": float(wrong.mean()),
            "only_drone": float(only[apart].mean()),
            "frame_ms": 1e3 * float(np.median(self.times)),
            "longest_false_s": longest(wrong > 0) / RATE,
        }


def longest(flags: NDArray[np.bool_]) -> int:
    """Return the length of the longest run of True."""
    best = run = 0
    for flag in flags:
        run = run + 1 if flag else 0
        best = max(best, run)
    return best


def company(rng: np.random.Generator) -> tuple[Motion, ...]:
    """Draw a person, a box that is pushed and a tray that is carried, on ellipses through the view."""

    def walker(**kind: Any) -> Walker:
        return Walker(
            (float(rng.uniform(-0.3, 0.5)), float(rng.uniform(-0.3, 0.5))),
            (float(rng.uniform(0.5, 1.1)), float(rng.uniform(0.4, 0.9))),
            turn=float(rng.uniform(-math.pi, math.pi)),
            start=float(rng.uniform(0.0, 5.0)),
            **kind,
        )

    return (
        walker(speed=float(rng.uniform(0.5, 0.9)), look=int(rng.integers(4))),
        walker(kind="box", speed=float(rng.uniform(0.1, 0.3))),
        walker(kind="tray", speed=-float(rng.uniform(0.3, 0.6)), z=float(rng.uniform(*_CARRIED))),
    )


def is_apart(taught: TaughtCamera, pose: Pose, things: Sequence[ThingPose]) -> bool:
    """Return whether the drone can be seen apart, by exact depths that no method is shown."""
    stage = taught.stage
    empty, both, others = stage.exact(None), stage.exact(pose, things), stage.exact(None, things)
    outline = stage.exact(pose) != empty
    shown = both != others
    border = np.ones_like(outline)
    border[_APART:-_APART, _APART:-_APART] = False
    if not outline.any() or (outline & border).any() or shown.sum() < _VISIBLE * outline.sum():
        return False
    wide = cv2.dilate(outline.astype(np.uint8), np.ones((2 * _APART + 1, 2 * _APART + 1), np.uint8))
    return not bool(((wide > 0) & (others != empty)).any())


def measure_detection(
    seed: int, hull: bool, frames: int = FRAMES, progress: Progress = lambda _: None
) -> dict[str, Any]:
    """Return the figures of one seed, by method, and the share of frames in which the drone is apart."""
    apart, tallies = watch(seed, hull, frames, progress)
    return {"apart": float(apart.mean()), **{name: tallies[name].figures(apart) for name in METHODS}}


def watch(
    seed: int, hull: bool, frames: int, progress: Progress = lambda _: None
) -> tuple[NDArray[np.bool_], dict[str, Tally]]:
    """Return in which frames (n,) the drone can be seen apart, and what every method said."""
    taught = teach_camera(seed, hull)
    rng = np.random.default_rng([seed, 8])
    things_that_move = company(rng)
    locator = taught.locator()
    tallies = {name: Tally() for name in METHODS}
    flight = manual_flight(seed + 1_000_000, frames / RATE, RATE, taught.stage.spec)
    apart = np.zeros(frames, dtype=bool)
    todo = enumerate(zip(stamps(taught.stamp, frames), flight, strict=True))
    while batch := tuple(itertools.islice(todo, _BATCH)):
        seen = []
        for k, (stamp, (_, pose)) in batch:
            things = things_at(things_that_move, stamp)
            seen.append((taught.stage.frame(stamp, pose, things), pose.position))
            apart[k] = is_apart(taught, pose, things)
        for frame, drone in seen:
            _propose(frame, drone, taught, tallies)
        for frame, drone in seen:
            started = time.perf_counter()
            measured = locator.step(frame).measurement
            spent = time.perf_counter() - started
            tallies["tracked"].add([] if measured is None else [measured.position], drone, spent)
        progress(batch[-1][0] + 1)
    return apart, tallies


def _propose(frame: DepthFrame, drone: Array, taught: TaughtCamera, tallies: dict[str, Tally]) -> None:
    """Let the three detectors look at a frame."""
    started = time.perf_counter()
    _, blobs = find_blobs(frame.depth, taught.background, taught.camera.intrinsics, min_area=MIN_AREA)
    found = time.perf_counter() - started
    detectors: tuple[Detector, ...] = (taught.detectors.cubics, taught.detectors.band, taught.detectors.hu)
    for detector in detectors:
        started = time.perf_counter()
        accepted = detector.propose(blobs, taught.camera)
        spent = time.perf_counter() - started
        where = [blob_position(blob, taught.camera) for blob in accepted]
        tallies[detector.name].add(where, drone, found + spent)


def draw_detection(seed: int, hull: bool, folder: Path) -> None:
    """Draw Fig. 11 and Fig. 12 of Santos et al., and the learned top view, into a folder."""
    from noctule.reports.detector_figures import write_detector_figure, write_timing_figure
    from noctule.reports.template_figure import write_template_figure

    taught = teach_camera(seed, hull)
    write_detector_figure(
        taught.samples, taught.detectors.cubics, taught.detectors.band, folder / "figure-11.png"
    )
    _, tallies = watch(seed, hull, _TIMED)
    # The first frames compile and warm up.
    times = {name: 1e3 * np.array(tally.times[_TIMED // 10 :]) for name, tally in tallies.items()}
    write_timing_figure(times, folder / "figure-12.png")
    write_template_figure(taught.template, folder / "template.png")
