"""Where a target image was taken, in metres, from its direction and the vehicle's own motion.

A homography gives the target's position t only in units of the scene's mean depth Z. The target does not
move and neither does the scene, so while the vehicle moves by a known amount the change of t tells the depth
(scale from motion). Written in the inverse depth s = 1/Z and the offset u = s (q - a) of the target q from
the place a where it was first seen, the measurement is linear, t = R' (u - s (c - a)) with c the camera's
place, so a Kalman filter converges from any depth. It finds the bias of the vehicle's own velocity on the
way and bridges ticks without a picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noctule.estimation.odometry import OdometryPose
from noctule.geometry import Array, rot_z, wrap_angle

_LEAST_INVERSE_DEPTH = 0.04  # [1/m]: no room is deeper than 25 m


@dataclass(frozen=True, slots=True)
class TargetPrior:
    """What is expected before the first measurement, and how far odometry may be trusted."""

    inverse_depth: float = 0.3  # [1/m], of the scene in the target image
    inverse_depth_sd: float = 0.15  # [1/m]: depths from 2.2 to 6.7 m are one sd away
    drift: float = 0.02  # [m / sqrt(s)], random walk of the odometry frame against the room
    bias_sd: float = 0.015  # [m/s], bias of the odometry's velocity
    bias_walk: float = 0.002  # [m/s / sqrt(s)]
    yaw_drift: float = 0.01  # [rad / sqrt(s)]
    unit_walk: float = 0.04  # [1 / sqrt(s)], relative: the mean is over the points in sight, and they go
    unit_jump: float = 0.12  # relative, when fresh points join
    t_floor: float = 0.002  # [mean depths], noise of t below which no covariance is believed
    yaw_floor: float = 0.0015  # [rad]


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """The target's camera pose in the odometry frame, with the depth that scales it."""

    stamp: float  # [s]
    anchor: Array  # (3,) [m], odometry: the camera's place at the first measurement
    x: Array  # (8,): u [mean depths], s [1/m], yaw [rad] in odometry, velocity bias (3,) [m/s] in heading
    P: Array  # (8, 8)

    @property
    def inverse_depth(self) -> float:
        """The inverse of the harmonic mean depth of the scene in the target image [1/m]."""
        return max(float(self.x[3]), _LEAST_INVERSE_DEPTH)

    @property
    def depth(self) -> float:
        """The harmonic mean depth of the scene in the target image [m]."""
        return 1.0 / self.inverse_depth

    @property
    def position(self) -> Array:
        """The target camera's position, (3,) [m], odometry frame."""
        return np.asarray(self.anchor + self.x[:3] / self.inverse_depth)

    @property
    def yaw(self) -> float:
        """The target's heading in the odometry frame [rad]."""
        return float(self.x[4])

    @property
    def velocity_bias(self) -> Array:
        """What the odometry's velocity has too much, (3,) [m/s], heading frame."""
        return self.x[5:8]


def begin_target(
    t_heading: Array,
    yaw: float,
    covariance: Array,
    pose: OdometryPose,
    lever: Array,
    prior: TargetPrior,
    inverse_depth: tuple[float, float] | None = None,
    bias: tuple[Array, Array] | None = None,
) -> TargetEstimate:
    """Start an estimate from one measurement.

    Parameters
    ----------
    t_heading
        Target camera's position seen from the current camera, (3,) [mean depths], heading frame FLU.
    yaw
        Yaw of the current camera against the target's [rad], positive when the current one is turned left.
    covariance
        (4, 4) of (yaw, t_heading).
    pose
        Odometry at the picture's exposure.
    lever
        Camera's position on the body, (3,) [m] FLU.
    prior
        Prior and noise.
    inverse_depth
        Inverse depth and its sd [1/m], when a neighbouring image has already told it.
    bias
        Velocity bias (3,) and its covariance (3, 3), when a neighbouring image has already told it.
    """
    s, s_sd = (prior.inverse_depth, prior.inverse_depth_sd) if inverse_depth is None else inverse_depth
    b, P_b = (np.zeros(3), prior.bias_sd**2 * np.eye(3)) if bias is None else bias
    R = pose.R_odom_heading
    C = _noise(covariance, prior)
    P = np.zeros((8, 8))
    P[:3, :3] = R @ C[1:, 1:] @ R.T
    P[3, 3] = s_sd**2
    P[4, 4] = C[0, 0]
    P[5:, 5:] = P_b
    x = np.array([*(R @ t_heading), s, wrap_angle(pose.yaw - yaw), *b])
    return TargetEstimate(pose.stamp, pose.position + R @ lever, x, P)


