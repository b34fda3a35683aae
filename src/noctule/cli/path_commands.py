"""The subcommands that teach, show and check paths: their options and help."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from noctule.cli.options import Flag, Seed

Preview = Annotated[bool, Parameter(name="--preview", negative="--no-preview")]


def teach(
    *,
    out: Path,
    waypoints: Path | None = None,
    keyboard: Flag = False,
    keys: Path | None = None,
    recording: Path | None = None,
    video: Path | None = None,
    device: int | None = None,
    mission: str | None = None,
    seed: Seed = None,
    camera: Path | None = None,
    focal: float | None = None,
    stabilised: Flag = False,
    seconds: float = 30.0,
    at: str | None = None,
    preview: Preview = True,
    json: Flag = False,
) -> int:
    """Teach a path from exactly one source: a simulated flight, a keyboard, a recording, a video or a camera.

    Key images are chosen by themselves, or taken where --at says. Exit code 0 if and only if the path can be
    repeated.

    Parameters
    ----------
    out
        The folder for the path; it must be new or empty.
    waypoints
        A TOML file with poses = [[x, y, z, heading in degrees], ...], flown in the room of --mission.
    keyboard
        Fly in the room of --mission by the keys of this terminal: w/s forward and back, a/d left and right,
        q/e turn, r/f up and down, x hover, space take a key image, u undo the last, enter finish; esc and
        Ctrl-C leave, and keep what was taken.
    keys
        The same flight by a file of a time [s] and a key on each line, faster than real time.
    recording
        The recording (.mcap) of a flight.
    video
        A video file.
    device
        A camera of this machine, by OpenCV's number; the first is 0.
    mission
        In simulation: whose room, vehicle and camera; left out, two-columns. Its columns are left out.
    seed
        In simulation: what draws the room. Left out, the mission's.
    camera
        With --video or --device: a TOML file with width, height, fx, fy, cx, cy [px].
    focal
        With --video or --device: the focal length [px], of a camera whose axis meets the picture's centre.
    stabilised
        With --focal: a gimbal keeps the camera level.
    seconds
        With --device: for how long.
    at
        Take the key images at these times [s], as 0,1.5,3.2; by hand, only where space is pressed: keys.
    preview
        With --keyboard: show what the camera sees.
    json
        End standard output with one JSON object.
    """
    from noctule.cli.teaching import Source, teach_path

    source = Source(
        waypoints, recording, video, device, mission, camera, focal, stabilised, seconds, at, seed
    )
    source = replace(source, keyboard=keyboard, keys=keys, preview=preview)
    return teach_path(source, out, json)


def path_show(folder: Path, /, *, out: Path | None = None, json: Flag = False) -> int:
    """Draw a path: a folder's contact sheet and what neighbours share, or the way of a path file or mission.

    Parameters
    ----------
    folder
        A folder of key images, a file of a path in space: waypoints (.csv) or pieces (.toml), or a mission.
    out
        The PNG file to draw; left out, contact-sheet.png in the folder, or beside the file with its name.
    json
        End standard output with one JSON object.
    """
    if folder.is_file() or (folder.suffix.lower() in (".csv", ".toml") and not folder.is_dir()):
        from noctule.cli.space_paths import show_space_path

        return show_space_path(folder, out, json)
    from noctule.cli.paths import show_path

    return show_path(folder, out, json)


def path_check(folder: Path, /, *, mission: str | None = None, json: Flag = False) -> int:
    """Judge whether a path can be repeated: one line per fault, and exit code 2, where it cannot.

    Parameters
    ----------
    folder
        The path folder.
    mission
        A bundled mission or a mission file, whose camera must be the one that took the path.
    json
        End standard output with one JSON object.
    """
    from noctule.cli.paths import check_path_folder

    return check_path_folder(folder, mission, json)
