"""Replay: the observations of a recording through a fresh pilot, compared with what was flown."""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from noctule.errors import NoctuleError
from noctule.estimation.sensors import Sensors
from noctule.flight.codec import encode_whereabouts
from noctule.flight.located_flight import located_pilot
from noctule.flight.mission import Mission
from noctule.flight.path_folder import load_path
from noctule.flight.reader import Recording, RecordingFileError
from noctule.localization.sensors_file import SENSORS, load_sensors
from noctule.localization.site import Site, load_site
from noctule.messages import Decision, Outcome, Pilot
from noctule.pilots import make_pilot
from noctule.pilots.handover import HandoverPilot
from noctule.pilots.located import LocatedPilot
from noctule.pilots.route import unroll
from noctule.pilots.visual_path import VisualPath


class NoDepthError(NoctuleError):
    """A located flight whose depth frames were not kept."""


@dataclass(frozen=True, slots=True)
class Replay:
    """How a replayed flight compares with the recorded one."""

    ticks: int
    identical: int  # ticks whose command, phase, outcome and place are the same, bit for bit
    first_difference: int | None  # index of the first tick that differs
    worst: float  # largest difference of a command's component [m/s or rad/s]
    lossless: bool  # whether the recording can be expected to replay exactly

    @property
    def exact(self) -> bool:
        """Whether every tick is the same."""
        return self.identical == self.ticks

    def __str__(self) -> str:
        """Say it in one line."""
        if self.exact:
            return f"replay: all {self.ticks} commands are the same, bit for bit"
        kind = "lossless, so this is a fault" if self.lossless else "lossy, so it is close, not exact"
        return (
            f"replay: {self.identical} of {self.ticks} commands are the same, the others differ by up to "
            f"{self.worst:.2g} from tick {self.first_difference} on; the pictures are {kind}"
        )


def recorded_mission(recording: Recording) -> Mission:
    """Return the mission as it was flown; raises RecordingFileError."""
    try:
        return Mission.model_validate_json(recording.files.get("mission.json", b""))
    except ValidationError as error:
        found = f"{error.error_count()} mistakes" if "mission.json" in recording.files else "none"
        raise RecordingFileError(
            f"recording {recording.path}: its mission cannot be read ({found}); "
            "read it with the version that wrote it"
        ) from None


def recorded_path(recording: Recording, kind: str | None = None) -> VisualPath:
    """Return the visual path that was flown, laps and all; raises RecordingFileError, PathFolderError."""
    with _unpacked(recording, "path") as folder:
        taught = load_path(folder, kind=kind)
    path = recorded_mission(recording).path
    return taught if path is None else unroll(taught, path.route(len(taught.images)))


def recorded_site(recording: Recording) -> tuple[Site, Sensors]:
    """Return the site below whose camera was flown, and the calibration of the sensors.

    Raises RecordingFileError, SiteFileError, SiteFormatError.
    """
    with _unpacked(recording, "site") as folder:
        sensors = load_sensors(folder) if (folder / SENSORS).exists() else Sensors()
        # What was flown is replayed as it was, with an offset too that no site may have any more.
        return load_site(folder, any_offset=True), sensors


@contextmanager
def _unpacked(recording: Recording, name: str) -> Iterator[Path]:
    """Give a folder with what was attached as `name`.zip; raises RecordingFileError."""
    try:
        archive = zipfile.ZipFile(io.BytesIO(recording.files.get(f"{name}.zip", b"")))
    except zipfile.BadZipFile:
        raise RecordingFileError(
            f"recording {recording.path}: holds no {name} that can be read, expected {name}.zip; "
            "was it made by noctule fly?"
        ) from None
    with archive, tempfile.TemporaryDirectory(prefix=f"noctule-{name}-") as folder:
        archive.extractall(folder)
        yield Path(folder)


def recorded_pilot(recording: Recording) -> Pilot:
    """Return the pilot that was flown, as it was before its first tick.

    Raises what reading the mission, the path and the site raises.
    """
    mission = recorded_mission(recording)
    limits, dt = mission.limits.values(), 1.0 / mission.flight.rate_hz
    located: LocatedPilot | None = None
    if mission.space_path is not None:
        located = located_pilot(mission, mission.space_plan(), *recorded_site(recording))
        if mission.path is None:
            return located
    visual = make_pilot(mission.pilot, recorded_path(recording, mission.pilot.features), limits, dt)
    return visual if located is None else HandoverPilot(located, visual, limits, mission.handover)


def replay_through(recording: Recording, pilot: Pilot, exact: bool | None = None) -> Replay:
    """Hand a pilot every recorded observation, in order, and compare its answers.

    `exact` says whether the same answers can be expected; None: where the pictures are lossless.
    """
    identical, first, worst = 0, None, 0.0
    for i, tick in enumerate(recording.flown):
        assert tick.decision is not None
        now, then = pilot.step(tick.observation()), tick.decision
        difference = np.abs(now.command.as_array() - then.command.as_array())
        if difference.max() == 0.0 and _said(now) == _said(then):
            identical += 1
        elif first is None:
            first = i
        worst = max(worst, float(difference.max()))
    return Replay(
        len(recording.flown), identical, first, worst, recording.lossless if exact is None else exact
    )


def _said(decision: Decision) -> tuple[str, Outcome | None, bytes]:
    # Bits, so that what is no number equals itself.
    known = decision.whereabouts
    place = b"" if known is None else encode_whereabouts(known).SerializeToString(deterministic=True)
    return decision.phase, decision.outcome, place


def replay(recording: Recording) -> Replay:
    """Replay a recording through a fresh pilot, made from what it holds: mission, path, site.

    Lossless pictures give the same commands bit for bit; lossy ones come close, and the result says so.

    Raises
    ------
    NoDepthError
        When the pilot flew by depth frames and they were not kept.
    """
    mission = recorded_mission(recording)
    if not recording.depth_kept:
        raise NoDepthError(
            f"replay {recording.path}: its pilot flew by depth frames and they were not kept, expected a "
            "recording with them; fly with recording.depth = true"
        )
    # Depth is kept as it was; only pictures may have lost something.
    return replay_through(recording, recorded_pilot(recording), mission.path is None or recording.lossless)
