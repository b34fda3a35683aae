"""What a tick sees: the newest picture and the newest depth frame, each told once, and how old they are."""

from __future__ import annotations

from noctule.devices.protocols import StaleFrameError
from noctule.flight.rig import Rig
from noctule.messages import Decision, DepthFrame, Picture

_LATEST_DEPTH = 0.5  # [s], an older depth frame says nothing of now


class Senses:
    """Polls the front camera and the depth camera above, where there are such."""

    def __init__(self, rig: Rig, origin: float, picture_age: float) -> None:
        self._rig, self._picture_age = rig, picture_age
        self.picture: Picture | None = None  # the newest
        self._picture_stamp = self._depth_stamp = origin  # [s]
        self._depth_seen = False
        self._located = False  # a pilot once said where it is

    def look(self) -> tuple[Picture | None, DepthFrame | None]:
        """Return the newest picture and depth frame, None for what was seen before or is too old."""
        return self._new_picture(), self._new_depth()

    def ages(self, now: float, decision: Decision) -> tuple[float, float, bool]:
        """Return how old [s] picture and depth frame are, 0 for what is not flown by; and whether by depth.

        A pilot that says where it is flies by the camera above, and so does one that does not know it yet.
        """
        known = decision.whereabouts is not None
        no_camera = self._rig.camera is None
        by_depth = self._rig.ceiling is not None and (known or no_camera or not self._located)
        self._located = self._located or known
        if by_depth:
            return 0.0, now - self._depth_stamp, True
        return 0.0 if no_camera else now - self._picture_stamp, 0.0, False

    def _new_picture(self) -> Picture | None:
        if self._rig.camera is None:
            return None
        try:
            picture = self._rig.camera.latest(self._picture_age)
        except StaleFrameError:
            return None
        if self.picture is not None and picture.stamp <= self.picture.stamp:
            return None
        self.picture, self._picture_stamp = picture, picture.stamp
        return picture

    def _new_depth(self) -> DepthFrame | None:
        if self._rig.ceiling is None:
            return None
        try:
            frame = self._rig.ceiling.latest(_LATEST_DEPTH)
        except StaleFrameError:
            return None
        if self._depth_seen and frame.stamp <= self._depth_stamp:
            return None
        self._depth_seen, self._depth_stamp = True, frame.stamp
        return frame
