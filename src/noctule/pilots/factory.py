"""Builds the pilot that a mission names."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from noctule.estimation.odometry import OdometryPose
from noctule.geometry import Array
from noctule.messages import Limits, MatchResult, Picture, Pilot
from noctule.pilots.law import Law, Optics, View
from noctule.pilots.noctule_law import NoctuleLaw, sighting_of
from noctule.pilots.perception import Perception, match_key_image
from noctule.pilots.progress import LinkGeometry
from noctule.pilots.published import PublishedLaw, published_velocity
from noctule.pilots.settings import PilotSettings, PublishedGains
from noctule.pilots.stability import check_delay
from noctule.pilots.visual import VisualPilot
from noctule.pilots.visual_path import VisualPath
from noctule.vision.homography import estimate_homography
from noctule.vision.triangle import largest_triangle


def link_geometries(path: VisualPath, optics: Optics, attitude_sd: float) -> tuple[LinkGeometry, ...]:
    """Return how every image lies from the one before, from their shared points alone."""
    origin = OdometryPose(0.0, np.zeros(3), 0.0, np.zeros(3))
    found = []
    for k, link in enumerate(path.links):
        here, ahead = path.images[k], path.images[k + 1]
        m_here = optics.levelled(link.p_ref, here.roll, here.pitch)
        m_ahead = optics.levelled(link.p_next, ahead.roll, ahead.pitch)
        forward = estimate_homography(m_ahead, m_here, "upright", attitude_sd)
        back = estimate_homography(m_here, m_ahead, "upright", attitude_sd)
        sighting = sighting_of(View(k + 1, origin, forward, link.p_next, link.p_ref, 0.0))
        # One baseline, measured in the mean depths of either image.
        ratio = float(np.linalg.norm(back.t)) / max(float(np.linalg.norm(forward.t)), 1e-6)
        found.append(LinkGeometry(sighting.t_heading, float(np.clip(ratio, 0.3, 3.0))))
    return tuple(found)


def _noctule(settings: PilotSettings, path: VisualPath, limits: Limits, optics: Optics) -> Law:
    attitude_sd = float(np.sqrt(2.0) * np.radians(settings.attitude_sd_deg))
    return NoctuleLaw(settings, limits, optics, link_geometries(path, optics, attitude_sd))


def segment_velocities(path: VisualPath, optics: Optics, gains: PublishedGains) -> tuple[Array, ...]:
    """Return (3) between neighbouring key images, once: the velocity (4,) that image k asks for in k - 1.

    Eq. (32) before its scale, in the heading frame of image k - 1.
    """
    found = []
    for k, link in enumerate(path.links):
        here, ahead = path.images[k], path.images[k + 1]
        m_here = optics.levelled(link.p_ref, here.roll, here.pitch)
        m_ahead = optics.levelled(link.p_next, ahead.roll, ahead.pitch)
        estimate = estimate_homography(m_ahead, m_here, "generic")
        m_ref = m_ahead[list(largest_triangle(m_ahead))].mean(axis=0)
        found.append(published_velocity(estimate.H, m_ref, optics, gains)[1])
    return tuple(found)


def _published(settings: PilotSettings, path: VisualPath, limits: Limits, optics: Optics) -> Law:
    gains = settings.published
    segments = () if gains.feed_forward is None else segment_velocities(path, optics, gains)
    return PublishedLaw(settings, limits, optics, len(path.images) - 1, segments)


LAWS: dict[str, tuple[Callable[[PilotSettings, VisualPath, Limits, Optics], Law], str]] = {
    "noctule": (_noctule, "upright"),
    "published": (_published, "generic"),
}
"""Laws by name, each with the homography estimator that it flies on."""


def make_pilot(settings: PilotSettings, path: VisualPath, limits: Limits, tick: float) -> Pilot:
    """Return the pilot for a path; `tick` [s] is the time between ticks.

    Raises LatencyError when the gains are not stable with the delays that the settings name.
    """
    check_delay(settings)
    optics = Optics(path.camera, path.mount)
    make_law, method = LAWS[settings.law]
    perception = Perception(path, settings, optics, method)
    return VisualPilot(settings, limits, perception, make_law(settings, path, limits, optics), tick)


def make_matcher(settings: PilotSettings, path: VisualPath) -> Callable[[Picture, int], MatchResult]:
    """Return what the worker beside the loop runs: a picture and the index of a key image to a match."""

    def match(picture: Picture, index: int) -> MatchResult:
        return match_key_image(path, settings, picture, index)

    return match
