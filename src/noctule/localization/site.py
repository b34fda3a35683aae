"""A site: the folder of a depth camera that stands in a room, and of what it was taught to see.

camera.toml      the camera: intrinsics, distortion, where it hangs, the constant offset of its measurements
background.npz   the empty room
detector.toml    what the blob of the drone looks like, by each method
template.npz     the drone's top view

camera.toml comes first; the others are learned with that camera, and refused when it is replaced by another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from noctule.camera import CEILING_CAMERA, FixedCamera, PinholeCamera
from noctule.geometry import Array
from noctule.localization.calibration.lens import Lens, straightener
from noctule.localization.calibration.offset import LARGEST_OFFSET, plausible
from noctule.localization.detector_file import Detectors, load_detectors, save_detectors
from noctule.localization.locator import Locator, LocatorSettings
from noctule.localization.site_files import (
    FORMAT,
    PINHOLE,
    SiteFileError,
    check_made_by,
    intrinsics_of,
    read_arrays,
    read_toml,
    save_arrays,
    take,
    toml,
    write_whole,
)
from noctule.localization.template import Template, TemplateError
from noctule.messages import DepthFrame
from noctule.settings import Settings
from noctule.vision.depth.background import Background

CAMERA, BACKGROUND, TEMPLATE = "camera.toml", "background.npz", "template.npz"
_CALIBRATE = "calibrate the camera with `noctule calibrate camera`"
_MEASURE = "measure it again with `noctule calibrate offset`, or set it to [0.0, 0.0, 0.0]"
_LEARN_ROOM = "learn the empty room with `noctule calibrate background`"
_LEARN_VIEW = "learn the drone's top view with `noctule calibrate template`"
_HEADER = """\
# A depth camera that stands in the room. Pixels, metres; world x forward, y left, z up, 0 on the floor.
# R_world_camera takes camera axes (right, down, forward) to the world. lens: OpenCV's k1, k2, p1, p2.
# offset: what is measured minus what is true, subtracted from every position.
"""

Finite = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Three = tuple[Finite, Finite, Finite]


@dataclass(frozen=True, slots=True)
class SiteCamera:
    """The camera of a site."""

    camera: FixedCamera
    lens: Lens = field(default_factory=Lens)  # taken out where frames are read
    offset: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m], measured minus true, world


SIMULATED = SiteCamera(CEILING_CAMERA)
"""The camera of the simulated room."""


class _CameraFile(Settings):
    """What camera.toml holds."""

    width: int = Field(ge=16, le=10000)
    height: int = Field(ge=16, le=10000)
    fx: float = Field(gt=0, le=1e5)
    fy: float = Field(gt=0, le=1e5)
    cx: float = Field(ge=-1e5, le=1e5)
    cy: float = Field(ge=-1e5, le=1e5)
    R_world_camera: tuple[Three, Three, Three]
    t_world_camera: Three
    lens: tuple[Finite, Finite, Finite, Finite] = (0.0, 0.0, 0.0, 0.0)
    offset: Three = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _a_rotation(self) -> _CameraFile:
        R = np.array(self.R_world_camera)
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0.0:
            raise ValueError("R_world_camera is no rotation, to 1e-6")
        return self


def save_camera(folder: Path, camera: SiteCamera) -> None:
    """Write camera.toml; raises SiteFileError."""
    fixed = camera.camera
    values = {
        "format": FORMAT,
        **{name: getattr(fixed.intrinsics, name) for name in PINHOLE},
        "R_world_camera": np.asarray(fixed.R_world_camera).tolist(),
        "t_world_camera": np.asarray(fixed.t_world_camera).tolist(),
        "lens": camera.lens.coefficients.tolist(),
        "offset": np.asarray(camera.offset).tolist(),
    }
    write_whole(folder / CAMERA, (_HEADER + toml(values)).encode())


def load_camera(folder: Path, any_offset: bool = False) -> SiteCamera:
    """Read camera.toml; raises SiteFileError, SiteFormatError.

    An offset that cannot be is refused too; with `any_offset` it is not, for whoever measures it anew.
    """
    file = read_toml(folder / CAMERA, _CameraFile, _CALIBRATE)
    intrinsics = PinholeCamera(file.width, file.height, file.fx, file.fy, file.cx, file.cy)
    fixed = FixedCamera(intrinsics, np.array(file.R_world_camera), np.array(file.t_world_camera))
    offset = np.array(file.offset)
    if not any_offset and not plausible(offset):
        found = ", ".join(f"{value:.4g}" for value in file.offset)
        raise SiteFileError(
            f"site file {folder / CAMERA}: offset is {found} m, expected {LARGEST_OFFSET:g} m or less along "
            f"each axis; {_MEASURE}"
        )
    return SiteCamera(fixed, Lens(*file.lens), offset)


def save_background(folder: Path, background: Background, camera: FixedCamera) -> None:
    """Write background.npz, which only this camera may use; raises SiteFileError."""
    save_arrays(
        folder / BACKGROUND,
        {
            "camera": intrinsics_of(camera),
            "mean": background.mean,
            "deviation": background.deviation,
            "count": background.count,
            "nearest": background.nearest,
            "frames": np.array(background.frames),
            "deviations": np.array(background.deviations),
        },
    )


def load_background(folder: Path, camera: FixedCamera) -> Background:
    """Read background.npz; raises SiteFileError, SiteFormatError, SiteCameraError."""
    path = folder / BACKGROUND
    arrays = read_arrays(path, _LEARN_ROOM)
    check_made_by(path, take(arrays, "camera", np.float64, (6,), path, _LEARN_ROOM), camera, _LEARN_ROOM)
    shape = (camera.intrinsics.height, camera.intrinsics.width)
    mean, deviation = (
        take(arrays, name, np.float32, shape, path, _LEARN_ROOM) for name in ("mean", "deviation")
    )
    count = take(arrays, "count", np.int32, shape, path, _LEARN_ROOM)
    nearest = take(arrays, "nearest", np.uint16, shape, path, _LEARN_ROOM)
    for name, missing in {
        "count": not (count > 0).any(),
        "mean": (mean[count > 0] <= 0.0).any(),
        "deviation": (deviation[count > 0] <= 0.0).any(),
        "nearest": not nearest.any(),
    }.items():
        if missing:
            raise SiteFileError(
                f"site file {path}: {name} is 0, expected more than that where the room was seen; "
                f"{_LEARN_ROOM}"
            )
    return Background(
        mean,
        deviation,
        count,
        nearest,
        int(take(arrays, "frames", np.int64, (), path, _LEARN_ROOM)),
        float(take(arrays, "deviations", np.float64, (), path, _LEARN_ROOM)),
    )


def save_template(folder: Path, template: Template) -> None:
    """Write template.npz; raises SiteFileError."""
    save_arrays(folder / TEMPLATE, template.arrays())


def load_template(folder: Path) -> Template:
    """Read template.npz; raises SiteFileError, SiteFormatError."""
    path = folder / TEMPLATE
    try:
        return Template.from_arrays(read_arrays(path, _LEARN_VIEW))
    except TemplateError as error:
        raise SiteFileError(f"site file {path}: {str(error).rsplit(';', 1)[0]}; {_LEARN_VIEW}") from None


@dataclass(frozen=True, slots=True)
class Site:
    """All that is needed to locate the drone."""

    camera: SiteCamera
    background: Background
    detectors: Detectors
    template: Template


def load_site(folder: Path, any_offset: bool = False) -> Site:
    """Read a whole site; raises SiteFileError, SiteFormatError, SiteCameraError, one file after the other.

    With `any_offset` an offset that cannot be is let pass.
    """
    camera = load_camera(folder, any_offset)
    background = load_background(folder, camera.camera)
    return Site(camera, background, load_detectors(folder, camera.camera), load_template(folder))


def locator_of(site: Site, settings: LocatorSettings | None = None, detector: str = "band") -> Locator:
    """Return the default method with all that a site was taught; it has seen nothing yet."""
    proposing = site.detectors.named(detector)
    camera = site.camera
    return Locator(camera.camera, site.background, site.template, proposing, settings, camera.offset)


def save_site(folder: Path, site: Site) -> None:
    """Write a whole site; raises SiteFileError."""
    save_camera(folder, site.camera)
    save_background(folder, site.background, site.camera.camera)
    save_detectors(folder, site.detectors, site.camera.camera)
    save_template(folder, site.template)


def straightened(frames: Iterable[DepthFrame], camera: SiteCamera) -> Iterator[DepthFrame]:
    """Yield the frames without the lens' distortion, as `straightening` says."""
    return map(straightening(camera), frames)


def straightening(camera: SiteCamera) -> Callable[[DepthFrame], DepthFrame]:
    """Return what takes the lens' distortion out of a frame of this camera.

    A frame that is no depth image of this camera is left as it is, for `health` to name.
    """
    if not camera.lens.coefficients.any():
        return lambda frame: frame
    intrinsics = camera.camera.intrinsics
    shape = (intrinsics.height, intrinsics.width)
    straight = straightener(intrinsics, camera.lens)

    def straighten(frame: DepthFrame) -> DepthFrame:
        sound = frame.depth.dtype == np.uint16 and frame.depth.shape == shape
        return straight.frame(frame) if sound else frame

    return straighten
