"""From pictures to views of key images: match in the worker, track in the tick, estimate.

A key image enters by a match that the worker found in an older picture; its points are carried to the newest
picture at once and tracked from then on. Matching goes on beside the loop, so that drift never builds up and
the next image is there before it is needed: no tick ever waits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from noctule.control.servoing import mean_distance
from noctule.control.tasks import SafetyBox
from noctule.estimation.odometry import Odometry, OdometryPose
from noctule.geometry import R_BODY_CAMERA, Array, rot_z, tilt
from noctule.messages import MatchRequest, MatchResult, Observation, Picture
from noctule.pilots.law import Optics, View
from noctule.pilots.link_estimates import LinkEstimates
from noctule.pilots.neighbours import Neighbours
from noctule.pilots.settings import PilotSettings
from noctule.pilots.tracks import TrackSet, empty_tracks
from noctule.pilots.visual_path import VisualPath
from noctule.vision.features import detect
from noctule.vision.homography import HomographyEstimate, NoHomographyError, estimate_homography
from noctule.vision.matching import match_robust, spread
from noctule.vision.tracking import Pyramid, align, track

_LATE = 2.0  # [s] after which a match is not waited for any more
_RETRY = 0.3  # [s] between requests for an image that is missing
_ALIGN_EVERY = 6  # ticks
_ALIGN_WITHIN = (
    0.06,
    0.09,
)  # |t| [mean depths] and yaw [rad] below which a live picture looks like the key image
_MARGIN = 0.05  # of the picture's width and height, left free around the safety box


def match_key_image(path: VisualPath, settings: PilotSettings, picture: Picture, index: int) -> MatchResult:
    """Match a live picture to key image `index`: what the worker beside the loop does."""
    features = detect(picture.pixels, settings.features)
    found = match_robust(path.images[index].features, features, path.camera)
    return MatchResult(picture.stamp, index, found.p_ref, found.p_current, found.reason)


def safety_box(width: int, height: int) -> SafetyBox:
    """Return the part of the picture in which points are safe from leaving it."""
    dx, dy = _MARGIN * width, _MARGIN * height
    return SafetyBox(dx, dy, width - 1 - dx, height - 1 - dy)


@dataclass(slots=True)
class Perception:
    """Keeps the tracks of the key images in sight."""

    links: LinkEstimates
    settings: PilotSettings
    method: str = "upright"
    tracks: dict[int, TrackSet] = field(default_factory=dict)
    reasons: dict[int, str] = field(default_factory=dict)  # why an image could not be matched last time
    path: VisualPath = field(init=False)
    optics: Optics = field(init=False)
    neighbours: Neighbours = field(init=False)
    _pyramid: Pyramid | None = None
    _stamp: float = -np.inf
    _asked: dict[int, float] = field(default_factory=dict)  # index -> [s] when it was asked for last
    _pending: dict[tuple[float, int], Pyramid] = field(default_factory=dict)
    _held: list[MatchResult] = field(default_factory=list)
    _references: dict[int, Pyramid] = field(default_factory=dict)
    _judged: dict[int, float] = field(default_factory=dict)  # index -> `matched` of the last view
    _ticks: int = 0

    def __post_init__(self) -> None:
        """Set up what tells two answers apart."""
        self.path, self.optics = self.links.path, self.links.optics
        self.neighbours = Neighbours(self.links)
        if self.method == "upright":
            for index in range(len(self.path.links)):
                self.neighbours.turn(index)  # now, not in the tick that needs it first

    @property
    def picture_stamp(self) -> float:
        """Exposure of the newest picture [s]."""
        return self._stamp

    def step(
        self, observation: Observation, odometry: Odometry, wanted: Mapping[int, int]
    ) -> dict[int, View]:
        """Take an observation; return the views of the newest picture by index.

        `wanted` are the key images worth following, each with the number of points that it may have; tracks
        of others are dropped.
        """
        picture, results = observation.picture, [*self._held, *observation.matches]
        # A match that arrives between two pictures waits for the next one.
        self._held = results if picture is None else []
        if picture is None:
            return {}
        pyramid, pose = Pyramid.of(picture.pixels), odometry.at(picture.stamp)
        self.tracks = {i: tracks for i, tracks in self.tracks.items() if i in wanted}
        self._follow(pyramid)
        for result in results:
            self._take(result, pyramid, odometry, pose, wanted)
        self._pyramid, self._stamp = pyramid, picture.stamp
        self._ticks += 1
        return self._views(pose, pyramid)

    def _follow(self, pyramid: Pyramid) -> None:
        """Track every point from the last picture to this one, in one call for all images."""
        sets = [tracks for tracks in self.tracks.values() if len(tracks)]
        if self._pyramid is None or not sets:
            return
        p, ok = track(self._pyramid, pyramid, np.vstack([tracks.p for tracks in sets]))
        first = 0
        for tracks in sets:
            part = slice(first, first + len(tracks))
            self.tracks[tracks.index] = replace(tracks, p=p[part]).kept(ok[part])
            first += len(tracks)

    def _take(
        self,
        result: MatchResult,
        pyramid: Pyramid,
        odometry: Odometry,
        pose: OdometryPose,
        wanted: Mapping[int, int],
    ) -> None:
        """Carry a match in an older picture to the newest one and join it to the tracks."""
        then = self._pending.pop((result.stamp, result.key_index), None)
        self.reasons[result.key_index] = result.reason
        if then is None or result.reason or result.key_index not in wanted:
            return
        box = safety_box(self.path.camera.width, self.path.camera.height)
        inside = box.contains(result.p_ref)
        p_ref, p_then = result.p_ref[inside], result.p_current[inside]
        # Only as many as will be kept: carrying hundreds of points over would stall the tick.
        camera, most = self.path.camera, wanted[result.key_index]
        chosen = spread(p_then, camera.width, camera.height, most)
        p_ref, p_then = p_ref[chosen], p_then[chosen]
        guess = self._turned(p_then, odometry.at(result.stamp), pose)
        p, ok = track(then, pyramid, p_then, guess)
        tracks = self.tracks.get(result.key_index, empty_tracks(result.key_index))
        shape = (camera.height, camera.width)
        self.tracks[result.key_index] = tracks.joined(p_ref[ok], p[ok], result.stamp, shape, most)

    def _turned(self, p: Array, then: OdometryPose, now: OdometryPose) -> Array:
        """Return where points (n, 2) [px] would be if the camera had only turned between the two poses."""
        turn = self._camera_rotation(now).T @ self._camera_rotation(then)
        x = np.column_stack([self.optics.camera.normalise(p), np.ones(len(p))]) @ turn.T
        return self.optics.camera.to_pixels(x[:, :2] / np.maximum(x[:, 2:3], 0.1))

    def _camera_rotation(self, pose: OdometryPose) -> Array:
        body = rot_z(pose.yaw)
        if not self.optics.mount.stabilised:
            body = body @ tilt(pose.roll, pose.pitch)
        return np.asarray(body @ R_BODY_CAMERA)

    def _views(self, pose: OdometryPose, pyramid: Pyramid) -> dict[int, View]:
        views: dict[int, View] = {}
        for index, tracks in sorted(self.tracks.items()):
            if len(tracks) < self.settings.min_points:
                continue
            if self._near(tracks.estimate) and self._ticks % _ALIGN_EVERY == 0:
                tracks = self._aligned(tracks, pyramid)
            estimate = self._estimate(tracks, pose)
            before = views.get(index - 1)
            if estimate is not None and before is not None and self.method == "upright":
                again = partial(self._estimate, replace(tracks, estimate=None), pose)
                estimate = self.neighbours.choose(index, estimate, before.estimate.yaw, again)
            if estimate is None:
                self.tracks[index] = replace(tracks, estimate=None)
                continue
            good = self._agreeing(estimate)
            if int(good.sum()) >= self.settings.min_points:
                p_ref, p = tracks.p_ref[good], tracks.p[good]
                fresh = tracks.matched > self._judged.get(index, -np.inf)
                views[index] = View(index, pose, estimate, p_ref, p, mean_distance(p, p_ref), fresh)
                self._judged[index] = tracks.matched
            self.tracks[index] = tracks.judged(estimate, good)
        return views

    def _agreeing(self, estimate: HomographyEstimate) -> NDArray[np.bool_]:
        """Return the points to go on with, (n,): those of one geometry, where the method can tell."""
        if self.method == "upright":
            return estimate.inliers
        return np.ones(len(estimate.inliers), dtype=np.bool_)

    def _near(self, estimate: HomographyEstimate | None) -> bool:
        return (
            self.method == "upright"
            and estimate is not None
            and float(np.linalg.norm(estimate.t)) < _ALIGN_WITHIN[0]
            and abs(estimate.yaw) < _ALIGN_WITHIN[1]
        )

    def _aligned(self, tracks: TrackSet, pyramid: Pyramid) -> TrackSet:
        """Take drift out: find the points straight from the key image, where the two pictures look alike."""
        reference = self._references.get(tracks.index)
        if reference is None:
            reference = Pyramid.of(self.path.images[tracks.index].pixels)
            self._references = {tracks.index: reference}
        found = align(reference, pyramid, tracks.p_ref, tracks.p)
        agree = found.ok & (np.linalg.norm(found.p - tracks.p, axis=1) < 4.0)
        return replace(tracks, p=np.where(agree[:, None], found.p, tracks.p))

    def _estimate(self, tracks: TrackSet, pose: OdometryPose) -> HomographyEstimate | None:
        image = self.path.images[tracks.index]
        m_ref = self.optics.levelled(tracks.p_ref, image.roll, image.pitch)
        m = self.optics.levelled(tracks.p, pose.roll, pose.pitch)
        try:
            return estimate_homography(m_ref, m, self.method, self.links.attitude_sd, start=tracks.estimate)
        except NoHomographyError:
            return None

    def requests(
        self, now: float, current: int, following: int | None, search: Sequence[int] = ()
    ) -> list[MatchRequest]:
        """Return what the worker should match next; call after `step`, at most one is under way at a time.

        With `search`, images to look for because the target is lost, the one that was asked for longest ago
        comes first, and of equals the earlier in the list.
        """
        # An answer that never comes must not keep the pilot from asking again.
        self._pending = {key: then for key, then in self._pending.items() if now - key[0] < _LATE}
        if self._pyramid is None or self._pending:
            return []
        for index in self._candidates(now, current, following, search):
            self._asked[index] = now
            self._pending[self._stamp, index] = self._pyramid
            return [MatchRequest(index)]
        return []

    def _candidates(
        self, now: float, current: int, following: int | None, search: Sequence[int]
    ) -> list[int]:
        def waited(index: int, time: float) -> bool:
            return now - self._asked.get(index, -np.inf) >= time

        if search:
            return sorted(search, key=lambda i: self._asked.get(i, -np.inf))
        weak = int(1.5 * self.settings.min_points)
        names = []
        if self._size(current) < weak and waited(current, _RETRY):
            names.append(current)
        if following is not None and self._size(following) < weak and waited(following, _RETRY):
            names.append(following)
        if waited(current, self.settings.rematch_s):
            names.append(current)
        if following is not None and waited(following, self.settings.rematch_s):
            names.append(following)
        return names

    def _size(self, index: int) -> int:
        tracks = self.tracks.get(index)
        return 0 if tracks is None else len(tracks)
