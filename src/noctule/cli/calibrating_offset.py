"""`noctule calibrate offset`: the constant error of a site's positions, from a drone that stands still."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

from noctule.cli.depth_options import SourceOptions, depth_source
from noctule.cli.depth_stream import open_stream
from noctule.cli.options import out_folder
from noctule.cli.show import as_json
from noctule.errors import NoctuleError

SECONDS = 5.0


class PlaceError(NoctuleError):
    """A place that cannot be read."""


def find_offset(
    options: SourceOptions, site: Path, height: float, at: str | None, out: Path | None, json: bool
) -> int:
    """Measure a standing drone, keep the offset in camera.toml; 0 when the measurements agree."""
    import numpy as np

    from noctule.localization.calibration.offset import Standing, measure_offset
    from noctule.localization.locator import Locator
    from noctule.localization.site import CAMERA, load_site, save_camera

    place = np.array([*read_place(at), _read_height(height)])
    source = depth_source(options, "calibrate offset", "stand", SECONDS)
    known = load_site(site)
    stream = open_stream(source, known.camera, known.background)
    folder = out_folder(out or site, "site")
    # No detector: it may stand lower than it was ever flown. And what was calibrated before is forgotten.
    locator = Locator(known.camera.camera, known.background, known.template)
    with stream.judged():
        located = [locator.step(frame).measurement for frame in stream.frames("measuring where it stands")]
        measured = np.array([m.position for m in located if m is not None]).reshape(-1, 3)
        found = measure_offset([Standing(place, measured)])
    save_camera(folder, replace(known.camera, offset=found.bias))
    if json:
        told = {
            "camera": folder / CAMERA,
            **stream.counts(),
            "measured": len(measured),
            "offset_m": [float(b) for b in found.bias],
            "scatter_m": [float(s) for s in found.scatter],
        }
        print(as_json(told))
        return 0
    x, y, z = (f"{1e3 * b:+.1f}" for b in found.bias)
    scatter = ", ".join(f"{1e3 * s:.1f}" for s in found.scatter)
    print(f"offset: measured minus true is x {x}, y {y}, z {z} mm; one measurement scatters by {scatter} mm")
    print(f"of: {len(measured)} measurements in {stream.used}\nsite: {folder / CAMERA}")
    return 0


def read_place(at: str | None) -> tuple[float, float]:
    """Read `x,y` [m]; not a number where nothing is said. Raises PlaceError."""
    if at is None:
        return math.nan, math.nan
    number = r"\s*([-+]?[0-9]*\.?[0-9]+)\s*"
    found = re.fullmatch(f"{number},{number}", at)
    if found is None:
        raise PlaceError(f"--at is {at!r}, expected x,y [m], as 0.5,-1")
    return float(found[1]), float(found[2])


def _read_height(height: float) -> float:
    if not 0.0 <= height <= 10.0:
        raise PlaceError(f"--height is {height:g}, expected 0 to 10 m")
    return height
