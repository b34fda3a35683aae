"""Pictures and depth images that are read from files, for calibration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.errors import NoctuleError

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


class PictureFileError(NoctuleError):
    """A picture that cannot be read, or is none."""


def picture_files(paths: Sequence[Path]) -> list[Path]:
    """Return the picture files: those named, and those inside the folders named, sorted by name.

    Raises PictureFileError.
    """
    files: list[Path] = []
    for path in paths:
        if not path.is_dir():
            files.append(path)
            continue
        inside = sorted(p for p in path.iterdir() if p.suffix.lower() in SUFFIXES)
        if not inside:
            raise PictureFileError(f"folder {path}: it holds no picture; expected {', '.join(SUFFIXES)}")
        files += inside
    return files


def read_greys(files: Sequence[Path]) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Yield (name, grey picture (height, width)) of each file; raises PictureFileError."""
    for file in files:
        yield file.name, read_grey(file)


def read_grey(file: Path) -> NDArray[np.uint8]:
    """Read a colour or grey picture of 8 bits as grey (height, width); raises PictureFileError."""
    pixels = _read(file, "picture")
    if pixels.dtype != np.uint8:
        raise PictureFileError(
            f"picture {file}: it has {8 * pixels.itemsize} bits a channel, as a depth image; expected a "
            "colour or grey picture of 8 bits"
        )
    if pixels.ndim == 2:
        return np.asarray(pixels, dtype=np.uint8)
    code = cv2.COLOR_BGRA2GRAY if pixels.shape[2] == 4 else cv2.COLOR_BGR2GRAY
    return np.asarray(cv2.cvtColor(pixels, code), dtype=np.uint8)


def read_depth(file: Path) -> NDArray[np.uint16]:
    """Read a depth image (height, width) [mm], 0 where there is none; raises PictureFileError."""
    pixels = _read(file, "depth image")
    if pixels.dtype != np.uint16 or pixels.ndim != 2:
        raise PictureFileError(
            f"depth image {file}: it is no image of one channel of 16 bits; expected a PNG of millimetres"
        )
    return np.asarray(pixels, dtype=np.uint16)


def _read(file: Path, what: str) -> NDArray[Any]:
    try:
        data = np.frombuffer(file.read_bytes(), dtype=np.uint8)
    except OSError as error:
        raise PictureFileError(
            f"{what} {file}: cannot be read ({error.strerror}); expected {', '.join(SUFFIXES)}"
        ) from None
    pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
    if pixels is None:
        raise PictureFileError(
            f"{what} {file}: this is no picture that can be read; expected {', '.join(SUFFIXES)}"
        )
    return np.asarray(pixels)
