"""detector.toml: what the three ways to detect the drone learned from a manual flight."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from noctule.camera import FixedCamera
from noctule.localization.detection.band import SurfaceBand
from noctule.localization.detection.cubics import AreaCubics
from noctule.localization.detection.detector import Detector
from noctule.localization.detection.hu import HuPatterns
from noctule.localization.site_files import (
    FORMAT,
    check_made_by,
    intrinsics_of,
    read_toml,
    toml,
    write_whole,
)
from noctule.settings import Settings

DETECTOR = "detector.toml"
_REMEDY = "learn it with `noctule calibrate detector`"
_HEADER = """\
# What the blob of the drone looks like. Altitudes [m] are of the surface seen, areas [px], surfaces [m^2].
# cubics: largest (g1) and smallest (g2) area as polynomials of the altitude. hu: invariants of its shapes.
"""

Real = Annotated[float, Field(allow_inf_nan=False)]
Four = tuple[Real, Real, Real, Real]
Seven = tuple[Real, Real, Real, Real, Real, Real, Real]


@dataclass(frozen=True, slots=True)
class Detectors:
    """All of them, fitted on the same flight."""

    cubics: AreaCubics
    band: SurfaceBand
    hu: HuPatterns

    def named(self, name: str) -> Detector:
        """Return the one of this name: cubics, band or hu."""
        found: Detector = getattr(self, name)
        return found


class _Range(Settings):
    lowest: float = Field(ge=-100, le=100)
    highest: float = Field(ge=-100, le=100)

    @model_validator(mode="after")
    def _in_order(self) -> _Range:
        if self.lowest >= self.highest:
            raise ValueError(f"lowest is {self.lowest:g}, expected less than highest, {self.highest:g}")
        return self


class _Cubics(_Range):
    g1: Four
    g2: Four


class _Band(_Range):
    smallest: float = Field(gt=0, le=100)
    largest: float = Field(gt=0, le=100)


class _Hu(Settings):
    patterns: tuple[Seven, ...] = Field(min_length=1, max_length=100)
    threshold: float = Field(gt=0, le=1e6)


class _DetectorFile(Settings):
    camera: tuple[Real, Real, Real, Real, Real, Real]
    cubics: _Cubics
    band: _Band
    hu: _Hu


def save_detectors(folder: Path, detectors: Detectors, camera: FixedCamera) -> None:
    """Write detector.toml, which only this camera may use; raises SiteFileError."""
    cubics, band, hu = detectors.cubics, detectors.band, detectors.hu
    text = _HEADER + toml({"format": FORMAT, "camera": intrinsics_of(camera).tolist()})
    text += "\n[cubics]\n" + toml(
        {
            "g1": [float(c) for c in cubics.g1],
            "g2": [float(c) for c in cubics.g2],
            "lowest": cubics.lowest,
            "highest": cubics.highest,
        }
    )
    text += "\n[band]\n" + toml(
        {name: getattr(band, name) for name in ("smallest", "largest", "lowest", "highest")}
    )
    text += "\n[hu]\n" + toml({"patterns": np.asarray(hu.patterns).tolist(), "threshold": hu.threshold})
    write_whole(folder / DETECTOR, text.encode())


def load_detectors(folder: Path, camera: FixedCamera) -> Detectors:
    """Read detector.toml; raises SiteFileError, SiteFormatError, SiteCameraError."""
    path = folder / DETECTOR
    file = read_toml(path, _DetectorFile, _REMEDY)
    check_made_by(path, np.array(file.camera), camera, _REMEDY)
    cubics, band = file.cubics, file.band
    return Detectors(
        AreaCubics(np.array(cubics.g1), np.array(cubics.g2), cubics.lowest, cubics.highest),
        SurfaceBand(band.smallest, band.largest, band.lowest, band.highest),
        HuPatterns(np.array(file.hu.patterns), file.hu.threshold),
    )
