"""Path folders: a visual path on disk, versioned, checked when it is loaded.

path.toml       format, camera, mount, feature kind, and the images in the order in which they are flown
000.png, ...    the key images
features.npz    features and links, a cache: keyed to the pictures, made anew when it does not fit
truth.toml      optional, where the pictures were really taken; only the judge reads it
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from noctule.camera import CameraMount, PinholeCamera
from noctule.errors import NoctuleError
from noctule.flight.feature_cache import features_and_links
from noctule.flight.path_entries import CameraEntry, ImageEntry, PathFile, TruthFile
from noctule.flight.setting_errors import explain
from noctule.geometry import Pose
from noctule.localization.calibration.pictures import decoded
from noctule.pilots.visual_path import KeyImage, VisualPath

FORMAT = 1
_MOUNT_TOLERANCE = 0.05  # [m]
_SAME_CAMERA = 0.1  # [px]


class PathFolderError(NoctuleError):
    """A path folder that cannot be flown."""


class PathCameraError(NoctuleError):
    """A path that was taken with another camera than the one that flies."""


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture taken for a path."""

    pixels: NDArray[np.uint8]  # (height, width, 3) RGB
    roll: float = 0.0  # [rad], as reported
    pitch: float = 0.0  # [rad], as reported
    truth: Pose | None = None


def _toml(values: dict[str, Any]) -> str:
    # JSON's numbers, strings and lists are TOML's too.
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in values.items())


