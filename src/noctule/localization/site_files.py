"""The files of a site: written whole or not at all, and every damage to them named when they are read."""

from __future__ import annotations

import io
import json
import os
import tomllib
import zipfile
import zlib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from noctule.camera import FixedCamera
from noctule.errors import NoctuleError
from noctule.geometry import Array
from noctule.settings import Settings

FORMAT = 1
PINHOLE = ("width", "height", "fx", "fy", "cx", "cy")
_SAME_CAMERA = 0.1  # [px]
Group = TypeVar("Group", bound=Settings)


class SiteFileError(NoctuleError):
    """A file of a site that is missing, damaged, or cannot be written."""


class SiteFormatError(NoctuleError):
    """A file of a site that another version wrote."""


class SiteCameraError(NoctuleError):
    """A file of a site that was made with another camera than the site's."""


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that a crash leaves the old one or the new one; raises SiteFileError."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with beside.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        with suppress(OSError):
            beside.unlink()
        raise SiteFileError(
            f"site file {path}: cannot be written ({error.strerror}); free some space or choose another "
            "folder"
        ) from error


def toml(values: Mapping[str, Any]) -> str:
    """Return values as lines of TOML; numbers, strings, truth values and lists of these."""
    # JSON's are TOML's too, and Python writes every float so that it reads back the same.
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in values.items())


def _read(path: Path, remedy: str) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        what = "is missing" if isinstance(error, FileNotFoundError) else f"cannot be read ({error.strerror})"
        raise SiteFileError(f"site file {path}: {what}; {remedy}") from None


def read_toml(path: Path, model: type[Group], remedy: str) -> Group:
    """Return what a TOML file holds; `remedy` says what to do. Raises SiteFileError, SiteFormatError."""
    data = _read(path, remedy)
    try:
        values = tomllib.loads(data.decode("utf-8"))
    except UnicodeDecodeError:
        raise SiteFileError(f"site file {path}: it is not UTF-8 text; {remedy}") from None
    except tomllib.TOMLDecodeError as error:
        raise SiteFileError(f"site file {path}: this is not TOML: {error}; {remedy}") from None
    _check_format(path, values.pop("format", None), remedy)
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise SiteFileError(f"site file {path}: {_first_mistake(error)}; {remedy}") from None


def _first_mistake(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"]).lstrip(".")
    if first["type"] == "missing":
        return f"{key} is missing"
    if first["type"] == "extra_forbidden":
        return f"unknown key {key}"
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] == "value_error":
        return f"{key}: {message}" if key else message
    given = str(first["input"])
    given = given if len(given) <= 60 else given[:57] + "..."
    return f"{key} is {given}, {message[:1].lower()}{message[1:]}"


def _check_format(path: Path, found: Any, remedy: str) -> None:
    if found != FORMAT:
        said = "no format" if found is None else f"format {found}"
        raise SiteFormatError(f"site file {path}: found {said}, this version reads format {FORMAT}; {remedy}")


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write named arrays to an .npz file; raises SiteFileError."""
    named: dict[str, Any] = {"format": np.array(FORMAT), **arrays}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **named)
    write_whole(path, buffer.getvalue())


def read_arrays(path: Path, remedy: str) -> dict[str, NDArray[Any]]:
    """Return the named arrays of an .npz file; raises SiteFileError, SiteFormatError."""
    data = _read(path, remedy)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in file.files}
    except (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile, zlib.error):
        raise SiteFileError(
            f"site file {path}: it is damaged, or not the .npz file that Noctule wrote; {remedy}"
        ) from None
    found = arrays.pop("format", None)
    whole = found is not None and found.shape == () and np.issubdtype(found.dtype, np.integer)
    _check_format(path, int(found) if whole and found is not None else None, remedy)
    return arrays


def take(
    arrays: Mapping[str, NDArray[Any]], name: str, kind: Any, shape: tuple[int, ...], path: Path, remedy: str
) -> NDArray[Any]:
    """Return an array of this type and shape; raises SiteFileError."""
    array = arrays.get(name)
    if array is None:
        raise SiteFileError(f"site file {path}: {name} is missing; {remedy}")
    if array.dtype != np.dtype(kind) or array.shape != shape:
        raise SiteFileError(
            f"site file {path}: {name} is {_shape(array.shape)} of {array.dtype}, expected {_shape(shape)} "
            f"of {np.dtype(kind)}; {remedy}"
        )
    if np.issubdtype(array.dtype, np.floating) and not np.isfinite(array).all():
        raise SiteFileError(f"site file {path}: {name} holds values that are not finite; {remedy}")
    return array


def _shape(shape: tuple[int, ...]) -> str:
    return "x".join(map(str, shape)) if shape else "one value"


def intrinsics_of(camera: FixedCamera) -> Array:
    """Return width, height, fx, fy, cx, cy [px] of a camera, (6,)."""
    return np.array([float(getattr(camera.intrinsics, name)) for name in PINHOLE])


def check_made_by(path: Path, made_by: Array, camera: FixedCamera, remedy: str) -> None:
    """Raise SiteCameraError unless the intrinsics (6,) of the camera that made a file are the site's."""
    for name, made, own in zip(PINHOLE, made_by, intrinsics_of(camera), strict=True):
        if abs(made - own) > _SAME_CAMERA:
            raise SiteCameraError(
                f"site file {path}: it was made with a camera of {name} {made:g} px, camera.toml says "
                f"{own:g}; {remedy}, or put the camera back"
            )
