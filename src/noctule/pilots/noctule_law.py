"""The law `noctule` on views of key images: progress, detours, and features kept in sight."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from noctule.control.activation import Activation, FadingTask
from noctule.control.hierarchy import TaskRows
from noctule.control.servoing import camera_twist_matrix, upright_error
from noctule.control.tasks import Visibility
from noctule.geometry import Array
from noctule.messages import Limits
from noctule.pilots.law import Answer, Optics, Scene, View
from noctule.pilots.perception import safety_box
from noctule.pilots.progress import LinkGeometry, ProgressLaw, Sighting
from noctule.pilots.settings import PilotSettings

_LOOK_AHEAD = 0.9  # [m]: nearer than this to an image, the next one is looked for
_COAST = 0.3  # [s] without a view of the target that are bridged by odometry
_VISIBILITY_GAIN = 1.0  # [1/s]
_VISIBILITY_FADE = 0.5  # [s]

# (yaw, t) of a camera (RDF) as (yaw, t) in the heading frame (FLU).
_HEADING_FROM_CAMERA = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]]
)


def sighting_of(view: View) -> Sighting:
    """Return a view's position and heading in the heading frame."""
    e = view.estimate
    x = _HEADING_FROM_CAMERA @ np.append(e.yaw, e.t)
    covariance = _HEADING_FROM_CAMERA @ e.covariance @ _HEADING_FROM_CAMERA.T
    return Sighting(view.index, view.pose, x[1:], float(x[0]), covariance, view.fresh)


@dataclass(slots=True)
class NoctuleLaw:
    """Flight by progress (servoing.md, "Visual path") with the improved avoidance."""

    settings: PilotSettings
    limits: Limits
    optics: Optics
    links: tuple[LinkGeometry, ...]
    progress: ProgressLaw = field(init=False)
    visibility: FadingTask = field(init=False)
    _seen: float = -np.inf  # [s], exposure of the last picture with the target in it
    _visibility_error: float = float("nan")

    def __post_init__(self) -> None:
        """Set up the parts."""
        self.progress = ProgressLaw(self.settings, self.limits, self.optics.mount.t_body_camera, self.links)
        self.visibility = FadingTask(Activation(_VISIBILITY_FADE))

    @property
    def target(self) -> int:
        """Index of the image that is flown to."""
        return self.progress.k

    @property
    def arrived(self) -> bool:
        """Whether the last image has been reached."""
        return self.progress.arrived

    @property
    def wants_next(self) -> bool:
        """Whether the following image should be looked for already."""
        return self.progress.remaining < _LOOK_AHEAD

    def jump(self, index: int) -> None:
        """Go on with another image."""
        self.progress.jump(index)

    def pause(self, scene: Scene) -> None:
        """Go on dead-reckoning while the pilot hovers."""
        self._observe(scene)

    def _observe(self, scene: Scene) -> None:
        pose = scene.exposed
        if pose is not None:
            self.progress.move(pose)
        for view in scene.views.values():
            if self.progress.sight(sighting_of(view)) and view.index == self.target:
                self._seen = view.pose.stamp
        if scene.columns is not None and pose is not None:
            self.progress.detour.see(self.optics.edges(scene.columns, pose.roll, pose.pitch))

    def step(self, scene: Scene) -> Answer | None:
        """Answer a scene; None when the target has not been in sight for too long."""
        self._observe(scene)
        if (
            self.target not in self.progress.targets
            or scene.stamp - self._seen > _COAST + self.settings.picture_latency_s
        ):
            return None
        view = scene.views.get(self.target)
        task = self._visibility_rows(view, scene)
        command = self.progress.step(scene.pose, scene.previous, scene.dt, task)
        error = np.full(6, np.nan) if view is None else upright_error(view.estimate.t, view.estimate.yaw)
        return Answer(
            command,
            error,
            {
                "avoidance": self.progress.detour.activation.h,
                "visibility": self.visibility.activation.h,
            },
            {"visibility": self._visibility_error},
        )

    def _visibility_rows(self, view: View | None, scene: Scene) -> tuple[TaskRows, ...]:
        """Keep points in the safety box, towards where the same points are in the key image."""
        rows = None
        if view is not None:
            box = safety_box(self.optics.camera.width, self.optics.camera.height)
            if not box.contains(view.p_current).all():
                task = self._visibility_task(view)
                self._visibility_error = float(np.linalg.norm(task.error()))
                J = task.jacobian() @ camera_twist_matrix(self.optics.mount.t_body_camera)
                rows = (J, task.demand)
            self.visibility = self.visibility.step(rows, scene.dt)
        return self.visibility.rows

    def _visibility_task(self, view: View) -> Visibility:
        points: Array = self.optics.camera.normalise(view.p_current)
        centroid_ref = self.optics.camera.normalise(view.p_ref).mean(axis=0)
        depth = self.progress.targets[view.index].depth
        return Visibility(gain=_VISIBILITY_GAIN, points=points, centroid_ref=centroid_ref, depth=depth)
