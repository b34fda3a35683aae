"""Paths in space from files: waypoints in CSV, pieces with speeds, headings and stops in TOML."""

from __future__ import annotations

import csv
import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from noctule.control.paths import (
    AlongPath,
    FacePoint,
    FixedHeading,
    PathJoinError,
    PathLengthError,
    PathPlan,
    PathShapeError,
    SpacePath,
    arc,
    eight,
    ellipse,
    joined,
    nearest,
    plan,
    polyline,
    require_length,
    spline,
    with_headings,
)
from noctule.errors import NoctuleError
from noctule.flight.setting_errors import explain
from noctule.flight.space_path_entries import SegmentEntry, SpacePathEntries
from noctule.flight.toml_lines import key_lines, line_of
from noctule.geometry import Array
from noctule.messages import Limits

SUFFIXES = (".csv", ".toml")
_HEADERS = (["x", "y", "z"], ["x", "y", "z", "yaw_deg"], ["x", "y", "z", "yaw"])
_FARTHEST = 100.0  # [m] from the origin: indoors
_MILLIMETRES = "are these millimetres? lengths are in metres"
_EXPECTED = "expected x,y,z or x,y,z,yaw_deg (or yaw, in radians)"


class SpacePathFileError(NoctuleError):
    """A path file with a mistake: file, line, field, what was found and what is expected."""


def read_space_path(file: Path, limits: Limits | None = None) -> PathPlan:
    """Return the plan of a path file, as `space_path_of` does. Raises SpacePathFileError."""
    return space_path_of(file, read_path_text(file), limits)


def read_path_text(file: Path) -> str:
    """Return what a path file holds; raises SpacePathFileError."""
    try:
        return file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise SpacePathFileError(f"{file}: it is not UTF-8 text; save it as UTF-8") from None
    except OSError as error:
        raise SpacePathFileError(
            f"{file}: cannot be read ({error.strerror or error}); expected the .csv or .toml file of a path"
        ) from None


def space_path_of(file: Path, text: str, limits: Limits | None = None) -> PathPlan:
    """Return the plan of a path file's text, .csv or .toml, within the `limits` of a vehicle if given.

    A CSV file holds waypoints [m], a line each under a line of names, and is flown as a smooth curve at the
    usual speed, with the heading along it or, where there is a column for it, as given; if the last waypoint
    is the first again, the path is closed. Raises SpacePathFileError.
    """
    if file.suffix.lower() == ".csv":
        return _of_csv(file, text, limits)
    if file.suffix.lower() == ".toml":
        return _of_toml(file, text, limits)
    raise SpacePathFileError(f"{file}: found the ending {file.suffix!r}, expected .csv or .toml")


def _of_csv(file: Path, text: str, limits: Limits | None) -> PathPlan:
    rows = [
        (n, row) for n, row in enumerate(csv.reader(text.splitlines()), start=1) if any(map(str.strip, row))
    ]
    if not rows:
        raise SpacePathFileError(f"{file}: it is empty; its first line names the columns: {_EXPECTED}")
    first, names = rows[0][0], [name.strip().lower() for name in rows[0][1]]
    if names not in _HEADERS:
        raise SpacePathFileError(f"{file}:{first}: the columns are {','.join(names)}; {_EXPECTED}")
    values = np.array([_numbers(file, n, row, names) for n, row in rows[1:]]).reshape(-1, len(names))
    if len(values) < 2:
        raise SpacePathFileError(f"{file}: {len(values)} waypoints, expected 2 or more")
    lines = [n for n, _ in rows[1:]]
    steps = np.linalg.norm(np.diff(values[:, :3], axis=0), axis=1)
    for k in np.flatnonzero(steps < 1e-3):
        raise SpacePathFileError(
            f"{file}:{lines[k + 1]}: the waypoint is where that of line {lines[k]} is; leave one of them out"
        )
    try:
        closed = len(values) > 3 and float(np.linalg.norm(values[-1, :3] - values[0, :3])) < 1e-3
        values = values[:-1] if closed else values
        path = spline(values[:, :3], closed)
        _require_indoors(path)
        if len(names) == 3:
            return plan(path, limits=limits)
        yaw = values[:, 3] if names[3] == "yaw" else np.radians(values[:, 3])
        rule = with_headings(path, _lengths_at(path, values[:, :3]), yaw)
        return plan(path, heading=rule, limits=limits)
    except PathShapeError as error:
        raise SpacePathFileError(f"{file}: {error}") from None


def _numbers(file: Path, line: int, row: list[str], names: list[str]) -> list[float]:
    if len(row) != len(names):
        raise SpacePathFileError(
            f"{file}:{line}: {len(row)} values, expected {len(names)}: {','.join(names)}"
        )
    found = []
    for name, cell in zip(names, row, strict=True):
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        most = _FARTHEST if name in "xyz" else 3600.0
        if not abs(value) <= most:
            unit = "m" if name in "xyz" else "rad" if name == "yaw" else "deg"
            hint = f"; {_MILLIMETRES}" if name in "xyz" and most < abs(value) < math.inf else ""
            raise SpacePathFileError(
                f"{file}:{line}: {name} is {cell.strip()!r}; "
                f"expected a number, {-most:g} to {most:g} [{unit}]{hint}"
            )
        found.append(value)
    return found


