"""A whole mission in simulation: build the world, teach what is to be taught, fly, record, sum up."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

import cv2
from threadpoolctl import threadpool_limits

from noctule.flight.codec import encode_pose
from noctule.flight.flown import Aborted, Flown
from noctule.flight.located_flight import LocatedFlight, prepare_located
from noctule.flight.loop import LoopSettings, fly
from noctule.flight.mission import Mission
from noctule.flight.path_check import require_seen
from noctule.flight.progress import flight_progress, teaching_progress
from noctule.flight.recording import FlightRecorder
from noctule.flight.rig import Rig
from noctule.flight.summary import reference_of, summarise
from noctule.flight.teach import teach
from noctule.flight.visual_flight import VisualFlight, prepare_visual
from noctule.geometry import Pose
from noctule.messages import Pilot
from noctule.pilots.handover import HandoverPilot
from noctule.simulation import SimulatedWorld

SUMMARY = "summary.json"
"""What a flight leaves beside its recording."""
_PACKAGES = ("noctule", "numpy", "opencv-python-headless", "mujoco", "numba", "foxglove-sdk")
_VALID = 0.25  # [s], of a command on arrival


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
    located, visual = None, None
    if mission.space_path is not None:
        with teaching_progress(progress) as told:
            located = prepare_located(mission, out, told)
    if mission.path is not None:
        visual = prepare_visual(mission, mission.path.folder or teach(mission, seed, out))
    settings = LoopSettings(
        mission.flight.rate_hz,
        mission.flight.time_limit_s,
        mission.flight.match_delay_s,
        # Its time runs from sending: one that is late on its way must not have expired when it arrives.
        valid_for_s=_VALID + (0.0 if located is None else mission.known_vehicle.delay_s),
        land_at_end=mission.flight.land,
        land_when_lost=located is not None,
        height=mission.start.z,
    )
    recording, kept = out / "flight.mcap", mission.recording
    with (
        _world(mission, located, visual) as rig,
        FlightRecorder(
            set_aside(recording), lossless=kept.lossless, jpeg_quality=kept.jpeg_quality, depth=kept.depth
        ) as recorder,
    ):
        truth = None if visual is None else visual.truth
        _note_beginning(recorder, mission, _attached(located, visual), truth)
        with flight_progress(progress, settings.time_limit_s) as show:
            # Dead reckoning begins where the mission says, not where the seed really put it.
            start, pilot = mission.start.nominal, _pilot(mission, located, visual)
            matcher = None if visual is None else visual.matcher
            flown = fly(rig, pilot, matcher, settings, mission.bounds, recorder, show, start)
        summary = _sum_up(flown, mission, truth, located)
        noted = {name: json.dumps(value) for name, value in summary.items()}
        summary["recording"] = str(recording)
        _write_summary(out / SUMMARY, summary)
        if not recorder.failed:
            recorder.note("summary", noted)
        if flown.error is not None:
            raise flown.error
    return FlightResult(summary, recording, out)


def _pilot(mission: Mission, located: LocatedFlight | None, visual: VisualFlight | None) -> Pilot:
    if located is None:
        assert visual is not None
        return visual.pilot
    if visual is None:
        return located.pilot
    return HandoverPilot(located.pilot, visual.pilot, mission.limits.values(), mission.handover)


def _attached(located: LocatedFlight | None, visual: VisualFlight | None) -> dict[str, bytes]:
    """Return the files that a replay needs beside the mission, by name."""
    files = {} if visual is None else {"path.zip": visual.zipped()}
    return files if located is None else files | {"site.zip": located.zipped()}


@contextmanager
def _world(mission: Mission, located: LocatedFlight | None, visual: VisualFlight | None) -> Iterator[Rig]:
    """Give the room with the vehicle in it, its cameras open; a visual path of another room is refused."""
    seed = mission.flight.seed
    start = mission.start.pose(seed)
    with (
        SimulatedWorld(
            mission.room,
            mission.vehicle,
            mission.camera,
            start,
            seed,
            start_flying=not mission.start.on_floor,
            ceiling=None if located is None else mission.ceiling.spec,
            motions=() if located is None else located.motions,
        ) as world,
        world.vehicle,
    ):
        if visual is not None:
            world.camera.open()
            # The room is painted now, not in the flight's first tick.
            seen = world.photograph(start).pixels
            # A flight that is located first begins elsewhere.
            if mission.path is not None and mission.path.folder is not None and located is None:
                require_seen(visual.taught, seen, f"path {visual.folder}")
        if world.ceiling is not None:
            world.ceiling.open()
        camera = None if visual is None else world.camera
        yield Rig(world.clock, world.vehicle, camera, world.referee, world.ceiling)


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
    recorder: FlightRecorder,
    mission: Mission,
    files: Mapping[str, bytes],
    truth: tuple[Pose, ...] | None,
) -> None:
    """Write all that a replay or a report needs, so that the recording can stand alone."""
    recorder.note(
        "flight",
        {
            "mission": mission.name,
            "law": mission.law,
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
    for name, data in files.items():
        recorder.attach(name, "application/zip", data)
    recorder.flush()


def _sum_up(
    flown: Flown, mission: Mission, truth: tuple[Pose, ...] | None, located: LocatedFlight | None
) -> dict[str, Any]:
    goal, reference = truth[-1] if truth else None, reference_of(mission, truth or ())
    plan = None if located is None else located.plan
    outcome = str(flown.outcome)
    pushes = [push.time_s for push in mission.vehicle.pushes]
    return summarise(
        flown.samples, goal, outcome, flown.reason, flown.realtime_factor, reference, plan, pushes
    )


def note_report(out: Path, report: str | None) -> None:
    """Say in a flight's summary.json in `out` where its report is."""
    with suppress(OSError, ValueError):
        written = json.loads((out / SUMMARY).read_text("utf-8"))
        _write_summary(out / SUMMARY, {**written, "report": report})


def _write_summary(path: Path, summary: dict[str, Any]) -> None:
    # The recording holds the same; a disk that is full has been told of already.
    with suppress(OSError):
        path.write_text(json.dumps(summary, indent=2) + "\n", "utf-8")
