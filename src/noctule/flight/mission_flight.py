"""A whole mission in simulation: build the world, teach or load the path, fly, record, sum up."""

from __future__ import annotations

import io
import json
import platform
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from noctule.flight.codec import encode_pose
from noctule.flight.flown import Aborted, Flown
from noctule.flight.loop import LoopSettings, fly
from noctule.flight.mission import Mission
from noctule.flight.path_check import require_seen, require_sound
from noctule.flight.path_folder import load_path, load_truth
from noctule.flight.progress import flight_progress
from noctule.flight.recording import FlightRecorder
from noctule.flight.rig import Rig
from noctule.flight.summary import reference_of, summarise
from noctule.flight.teach import teach
from noctule.geometry import Pose
from noctule.messages import FlightState, MatchResult, Observation, Picture, VehicleState
from noctule.pilots import make_matcher, make_pilot
from noctule.pilots.route import unroll
from noctule.pilots.visual_path import VisualPath
from noctule.simulation import SimulatedWorld

_WARM_TICKS = 6
_NOT_OF_THE_PATH = ("truth.toml", "contact-sheet.png")  # in its folder, but not for the pilot
_PACKAGES = ("noctule", "numpy", "opencv-python-headless", "mujoco", "numba", "foxglove-sdk")


@dataclass(frozen=True, slots=True)
class FlightResult:
    """What a flight left behind."""

    summary: dict[str, Any]  # the figures that the command line promises
    recording: Path
    out: Path


def fly_mission(
    mission: Mission,
    seed: int | None,
    out: Path,
    law: Literal["published", "noctule"] | None = None,
    progress: bool = True,
) -> FlightResult:
    """Fly a mission in simulation; writes flight.mcap and summary.json into `out`.

    `seed` None takes the mission's; `law` None too.

    Raises
    ------
    Aborted
        After Ctrl-C, once all is written.
    NoctuleError
        For everything else that a person can mend, such as RecordingError when the disk is full.
    """
    try:
        with _one_thread_each():
            return _fly(settled(mission, seed, law), out, progress)
    except KeyboardInterrupt:
        raise Aborted(
            "flight: ended by Ctrl-C before it began or while it was being ended; "
            "what was recorded until then can be read"
        ) from None


def _fly(mission: Mission, out: Path, progress: bool) -> FlightResult:
    seed = mission.flight.seed
    folder = mission.path.folder or teach(mission, seed, out)
    taught = load_path(folder, mission.camera.intrinsics, mission.pilot.features, mission.camera.mount)
    if mission.path.folder is not None:
        require_sound(taught, f"path {folder}")
    route = mission.path.route(len(taught.images))
    path, truth = unroll(taught, route), load_truth(folder)
    if truth is not None:
        truth = tuple(truth[k] for k in route)
    pilot = make_pilot(mission.pilot, path, mission.limits.values(), 1.0 / mission.flight.rate_hz)
    matcher = make_matcher(mission.pilot, path)
    warm_up(mission, taught)
    settings = LoopSettings(
        mission.flight.rate_hz,
        mission.flight.time_limit_s,
        mission.flight.match_delay_s,
        land_at_end=mission.flight.land,
        height=mission.start.z,
    )
    recording, kept = out / "flight.mcap", mission.recording
    with (
        _world(mission, taught, folder) as world,
        FlightRecorder(
            set_aside(recording), lossless=kept.lossless, jpeg_quality=kept.jpeg_quality
        ) as recorder,
    ):
        _note_beginning(recorder, mission, folder, truth)
        rig = Rig(world.clock, world.vehicle, world.camera, world.referee)
        with flight_progress(progress, settings.time_limit_s) as show:
            # Dead reckoning begins where the mission says, not where the seed really put it.
            start = mission.start.nominal
            flown = fly(rig, pilot, matcher, settings, mission.bounds, recorder, show, start)
        summary = _sum_up(flown, mission, truth)
        noted = {name: json.dumps(value) for name, value in summary.items()}
        summary["recording"] = str(recording)
        _write_summary(out / "summary.json", summary)
        if not recorder.failed:
            recorder.note("summary", noted)
        if flown.error is not None:
            raise flown.error
    return FlightResult(summary, recording, out)


