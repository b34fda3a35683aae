"""Where a target image was taken, in metres, from its direction and the vehicle's own motion.

A homography gives the target's position t only in units of the scene's mean depth. The target does not move
and neither does the scene, so while the vehicle moves by a known amount the change of t tells the depth
(scale from motion). An extended Kalman filter does both at once, finds the bias of the vehicle's own
velocity on the way, and bridges the ticks without a picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noctule.estimation.odometry import OdometryPose
from noctule.geometry import Array, wrap_angle


@dataclass(frozen=True, slots=True)
class TargetPrior:
    """What is expected before the first measurement, and how far odometry may be trusted."""

    depth: float = 3.0  # [m], harmonic mean depth of the scene in the target image
    depth_log_sd: float = 0.6  # sd of log(depth): a factor of 1.8 either way
    drift: float = 0.02  # [m / sqrt(s)], random walk of the odometry frame against the room
    bias_sd: float = 0.015  # [m/s], bias of the odometry's velocity
    bias_walk: float = 0.002  # [m/s / sqrt(s)]
    yaw_drift: float = 0.01  # [rad / sqrt(s)]
    depth_walk: float = (
        0.04  # [1 / sqrt(s)], of log(depth): the mean is over the points in sight, and they go
    )
    depth_jump: float = 0.12  # of log(depth), when fresh points join
    t_floor: float = 0.002  # [mean depths], noise of t below which no covariance is believed
    yaw_floor: float = 0.0015  # [rad]


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """The target's camera pose in the odometry frame, with the depth that scales it."""

    stamp: float  # [s]
    x: Array  # (8,): position [m] and yaw (at 4) [rad] in odometry, log(depth / 1 m) (at 3), bias (5 to 7)
    P: Array  # (8, 8)

    @property
    def position(self) -> Array:
        """The target camera's position, (3,) [m], odometry frame."""
        return self.x[:3]

    @property
    def depth(self) -> float:
        """The harmonic mean depth of the scene in the target image [m]."""
        return float(np.exp(self.x[3]))

    @property
    def yaw(self) -> float:
        """The target's heading in the odometry frame [rad]."""
        return float(self.x[4])

    @property
    def velocity_bias(self) -> Array:
        """What the odometry's velocity has too much, (3,) [m/s], heading frame."""
        return self.x[5:8]


def _measured(t_heading: Array, yaw: float, camera: Array, pose: OdometryPose, depth: float) -> Array:
    """Return target position and yaw in odometry, (4,), that one measurement alone would give."""
    position = camera + pose.R_odom_heading @ t_heading * depth
    return np.append(position, wrap_angle(pose.yaw - yaw))


def begin_target(
    t_heading: Array,
    yaw: float,
    covariance: Array,
    pose: OdometryPose,
    lever: Array,
    prior: TargetPrior,
    depth: float | None = None,
    depth_log_sd: float | None = None,
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
    depth, depth_log_sd
        Replace the prior's depth, when a neighbouring image has already told it.
    bias
        Velocity bias (3,) and its covariance (3, 3), when a neighbouring image has already told it.
    """
    depth = prior.depth if depth is None else depth
    log_sd = prior.depth_log_sd if depth_log_sd is None else depth_log_sd
    R = pose.R_odom_heading
    camera = pose.position + R @ lever
    measured = _measured(t_heading, yaw, camera, pose, depth)
    b, P_b = (np.zeros(3), prior.bias_sd**2 * np.eye(3)) if bias is None else bias
    x = np.array([*measured[:3], np.log(depth), measured[3], *b])
    P = np.zeros((8, 8))
    ray = R @ t_heading * depth
    C = _noise(covariance, prior)
    P[:3, :3] = depth**2 * R @ C[1:, 1:] @ R.T + np.outer(ray, ray) * log_sd**2
    P[:3, 3] = P[3, :3] = ray * log_sd**2
    P[3, 3] = log_sd**2
    P[4, 4] = C[0, 0]
    P[5:, 5:] = P_b
    return TargetEstimate(pose.stamp, x, P)


def _noise(covariance: Array, prior: TargetPrior) -> Array:
    """Return the (4, 4) covariance of (yaw, t) with its floor: neighbouring ticks share their errors."""
    return covariance + np.diag([prior.yaw_floor**2, *[prior.t_floor**2] * 3])


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

    Prediction: the odometry counts a bias b too much, so in its frame what stands still moves by R b dt.
    Measurement: t = R(yaw_odom)' (q - c) / Z and yaw = yaw_odom - yaw_target, with q the target's position,
    c the current camera's, Z the depth: the mean over the points in sight, so it changes with them, the more
    when `fresh` points have joined. Returns the new estimate and whether the measurement passed the
    chi-square gate (4 degrees of freedom); outside it only the prediction is kept.
    """
    dt = max(pose.stamp - estimate.stamp, 0.0)
    R = pose.R_odom_heading
    F = np.eye(8)
    F[:3, 5:] = R * dt
    walk = np.array(
        [*[prior.drift**2] * 3, prior.depth_walk**2, prior.yaw_drift**2, *[prior.bias_walk**2] * 3]
    )
    predicted = F @ estimate.x
    P = F @ estimate.P @ F.T + np.diag(walk * dt)
    if fresh:
        P[3, 3] += prior.depth_jump**2
    camera = pose.position + R @ lever
    depth = estimate.depth
    expected = R.T @ (predicted[:3] - camera) / depth
    H = np.zeros((4, 8))
    H[0, 4] = -1.0
    H[1:, :3] = R.T / depth
    H[1:, 3] = -expected
    residual = np.append(wrap_angle(yaw - wrap_angle(pose.yaw - estimate.yaw)), t_heading - expected)
    S = H @ P @ H.T + _noise(covariance, prior)
    gain = np.linalg.solve(S, H @ P).T  # (8, 4)
    accepted = bool(residual @ np.linalg.solve(S, residual) <= gate)
    if not accepted:
        return TargetEstimate(pose.stamp, predicted, P), False
    x = predicted + gain @ residual
    x[4] = wrap_angle(float(x[4]))
    # Joseph form: stays symmetric and positive when the measurement is far better than the prediction.
    A = np.eye(8) - gain @ H
    P = A @ P @ A.T + gain @ _noise(covariance, prior) @ gain.T
    return TargetEstimate(pose.stamp, x, P), True


def target_in_heading(estimate: TargetEstimate, pose: OdometryPose, lever: Array) -> tuple[Array, float]:
    """Return where the *body* has to go, (3,) [m] in the heading frame, and the turn left to make [rad].

    The camera sits ahead of the centre, so while the headings differ camera and body have different ways
    to go; this is the lever arm of eq. (5).
    """
    turn = wrap_angle(estimate.yaw - pose.yaw)
    c, s = np.cos(estimate.yaw), np.sin(estimate.yaw)
    target_body = estimate.position - np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ lever
    return pose.R_odom_heading.T @ (target_body - pose.position), turn
