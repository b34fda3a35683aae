"""How well two pictures hang together: what they share, how it is spread, how far the camera went."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from noctule.camera import PinholeCamera, derotate
from noctule.geometry import Array, rot_y, wrap_angle
from noctule.vision.features import Features
from noctule.vision.homography import HomographyEstimate, NoHomographyError, estimate_homography
from noctule.vision.homography.result import TooFewPointsError
from noctule.vision.matching import match_robust

Attitude = tuple[float, float]
"""Roll and pitch [rad] as the vehicle reported them."""

COLUMNS, ROWS = 6, 4
PARTS = COLUMNS * ROWS
_LEAST_SHARE = 0.5  # of the points in one upright geometry, or there is none
_MOVED = 0.02  # normalised: points that moved so much show a translation, or cannot


@dataclass(frozen=True, slots=True)
class LinkQuality:
    """What two pictures of a path share."""

    shared: int  # points
    cells: int  # parts of the picture, of 24, that hold some of them, in the picture that has fewer
    displacement: float  # [px], median
    share: float = 0.0  # of the points, those that fit one upright geometry
    noise: float = float("nan")  # [px], of these points
    baseline: float = 0.0  # [mean depths of the second], 0 where it does not stand out of the noise
    yaw: float = 0.0  # [rad], positive where the camera turned left
    conditioned: bool = False  # the motion, or that there is none, can be told
    reason: str = ""  # why nothing is shared


def covered(p: Array, camera: PinholeCamera) -> int:
    """Return how many of the 6 x 4 equal parts of the picture hold one of the points (n, 2) [px]."""
    if len(p) == 0:
        return 0
    x = np.clip((p[:, 0] + 0.5) * COLUMNS / camera.width, 0, COLUMNS - 1).astype(int)
    y = np.clip((p[:, 1] + 0.5) * ROWS / camera.height, 0, ROWS - 1).astype(int)
    return len(np.unique(y * COLUMNS + x))


def _estimate(m_ref: Array, m_next: Array, attitude_sd: float) -> HomographyEstimate | None:
    try:
        return estimate_homography(m_ref, m_next, "upright", attitude_sd)
    except (NoHomographyError, TooFewPointsError):
        return None


def measure_link(
    p_ref: Array,
    p_next: Array,
    camera: PinholeCamera,
    attitudes: tuple[Attitude, Attitude] = ((0.0, 0.0), (0.0, 0.0)),
    attitude_sd: float = 0.0,
    reason: str = "",
) -> LinkQuality:
    """Judge the points (n, 2) [px] that two pictures share.

    `attitudes` are those of both pictures; `attitude_sd` [rad] is what is left between them.
    """
    cells = min(covered(p_ref, camera), covered(p_next, camera))
    if len(p_ref) == 0:
        return LinkQuality(0, 0, float("nan"), reason=reason or "no points are shared")
    displacement = float(np.median(np.linalg.norm(p_next - p_ref, axis=1)))
    m_ref = derotate(camera.normalise(p_ref), *attitudes[0])
    m_next = derotate(camera.normalise(p_next), *attitudes[1])
    # As it is flown: the next picture is the reference, so lengths are in its mean depths.
    found = _estimate(m_next, m_ref, attitude_sd)
    if found is None:
        return LinkQuality(len(p_ref), cells, displacement, reason=reason)
    # What a turn does not explain: where that is much, a translation must be found.
    turned = np.column_stack([m_ref, np.ones(len(m_ref))]) @ rot_y(-found.yaw).T
    left = float(np.median(np.linalg.norm(m_next - turned[:, :2] / turned[:, 2:3], axis=1)))
    share = float(np.mean(found.inliers))
    return LinkQuality(
        shared=len(p_ref),
        cells=cells,
        displacement=displacement,
        share=share,
        noise=found.noise * float(np.mean(camera.focal)),
        baseline=float(np.linalg.norm(found.t)) if found.t_defined else 0.0,
        yaw=wrap_angle(-found.yaw),
        conditioned=share >= _LEAST_SHARE and (found.t_defined or left < _MOVED),
        reason=reason,
    )


def match_link(
    ref: Features,
    following: Features,
    camera: PinholeCamera,
    attitudes: tuple[Attitude, Attitude] = ((0.0, 0.0), (0.0, 0.0)),
    attitude_sd: float = 0.0,
) -> LinkQuality:
    """Match two pictures' features and judge what they share; deterministic."""
    found = match_robust(ref, following, camera)
    return measure_link(found.p_ref, found.p_current, camera, attitudes, attitude_sd, found.reason)
