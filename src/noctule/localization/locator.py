"""A depth frame in, the drone's pose out: the default method, tracker and all.

While it is tracked, the drone's top view is registered around where it must be: no blob, so nothing merges.
To start and to find it again detectors propose blobs, and the registration confirms over a few frames.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from noctule.camera import FixedCamera
from noctule.geometry import Array, Pose, wrap_angle
from noctule.localization.detection.splinters import join_splinters
from noctule.localization.half_turn import Facing
from noctule.localization.health import FrameHealth
from noctule.localization.located import Located, LocatorDiagnostics, LocatorSettings, LocatorState
from noctule.localization.matcher import Matcher
from noctule.localization.placing import slanted
from noctule.localization.registration import Registration, Scene, acquire, register
from noctule.localization.template import Template
from noctule.localization.tracker import Prediction, Track, facing_as, merged
from noctule.messages import DepthFrame, PoseMeasurement
from noctule.vision.depth.background import Background
from noctule.vision.depth.blob import Blob
from noctule.vision.depth.blobs import find_blobs

__all__ = ["Located", "Locator", "LocatorDiagnostics", "LocatorSettings", "LocatorState", "Proposing"]

_STEP = 0.04  # [m], of the search's shifts
_MOST_STEPS = 4
# [m], [rad], and deviations of the prediction, that a drone may be off
_AGREE, _AGREE_TURN = 0.15, 0.5  # [m], [rad] that frames may differ by and yet have seen the same drone
_REMEMBERED = 2.0  # [s], so long a lost drone that is found where it was needs no confirmation
_JUMP, _TURN, _SIGMAS = 0.03, 0.06, 4.0
_UNKNOWN_YAW = (math.pi / 2.0) ** 2  # [rad^2], added to the variance while the half turn is undecided


class Proposing(Protocol):
    """The part of a detector that the locator needs."""

    def propose(self, blobs: Sequence[Blob], camera: FixedCamera) -> tuple[Blob, ...]:
        """Return the blobs that may be the drone."""
        ...


class Locator:
    """Finds and follows the drone: deterministic, without a clock, and no frame makes it raise.

    Parameters
    ----------
    camera : where the depth camera hangs
    background : the room without the drone
    template : the drone's top view
    detector : proposes blobs to start from; None: all of a plausible size are tried
    offset : (3,) [m], measured minus true, as the calibration found it; taken off every position
    """

    def __init__(
        self,
        camera: FixedCamera,
        background: Background,
        template: Template,
        detector: Proposing | None = None,
        settings: LocatorSettings | None = None,
        offset: Array | None = None,
    ) -> None:
        self.camera = camera
        self.settings = settings or LocatorSettings()
        self._background = background
        self._detector = detector
        self._matcher = Matcher.of(template)
        self._offset = np.zeros(3) if offset is None else offset
        self._health = FrameHealth(camera.intrinsics, background)
        self._track: Track | None = None
        self._candidate: tuple[Track, int] | None = None  # and the frames that agreed
        self._lost: Track | None = None  # as it was seen last, while it is searched for
        self._seen = False
        self._sure = 0.0  # [s], when a frame last left no doubt

    @property
    def track(self) -> Track | None:
        """The drone as last seen, None when it must be searched for."""
        return self._track

    @property
    def _last(self) -> Track | None:
        """The drone as last seen, also when it is lost."""
        return self._lost if self._track is None else self._track

    def step(self, frame: DepthFrame, prediction: Prediction | None = None) -> Located:
        """Look at a frame; `prediction` is a filter's for its exposure. Never raises for a bad frame."""
        reason = self._health.check(frame)
        if reason:
            return self._without(frame.stamp, reason)
        scene = Scene(frame.depth, self._background.nearest, self.camera, self._matcher)
        reason, looked = "", LocatorDiagnostics()
        if self._track is not None:
            expected = merged(self._track, frame.stamp, prediction)
            found = self._look(scene, expected, self._track.half_turn.due)
            looked = _diagnostics(found)
            reason = self._doubt(frame.stamp, found, expected)
            if not reason:
                self._candidate = None
                return self._accept(frame.stamp, self._track.follow(frame.stamp, found), found)
            if frame.stamp - self._track.stamp > self.settings.coast:
                self._lost = self._track
                self._track = None
        return self._search(scene, frame.stamp, reason, looked)

    def _look(self, scene: Scene, expected: Prediction, weighed: bool) -> Registration:
        P = expected.covariance
        wide = math.sqrt(max(P[0, 0], P[1, 1]))
        reach = min(max(math.ceil(2.0 * wide / _STEP), 1), _MOST_STEPS)
        return register(scene, expected.pose, reach=reach, weighed=weighed)

    def _doubt(self, stamp: float, found: Registration, expected: Prediction) -> str:
        """Return why what was found where the drone must be is not it, "" when it is."""
        s = self.settings
        if found.visible < s.min_visible:
            return self._unseen(found)
        doubtful = stamp - self._sure
        if found.ratio < s.min_ratio:
            return (
                f"low score: {100.0 * found.ratio:.0f} % of what the drone would score, "
                f"expected at least {100.0 * s.min_ratio:.0f} %"
            )
        sure = found.ratio >= s.sure_ratio and found.visible >= s.sure_visible
        if sure and found.outline <= s.sure_outline:
            self._sure = stamp
        elif doubtful > s.max_doubt:
            return (
                f"in doubt: for {doubtful:.2f} s too little of it fits (seen {100.0 * found.visible:.0f} %, "
                f"score {100.0 * found.ratio:.0f} %, outline's misfit {found.outline:.2f}), "
                f"allowed {s.max_doubt:.2f} s"
            )
        if found.relief > s.max_relief:
            return f"another shape: surface misfit {found.relief:.2f}, expected at most {s.max_relief:.2f}"
        jump = math.dist(found.pose.position.tolist(), expected.pose.position.tolist())
        turn = abs(wrap_angle(found.pose.yaw - expected.pose.yaw))
        *place, heading = expected.covariance.diagonal().tolist()
        far = _JUMP + _SIGMAS * math.sqrt(sum(place))
        round_ = _TURN + _SIGMAS * math.sqrt(heading)
        if jump > far or turn > round_:
            return (
                f"jump: {jump:.2f} m and {math.degrees(turn):.0f} deg from where it must be, at most "
                f"{far:.2f} m and {math.degrees(round_):.0f} deg"
            )
        return ""

    def _unseen(self, found: Registration) -> str:
        k = self.camera.intrinsics
        x = self.camera.to_camera(found.pose.position[None])
        if x[0, 2] <= 0.0:
            return "outside the picture: it would be above the camera"
        u, v = k.project(x)[0]
        if not (0.0 <= u < k.width and 0.0 <= v < k.height):
            return f"outside the picture: it would be at ({u:.0f}, {v:.0f}) px of {k.width}x{k.height}"
        return (
            f"occluded: {100.0 * found.visible:.0f} % of the drone can be seen, expected at least "
            f"{100.0 * self.settings.min_visible:.0f} %"
        )

    def _search(self, scene: Scene, stamp: float, reason: str, looked: LocatorDiagnostics) -> Located:
        """Look at the blobs; a drone must be confirmed over a few frames before it is believed."""
        _, blobs = find_blobs(scene.depth, self._background, self.camera.intrinsics, self.settings.min_area)
        best, looked_at = self._best_start(scene, blobs)
        looked = replace(looked, proposals=looked_at)
        if best is None:
            self._candidate = None
            return self._without(stamp, reason or _nothing(len(blobs), looked_at), looked)
        track, agreed = self._agreed(stamp, best)
        if agreed >= self.settings.start_frames:
            self._candidate, self._sure = None, stamp
            return self._accept(stamp, track, best, looked_at)
        self._candidate = (track, agreed)
        confirming = f"confirming: a drone was found in {agreed} of {self.settings.start_frames} frames"
        return self._without(stamp, confirming, looked)

    def _best_start(self, scene: Scene, blobs: Sequence[Blob]) -> tuple[Registration | None, int]:
        """Return the best drone that is found anew, and how many places were looked at.

        A detector knows only the heights that it was shown, and what is near may hide in one blob with
        something else: where its proposals are none, the place of the loss and then all things of a plausible
        size are looked at. The registration confirms in any case.
        """
        proposed = () if self._detector is None else self._detector.propose(blobs, self.camera)
        last = self._last
        lost = [] if last is None else [last.pose.position]
        known = {blob.label for blob in proposed}
        rest = [b for b in self._plausible(join_splinters(blobs, self.camera)[0]) if b.label not in known]
        looked_at = 0
        for places in ([self._position(b) for b in proposed] + lost, [self._position(b) for b in rest]):
            found = [acquire(scene, place) for place in places]
            looked_at += len(places)
            starts = [one for one in found if self._is_start(one)]
            if starts:
                return max(starts, key=lambda one: one.score), looked_at
        return None, looked_at

    def _agreed(self, stamp: float, found: Registration) -> tuple[Track, int]:
        """Return the track of a candidate, and the frames in a row that agree on it."""
        last = self._last
        if last is not None and stamp - last.stamp < _REMEMBERED:
            resumed = self._resumed(last, stamp, found)
            if resumed is not None:
                return resumed, self.settings.start_frames
        if self._candidate is not None:
            track, agreed = self._candidate
            held = _held(found, track.predict(stamp).pose, _AGREE, _AGREE_TURN)
            if held is not None:
                return track.follow(stamp, held), agreed + 1
        track = Track.start(stamp, found.pose)
        return replace(track, half_turn=track.half_turn.add(found.half_turn)[0]), 1

    def _resumed(self, lost: Track, stamp: float, found: Registration) -> Track | None:
        """Return the track of a drone that is where it was lost and turned as it was, None otherwise."""
        held = _held(found, lost.pose, _AGREE, _AGREE_TURN)
        if held is None:
            return None
        return replace(Track.start(stamp, held.pose), half_turn=lost.half_turn.add(held.half_turn)[0])

    def _is_start(self, found: Registration) -> bool:
        s = self.settings
        seen = found.visible >= s.start_visible and found.ratio >= s.start_ratio
        return seen and found.outline <= s.start_outline and found.relief <= s.start_relief

    def _position(self, blob: Blob) -> Array:
        """Return where the body's origin would be if the blob were the drone, (3,) [m]."""
        position = self.camera.R_world_camera @ blob.points + self.camera.t_world_camera
        position[2] -= self._matcher.template.surface
        return np.asarray(position)

    def _plausible(self, blobs: Sequence[Blob]) -> tuple[Blob, ...]:
        """Return the blobs that are not much larger or smaller than the template."""
        t = self._matcher.template
        area = float((t.probability > 0.5).sum()) * t.grid.cell**2
        fx, fy = self.camera.intrinsics.focal
        return tuple(b for b in blobs if 0.3 * area < b.area * b.depth**2 / (fx * fy) < 6.0 * area)

    def _accept(self, stamp: float, track: Track, found: Registration, proposals: int = 0) -> Located:
        self._track, self._seen, self._lost = track, True, None
        certain = track.half_turn.facing is Facing.CERTAIN
        covariance = (
            found.covariance if certain else found.covariance + np.diag([0.0, 0.0, 0.0, _UNKNOWN_YAW])
        )
        measurement = PoseMeasurement(
            stamp, self._corrected(track.pose.position), track.pose.yaw, covariance, "registration"
        )
        looked = replace(_diagnostics(found), half_turn=track.half_turn.evidence, proposals=proposals)
        slipped = track.half_turn.slipped
        return Located(stamp, LocatorState.TRACKING, measurement, "", certain, slipped, looked)

    def _corrected(self, position: Array) -> Array:
        slant = self._matcher.template.slant
        return np.asarray(position - self._offset - slanted(slant, self.camera.t_world_camera, position))

    def _without(self, stamp: float, reason: str, looked: LocatorDiagnostics | None = None) -> Located:
        state = LocatorState.LOST if self._seen else LocatorState.SEARCHING
        return Located(stamp, state, None, reason, diagnostics=looked or LocatorDiagnostics())


def _held(found: Registration, near: Pose, away: float, turn: float) -> Registration | None:
    """Return what was found with the half turn nearest to a pose, None when it is not that pose's drone.

    `away` [m] and `turn` [rad] are what it may differ by.
    """
    held = facing_as(found.pose, near.yaw)
    if float(np.linalg.norm(held.position - near.position)) >= away:
        return None
    if abs(wrap_angle(held.yaw - near.yaw)) >= turn:
        return None
    if held is found.pose or found.half_turn is None:
        return replace(found, pose=held)
    return replace(found, pose=held, half_turn=-found.half_turn)


def _diagnostics(found: Registration) -> LocatorDiagnostics:
    pose: Pose = found.pose
    return LocatorDiagnostics(
        found.ratio, found.outline, found.relief, found.visible, 0.0, pose.roll, pose.pitch
    )


def _nothing(blobs: int, proposed: int) -> str:
    if not blobs:
        return "nothing in view: no foreground is as large as a drone"
    if not proposed:
        return f"no drone in view: none of {blobs} things looks like one to the detector"
    return f"no drone in view: none of {proposed} candidates has its shape"
