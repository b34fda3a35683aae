"""Where a drone stands still: one place by options, several by a file that names a recording for each."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path

from noctule.cli.depth_options import Place
from noctule.errors import NoctuleError

COLUMNS = ("recording", "x", "y", "z")
FEWEST = 3  # places: with two, a place that was measured wrongly would be taken for slant
_HIGHEST = 10.0  # [m]
_FARTHEST = 100.0  # [m]


class PlaceError(NoctuleError):
    """A place that cannot be read."""


class PlacesFileError(NoctuleError):
    """A file of places with a mistake: file, line, what was found and what is expected."""


@dataclass(frozen=True, slots=True)
class RecordedPlace:
    """A line of a file of places."""

    recording: Path  # .mcap, or a folder of images
    place: tuple[float, float, float]  # x, y, z [m] of the middle of the hull


def read_place(at: str | None) -> tuple[float, float]:
    """Read `x,y` [m]; not a number where nothing is said. Raises PlaceError."""
    if at is None:
        return math.nan, math.nan
    number = r"\s*([-+]?[0-9]*\.?[0-9]+)\s*"
    found = re.fullmatch(f"{number},{number}", at)
    if found is None:
        raise PlaceError(f"--at is {at!r}, expected x,y [m], as 0.5,-1")
    return float(found[1]), float(found[2])


def read_height(height: float) -> float:
    """Return a height [m] that can be; raises PlaceError."""
    if not 0.0 <= height <= _HIGHEST:
        raise PlaceError(f"--height is {height:g}, expected 0 to {_HIGHEST:g} m")
    return height


def simulated_place(command: str, at: str | None, height: float | None) -> Place:
    """Return where the simulated drone stands, as usual where nothing is said; raises PlaceError."""
    import numpy as np

    from noctule.flight.depth_scene import STAND, Scene
    from noctule.simulation.ceiling.flights import sees_whole

    x, y = STAND[:2] if at is None else read_place(at)
    place = x, y, STAND[2] if height is None else read_height(height)
    if not sees_whole(Scene("stand").spec.camera, np.array(place)):
        raise PlaceError(
            f"{command}: the simulated camera does not see the whole drone at x {x:g}, y {y:g}, height "
            f"{place[2]:g} m; expected a place nearer to the middle of its picture"
        )
    return place


def read_places(file: Path) -> list[RecordedPlace]:
    """Read lines `recording,x,y,z` below a line of these names; recordings are beside the file.

    Raises PlacesFileError.
    """
    numbered = enumerate(csv.reader(_text(file).splitlines()), start=1)
    rows = [(line, row) for line, row in numbered if any(map(str.strip, row))]
    expected = ",".join(COLUMNS)
    if not rows:
        raise PlacesFileError(f"{file}: it is empty; its first line names the columns: {expected}")
    first, names = rows[0][0], tuple(name.strip().lower() for name in rows[0][1])
    if names != COLUMNS:
        raise PlacesFileError(f"{file}:{first}: the columns are {','.join(names)}; expected {expected}")
    places: list[RecordedPlace] = []
    for line, row in rows[1:]:
        place = _place(file, line, row)
        if place.recording in [other.recording for other in places]:
            raise PlacesFileError(
                f"{file}:{line}: {place.recording} was named before; expected a recording of its own for "
                "each place"
            )
        places.append(place)
    if len(places) < FEWEST:
        raise PlacesFileError(
            f"{file}: {len(places)} places, expected {FEWEST} or more; a single place is given by "
            "--recording, --height and --at"
        )
    return places


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise PlacesFileError(f"{file}: it is not UTF-8 text; save it as UTF-8") from None
    except OSError as error:
        raise PlacesFileError(
            f"{file}: cannot be read ({error.strerror or error}); expected a .csv file of places: "
            f"{','.join(COLUMNS)}"
        ) from None


def _place(file: Path, line: int, row: list[str]) -> RecordedPlace:
    cells = [cell.strip() for cell in row]
    if len(cells) != len(COLUMNS):
        raise PlacesFileError(
            f"{file}:{line}: {len(cells)} values, expected {len(COLUMNS)}: {','.join(COLUMNS)}"
        )
    recording = file.parent / cells[0]
    if not cells[0] or not recording.exists():
        missing = f", and there is no {recording}" if cells[0] else ""
        raise PlacesFileError(
            f"{file}:{line}: recording is {cells[0]!r}{missing}; expected an .mcap file or a folder of "
            "images, named as seen from the file of places"
        )
    x, y = (
        _number(file, line, name, cell, -_FARTHEST, _FARTHEST)
        for name, cell in zip("xy", cells[1:3], strict=True)
    )
    return RecordedPlace(recording, (x, y, _number(file, line, "z", cells[3], 0.0, _HIGHEST)))


def _number(file: Path, line: int, name: str, cell: str, low: float, high: float) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise PlacesFileError(
            f"{file}:{line}: {name} is {cell!r}; expected a number, {low:g} to {high:g} [m]"
        )
    return value
