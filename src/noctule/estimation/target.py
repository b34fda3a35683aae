"""Where a target image was taken, in metres, from its direction and the vehicle's own motion.

A homography gives the target's position t only in units of the scene's mean depth. The target does not move
and neither does the scene, so while the vehicle moves by a known amount the change of t tells the depth
(scale from motion). An extended Kalman filter of four states does both at once and bridges the ticks
without a picture.
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
    drift: float = 0.03  # [m / sqrt(s)], random walk of the odometry frame against the room
    yaw_drift: float = 0.01  # [rad / sqrt(s)]
    t_floor: float = 0.002  # [mean depths], noise of t below which no covariance is believed
    yaw_floor: float = 0.0015  # [rad]


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """The target's camera pose in the odometry frame, with the depth that scales it."""

    stamp: float  # [s]
    x: Array  # (5,): position [m] in odometry, log(depth / 1 m), yaw [rad] of the target in odometry
    P: Array  # (5, 5)

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
    """
    depth = prior.depth if depth is None else depth
    log_sd = prior.depth_log_sd if depth_log_sd is None else depth_log_sd
    R = pose.R_odom_heading
    camera = pose.position + R @ lever
    measured = _measured(t_heading, yaw, camera, pose, depth)
    x = np.array([*measured[:3], np.log(depth), measured[3]])
    P = np.zeros((5, 5))
    ray = R @ t_heading * depth
    C = _noise(covariance, prior)
    P[:3, :3] = depth**2 * R @ C[1:, 1:] @ R.T + np.outer(ray, ray) * log_sd**2
    P[:3, 3] = P[3, :3] = ray * log_sd**2
    P[3, 3] = log_sd**2
    P[4, 4] = C[0, 0]
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
    gate: float = 25.0,
) -> tuple[TargetEstimate, bool]:
    """Predict to the picture's exposure and update with one measurement (see `begin_target`).

    Measurement model: t = R(yaw_odom)' (q - c) / Z and yaw = yaw_odom - yaw_target, with q the target's
    position, c the current camera's, Z the depth. Returns the new estimate and whether the measurement
    passed the chi-square gate (4 degrees of freedom); outside it only the prediction is kept.
    """
    dt = max(pose.stamp - estimate.stamp, 0.0)
    P = estimate.P + np.diag([*[prior.drift**2 * dt] * 3, 1e-6 * dt, prior.yaw_drift**2 * dt])
    R = pose.R_odom_heading
    camera = pose.position + R @ lever
    depth = estimate.depth
    expected = R.T @ (estimate.position - camera) / depth
    H = np.zeros((4, 5))
    H[0, 4] = -1.0
    H[1:, :3] = R.T / depth
    H[1:, 3] = -expected
    residual = np.append(wrap_angle(yaw - wrap_angle(pose.yaw - estimate.yaw)), t_heading - expected)
    S = H @ P @ H.T + _noise(covariance, prior)
    gain = np.linalg.solve(S, H @ P).T  # (5, 4)
    accepted = bool(residual @ np.linalg.solve(S, residual) <= gate)
    if not accepted:
        return TargetEstimate(pose.stamp, estimate.x, P), False
    x = estimate.x + gain @ residual
    x[4] = wrap_angle(float(x[4]))
    # Joseph form: stays symmetric and positive when the measurement is far better than the prediction.
    A = np.eye(5) - gain @ H
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
