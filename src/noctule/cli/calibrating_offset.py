"""`noctule calibrate offset`: the constant error of a site's positions, from a drone that stands still."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from noctule.cli.depth_options import SourceOptions, depth_source
from noctule.cli.depth_stream import Stream, open_stream
from noctule.cli.options import out_folder
from noctule.cli.show import as_json
from noctule.cli.standing_places import PlaceError, read_height, read_place, read_places, simulated_place

if TYPE_CHECKING:
    from noctule.flight.depth_sources import DepthSource
    from noctule.geometry import Array
    from noctule.localization.calibration.offset import Offset, Standing
    from noctule.localization.site import Site

SECONDS = 5.0
_COMMAND = "calibrate offset"
_NO_SOURCE = ("recording", "folder", "simulated", "seed", "hull", "markers", "person", "device", "seconds")


@dataclass(frozen=True, slots=True)
class OffsetOptions:
    """What is said beside the source and the site."""

    height: float | None = None
    at: str | None = None
    places: Path | None = None
    out: Path | None = None


def find_offset(options: SourceOptions, site: Path, said: OffsetOptions, json: bool) -> int:
    """Measure a standing drone, keep offset and slant in the site; 0 when the measurements agree."""
    from noctule.localization.calibration.offset import measure_offset, next_place
    from noctule.localization.site import CAMERA, TEMPLATE, load_site, save_camera, save_template

    sources = _one_place(options, said) if said.places is None else _several(options, said, said.places)
    known = load_site(site, any_offset=True)  # that in the file is forgotten: it is measured anew
    streams = [open_stream(source, known.camera, known.background) for source, _ in sources]
    standings = [_located(s, known, place) for s, (_, place) in zip(streams, sources, strict=True)]
    if said.places is not None:
        standings = [replace(s, name=source.name) for s, (source, _) in zip(standings, sources, strict=True)]
    camera = known.camera.camera
    found = measure_offset(standings, camera.t_world_camera, known.template.slant)
    following = None if found.told else next_place(standings, camera)
    # Only now: what fails leaves nothing behind.
    folder = out_folder(said.out or site, "site")
    files = [folder / CAMERA]
    save_camera(folder, replace(known.camera, offset=found.bias))
    if said.places is not None:
        files.append(folder / TEMPLATE)
        save_template(folder, replace(known.template, slant=found.slant))
    if json:
        print(as_json(_told(found, files, streams, standings, following)))
        return 0
    print("\n".join(_in_words(found, streams, standings) + _slant_in_words(found, following)))
    print(f"site: {', '.join(map(str, files))}")
    return 0


def _one_place(options: SourceOptions, said: OffsetOptions) -> list[tuple[DepthSource, Array]]:
    import numpy as np

    if said.height is None:
        raise PlaceError(
            f"{_COMMAND}: found no --height, expected that of the place where the drone stands, or several "
            "places with --places FILE"
        )
    place = np.array([*read_place(said.at), read_height(said.height)])
    at = simulated_place(_COMMAND, said.at, said.height) if options.simulated else None
    return [(depth_source(options, _COMMAND, "stand", SECONDS, at), place)]


def _several(options: SourceOptions, said: OffsetOptions, file: Path) -> list[tuple[DepthSource, Array]]:
    import numpy as np

    given = [name for name in ("height", "at") if getattr(said, name) is not None]
    given += [name for name in _NO_SOURCE if getattr(options, name) not in (None, False)]
    if given:
        raise PlaceError(f"{_COMMAND}: --{given[0]} does not go with --places; leave it out")
    sources = []
    for line in read_places(file):
        own = (
            SourceOptions(folder=line.recording, scale=options.scale)
            if line.recording.is_dir()
            else SourceOptions(recording=line.recording)
        )
        sources.append((depth_source(own, _COMMAND, "stand", SECONDS), np.array(line.place)))
    return sources


def _located(stream: Stream, known: Site, place: Array) -> Standing:
    import numpy as np

    from noctule.localization.calibration.near_floor import LOW, near_floor, steadied
    from noctule.localization.calibration.offset import FEWEST, Standing, TooFewMeasurementsError
    from noctule.localization.locator import Locator

    frames = stream.frames(f"locating, {stream.source.name}")
    background, template = known.background, replace(known.template, slant=0.0)
    low = place[2] < LOW
    if low:
        frames = steadied(frames, background)
        background, template = near_floor(background, template)
    # No detector: it may stand lower than it was ever flown. And what was calibrated before is forgotten.
    locator = Locator(known.camera.camera, background, template)
    with stream.judged():
        located = [locator.step(frame).measurement for frame in frames]
    measured = np.array([m.position for m in located if m is not None]).reshape(-1, 3)
    if low and len(measured) < FEWEST <= len(located):
        raise TooFewMeasurementsError(
            f"offset: a drone {place[2]:g} m above the floor was measured {len(measured)} times in "
            f"{stream.source.name}, expected {FEWEST} or more; it is hardly told from the floor there: put "
            f"it below the camera, or on a stool of {LOW:g} m or more"
        )
    return Standing(place, measured)


def _told(
    found: Offset,
    files: list[Path],
    streams: list[Stream],
    standings: list[Standing],
    following: Array | None,
) -> dict[str, Any]:
    unusable = sum((stream.sieve.reasons for stream in streams), Counter[str]())
    measured = [len(standing.measured) for standing in standings]
    several = {
        "template": files[-1],
        "places": [
            {"source": s.name, "place_m": _numbers(s.true), "measured": n, "left_m": _numbers(left)}
            for s, n, left in zip(standings, measured, found.left, strict=True)
        ],
    }
    return {
        "camera": files[0],
        "frames": sum(stream.sieve.seen for stream in streams),
        "unusable": dict(unusable),
        "measured": sum(measured),
        "offset_m": _numbers(found.bias),
        "scatter_m": _numbers(found.scatter),
        "slant_m": found.slant,
        "slant_told": found.told,
        "next_place_m": None if following is None else _numbers(following),
        "disagreement_m": _numbers(found.disagreement),
        **(several if len(files) > 1 else {}),
    }


def _in_words(found: Offset, streams: list[Stream], standings: list[Standing]) -> list[str]:
    x, y, z = (f"{1e3 * b:+.1f}" for b in found.bias)
    scatter = _millimetres(found.scatter)
    lines = [
        f"offset: measured minus true is x {x}, y {y}, z {z} mm; one measurement scatters by {scatter} mm"
    ]
    for stream, standing, left in zip(streams, standings, found.left, strict=True):
        without = f", {_millimetres(left, '+.1f')} mm left" if standing.name else ""
        lines.append(f"of: {len(standing.measured)} measurements in {stream.used}{without}")
    if found.places > 1:
        lines.append(f"places: {found.places}, which disagree by {_millimetres(found.disagreement)} mm")
    return lines


def _slant_in_words(found: Offset, following: Array | None) -> list[str]:
    slant = f"{1e3 * found.slant:+.1f} mm at 45 degrees"
    if found.told:
        return [f"slant: seen from aside, positions are off by {slant}; - is towards the camera"]
    who = "the places, all seen from much the same side, do" if found.places > 1 else "one place does"
    kept = f"{slant}, and is taken off" if found.slant else "0"
    lines = [f"slant: {who} not tell it; it stays {kept}"]
    if following is not None:
        x, y, z = following
        where = f"x {x:+.1f}, y {y:+.1f}, height {z:.1f} m"
        lines.append(f"next: a stool near {where} would tell it best, see --places")
    return lines


def _numbers(values: Array) -> list[float]:
    return [float(value) for value in values]


def _millimetres(values: Array, form: str = ".1f") -> str:
    return ", ".join(format(1e3 * float(value), form) for value in values)