@contextmanager
def _world(mission: Mission, path: VisualPath, folder: Path) -> Iterator[SimulatedWorld]:
    """Give the room with the vehicle in hover and its camera open; a path of another room is refused."""
    seed = mission.flight.seed
    start = mission.start.pose(seed)
    with (
        SimulatedWorld(mission.room, mission.vehicle, mission.camera, start, seed) as world,
        world.vehicle,
    ):
        world.camera.open()
        # The room is painted now, not in the flight's first tick.
        seen = world.photograph(start).pixels
        if mission.path.folder is not None:
            require_seen(path, seen, f"path {folder}")
        yield world


def warm_up(mission: Mission, path: VisualPath) -> None:
    """Show the first key image to a pilot that is then thrown away: no tick of the flight compiles code."""
    dt = 1.0 / mission.flight.rate_hz
    pilot = make_pilot(mission.pilot, path, mission.limits.values(), dt)
    matcher = make_matcher(mission.pilot, path)
    still = VehicleState(0.0, FlightState.FLYING, 0.0, 0.0, 0.0, np.zeros(3), 1.0)
    matches: tuple[MatchResult, ...] = ()
    for i in range(_WARM_TICKS):
        picture = Picture(i * dt, path.images[0].pixels)
        decision = pilot.step(Observation(i * dt, replace(still, stamp=i * dt), picture, matches))
        matches = tuple(matcher(picture, r.key_index) for r in decision.requests)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Keep OpenCV and BLAS to the thread that calls them.

    The loop, the renderer and the worker already fill two cores, and the helpers that these libraries start
    wait by spinning: with them a flight takes a fifth longer.
    """
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(limits=1, user_api="blas"):
            yield
    finally:
        cv2.setNumThreads(before)


def set_aside(recording: Path) -> Path:
    """Rename what an earlier flight left at `recording` to the next free -1, -2, ...; return `recording`."""
    if recording.exists():
        number = 1
        while (kept := recording.with_stem(f"{recording.stem}-{number}")).exists():
            number += 1
        recording.rename(kept)
    return recording


def settled(mission: Mission, seed: int | None, law: Literal["published", "noctule"] | None) -> Mission:
    """Return the mission with the seed and the law that are flown, in every place that they reach."""
    seed = mission.flight.seed if seed is None else seed
    update: dict[str, Any] = {
        "flight": mission.flight.model_copy(update={"seed": seed}),
        "room": mission.room.model_copy(update={"seed": seed}),
    }
    if law is not None:
        update["pilot"] = mission.pilot.model_copy(update={"law": law})
    return mission.model_copy(update=update)


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found


def _note_beginning(
    recorder: FlightRecorder, mission: Mission, folder: Path, truth: tuple[Pose, ...] | None
) -> None:
    """Write all that a replay or a report needs, so that the recording can stand alone."""
    recorder.note(
        "flight",
        {
            "mission": mission.name,
            "law": mission.pilot.law,
            "seed": str(mission.flight.seed),
            "lossless": json.dumps(mission.recording.lossless),
            "simulated": "true",
        },
    )
    recorder.note("versions", _versions())
    if truth is not None:
        recorder.note("truth", {"key_poses": f"[{', '.join(encode_pose(p) for p in truth)}]"})
    recorder.attach("mission.toml", "application/toml", mission.text.encode())
    recorder.attach("mission.json", "application/json", mission.model_dump_json().encode())
    recorder.attach("path.zip", "application/zip", _zipped(folder))
    recorder.flush()


def _zipped(folder: Path) -> bytes:
    """Return the path folder as a zip without the truth, the same bytes for the same path."""
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
        for file in sorted(folder.iterdir()):
            if file.suffix in (".toml", ".png", ".npz") and file.name not in _NOT_OF_THE_PATH:
                # ZipInfo's own date, not the file's.
                archive.writestr(zipfile.ZipInfo(file.name), file.read_bytes())
    return target.getvalue()


def _sum_up(flown: Flown, mission: Mission, truth: tuple[Pose, ...] | None) -> dict[str, Any]:
    goal, reference = truth[-1] if truth else None, reference_of(mission, truth or ())
    outcome = str(flown.outcome)
    return summarise(flown.samples, goal, outcome, flown.reason, flown.realtime_factor, reference)


def _write_summary(path: Path, summary: dict[str, Any]) -> None:
    # The recording holds the same; a disk that is full has been told of already.
    with suppress(OSError):
        path.write_text(json.dumps(summary, indent=2) + "\n", "utf-8")
