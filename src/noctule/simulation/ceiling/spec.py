"""What a simulated depth camera on the ceiling is made of: the settings."""

from __future__ import annotations

import math
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from noctule.camera import CEILING_CAMERA, FixedCamera, PinholeCamera
from noctule.geometry import Array, rot_x, rot_y, rot_z
from noctule.settings import Settings

R_LEVEL_CAMERA: Array = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Takes RDF coordinates of a camera that looks straight down, the top of its picture ahead, to FLU."""
R_LEVEL_CAMERA.setflags(write=False)


def _mounting(R_world_camera: Array) -> tuple[float, float, float]:
    """Return (yaw, pitch, roll) [deg] with R_world_camera = R_z R_y R_x R_LEVEL_CAMERA."""
    R = R_world_camera @ R_LEVEL_CAMERA.T
    yaw = math.atan2(R[1, 0], R[0, 0])
    pitch = math.atan2(-R[2, 0], math.hypot(R[2, 1], R[2, 2]))
    return math.degrees(yaw), math.degrees(pitch), math.degrees(math.atan2(R[2, 1], R[2, 2]))


_PINHOLE = CEILING_CAMERA.intrinsics
_X, _Y, _Z = (float(v) for v in CEILING_CAMERA.t_world_camera)
_YAW, _PITCH, _ROLL = _mounting(CEILING_CAMERA.R_world_camera)


_MOVES = ("yaw_deg", "pitch_deg", "roll_deg", "x_m", "y_m", "z_m")


class DepthSensorSpec(Settings):
    """The errors of a structured-light depth camera (Xtion, first Kinect).

    The step is that of a disparity in eighths of a pixel, 1 / (8 x 580 px x 0.075 m); with the noise the
    spread comes to 1.4 mm at 1 m, growing with depth squared, as measured by Khoshelham and Elberink (2012).
    The sideways spread is that of Nguyen, Izadi and Lovell (2012).
    """

    baseline_m: float = Field(0.075, ge=0.0, le=1.0, description="the projector is this far to the right [m]")
    step_mm: float = Field(2.87, gt=0.0, le=100.0, description="depth step at 1 m; grows with depth squared")
    noise_steps: float = Field(0.4, ge=0.0, le=10.0, description="sd of the disparity [steps]")
    sideways_px: float = Field(0.7, ge=0.0, le=3.0, description="sd by which an edge is displaced [px]")
    edge_px: float = Field(2.0, gt=0.0, le=100.0, description="disparity jump that makes holes [px]")
    edge_holes: float = Field(0.35, ge=0.0, le=1.0, description="share of pixels at a jump with no depth")
    dropouts: float = Field(0.001, ge=0.0, le=1.0, description="share of pixels with no depth anywhere")
    colour_noise: float = Field(2.0, ge=0.0, le=50.0, description="sd of a colour pixel [grey levels]")
    least_echo: float = Field(
        0.008, ge=0.0, le=1.0, description="reflectance x cosine / (depth [m])^2 at which half is lost"
    )


class BumpSpec(Settings):
    """Somebody bumps the camera, which hangs another way from then on; nobody calibrates it again."""

    time_s: float = Field(ge=0.0, le=36000.0, description="when, on the flight's clock [s]")
    yaw_deg: float = Field(0.0, ge=-90.0, le=90.0, description="by which it is turned [deg]")
    pitch_deg: float = Field(0.0, ge=-90.0, le=90.0, description="by which it is tilted [deg]")
    roll_deg: float = Field(0.0, ge=-90.0, le=90.0, description="by which it is tilted [deg]")
    x_m: float = Field(0.0, ge=-5.0, le=5.0, description="by which it is moved, world [m]")
    y_m: float = Field(0.0, ge=-5.0, le=5.0, description="by which it is moved, world [m]")
    z_m: float = Field(0.0, ge=-5.0, le=5.0, description="by which it is moved, world [m]")


class CeilingSpec(Settings):
    """A depth camera on the ceiling, and what the vehicle wears; the defaults are Table 2's."""

    width_px: int = Field(_PINHOLE.width, ge=16, le=1920, description="[px]")
    height_px: int = Field(_PINHOLE.height, ge=16, le=1200, description="[px]")
    fx_px: float = Field(_PINHOLE.fx, ge=10.0, le=10000.0, description="focal length [px]")
    fy_px: float = Field(_PINHOLE.fy, ge=10.0, le=10000.0, description="focal length [px]")
    cx_px: float = Field(_PINHOLE.cx, ge=-2000.0, le=4000.0, description="principal point [px]")
    cy_px: float = Field(_PINHOLE.cy, ge=-2000.0, le=4000.0, description="principal point [px]")
    x_m: float = Field(_X, ge=-100.0, le=100.0, description="where it hangs, world [m]")
    y_m: float = Field(_Y, ge=-100.0, le=100.0, description="where it hangs, world [m]")
    z_m: float = Field(_Z, ge=0.1, le=20.0, description="above the floor [m]")
    yaw_deg: float = Field(_YAW, ge=-360.0, le=360.0, description="heading of the picture's top [deg]")
    pitch_deg: float = Field(
        _PITCH, ge=-90.0, le=90.0, description="away from straight down; positive looks behind [deg]"
    )
    roll_deg: float = Field(
        _ROLL, ge=-90.0, le=90.0, description="away from straight down; positive looks to the left [deg]"
    )
    rate_hz: float = Field(30.0, ge=1.0, le=120.0, description="frames a second")
    latency_s: float = Field(0.04, ge=0.0, le=2.0, description="from exposure to delivery [s]")
    nearest_m: float = Field(0.5, ge=0.05, le=10.0, description="nothing nearer has a depth [m]")
    farthest_m: float = Field(8.0, ge=0.5, le=60.0, description="nothing beyond has a depth [m]")
    sensor: DepthSensorSpec = DepthSensorSpec()
    hull: bool = Field(False, description="the vehicle wears its indoor hull")
    colour: bool = Field(False, description="frames carry a colour picture")
    markers: bool = Field(False, description="a red marker in front and a blue one behind, on its top")
    bump: BumpSpec | None = Field(None, description="it is moved in the flight")

    @model_validator(mode="after")
    def _some_range(self) -> Self:
        if self.nearest_m >= self.farthest_m:
            raise ValueError(
                f"nearest_m is {self.nearest_m:g} and farthest_m is {self.farthest_m:g}; expected nearest_m "
                "below farthest_m"
            )
        return self

    @property
    def camera(self) -> FixedCamera:
        """Intrinsics and mounting."""
        pinhole = PinholeCamera(self.width_px, self.height_px, self.fx_px, self.fy_px, self.cx_px, self.cy_px)
        yaw, pitch, roll = (math.radians(a) for a in (self.yaw_deg, self.pitch_deg, self.roll_deg))
        R_world_camera = rot_z(yaw) @ rot_y(pitch) @ rot_x(roll) @ R_LEVEL_CAMERA
        return FixedCamera(pinhole, R_world_camera, np.array([self.x_m, self.y_m, self.z_m]))

    def at(self, stamp: float) -> CeilingSpec:
        """Return how it hangs at `stamp` [s, the flight's clock]; `camera` is how it was calibrated."""
        bump = self.bump
        if bump is None or stamp < bump.time_s:
            return self
        moved = {name: getattr(self, name) + getattr(bump, name) for name in _MOVES}
        return self.model_copy(update=moved)