def save_path(
    folder: Path, shots: list[Shot], camera: PinholeCamera, mount: CameraMount, kind: str = "sift"
) -> None:
    """Write a path folder; raises PathFolderError when it cannot be written.

    path.toml is written last: a folder without it is no path yet.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = _toml({"format": FORMAT, "features": kind}) + "\n[camera]\n"
        text += _toml(
            {
                **{name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")},
                "t_body_camera": [float(v) for v in mount.t_body_camera],
                "stabilised": mount.stabilised,
            }
        )
        truth = ""
        for i, shot in enumerate(shots):
            name = f"{i:03d}.png"
            _, png = cv2.imencode(".png", cv2.cvtColor(shot.pixels, cv2.COLOR_RGB2BGR))
            data = bytes(png)
            (folder / name).write_bytes(data)
            entry = {
                "file": name,
                "sha256": hashlib.sha256(data).hexdigest(),
                "roll_deg": float(np.degrees(shot.roll)),
                "pitch_deg": float(np.degrees(shot.pitch)),
                "intrinsics": [float(v) for v in (camera.fx, camera.fy, camera.cx, camera.cy)],
            }
            text += "\n[[images]]\n" + _toml(entry)
            if shot.truth is not None:
                truth += "\n[[images]]\n" + _toml(
                    {
                        "position": [float(v) for v in shot.truth.position],
                        "yaw_deg": float(np.degrees(shot.truth.yaw)),
                        "roll_deg": float(np.degrees(shot.truth.roll)),
                        "pitch_deg": float(np.degrees(shot.truth.pitch)),
                    }
                )
        if truth:
            (folder / "truth.toml").write_text(truth.lstrip(), "utf-8")
        (folder / "path.toml").write_text(text, "utf-8")
    except OSError as error:
        raise PathFolderError(
            f"path {folder}: cannot be written ({error.strerror}); choose another folder"
        ) from error


def _read_toml(path: Path, model: type[Any]) -> Any:
    try:
        text = path.read_text("utf-8")
        return model.model_validate(tomllib.loads(text))
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise PathFolderError(f"path file {path}: cannot be read ({why}); teach the path again") from None
    except tomllib.TOMLDecodeError as error:
        raise PathFolderError(f"path file {path}: this is not TOML: {error}; teach the path again") from None
    except ValidationError as error:
        raise PathFolderError(explain(error, model, text, f"path file {path}")) from None


def read_picture(folder: Path, entry: ImageEntry, camera: CameraEntry) -> NDArray[np.uint8]:
    """Return a key image, checked; raises PathFolderError and PathCameraError."""
    where = f"path {folder}: image {entry.file}"
    own = (camera.fx, camera.fy, camera.cx, camera.cy)
    for name, taken, rest in zip(("fx", "fy", "cx", "cy"), entry.intrinsics or own, own, strict=True):
        if abs(taken - rest) > _SAME_CAMERA:
            raise PathCameraError(
                f"{where} was taken by a camera with {name} {taken:g} px, the path's has {rest:g}; "
                "one path needs one camera: teach it again"
            )
    try:
        data = (folder / entry.file).read_bytes()
    except OSError as error:
        raise PathFolderError(
            f"{where} cannot be read ({error.strerror}); restore it or teach the path again"
        ) from None
    found = hashlib.sha256(data).hexdigest()
    if found != entry.sha256:
        raise PathFolderError(
            f"{where} was changed after the path was taught: its sha256 is {found[:12]}..., path.toml says "
            f"{entry.sha256[:12]}...; restore it or teach the path again"
        )
    bgr = decoded(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR)
    if bgr is None:
        raise PathFolderError(f"{where} is no picture that can be decoded; teach the path again")
    if bgr.shape[:2] != (camera.height, camera.width):
        raise PathFolderError(
            f"{where} is {bgr.shape[1]}x{bgr.shape[0]} px, its camera {camera.width}x{camera.height} px; "
            "teach the path again"
        )
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def read_path_file(folder: Path) -> PathFile:
    """Return what path.toml of a path folder says; raises PathFolderError."""
    if folder.is_dir() and not (folder / "path.toml").exists():
        raise PathFolderError(
            f"path {folder}: the folder holds no path.toml; expected one that `noctule teach` made "
            "(a path in space is a .csv or .toml file, no folder)"
        )
    file: PathFile = _read_toml(folder / "path.toml", PathFile)
    if file.format != FORMAT:
        raise PathFolderError(
            f"path {folder}: its format is {file.format}, this version reads {FORMAT}; teach the path again"
        )
    return file


def load_path(
    folder: Path,
    expected: PinholeCamera | None = None,
    kind: str | None = None,
    mount: CameraMount | None = None,
    *,
    refuse: bool = True,
) -> VisualPath:
    """Load a path folder and check it; features and links come from its cache where that fits.

    `kind` asks for another kind of feature than the path was taught with. Without `refuse` neighbours may
    share any number of points: to look at a path, not to fly it.

    Raises
    ------
    PathFolderError
        For another format, or a missing, changed or wrongly sized picture.
    NeighbourError
        When neighbours share too little.
    PathCameraError
        When a picture was taken with another camera than the rest, or when `expected`, the camera that will
        fly, or its `mount` are not those that took the pictures.
    """
    file = read_path_file(folder)
    camera, taken = file.camera.intrinsics, file.camera.mount
    if expected is not None:
        check_camera(camera, expected, f"path {folder}")
    if mount is not None:
        check_mount(taken, mount, f"path {folder}")
    pictures = [read_picture(folder, entry, file.camera) for entry in file.images]
    names = [entry.file for entry in file.images]
    kind = kind or file.features
    key = "".join([kind, *(entry.sha256 for entry in file.images), repr(camera)])
    features, links = features_and_links(
        folder / "features.npz",
        hashlib.sha256(key.encode()).hexdigest(),
        pictures,
        names,
        camera,
        kind,
        refuse,
    )
    images = tuple(
        KeyImage(e.file, p, f, float(np.radians(e.roll_deg)), float(np.radians(e.pitch_deg)))
        for e, p, f in zip(file.images, pictures, features, strict=True)
    )
    return VisualPath(camera, taken, images, links)


def check_camera(camera: PinholeCamera, expected: PinholeCamera, where: str) -> None:
    """Raise PathCameraError unless the two cameras agree within a tenth of a pixel."""
    for name in ("width", "height", "fx", "fy", "cx", "cy"):
        taken, flying = getattr(camera, name), getattr(expected, name)
        if abs(taken - flying) > _SAME_CAMERA:
            raise PathCameraError(
                f"{where}: it was taken by a camera with {name} {taken:g} px, the mission's has {flying:g}; "
                "fly it with the camera that took it or teach the path again"
            )


def check_mount(taken: CameraMount, flying: CameraMount, where: str) -> None:
    """Raise PathCameraError unless both are stabilised or neither, and they sit within 5 cm of each other."""
    if taken.stabilised != flying.stabilised:
        words = {True: "stabilised", False: "not stabilised"}
        raise PathCameraError(
            f"{where}: the camera that took it is {words[taken.stabilised]}, the mission's is "
            f"{words[flying.stabilised]}; fly it with the camera that took it or teach the path again"
        )
    apart = float(np.linalg.norm(taken.t_body_camera - flying.t_body_camera))
    if apart > _MOUNT_TOLERANCE:
        raise PathCameraError(
            f"{where}: it was taken by a camera {apart:.2f} m off the mission's on the body, at most "
            f"{_MOUNT_TOLERANCE:g} m are allowed; mend the mission or teach the path again"
        )


def load_truth(folder: Path) -> tuple[Pose, ...] | None:
    """Return where the key images were really taken, None where nobody knows. For the judge only."""
    path = folder / "truth.toml"
    if not path.exists():
        return None
    entries = _read_toml(path, TruthFile).images
    return tuple(
        Pose(
            np.array(e.position, dtype=np.float64),
            float(np.radians(e.yaw_deg)),
            float(np.radians(e.roll_deg)),
            float(np.radians(e.pitch_deg)),
        )
        for e in entries
    )
