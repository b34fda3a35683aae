"""What a flight along a visual path needs: the path, taught or loaded, its pilot and its matcher."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from noctule.flight.mission import Mission
from noctule.flight.path_check import require_sound
from noctule.flight.path_folder import load_path, load_truth
from noctule.flight.worker import Matcher
from noctule.geometry import Pose
from noctule.messages import FlightState, MatchResult, Observation, Picture, Pilot, VehicleState
from noctule.pilots import make_matcher, make_pilot
from noctule.pilots.route import unroll
from noctule.pilots.visual_path import VisualPath

_WARM_TICKS = 6
_NOT_OF_THE_PATH = ("truth.toml", "contact-sheet.png")  # in its folder, but not for the pilot


@dataclass(frozen=True, slots=True)
class VisualFlight:
    """What flies a visual path."""

    folder: Path
    taught: VisualPath
    truth: tuple[Pose, ...] | None  # where each image of the route was really taken
    pilot: Pilot
    matcher: Matcher

    def zipped(self) -> bytes:
        """Return the path folder as a zip without the truth."""
        files = (file for file in self.folder.iterdir() if file.name not in _NOT_OF_THE_PATH)
        return zipped(file for file in files if file.suffix in (".toml", ".png", ".npz"))


def prepare_visual(mission: Mission, folder: Path) -> VisualFlight:
    """Load the path in `folder` and make its pilot, compiled and warm; raises PathFolderError."""
    assert mission.path is not None
    taught = load_path(folder, mission.camera.intrinsics, mission.pilot.features, mission.camera.mount)
    if mission.path.folder is not None:
        require_sound(taught, f"path {folder}")
    route = mission.path.route(len(taught.images))
    path, truth = unroll(taught, route), load_truth(folder)
    if truth is not None:
        truth = tuple(truth[k] for k in route)
    pilot = make_pilot(mission.pilot, path, mission.limits.values(), 1.0 / mission.flight.rate_hz)
    warm_up(mission, taught)
    return VisualFlight(folder, taught, truth, pilot, make_matcher(mission.pilot, path))


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


def zipped(files: Iterable[Path]) -> bytes:
    """Return files as a zip, the same bytes for the same files."""
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
        for file in sorted(files):
            # ZipInfo's own date, not the file's.
            archive.writestr(zipfile.ZipInfo(file.name), file.read_bytes())
    return target.getvalue()
