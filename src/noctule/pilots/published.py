"""The law `published`: Algorithm 1 of Toro-Arcila et al. with its errata mended, the baseline of comparisons.

Generic homography, the error (2) as printed, adaptive gain (4), tasks (8) to (12) in the exact hierarchy in
four degrees of freedom, activation (20) with a clock of its own for each task, blending at switches, and the
change to the next image when the mean distance (7) falls below a threshold. Algorithm 2 is the same without
columns: with feed-forward (31), (32) it adds the velocity that the segment itself asks for.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from noctule.control.activation import Activation, FadingTask
from noctule.control.gains import AdaptiveGain, gain_vector
from noctule.control.hierarchy import solve_hierarchy
from noctule.control.limiter import limit_command
from noctule.control.servoing import body_velocity, camera_twist, camera_twist_matrix, homography_error
from noctule.control.tasks import CollisionAvoidance, Task, Visibility
from noctule.control.transition import Transition
from noctule.geometry import Array
from noctule.messages import ColumnBox, Limits
from noctule.pilots.law import Answer, Optics, Scene, View
from noctule.pilots.perception import safety_box
from noctule.pilots.settings import PilotSettings, PublishedGains
from noctule.vision.triangle import largest_triangle

_RISES = 5  # ticks of rising error after which an image counts as passed
_COAST = 0.3  # [s] without a view of the target during which the last command is held


def published_velocity(H: Array, m_ref: Array, optics: Optics, gains: PublishedGains) -> tuple[Array, Array]:
    """Return the error (2), (6,), and the body velocity (4,) that brings it to zero: (3) to (6).

    `H` (3, 3) takes the key image to the current one, `m_ref` (2,) is a point of its plane in the key image.
    """
    error = homography_error(H, m_ref)
    gain = AdaptiveGain(gains.lambda_0, gains.lambda_inf, gains.lambda_slope)(error)
    nu_c = camera_twist(error, gain_vector(gain, gains.lambda_lateral_extra, gains.lambda_yaw_ratio))
    return error, body_velocity(nu_c, optics.mount.t_body_camera)


@dataclass(slots=True)
class PublishedLaw:
    """Algorithm 1."""

    settings: PilotSettings
    limits: Limits
    optics: Optics
    last: int  # index of the last image
    segments: tuple[Array, ...] = ()  # velocities (4,) of the segments to images 1, 2, ...
    k: int = 0
    avoidance: FadingTask = field(init=False)
    visibility: FadingTask = field(init=False)
    transition: Transition | None = None
    _arrived: bool = False
    _epsilon: float = float("inf")
    _seen: float = -np.inf
    _rises: int = 0  # ticks in a row in which the mean distance rose
    _errors: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Start with both tasks off."""
        self.avoidance = FadingTask(Activation(self.settings.published.activation_s))
        self.visibility = FadingTask(Activation(self.settings.published.activation_s))

    @property
    def target(self) -> int:
        """Index of the image that is flown to."""
        return self.k

    @property
    def arrived(self) -> bool:
        """Whether the mean distance to the last image fell below its threshold."""
        return self._arrived

    @property
    def wants_next(self) -> bool:
        """Whether the following image should be looked for already."""
        return self._epsilon < 3.0 * self.settings.published.epsilon_intermediate_px

    def pause(self, scene: Scene) -> None:
        """Begin again from the command that hovering left."""
        self.transition = None

    def jump(self, index: int) -> None:
        """Go on with another image."""
        self.k, self.transition, self._rises = index, None, 0

    def step(self, scene: Scene) -> Answer | None:
        """Answer a scene; None when the target has not been in sight for too long."""
        view = scene.views.get(self.k)
        if view is None:
            # A tick without a picture holds the command; more of them are the pilot's business.
            if scene.stamp - self._seen <= _COAST + self.settings.picture_latency_s:
                return Answer(scene.previous.copy())
            self.transition = None  # the hover that follows leaves no command worth blending from
            return None
        self._seen = view.pose.stamp
        view = self._change_image(view, scene)
        error, bottom = self._servo(view)
        self._avoid(scene)
        self._keep_visible(view, scene)
        nu = solve_hierarchy([*self.avoidance.rows, *self.visibility.rows], bottom)
        if self.transition is not None:
            self.transition = self.transition.step(scene.dt)
            nu = self.transition.blend(nu)
        command = limit_command(nu, scene.previous, self.limits, scene.dt)
        activations = {
            "avoidance": self.avoidance.activation.h,
            "visibility": self.visibility.activation.h,
            "transition": 1.0 if self.transition is None else self.transition.h,
        }
        return Answer(command, error, activations, dict(self._errors))

    def _change_image(self, view: View, scene: Scene) -> View:
        """Switch to the next image below the threshold, when it is in sight; end at the last one."""
        gains = self.settings.published
        # While a column is being passed the error rises for a reason: that must not skip an image.
        avoiding = self.avoidance.activation.h > 0.0
        rose = view.epsilon_px > self._epsilon and not avoiding
        self._rises = self._rises + 1 if rose else 0
        self._epsilon = view.epsilon_px
        if self.k == self.last:
            self._arrived = view.epsilon_px < gains.epsilon_last_px
            return view
        following = scene.views.get(self.k + 1)
        rising = gains.feed_forward is not None and gains.change_on_rise and self._rises >= _RISES
        passed = view.epsilon_px < gains.epsilon_intermediate_px or rising
        if not passed or following is None:
            return view
        self.k += 1
        self._rises = 0
        self.transition = Transition(scene.previous.copy(), gains.transition_s, gains.h_0)
        self._epsilon = following.epsilon_px
        return following

    def _servo(self, view: View) -> tuple[Array, Array]:
        """Return the error (2), (6,), and the body velocity (4,) that brings it to zero: (3) to (6)."""
        corners = largest_triangle(view.p_ref)
        m_ref = self.optics.camera.normalise(view.p_ref[list(corners)]).mean(axis=0)
        error, nu = published_velocity(view.estimate.H, m_ref, self.optics, self.settings.published)
        return error, self._with_feed_forward(nu)

    def _with_feed_forward(self, nu: Array) -> Array:
        """Return (31): p nu_e + (1 - p) nu_p.

        Corrected: Algorithm 2 leads by one segment and has no row for the last image. Heading to image k the
        velocity of the segment from k - 1 to k is used, and none on the last image, where the flight would
        never end.
        """
        gains = self.settings.published
        if gains.feed_forward is None or self.k in (0, self.last):
            return nu
        p = gains.feed_forward_weight
        return np.asarray(p * nu + (1.0 - p) * gains.feed_forward * self.segments[self.k - 1])

    def _rows(self, task: Task) -> tuple[Array, Array]:
        J = task.jacobian() @ camera_twist_matrix(self.optics.mount.t_body_camera)
        return J, task.demand

    def _avoid(self, scene: Scene) -> None:
        """Serve (8) and (9) for the widest column while it is wider than sigma."""
        gains = self.settings.published
        if scene.columns is None:
            return
        tasks = [
            CollisionAvoidance(
                gain=gains.lambda_avoid,
                m1=self.optics.camera.normalise(box.p1[None])[0],
                m2=self.optics.camera.normalise(box.p2[None])[0],
                z1=gains.column_distance,
                z2=gains.column_distance,
                sigma=gains.sigma,
            )
            for box in scene.columns
            if _whole(box, self.optics.camera.width)
        ]
        widest = max(tasks, key=lambda task: task.width, default=None)
        wanted = widest is not None and widest.width > gains.sigma
        self._errors["avoidance"] = 0.0 if widest is None else widest.width - gains.sigma
        self.avoidance = self.avoidance.step(self._rows(widest) if wanted and widest else None, scene.dt)

    def _keep_visible(self, view: View, scene: Scene) -> None:
        """Serve (10) to (12) while a point is outside the safety box."""
        gains = self.settings.published
        box = safety_box(self.optics.camera.width, self.optics.camera.height)
        task = Visibility(
            gain=gains.lambda_visibility,
            points=self.optics.camera.normalise(view.p_current),
            centroid_ref=self.optics.camera.normalise(view.p_ref).mean(axis=0),
            depth=gains.scene_distance,
        )
        self._errors["visibility"] = float(np.linalg.norm(task.error()))
        outside = not box.contains(view.p_current).all()
        self.visibility = self.visibility.step(self._rows(task) if outside else None, scene.dt)


def _whole(box: ColumnBox, width: int) -> bool:
    """Return whether both edges are in the picture: (8) needs them both."""
    return bool(box.p1[0] >= 1.0 and box.p2[0] <= width - 2.0)