def _lengths_at(path: SpacePath, points: Array) -> Array:
    """Return the arc lengths (m,) [m] of waypoints (m, 3) on the path through them, in their order."""
    # Each is looked for beyond the one before: where the path crosses itself it is near twice.
    found, floor = [0.0], 0
    for point in points[1:] if path.closed else points[1:-1]:
        gaps = np.linalg.norm(path.position[floor + 1 :] - point, axis=1)
        near = np.flatnonzero(gaps <= max(float(gaps.min()), 0.0) + 0.01)
        k = int(near[0])
        while k + 1 < len(gaps) and gaps[k + 1] < gaps[k]:
            k += 1
        floor += 1 + k
        found.append(nearest(path, point, float(path.s[floor])))
    return np.array(found if path.closed else [*found, path.length])


def _of_toml(file: Path, text: str, limits: Limits | None) -> PathPlan:
    try:
        entries = SpacePathEntries.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise SpacePathFileError(f"{file}: this is not TOML: {error}") from None
    except ValidationError as error:
        raise SpacePathFileError(explain(error, SpacePathEntries, text, str(file))) from None
    lines = key_lines(text)

    def where(k: int) -> str:
        line = line_of(lines, ("segments", k))
        return f"{file}: segments[{k}]" if line is None else f"{file}:{line}: segments[{k}]"

    return plan_of_entries(entries, str(file), where, limits)


def plan_of_entries(
    entries: SpacePathEntries, name: str, where: Callable[[int], str], limits: Limits | None = None
) -> PathPlan:
    """Return the plan of entries; `name` and `where` (by the segment's index) stand in errors.

    Raises SpacePathFileError.
    """
    pieces: list[SpacePath] = []
    for k, entry in enumerate(entries.segments):
        try:
            pieces.append(_piece(entry, entries.closed and len(entries.segments) == 1))
            _require_indoors(pieces[-1])
            require_length(math.fsum(piece.length for piece in pieces))  # before the next one is made
        except PathLengthError as error:
            hint = f"; {_MILLIMETRES}" if _largest(entry) > 0.5 * _FARTHEST else ""
            raise SpacePathFileError(f"{where(k)}: {error}{hint}") from None
        except PathShapeError as error:
            raise SpacePathFileError(f"{where(k)}: {error}") from None
    try:
        path = joined(pieces, entries.closed)
        made = plan(
            path,
            entries.speed,
            _heading(entries),
            tuple(entry.stop() for entry in entries.stops),
            entries.rounds,
            turning=entries.turning,
            cruise=_cruise(entries, pieces, path),
            limits=limits,
        )
    except PathJoinError as error:
        raise SpacePathFileError(f"{where(error.piece)}: {error}") from None
    except PathShapeError as error:
        raise SpacePathFileError(f"{name}: {error}") from None
    return made


def _require_indoors(path: SpacePath) -> None:
    """Refuse a path with a coordinate beyond _FARTHEST; raises PathShapeError."""
    farthest = np.abs(path.position).max(axis=1)
    if farthest.max() > _FARTHEST + 1e-3:  # a node may be off by rounding
        x, y, z = path.position[int(farthest.argmax())]
        raise PathShapeError(
            f"path: it leads to ({x:.2f}, {y:.2f}, {z:.2f}); "
            f"expected x, y, z from {-_FARTHEST:g} to {_FARTHEST:g} m; {_MILLIMETRES}"
        )


def _largest(entry: SegmentEntry) -> float:
    """Return the largest length [m] that stands in a segment."""
    given = [v for point in entry.points or () for v in point] + [*(entry.centre or ())]
    return max(map(abs, [*given, *(entry.half_axes or ()), entry.radius or 0.0]), default=0.0)


def _piece(entry: SegmentEntry, closed: bool) -> SpacePath:
    if entry.kind == "spline":
        return spline(entry.points or (), closed)
    if entry.kind == "line":
        return polyline(entry.points or (), entry.radius or 0.0, closed)
    centre, axes = entry.centre or (0.0, 0.0, 0.0), entry.half_axes or (0.0, 0.0)
    if entry.kind == "arc":
        begin, sweep = math.radians(entry.begin_deg or 0.0), math.radians(entry.sweep_deg or 0.0)
        return arc(centre, entry.radius or 0.0, begin, sweep, entry.climb or 0.0)
    return (ellipse if entry.kind == "ellipse" else eight)(centre, axes, entry.rise or 0.0)


def _heading(entries: SpacePathEntries) -> AlongPath | FixedHeading | FacePoint:
    heading = entries.heading
    if heading.rule == "fixed":
        return FixedHeading(math.radians(heading.yaw_deg))
    if heading.rule == "point" and heading.x is not None and heading.y is not None:
        return FacePoint(heading.x, heading.y)
    return AlongPath()


def _cruise(entries: SpacePathEntries, pieces: list[SpacePath], path: SpacePath) -> Array:
    """Return the cruise at every node of the joined path, (n,) [m/s]; where two pieces meet, the slower."""
    cruise = np.full(path.s.size, np.inf)
    begin = 0.0
    for entry, piece in zip(entries.segments, pieces, strict=True):
        own = entries.speed.cruise if entry.cruise is None else entry.cruise
        inside = (path.s >= begin - 1e-9) & (path.s <= begin + piece.length + 1e-9)
        cruise[inside] = np.minimum(cruise[inside], own)
        begin += piece.length
    return cruise
