"""What a control law is given at a tick and what it answers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from noctule.camera import CameraMount, PinholeCamera, derotate
from noctule.estimation.odometry import OdometryPose
from noctule.geometry import Array
from noctule.messages import ColumnBox
from noctule.vision.homography import HomographyEstimate


@dataclass(frozen=True, slots=True)
class View:
    """A key image recognised in the newest picture."""

    index: int
    pose: OdometryPose  # at the picture's exposure
    estimate: HomographyEstimate  # from the key image to the levelled current camera
    p_ref: Array  # (n, 2) [px], inliers
    p_current: Array  # (n, 2) [px]
    epsilon_px: float  # mean distance (7) [px]
    fresh: bool = False  # points of a new match joined: the mean depth is another one


@dataclass(frozen=True, slots=True)
class Scene:
    """All that a law may use at a tick."""

    stamp: float  # [s]
    dt: float  # [s] since the last tick
    pose: OdometryPose  # now
    previous: Array  # (4,) last command
    views: dict[int, View]  # by index of the key image, of the newest picture
    columns: tuple[ColumnBox, ...] | None  # of the newest picture; None when there was no new one
    exposed: OdometryPose | None = None  # at the newest picture's exposure; None when there was no new one


@dataclass(frozen=True, slots=True)
class Answer:
    """A law's command and what it thought."""

    command: Array  # (4,): forward, left, up [m/s], yaw rate [rad/s]
    error: Array = field(default_factory=lambda: np.full(6, np.nan))
    activations: dict[str, float] = field(default_factory=dict)
    task_errors: dict[str, float] = field(default_factory=dict)


class Law(Protocol):
    """Turns views of key images into commands; it has no picture and no clock of its own."""

    @property
    def target(self) -> int:
        """Index of the image that is flown to."""
        ...

    @property
    def wants_next(self) -> bool:
        """Whether the following image should be looked for already."""
        ...

    @property
    def arrived(self) -> bool:
        """Whether the last image has been reached."""
        ...

    def step(self, scene: Scene) -> Answer | None:
        """Answer a scene; None when what is seen is not enough to fly on."""
        ...

    def jump(self, index: int) -> None:
        """Go on with another image than the current target: it was recognised, the target was not."""
        ...

    def pause(self, scene: Scene) -> None:
        """Take notice of a tick in which the pilot hovers instead of flying the law."""
        ...


@dataclass(frozen=True, slots=True)
class Optics:
    """The front camera on the body, and what its pictures mean once roll and pitch are taken out."""

    camera: PinholeCamera
    mount: CameraMount

    def levelled(self, p: Array, roll: float, pitch: float) -> Array:
        """Take pixels (n, 2) to normalised coordinates (n, 2) of the levelled camera."""
        m = self.camera.normalise(p)
        return m if self.mount.stabilised else derotate(m, roll, pitch)

    def edges(
        self, boxes: tuple[ColumnBox, ...], roll: float, pitch: float
    ) -> list[tuple[float | None, float | None]]:
        """Return the bearings [rad, left positive] of every column's left and right edge.

        An edge that coincides with the border of the picture is not the column's: None.
        """
        found: list[tuple[float | None, float | None]] = []
        for box in boxes:
            m = self.levelled(np.array([box.p1, box.p2]), roll, pitch)
            left, right = (-float(np.arctan(x)) for x in m[:, 0])
            cut_left, cut_right = box.p1[0] < 1.0, box.p2[0] > self.camera.width - 2.0
            found.append((None if cut_left else left, None if cut_right else right))
        return found
