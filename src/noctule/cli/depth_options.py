"""Where the depth frames of a command come from: options that several commands share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import Parameter

from noctule.cli.options import Flag, Seed
from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.flight.depth_scene import Flight
    from noctule.flight.depth_sources import DepthSource

Place = tuple[float, float, float]
"""x, y and height [m]."""

_KINDS = ("recording", "folder", "simulated", "device")


class DepthSourceError(NoctuleError):
    """Options that name no source of depth frames, or do not go together."""


@Parameter(name="*")
@dataclass(frozen=True, slots=True)
class SourceOptions:
    """Exactly one of recording, folder, simulated and device.

    Attributes
    ----------
    recording
        Depth frames from a recording (.mcap).
    folder
        Depth frames from a folder of images: depth/*.png of 16 bits, and rgb/*.png.
    scale
        With --folder: what its images count to the metre; left out, 1000 (millimetres).
    simulated
        Depth frames from the simulated room.
    seed
        With --simulated: draws the room and the sensor's errors. Left out, 0.
    hull
        With --simulated: the drone wears its indoor hull.
    markers
        With --simulated: the drone wears its colour markers, and the camera gives colour.
    person
        With --simulated: somebody walks about.
    device
        Depth frames from a camera of this machine, by the name that its package gave it.
    seconds
        With --simulated and --device: for how long.
    """

    recording: Path | None = None
    folder: Path | None = None
    scale: float | None = None
    simulated: Flag = False
    seed: Seed = None
    hull: Flag = False
    markers: Flag = False
    person: Flag = False
    device: str | None = None
    seconds: float | None = None


NONE = SourceOptions()


def depth_source(
    options: SourceOptions, command: str, flight: Flight, seconds: float, at: Place | None = None
) -> DepthSource:
    """Return the source; raises DepthSourceError unless the options go together.

    `flight` and `seconds` are what the simulated room shows where the options do not say, `at` is where the
    drone stands in it.
    """
    given = [kind for kind in _KINDS if getattr(options, kind)]
    if len(given) != 1:
        found = " and ".join(f"--{kind}" for kind in given) or "none"
        raise DepthSourceError(
            f"{command}: found {found}, expected exactly one of --recording FILE, --folder DIR, --simulated, "
            "--device NAME"
        )
    (kind,) = given
    wrong = {
        "--scale": options.scale is not None and kind != "folder",
        "--seed": options.seed is not None and kind != "simulated",
        "--hull": options.hull and kind != "simulated",
        "--markers": options.markers and kind != "simulated",
        "--person": options.person and kind != "simulated",
        "--seconds": options.seconds is not None and kind in ("recording", "folder"),
    }
    for option, is_wrong in wrong.items():
        if is_wrong:
            raise DepthSourceError(f"{command}: {option} does not go with --{kind}; leave it out")
    if options.seconds is not None:
        seconds = options.seconds
    if not 0.0 < seconds <= 3600.0:
        raise DepthSourceError(f"{command}: --seconds is {seconds:g}, expected above 0, up to 3600")
    return _open(options, kind, flight, seconds, at)


def _open(options: SourceOptions, kind: str, flight: Flight, seconds: float, at: Place | None) -> DepthSource:
    from noctule.flight import depth_sources

    if options.recording is not None:
        return depth_sources.recording_source(options.recording)
    if options.folder is not None:
        return depth_sources.folder_source(options.folder, 1000.0 if options.scale is None else options.scale)
    if options.device is not None:
        return depth_sources.device_source(options.device, seconds)
    from noctule.flight.depth_scene import STAND, Scene, simulated_source

    seed = options.seed or 0
    return simulated_source(
        Scene(flight, seed, options.hull, options.markers, options.person, seconds, at or STAND)
    )
