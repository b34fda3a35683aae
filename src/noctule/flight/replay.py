"""Replay: the observations of a recording through a fresh pilot, compared with what was flown."""

from __future__ import annotations

import io
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from noctule.flight.mission import Mission
from noctule.flight.path_folder import load_path
from noctule.flight.reader import Recording, RecordingFileError
from noctule.messages import Pilot
from noctule.pilots import make_pilot
from noctule.pilots.route import unroll
from noctule.pilots.visual_path import VisualPath


@dataclass(frozen=True, slots=True)
class Replay:
    """How a replayed flight compares with the recorded one."""

    ticks: int
    identical: int  # ticks whose command, phase and outcome are the same, bit for bit
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
    try:
        archive = zipfile.ZipFile(io.BytesIO(recording.files.get("path.zip", b"")))
    except zipfile.BadZipFile:
        raise RecordingFileError(
            f"recording {recording.path}: holds no path that can be read, expected path.zip; "
            "was it made by noctule fly?"
        ) from None
    with archive, tempfile.TemporaryDirectory(prefix="noctule-path-") as folder:
        archive.extractall(folder)
        taught = load_path(Path(folder), kind=kind)
    return unroll(taught, recorded_mission(recording).path.route(len(taught.images)))


def replay_through(recording: Recording, pilot: Pilot) -> Replay:
    """Hand a pilot every recorded observation, in order, and compare its answers."""
    identical, first, worst = 0, None, 0.0
    for i, tick in enumerate(recording.flown):
        assert tick.decision is not None
        now, then = pilot.step(tick.observation()), tick.decision
        difference = np.abs(now.command.as_array() - then.command.as_array())
        if difference.max() == 0.0 and (now.phase, now.outcome) == (then.phase, then.outcome):
            identical += 1
        elif first is None:
            first = i
        worst = max(worst, float(difference.max()))
    return Replay(len(recording.flown), identical, first, worst, recording.lossless)


def replay(recording: Recording) -> Replay:
    """Replay a recording through a fresh pilot, made from the mission and the path that it holds.

    Lossless pictures give the same commands bit for bit; lossy ones come close, and the result says so.
    """
    mission = recorded_mission(recording)
    dt = 1.0 / mission.flight.rate_hz
    pilot = make_pilot(
        mission.pilot, recorded_path(recording, mission.pilot.features), mission.limits.values(), dt
    )
    return replay_through(recording, pilot)
