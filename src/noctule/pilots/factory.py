"""Builds the pilot that a mission names."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from noctule.estimation.odometry import OdometryPose
from noctule.geometry import Array
from noctule.messages import Limits, MatchResult, Picture, Pilot
from noctule.pilots.law import Law, Optics, View
from noctule.pilots.link_estimates import LinkEstimates
from noctule.pilots.noctule_law import NoctuleLaw, sighting_of
from noctule.pilots.perception import Perception, match_key_image
from noctule.pilots.progress import LinkGeometry
from noctule.pilots.published import PublishedLaw, published_velocity
from noctule.pilots.settings import PilotSettings, PublishedGains
from noctule.pilots.stability import check_delay
from noctule.pilots.visual import VisualPilot
from noctule.pilots.visual_path import VisualPath
from noctule.vision.triangle import largest_triangle


def link_estimates(path: VisualPath, attitude_sd_deg: float) -> LinkEstimates:
    """Return the estimates between the images of a path; `attitude_sd_deg` is one image's error [deg]."""
    attitude_sd = float(np.sqrt(2.0) * np.radians(attitude_sd_deg))  # a pair has two of them
    return LinkEstimates(path, Optics(path.camera, path.mount), attitude_sd)


def link_geometries(links: LinkEstimates) -> tuple[LinkGeometry, ...]:
    """Return how every image lies from the one before, from their shared points alone."""
    origin = OdometryPose(0.0, np.zeros(3), 0.0, np.zeros(3))
    found = []
    for k, link in enumerate(links.path.links):
        ahead, here = links.back(k), links.onward(k)
        sighting = sighting_of(View(k + 1, origin, ahead, link.p_next, link.p_ref, 0.0))
        # One baseline, measured in the mean depths of either image.
        ratio = float(np.linalg.norm(here.t)) / max(float(np.linalg.norm(ahead.t)), 1e-6)
        found.append(LinkGeometry(sighting.t_heading, float(np.clip(ratio, 0.3, 3.0))))
    return tuple(found)


def segment_velocities(links: LinkEstimates, gains: PublishedGains) -> tuple[Array, ...]:
    """Return (3) between neighbouring key images, once: the velocity (4,) that image k asks for in k - 1.

    Eq. (32) before its scale, in the heading frame of image k - 1.
    """
    found = []
    for k in range(len(links.path.links)):
        _, m_ahead = links.shared(k)
        m_ref = m_ahead[list(largest_triangle(m_ahead))].mean(axis=0)
        found.append(published_velocity(links.back(k, "generic").H, m_ref, links.optics, gains)[1])
    return tuple(found)


def _noctule(settings: PilotSettings, limits: Limits, links: LinkEstimates) -> Law:
    return NoctuleLaw(settings, limits, links.optics, link_geometries(links))


def _published(settings: PilotSettings, limits: Limits, links: LinkEstimates) -> Law:
    gains = settings.published
    segments = () if gains.feed_forward is None else segment_velocities(links, gains)
    return PublishedLaw(settings, limits, links.optics, len(links.path.images) - 1, segments)


LAWS: dict[str, tuple[Callable[[PilotSettings, Limits, LinkEstimates], Law], str]] = {
    "noctule": (_noctule, "upright"),
    "published": (_published, "generic"),
}
"""Laws by name, each with the homography estimator that it flies on."""


def make_pilot(settings: PilotSettings, path: VisualPath, limits: Limits, tick: float) -> Pilot:
    """Return the pilot for a path; `tick` [s] is the time between ticks.

    Raises LatencyError when the gains are not stable with the delays that the settings name.
    """
    check_delay(settings)
    make_law, method = LAWS[settings.law]
    links = link_estimates(path, settings.attitude_sd_deg)
    perception = Perception(links, settings, method)
    return VisualPilot(settings, limits, perception, make_law(settings, limits, links), tick)


def make_matcher(settings: PilotSettings, path: VisualPath) -> Callable[[Picture, int], MatchResult]:
    """Return what the worker beside the loop runs: a picture and the index of a key image to a match."""

    def match(picture: Picture, index: int) -> MatchResult:
        return match_key_image(path, settings, picture, index)

    return match
