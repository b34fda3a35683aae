"""What the files of a path folder hold."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from noctule.camera import CameraMount, PinholeCamera
from noctule.settings import Settings


class CameraEntry(Settings):
    """The camera that took the pictures."""

    width: int = Field(ge=16, le=10000, description="[px]")
    height: int = Field(ge=16, le=10000, description="[px]")
    fx: float = Field(gt=0, le=1e5, description="[px]")
    fy: float = Field(gt=0, le=1e5, description="[px]")
    cx: float = Field(ge=-1e5, le=1e5, description="[px]")
    cy: float = Field(ge=-1e5, le=1e5, description="[px]")
    t_body_camera: tuple[float, float, float] = Field(description="place on the body, FLU [m]")
    stabilised: bool = Field(description="pictures show neither roll nor pitch")

    @property
    def intrinsics(self) -> PinholeCamera:
        """The pinhole."""
        return PinholeCamera(self.width, self.height, self.fx, self.fy, self.cx, self.cy)

    @property
    def mount(self) -> CameraMount:
        """How it sits on the body."""
        return CameraMount(np.array(self.t_body_camera), self.stabilised)


class ImageEntry(Settings):
    """One key image."""

    file: str = Field(min_length=1, max_length=200, pattern=r"^[^/\\]+$", description="in this folder")
    sha256: str = Field(pattern="^[0-9a-f]{64}$", description="of the file")
    roll_deg: float = Field(0.0, ge=-90, le=90, description="as the vehicle reported it [deg]")
    pitch_deg: float = Field(0.0, ge=-90, le=90, description="as the vehicle reported it [deg]")
    intrinsics: tuple[float, float, float, float] | None = Field(
        None, description="fx, fy, cx, cy of the camera that took it [px]"
    )


class PathFile(Settings):
    """What path.toml holds."""

    format: int = Field(description="version of this layout")
    features: str = Field("sift", description="kind of feature")
    camera: CameraEntry
    images: tuple[ImageEntry, ...] = Field(min_length=1, max_length=1000)


class PoseEntry(Settings):
    """Where a key image was really taken."""

    position: tuple[float, float, float]
    yaw_deg: float
    roll_deg: float = 0.0
    pitch_deg: float = 0.0


class TruthFile(Settings):
    """What truth.toml holds."""

    images: tuple[PoseEntry, ...]