def _noise(covariance: Array, prior: TargetPrior) -> Array:
    """Return the (4, 4) covariance of (yaw, t) with its floor: neighbouring ticks share their errors."""
    return covariance + np.diag([prior.yaw_floor**2, *[prior.t_floor**2] * 3])


def _predicted(
    estimate: TargetEstimate, pose: OdometryPose, prior: TargetPrior, fresh: bool
) -> tuple[Array, Array]:
    """Return state (8,) and covariance (8, 8) at `pose`.

    The odometry counts a bias b too much, so in its frame what stands still moves by R b dt, and u by
    s R b dt. A change of unit by (1 + e) multiplies u and s alike and moves nothing.
    """
    dt = max(pose.stamp - estimate.stamp, 0.0)
    R, s, b = pose.R_odom_heading, estimate.x[3], estimate.x[5:8]
    F = np.eye(8)
    F[:3, 3] = R @ b * dt
    F[:3, 5:] = s * R * dt
    x = estimate.x.copy()
    x[:3] += s * (R @ b) * dt
    unit = np.append(x[:4], np.zeros(4))
    walk = [*[(s * prior.drift) ** 2] * 3, 0.0, prior.yaw_drift**2, *[prior.bias_walk**2] * 3]
    relative = prior.unit_walk**2 * dt + (prior.unit_jump**2 if fresh else 0.0)
    return x, F @ estimate.P @ F.T + np.diag(walk) * dt + relative * np.outer(unit, unit)


def update_target(
    estimate: TargetEstimate,
    t_heading: Array,
    yaw: float,
    covariance: Array,
    pose: OdometryPose,
    lever: Array,
    prior: TargetPrior,
    fresh: bool = False,
    gate: float = 25.0,
) -> tuple[TargetEstimate, bool]:
    """Predict to the picture's exposure and update with one measurement (see `begin_target`).

    Measurement: t = R' (u - s (c - a)) and yaw = yaw_odom - yaw_target. The unit of t is the mean depth of
    the points in sight, so it changes with them, the more when `fresh` points have joined. Returns the new
    estimate and whether the measurement passed the chi-square gate (4 degrees of freedom); outside it only
    the prediction is kept.
    """
    x, P = _predicted(estimate, pose, prior, fresh)
    R = pose.R_odom_heading
    moved = pose.position + R @ lever - estimate.anchor
    H = np.zeros((4, 8))
    H[0, 4] = -1.0
    H[1:, :3] = R.T
    H[1:, 3] = -R.T @ moved
    expected = H[1:, :4] @ x[:4]
    residual = np.append(wrap_angle(yaw - wrap_angle(pose.yaw - float(x[4]))), t_heading - expected)
    noise = _noise(covariance, prior)
    S = H @ P @ H.T + noise
    gain = np.linalg.solve(S, H @ P).T  # (8, 4)
    if residual @ np.linalg.solve(S, residual) > gate:
        return TargetEstimate(pose.stamp, estimate.anchor, x, P), False
    x = x + gain @ residual
    x[4] = wrap_angle(float(x[4]))
    # Joseph form: stays symmetric and positive when the measurement is far better than the prediction.
    A = np.eye(8) - gain @ H
    P = A @ P @ A.T + gain @ noise @ gain.T
    return TargetEstimate(pose.stamp, estimate.anchor, x, P), True


def target_in_heading(estimate: TargetEstimate, pose: OdometryPose, lever: Array) -> tuple[Array, float]:
    """Return where the *body* has to go, (3,) [m] in the heading frame, and the turn left to make [rad].

    The camera sits ahead of the centre, so while the headings differ camera and body have different ways
    to go; this is the lever arm of eq. (5).
    """
    target_body = estimate.position - rot_z(estimate.yaw) @ lever
    return pose.R_odom_heading.T @ (target_body - pose.position), wrap_angle(estimate.yaw - pose.yaw)
