"""The files that intrinsics are kept in.

intrinsics.toml    the pinhole, its standard deviations and the lens: what places the camera later
teach-camera.toml  the pinhole alone, in the form that `noctule teach --camera` reads
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from noctule.camera import PinholeCamera
from noctule.geometry import Array
from noctule.localization.calibration.lens import Lens
from noctule.localization.site_files import FORMAT, read_toml, toml, write_whole
from noctule.settings import Settings

INTRINSICS, TEACH_CAMERA = "intrinsics.toml", "teach-camera.toml"
_CALIBRATE = "find them with `noctule calibrate camera PICTURES`"
_PINHOLE = ("width", "height", "fx", "fy", "cx", "cy")
_HEADER = """\
# The intrinsics of a camera [px]; the middle of the top left pixel is (0, 0). lens: OpenCV's k1, k2, p1, p2.
# sd: how well fx, fy, cx, cy are known.
"""
_TEACH_HEADER = """\
# For `noctule teach --camera`, and pictures whose distortion was taken out: see intrinsics.toml beside this.
# Of a camera on a drone, say here how it sits: stabilised = true, t_body_camera = [forward, left, up] [m].
"""

Finite = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Positive = Annotated[float, Field(ge=0.0, le=1000.0)]


class _IntrinsicsFile(Settings):
    width: int = Field(ge=16, le=10000)
    height: int = Field(ge=16, le=10000)
    fx: float = Field(gt=0, le=1e5)
    fy: float = Field(gt=0, le=1e5)
    cx: float = Field(ge=-1e5, le=1e5)
    cy: float = Field(ge=-1e5, le=1e5)
    lens: tuple[Finite, Finite, Finite, Finite] = (0.0, 0.0, 0.0, 0.0)
    sd: tuple[Positive, Positive, Positive, Positive] = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class CameraIntrinsics:
    """What intrinsics.toml holds."""

    camera: PinholeCamera
    lens: Lens
    sd: Array  # (4,) [px], of fx, fy, cx, cy


def save_intrinsics(folder: Path, known: CameraIntrinsics) -> None:
    """Write intrinsics.toml and teach-camera.toml; raises SiteFileError."""
    pinhole = {name: getattr(known.camera, name) for name in _PINHOLE}
    more = {"lens": known.lens.coefficients.tolist(), "sd": known.sd.tolist()}
    write_whole(folder / INTRINSICS, (_HEADER + toml({"format": FORMAT, **pinhole, **more})).encode())
    write_whole(folder / TEACH_CAMERA, (_TEACH_HEADER + toml(pinhole)).encode())


def load_intrinsics(folder: Path) -> CameraIntrinsics:
    """Read intrinsics.toml; raises SiteFileError, SiteFormatError."""
    file = read_toml(folder / INTRINSICS, _IntrinsicsFile, _CALIBRATE)
    camera = PinholeCamera(file.width, file.height, file.fx, file.fy, file.cx, file.cy)
    return CameraIntrinsics(camera, Lens(*file.lens), np.array(file.sd))
