"""Folders of depth images, read as a stream of depth frames.

    depth/*.png     16 bits a pixel, 0 where there is no depth
    depth.txt       optional: lines of "stamp file", as the TUM RGB-D benchmark has them
    rgb/*.png       optional: colour, registered to the depth; rgb.txt as depth.txt

Without a listing the names are the stamps: seconds where they have a decimal point (1305031102.160407.png),
nanoseconds where they are whole numbers of 16 digits and more, else the numbers of frames at 30 Hz.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from noctule.errors import NoctuleError
from noctule.localization.calibration.pictures import decoded
from noctule.messages import DepthFrame

RATE = 30.0  # [Hz], of frames that are only numbered
_APART = 0.02  # [s], colour that was taken further from the depth belongs to another frame
_COLOUR = ("rgb", "colour", "color")
_PICTURES = (".png", ".jpg", ".jpeg")


class DepthFolderError(NoctuleError):
    """A folder that is no sequence of depth images."""


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture and when it was taken."""

    stamp: float  # [s]
    file: Path


@dataclass(frozen=True, slots=True)
class DepthFolder:
    """A sequence of depth images; read from the disk one by one."""

    path: Path
    depth: tuple[Shot, ...]
    colour: tuple[Shot, ...]  # empty where there is none
    scale: float  # [1/m], what the pixels count

    @property
    def count(self) -> int:
        """The number of frames."""
        return len(self.depth)

    def frames(self) -> Iterator[DepthFrame]:
        """Yield the frames in order; raises DepthFolderError for a picture that cannot be decoded."""
        stamps = [shot.stamp for shot in self.colour]
        for shot in self.depth:
            depth = _decoded(shot.file, cv2.IMREAD_UNCHANGED)
            if self.scale != 1000.0 and depth.dtype == np.uint16:
                millimetres = np.rint(depth.astype(np.float64) * (1000.0 / self.scale))
                depth = np.minimum(millimetres, np.iinfo(np.uint16).max).astype(np.uint16)
            colour = None
            nearest = _nearest(stamps, shot.stamp)
            if nearest is not None:
                bgr = _decoded(self.colour[nearest].file, cv2.IMREAD_COLOR)
                colour = np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)
            yield DepthFrame(shot.stamp, depth, colour)


def _nearest(stamps: Sequence[float], stamp: float) -> int | None:
    if not stamps:
        return None
    at = bisect_left(stamps, stamp)
    best = min((i for i in (at - 1, at) if 0 <= i < len(stamps)), key=lambda i: abs(stamps[i] - stamp))
    return best if abs(stamps[best] - stamp) <= _APART else None


def _decoded(file: Path, flags: int) -> Any:
    try:
        data = np.fromfile(file, dtype=np.uint8)
    except OSError as error:
        raise DepthFolderError(
            f"picture {file}: cannot be read ({error.strerror}); restore it, or take it out of the listing"
        ) from None
    picture = decoded(data, flags)
    if picture is None:
        raise DepthFolderError(f"picture {file}: it cannot be decoded; restore it, or remove it")
    return picture


def read_depth_folder(folder: Path, scale: float = 1000.0) -> DepthFolder:
    """Open a folder of depth images that count `scale` to the metre (the TUM benchmark's: 5000).

    Raises
    ------
    DepthFolderError
        When it holds no depth images, or they cannot be put in order.
    """
    if not 1.0 <= scale <= 1e6:
        raise DepthFolderError(f"folder {folder}: --scale is {scale:g}, expected 1 to 1000000 counts a metre")
    depth = _listed(folder, "depth")
    if not depth:
        what = "it holds no depth images" if folder.is_dir() else "there is no such folder"
        raise DepthFolderError(
            f"folder {folder}: {what}; expected depth/*.png of 16 bits, or depth.txt with lines of stamp and "
            "file"
        )
    colour = next((shots for name in _COLOUR if (shots := _listed(folder, name))), ())
    return DepthFolder(folder, depth, colour, scale)


def _listed(folder: Path, name: str) -> tuple[Shot, ...]:
    listing = folder / f"{name}.txt"
    if listing.is_file():
        return tuple(_in_order(list(_lines(listing)), listing))
    try:
        inside = list((folder / name).iterdir())
    except OSError:
        return ()
    files = [file for file in inside if file.suffix.lower() in _PICTURES]
    return tuple(_in_order(sorted(_named(files), key=lambda shot: shot.stamp), folder / name))


def _lines(listing: Path) -> Iterator[Shot]:
    try:
        text = listing.read_text("utf-8")
    except (OSError, UnicodeDecodeError):
        raise DepthFolderError(f"listing {listing}: it cannot be read; expected UTF-8 text") from None
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        words = line.split(maxsplit=1)
        try:
            stamp = float(words[0])
        except ValueError:
            stamp = float("nan")
        if len(words) != 2 or not np.isfinite(stamp):
            raise DepthFolderError(
                f"listing {listing}, line {number}: found {line.strip()[:60]!r}, expected a stamp in seconds "
                "and a file"
            )
        file = listing.parent / words[1].strip()
        if not file.is_file():
            raise DepthFolderError(
                f"listing {listing}, line {number}: there is no file {words[1].strip()!r}; restore it, or "
                "take the line out"
            )
        yield Shot(stamp, file)


def _named(files: Sequence[Path]) -> Iterator[Shot]:
    for file in files:
        stem = file.stem
        if re.fullmatch(r"-?[0-9]+\.[0-9]+", stem):
            yield Shot(float(stem), file)
        elif re.fullmatch(r"[0-9]{16,}", stem):
            yield Shot(int(stem) / 1e9, file)
        elif numbers := re.search(r"([0-9]{1,15})$", stem):
            yield Shot(int(numbers[1]) / RATE, file)
        else:
            raise DepthFolderError(
                f"picture {file}: its name is no stamp; expected seconds as 12.345.png, or a number, or a "
                f"listing {file.parent.name}.txt beside the folder"
            )


def _in_order(shots: list[Shot], where: Path) -> Iterator[Shot]:
    for before, shot in zip([None, *shots], shots, strict=False):
        if before is not None and shot.stamp <= before.stamp:
            raise DepthFolderError(
                f"{where}: {shot.file.name} is stamped {shot.stamp:.6f} s, not after {before.file.name} "
                f"({before.stamp:.6f} s); put them in order"
            )
        yield shot
