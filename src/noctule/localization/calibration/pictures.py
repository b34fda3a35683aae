"""Pictures and depth images that are read from files, for calibration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.camera import PinholeCamera
from noctule.errors import NoctuleError
from noctule.localization.health import Expected, check_frame
from noctule.messages import DepthFrame

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


def read_depth(file: Path, camera: PinholeCamera) -> NDArray[np.uint16]:
    """Read a camera's depth image (height, width) [mm], 0 where there is none; raises PictureFileError."""
    pixels = _read(file, "depth image")
    if pixels.dtype != np.uint16 or pixels.ndim != 2:
        found = f"{1 if pixels.ndim == 2 else pixels.shape[2]} x {8 * pixels.itemsize} bits"
        raise PictureFileError(
            f"depth image {file}: a pixel has {found}, expected one channel of 16 bits; save the depth "
            "itself, in millimetres, not a picture of it"
        )
    reason = check_frame(DepthFrame(0.0, pixels), Expected.of(camera))
    if reason:
        raise PictureFileError(f"depth image {file}: {reason}")
    return np.asarray(pixels, dtype=np.uint16)


def decoded(data: NDArray[np.uint8], flags: int) -> NDArray[Any] | None:
    """Return the picture of an encoded file, None when it is none."""
    # One that was cut off is not tried: the decoder would complain on standard error by itself.
    cut_off = data[:4].tobytes() == b"\x89PNG" and b"IEND" not in data[-12:].tobytes()
    return cv2.imdecode(data, flags) if data.size and not cut_off else None


def _read(file: Path, what: str) -> NDArray[Any]:
    try:
        data = np.frombuffer(file.read_bytes(), dtype=np.uint8)
    except OSError as error:
        raise PictureFileError(
            f"{what} {file}: cannot be read ({error.strerror}); expected {', '.join(SUFFIXES)}"
        ) from None
    pixels = decoded(data, cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise PictureFileError(
            f"{what} {file}: this is no picture that can be read; expected {', '.join(SUFFIXES)}"
        )
    return np.asarray(pixels)
