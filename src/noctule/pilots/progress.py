"""The law `noctule`: flight by progress through the target images, with detours around columns.

It works on sightings (target image k is there, seen from here) and edges of columns; where those come from,
pictures or a test's geometry, is not its business.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from noctule.control.hierarchy import TaskRows, solve_hierarchy
from noctule.control.limiter import limit_command
from noctule.estimation.odometry import OdometryPose
from noctule.estimation.target import (
    TargetEstimate,
    TargetPrior,
    begin_target,
    target_in_heading,
    update_target,
)
from noctule.geometry import Array, rot_z, wrap_angle
from noctule.messages import Limits
from noctule.pilots.detour import J_DETOUR, STILL, Detour, Motion
from noctule.pilots.guidance import Segment, cruise_velocity, stop_velocity, unit, yaw_rate
from noctule.pilots.settings import PilotSettings


@dataclass(frozen=True, slots=True)
class Sighting:
    """One target image seen from the current camera."""

    index: int
    pose: OdometryPose  # at the picture's exposure
    t_heading: Array  # (3,) [mean depths] to the target camera, heading frame FLU
    yaw: float  # [rad] of the current camera against the target's, positive when turned left
    covariance: Array  # (4, 4) of (yaw, t_heading)
    fresh: bool = False  # points of a new match joined


@dataclass(frozen=True, slots=True)
class LinkGeometry:
    """How image k + 1 lies from image k, from their shared points alone."""

    t_heading: Array  # (3,) [mean depths of image k + 1], in image k's heading frame
    depth_ratio: float  # mean depth of image k + 1 over that of image k


@dataclass(slots=True)
class ProgressLaw:
    """Keeps the targets in the odometry frame and answers with a command."""

    settings: PilotSettings
    limits: Limits
    lever: Array  # (3,) [m], camera on the body, FLU
    links: tuple[LinkGeometry, ...]
    prior: TargetPrior = field(default_factory=TargetPrior)
    k: int = 0
    targets: dict[int, TargetEstimate] = field(default_factory=dict)
    rejected: dict[int, int] = field(default_factory=dict)  # sightings in a row outside the gate
    origin: Array | None = None  # (3,) [m] odometry, where the current segment began
    remaining: float = np.inf  # [m] along the segment to the target image
    held: float = 0.0  # [s] within the arrival tolerance
    off: Array | None = None  # (4,) mean of the last half second: way [m] and turn [rad] to the last image
    stops: set[int] = field(init=False)  # images still to hover at
    detour: Detour = field(init=False)
    _exposed: OdometryPose | None = None  # where the newest picture was taken

    def __post_init__(self) -> None:
        """Set up the detour."""
        self.stops = set(self.settings.hover_at)
        self.detour = Detour(
            self.settings.detour, self.settings.body_radius, float(self.lever[0]), self._answers_after
        )

    @property
    def _answers_after(self) -> float:
        """How long the vehicle goes on as it goes now [s]: its lag, and what a command takes to arrive."""
        return self.settings.vehicle_lag + self.settings.command_latency_s

    @property
    def last(self) -> int:
        """Index of the last image."""
        return len(self.links)

    def sight(self, sighting: Sighting) -> bool:
        """Take a sighting; returns whether it agreed with what was known."""
        i = sighting.index
        known = self.targets.get(i)
        measured = (sighting.t_heading, sighting.yaw, sighting.covariance, sighting.pose, self.lever)
        if known is not None:
            self.targets[i], agreed = update_target(known, *measured, self.prior, sighting.fresh)
            self.rejected[i] = 0 if agreed else self.rejected.get(i, 0) + 1
            # The way back: what disagrees for a third of a second is the truth, and what was known is not.
            if self.rejected[i] < 10:
                return agreed
        expected, bias = self._expected_inverse_depth(i), self._known_bias()
        self.targets[i] = begin_target(*measured, self.prior, expected, bias)
        self.rejected[i] = 0
        return known is None

    def _expected_inverse_depth(self, i: int) -> tuple[float, float] | None:
        """Return the inverse depth [1/m] to expect for image i and its sd, from what is known, or None."""
        same, before = self.targets.get(i), self.targets.get(i - 1)
        if same is not None:
            s = same.inverse_depth
            return s, max(0.2 * s, float(np.sqrt(same.P[3, 3])))
        if before is not None:
            ratio = self.links[i - 1].depth_ratio
            s = before.inverse_depth / ratio
            return s, float(np.hypot(0.15 * s, np.sqrt(before.P[3, 3]) / ratio))
        return None

    def jump(self, index: int) -> None:
        """Fly to image `index` next, straight from where the vehicle is."""
        self.k, self.origin, self.off, self.held = index, None, None, 0.0

    def _known_bias(self) -> tuple[Array, Array] | None:
        current = self.targets.get(self.k)
        return None if current is None else (current.velocity_bias, current.P[5:, 5:])

    def move(self, pose: OdometryPose) -> None:
        """Dead-reckon the columns to `pose`, where the newest picture was taken."""
        if self._exposed is not None:
            motion = self._motion(self._exposed, pose)
            self.detour.move(motion.step, motion.turn, motion.dt)
        self._exposed = pose

    def _motion(self, old: OdometryPose, new: OdometryPose) -> Motion:
        """Return the motion between two poses of the odometry, without the bias of its velocity."""
        dt = new.stamp - old.stamp
        step = old.R_odom_heading.T @ (new.position - old.position) - self._bias() * dt
        return Motion(step[:2], wrap_angle(new.yaw - old.yaw), dt)

    def _bias(self) -> Array:
        current = self.targets.get(self.k)
        return np.zeros(3) if current is None else current.velocity_bias

    def segment(self, pose: OdometryPose) -> Segment:
        """Return the current segment seen from `pose`."""
        target = self.targets[self.k]
        to_target, turn = target_in_heading(target, pose, self.lever)
        if self.origin is None:
            self.origin = pose.position
        here = pose.R_odom_heading.T
        begin = here @ (self.origin - pose.position)
        direction = to_target - begin
        # Too short to have a direction: the image is where the segment began.
        direction = unit(direction) if np.linalg.norm(direction) > 0.1 else unit(to_target)
        return Segment(to_target, turn, direction, self._next_direction(pose), pose.v_heading - self._bias())

    def _next_direction(self, pose: OdometryPose) -> Array | None:
        if self.k >= self.last:
            return None
        ahead = self.targets.get(self.k + 1)
        if ahead is not None:
            way = ahead.position - self.targets[self.k].position
        else:
            way = rot_z(self.targets[self.k].yaw) @ self.links[self.k].t_heading
        return unit(pose.R_odom_heading.T @ way)

    def step(
        self, pose: OdometryPose, previous: Array, dt: float, others: tuple[TaskRows, ...] = ()
    ) -> Array:
        """Return the command (4,) at `pose`; `others` are tasks between the detour and the servoing.

        At a new picture call `move`, `sight` for every sighting, and `detour.see` before.
        """
        segment = self.segment(pose)
        while not self._to_stop() and self._passed(segment) and self._next_known(pose):
            self.origin = self._body_position(self.targets[self.k])
            self.k, self.off, self.held = self.k + 1, None, 0.0
            segment = self.segment(pose)
        self.remaining = segment.along
        stopping = self._to_stop() or self._passed(segment)
        gains = self.settings.progress
        if stopping:
            v = stop_velocity(segment, gains, self.limits, self._answers_after)
        else:
            v = cruise_velocity(segment, gains)
        goal = segment.to_target[:2] if stopping else None
        since = STILL if self._exposed is None else self._motion(self._exposed, pose)
        demand, h = self.detour.steer(v[:2], segment.v[:2], goal, dt, since)
        bottom = np.append(v, yaw_rate(segment.turn, gains, self.limits))
        tasks = [TaskRows(J_DETOUR, demand, h), *others]
        self._check_arrival(segment, dt)
        return limit_command(solve_hierarchy(tasks, bottom), previous, self.limits, dt)

    def _to_stop(self) -> bool:
        """Return whether the current image is one to stop at."""
        return self.k == self.last or self.k in self.stops

    def _passed(self, segment: Segment) -> bool:
        return segment.along < self.settings.progress.switch_ahead

    def _next_known(self, pose: OdometryPose) -> bool:
        ahead = self.targets.get(self.k + 1)
        return ahead is not None and pose.stamp - ahead.stamp < 0.5 + self.settings.picture_latency_s

    def _body_position(self, target: TargetEstimate) -> Array:
        return np.asarray(target.position - rot_z(target.yaw) @ self.lever)

    def _check_arrival(self, segment: Segment, dt: float) -> None:
        """Judge by the mean of the last half second, so that gusts neither make nor spoil an arrival."""
        gains = self.settings.progress
        now = np.append(segment.to_target, segment.turn)
        if not self._to_stop():
            return
        self.off = now if self.off is None else self.off + min(dt / 0.5, 1.0) * (now - self.off)
        near = (
            float(np.linalg.norm(self.off[:3])) < gains.arrive_m
            and abs(float(self.off[3])) < np.radians(gains.arrive_deg)
            and float(np.linalg.norm(now[:3])) < 2.0 * gains.arrive_m
            and float(np.linalg.norm(segment.v)) < 0.1
        )
        # Once it hovers, a gust does not make it begin again: only the arrival itself has to be in a row.
        self.held = self.held + dt if near or self.held > gains.arrive_hold_s else 0.0
        if self.k < self.last and self.held > gains.arrive_hold_s + self.settings.hover_s:
            self.stops.discard(self.k)

    @property
    def arrived(self) -> bool:
        """Whether the last image's place has been held long enough."""
        return self.k == self.last and self.held > self.settings.progress.arrive_hold_s
