"""Dead reckoning from what the vehicle reports, or from the commands sent when it reports nothing."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field

import numpy as np

from noctule.geometry import Array, rot_z, wrap_angle


@dataclass(frozen=True, slots=True)
class OdometryPose:
    """A dead-reckoned pose in the odometry frame: levelled, FLU at the place where counting began."""

    stamp: float  # [s]
    position: Array  # (3,) [m]
    yaw: float  # [rad]
    v_heading: Array  # (3,) [m/s], levelled heading frame
    roll: float = 0.0  # [rad], reported
    pitch: float = 0.0  # [rad]

    @property
    def R_odom_heading(self) -> Array:
        """The (3, 3) rotation that takes heading-frame coordinates to odometry coordinates."""
        return rot_z(self.yaw)


@dataclass(slots=True)
class Odometry:
    """Integrates velocity and yaw, and remembers the last second so that pictures find their own pose.

    The velocity is predicted by the first-order lag that the flight expects of a command (eq. (1) of
    Toro-Arcila et al. with a lag: a quadcopter does not jump to its command) and corrected by what the
    vehicle reports, so that a noisy report costs no delay. A vehicle that reports neither velocity nor yaw
    is flown on the prediction alone.
    """

    lag: float = 0.3  # [s], expected response of the vehicle to a velocity command
    trust: float = 0.2  # share of a reported velocity's difference that is taken over at a report
    keep: float = 1.5  # [s], how long poses are remembered
    _poses: list[OdometryPose] = field(default_factory=list)
    _yaw_reported: float | None = None
    _nu: Array = field(default_factory=lambda: np.zeros(4))  # (4,) command after the lag

    @property
    def now(self) -> OdometryPose:
        """The newest pose."""
        return self._poses[-1]

    def step(
        self,
        stamp: float,
        command: Array,
        v_heading: Array | None,
        yaw: float | None,
        attitude: tuple[float, float] = (0.0, 0.0),
    ) -> OdometryPose:
        """Advance to `stamp` [s].

        Parameters
        ----------
        stamp
            Time of the tick [s]; must not decrease.
        command
            The command in force since the last step, (4,): forward, left, up [m/s], yaw rate [rad/s].
        v_heading
            Reported velocity (3,) [m/s] in the levelled heading frame, None when not reported.
        yaw
            Reported yaw [rad], any zero, None when not reported.
        attitude
            Reported roll and pitch [rad].
        """
        if not self._poses:
            v = np.zeros(3) if v_heading is None else np.asarray(v_heading, dtype=np.float64)
            self._yaw_reported = yaw
            self._poses.append(OdometryPose(stamp, np.zeros(3), 0.0, v, *attitude))
            return self.now
        last = self.now
        dt = stamp - last.stamp
        self._nu = self._nu + (1.0 - np.exp(-dt / self.lag)) * (command - self._nu)
        if v_heading is not None:
            self._nu[:3] += self.trust * (v_heading - self._nu[:3])
        v = self._nu[:3].copy()
        if yaw is None or self._yaw_reported is None:
            turn = self._nu[3] * dt
        else:
            turn = wrap_angle(yaw - self._yaw_reported)
        self._yaw_reported = yaw
        # Midpoint rule: the heading half-way through the step carries the mean of both velocities.
        step = rot_z(last.yaw + turn / 2.0) @ (0.5 * (last.v_heading + v)) * dt
        self._poses.append(
            OdometryPose(stamp, last.position + step, wrap_angle(last.yaw + turn), v, *attitude)
        )
        while self._poses[0].stamp < stamp - self.keep:
            self._poses.pop(0)
        return self.now

    def at(self, stamp: float) -> OdometryPose:
        """Return the pose at `stamp` [s], interpolated; the nearest remembered one outside the memory."""
        stamps = [pose.stamp for pose in self._poses]
        i = bisect_left(stamps, stamp)
        if i == 0:
            return self._poses[0]
        if i == len(stamps):
            return self._poses[-1]
        a, b = self._poses[i - 1], self._poses[i]
        w = (stamp - a.stamp) / (b.stamp - a.stamp)
        return OdometryPose(
            stamp,
            (1 - w) * a.position + w * b.position,
            wrap_angle(a.yaw + w * wrap_angle(b.yaw - a.yaw)),
            (1 - w) * a.v_heading + w * b.v_heading,
            (1 - w) * a.roll + w * b.roll,
            (1 - w) * a.pitch + w * b.pitch,
        )
