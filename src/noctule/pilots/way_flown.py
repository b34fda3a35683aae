"""Whether the drone flies the way that its held heading says: the last check of the half turn.

The fusion looks for a half turn that slipped too, but by its own velocity, and that follows the vehicle's
reports: in a closed loop the camera's poses are then refused, and what is left agrees with itself while the
drone flies away. This compares where the camera sees it go, refused or not, with what the vehicle says.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from noctule.geometry import Array, rot_z

_SPAN = 0.3  # [s], over which displacements are compared
_KEPT = 1.0  # [s]
_MOVES = 0.1  # [m/s], slower than this nothing is said
_SD = 0.15  # [m/s], of what both may differ by on each axis
_PER_FRAME, _CERTAIN = 1.0, 8.0  # log-likelihood ratios


@dataclass(slots=True)
class WayFlown:
    """Remembers a second of poses and of reported velocities."""

    _poses: deque[tuple[float, Array]] = field(default_factory=deque)  # stamp [s], position (3,)
    _told: deque[tuple[float, Array]] = field(default_factory=deque)  # stamp [s], level velocity (2,), world
    _agreement: float = 0.0

    def told(self, stamp: float, v_body: Array | None, yaw: float) -> None:
        """Hear a reported velocity (3,), as the heading `yaw` [rad] that is held turns it."""
        if v_body is not None:
            _keep(self._told, stamp, (rot_z(yaw) @ v_body)[:2])

    def contradicted(self, stamp: float, position: Array) -> bool:
        """Take a pose of the camera; True says that the heading held is the wrong half turn."""
        _keep(self._poses, stamp, position)
        before = [(at, p) for at, p in self._poses if at <= stamp - _SPAN]
        if not before:
            return False
        at, p = before[-1]
        said = [v for when, v in self._told if at <= when <= stamp]
        if not said or stamp - at > 2.0 * _SPAN:
            return False
        seen, flown = (position - p)[:2] / (stamp - at), np.mean(said, axis=0)
        if min(float(np.linalg.norm(seen)), float(np.linalg.norm(flown))) < _MOVES:
            return False
        # Both ways are as likely, so the ratio is 2 seen . flown / variance.
        ratio = 2.0 * float(seen @ flown) / _SD**2
        step = min(max(ratio, -_PER_FRAME), _PER_FRAME)
        self._agreement = min(max(self._agreement + step, -_CERTAIN), _CERTAIN)
        return self._agreement <= -_CERTAIN

    def forget(self) -> None:
        """Begin anew: what was told was turned by a heading that is no longer held."""
        self._told.clear()
        self._agreement = 0.0


def _keep(kept: deque[tuple[float, Array]], stamp: float, value: Array) -> None:
    kept.append((stamp, value))
    while kept[0][0] < stamp - _KEPT:
        kept.popleft()
