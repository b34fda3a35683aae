"""The experiments in which nothing is flown to an end but something is measured: figures for every seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field

from noctule.experiments.loc_detection import FRAMES, draw_detection, measure_detection
from noctule.experiments.loc_fusion import FusionOptions, keep_fusion, measure_fusion
from noctule.experiments.loc_identification import IdentificationOptions, fly_vehicle, run
from noctule.experiments.loc_pose import POSES, measure_poses
from noctule.settings import Settings


class CeilingOptions(Settings):
    """What may be asked of an experiment below the ceiling camera."""

    hull: bool = Field(False, description="the drone wears its indoor hull")


class PoseOptions(CeilingOptions):
    """What may be asked of loc-pose."""

    person: bool = Field(False, description="somebody stands at 0.4 to 0.75 m from the drone")
    poses: int = Field(POSES, ge=1, le=100_000, description="poses that are measured")


@dataclass(frozen=True, slots=True)
class MeasuredExperiment:
    """An experiment that returns figures."""

    title: str
    options: type[Settings]
    measure: Callable[[int, Any, Callable[[int], None]], Mapping[str, Any]]  # seed, options, progress
    steps: Callable[[Any], int]  # how many progress counts to, by options
    keep: Callable[[int, Any, Path], object] | None = None  # leaves files of a seed in a folder


def _detection(seed: int, options: CeilingOptions, progress: Callable[[int], None]) -> Mapping[str, Any]:
    return measure_detection(seed, options.hull, progress=progress)


def _poses(seed: int, options: PoseOptions, progress: Callable[[int], None]) -> Mapping[str, Any]:
    return measure_poses(seed, options.hull, options.person, options.poses, progress)


def _identification(
    seed: int, options: IdentificationOptions, progress: Callable[[int], None]
) -> Mapping[str, Any]:
    return run(seed, options)


def _keep_flights(seed: int, options: IdentificationOptions, folder: Path) -> object:
    return fly_vehicle(seed, options.noise, folder)


MEASURED: dict[str, MeasuredExperiment] = {
    "loc-detection": MeasuredExperiment(
        "6.1: which blob is the drone, beside a person, a box and a tray.",
        CeilingOptions,
        _detection,
        lambda _: FRAMES,
        lambda seed, options, folder: draw_detection(seed, options.hull, folder),
    ),
    "loc-pose": MeasuredExperiment(
        "How true the pose of a single frame is.", PoseOptions, _poses, lambda options: options.poses
    ),
    "loc-identification": MeasuredExperiment(
        "6.2: k1 to k8 and the delay from flights of the deformed sinusoid.",
        IdentificationOptions,
        _identification,
        lambda _: 1,
        _keep_flights,
    ),
    "loc-fusion": MeasuredExperiment(
        "6.3: yaw and position of every sensor and of all of them fused.",
        FusionOptions,
        measure_fusion,
        lambda options: options.frames,
        keep_fusion,
    ),
}
"""The experiments by the name that `noctule experiment` takes."""
