"""Teaching from frames without poses: choose the key images and write the path folder."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType

from pydantic import Field, ValidationError

from noctule.camera import CameraMount, PinholeCamera
from noctule.errors import NoctuleError
from noctule.flight.mission import Mission, PathPose, PathSettings
from noctule.flight.path_check import TILT_SD
from noctule.flight.path_folder import Shot, save_path
from noctule.flight.setting_errors import explain
from noctule.geometry import Pose
from noctule.settings import Settings
from noctule.vision.key_images import Frame, KeyFrame, choose_key_images

Progress = Callable[[int, float], None]
NOTHING_KNOWN: Mapping[float, Pose] = MappingProxyType({})


class PathExistsError(NoctuleError):
    """A folder that holds a path already."""


class TeachInputError(NoctuleError):
    """Times, waypoints or frames that make no path."""


@dataclass(frozen=True, slots=True)
class Taken:
    """A key image of a path that was taught."""

    stamp: float  # [s] from the first frame
    reason: str  # why this frame


class Waypoints(Settings):
    """What a file of waypoints holds."""

    poses: tuple[PathPose, ...] = Field(
        min_length=1, max_length=500, description="x, y, z [m] and heading [deg] of each key image"
    )


def refuse_existing(folder: Path) -> None:
    """Raise PathExistsError unless `folder` may be written: it is not there, or empty."""
    if folder.is_file():
        raise PathExistsError(f"path {folder}: this is a file, expected a new folder; choose another --out")
    if folder.is_dir() and any(folder.iterdir()):
        raise PathExistsError(
            f"path {folder}: this folder is not empty, and teaching overwrites nothing; "
            "choose another --out or remove it"
        )


def read_waypoints(path: Path, mission: Mission) -> Mission:
    """Return `mission` with the poses in a file as its path; raises TeachInputError, one line a mistake."""
    name = f"waypoints {path}"
    try:
        text = path.read_text("utf-8")
        poses = Waypoints.model_validate(tomllib.loads(text)).poses
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise TeachInputError(
            f"{name}: cannot be read ({why}); expected a .toml file with poses = [[x, y, z, heading], ...]"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise TeachInputError(f"{name}: this is not TOML: {error}; mend it there") from None
    except ValidationError as error:
        raise TeachInputError(explain(error, Waypoints, text, name)) from None
    return mission.model_copy(update={"path": PathSettings(poses=poses)})


def read_times(text: str) -> tuple[float, ...]:
    """Read `0,1.5,3.2` as ascending times [s]; raises TeachInputError."""
    try:
        times = tuple(float(part) for part in text.split(","))
    except ValueError:
        times = ()
    rising = all(a < b for a, b in pairwise(times))
    if len(times) < 2 or not rising or not all(math.isfinite(t) and t >= 0.0 for t in times):
        raise TeachInputError(
            f"--at is {text!r}, expected two or more rising times in seconds, as 0,1.5,3.2"
        ) from None
    return times


def frames_at(frames: Iterable[Frame], times: Sequence[float], progress: Progress) -> Iterator[KeyFrame]:
    """Yield the frame nearest to each of the rising `times` [s]; raises TeachInputError."""
    wanted = list(times)
    before: tuple[int, Frame] | None = None
    for index, frame in enumerate(frames):
        progress(index, frame.stamp)
        while wanted and frame.stamp >= wanted[0]:
            nearest = (index, frame)
            if before is not None and wanted[0] - before[1].stamp < frame.stamp - wanted[0]:
                nearest = before
            yield KeyFrame(*nearest, f"asked for at {wanted.pop(0):g} s")
        before = (index, frame)
        if not wanted:
            return
    end = "there are no frames" if before is None else f"the last frame is at {before[1].stamp:.2f} s"
    raise TeachInputError(f"--at asks for {wanted[0]:g} s, {end}; give times within the footage")


def teach_frames(
    frames: Iterable[Frame],
    camera: PinholeCamera,
    mount: CameraMount,
    folder: Path,
    at: Sequence[float] | None = None,
    progress: Progress = lambda index, stamp: None,
) -> tuple[Taken, ...]:
    """Write a path folder of the frames that make good key images, or of those nearest to the times `at` [s].

    Returns where and why each was taken. The path is as good as the footage: check it before it is flown.

    Raises
    ------
    PathExistsError
        When there is a path in `folder` already.
    TeachInputError
        For fewer than two key images, or times outside of the footage.
    PathFolderError
        When the folder cannot be written.
    """
    refuse_existing(folder)
    sd = 0.0 if mount.stabilised else TILT_SD
    chosen = (
        choose_key_images(frames, camera, attitude_sd=sd, progress=progress)
        if at is None
        else frames_at(frames, at, progress)
    )
    keys, indices = [], set()
    for key in chosen:
        if key.index not in indices:  # two times may be nearest to one frame
            indices.add(key.index)
            keys.append(key)
    if len(keys) < 2:
        raise TeachInputError(
            f"teaching: the footage gives {len(keys)} key images, at least 2 are needed; "
            "move the camera along the path"
        )
    return save_keys(keys, camera, mount, folder)


def save_keys(
    keys: Sequence[KeyFrame],
    camera: PinholeCamera,
    mount: CameraMount,
    folder: Path,
    kind: str = "sift",
    truths: Mapping[float, Pose] = NOTHING_KNOWN,
) -> tuple[Taken, ...]:
    """Write a path folder of key images; `truths` says by stamp where they were taken, where that is known.

    Raises PathFolderError.
    """
    shots = [Shot(k.frame.pixels, *k.frame.attitude, truths.get(k.frame.stamp)) for k in keys]
    save_path(folder, shots, camera, mount, kind)
    return tuple(Taken(k.frame.stamp, k.reason) for k in keys)
