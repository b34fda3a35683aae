"""`planar`: the homography of one plane, by normalised DLT on the matches that a robust search keeps."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from noctule.geometry import Array
from noctule.vision.homography.result import (
    DEFAULT_NOISE,
    HomographyEstimate,
    NoHomographyError,
    checked_options,
    checked_points,
    scaled_homography,
)

LEAST_POINTS = 4
THRESHOLD = 4.0  # in standard deviations of the noise
MAX_ITERATIONS = 2000
CONFIDENCE = 0.999


def hartley(m: Array) -> Array:
    """Return the (3, 3) similarity that moves m (n, 2) to mean 0 and mean distance sqrt(2)."""
    centre = m.mean(axis=0)
    size = float(np.mean(np.linalg.norm(m - centre, axis=1)))
    k = np.sqrt(2.0) / max(size, 1e-12)
    return np.array([[k, 0.0, -k * centre[0]], [0.0, k, -k * centre[1]], [0.0, 0.0, 1.0]])


def direct_linear_transform(m_ref: Array, m_current: Array) -> Array:
    """Return H (3, 3) from m_current x (H m_ref) = 0, least squares in Hartley's coordinates."""
    T_ref, T_cur = hartley(m_ref), hartley(m_current)
    x = np.column_stack([m_ref, np.ones(len(m_ref))]) @ T_ref.T
    y = np.column_stack([m_current, np.ones(len(m_current))]) @ T_cur.T
    A = np.zeros((2 * len(x), 9))
    A[0::2, 3:6] = -x
    A[0::2, 6:9] = y[:, 1:2] * x
    A[1::2, 0:3] = x
    A[1::2, 6:9] = -y[:, 0:1] * x
    _, singular, Vt = np.linalg.svd(A, full_matrices=True)
    if not singular[7] > 1e-10 * singular[0]:
        raise NoHomographyError(
            f"homography 'planar': the {len(x)} points coincide or lie on one line, "
            "expected points that are spread over a surface; match other features"
        )
    return np.asarray(np.linalg.solve(T_cur, Vt[8].reshape(3, 3) @ T_ref))


def transfer_distance(H: Array, m_ref: Array, m_current: Array) -> Array:
    """Return |pi(H m_ref) - m_current| (n,); infinite for a point that H sends behind the camera."""
    x = np.column_stack([m_ref, np.ones(len(m_ref))]) @ H.T
    front = x[:, 2] > 1e-9
    z = np.where(front, x[:, 2], 1.0)
    distance = np.linalg.norm(x[:, :2] / z[:, None] - m_current, axis=1)
    return np.asarray(np.where(front, distance, np.inf))


def robust_inliers(m_ref: Array, m_current: Array, threshold: float) -> NDArray[np.bool_]:
    """Return which points (n,) lie on the plane that OpenCV's USAC (MAGSAC) finds; it has a fixed seed.

    The search runs in units in which the threshold is a few pixels, for which OpenCV's constants are made,
    and one fit to all points within the threshold widens what it keeps.
    """
    if len(m_ref) == LEAST_POINTS:
        return np.ones(LEAST_POINTS, dtype=np.bool_)
    unit = THRESHOLD / threshold
    H, _ = cv2.findHomography(
        m_ref * unit, m_current * unit, cv2.USAC_MAGSAC, THRESHOLD, None, MAX_ITERATIONS, CONFIDENCE
    )
    if H is None:
        return np.zeros(len(m_ref), dtype=np.bool_)
    back = np.diag([1.0 / unit, 1.0 / unit, 1.0])
    G = scaled_homography(back @ H @ np.linalg.inv(back), m_ref, m_current)
    inliers = transfer_distance(G, m_ref, m_current) < threshold
    if np.count_nonzero(inliers) <= LEAST_POINTS:
        return np.asarray(inliers)
    try:
        G = scaled_homography(direct_linear_transform(m_ref[inliers], m_current[inliers]), m_ref, m_current)
    except NoHomographyError:
        return np.asarray(inliers)
    return np.asarray(transfer_distance(G, m_ref, m_current) < threshold)


def estimate_planar(
    m_ref: ArrayLike,
    m_current: ArrayLike,
    attitude_sd: float = 0.0,
    *,
    start: HomographyEstimate | None = None,
    noise: float | None = None,
    seed: int = 0,
) -> HomographyEstimate:
    """Estimate the homography of the plane that most points lie on.

    It needs neither `attitude_sd` nor `start`, and its random search has a seed of its own.

    Raises
    ------
    PointShapeError, NonFinitePointsError, TooFewPointsError, NoHomographyError

    """
    a, b = checked_points(m_ref, m_current, "planar", LEAST_POINTS)
    checked_options("planar", attitude_sd, noise)
    level = DEFAULT_NOISE if noise is None else noise
    threshold = THRESHOLD * level
    inliers = robust_inliers(a, b, threshold)
    note = ""
    # Any four points have a homography of their own.
    if np.count_nonzero(inliers) <= LEAST_POINTS < len(a):
        inliers = np.ones(len(a), dtype=np.bool_)
        note = "no plane holds enough of the points; least squares over all of them"
    H = scaled_homography(direct_linear_transform(a[inliers], b[inliers]), a[inliers], b[inliers])
    distance = transfer_distance(H, a, b)
    quality = float(np.mean(np.maximum(0.0, 1.0 - (distance / threshold) ** 2)))
    return HomographyEstimate(H=H, method="planar", quality=quality, inliers=inliers, note=note, noise=level)
