"""The shape of a blob: its inertial ellipse, Hu's invariants, and how far two shapes are apart.

Central moments come in the order of `Blob.moments`: mu20, mu11, mu02, mu30, mu21, mu12, mu03. Angles are the
image's: from u (right) toward v (down).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from noctule.geometry import Array
from noctule.vision.depth.blob import Blob

_ORDER = np.array([2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0])  # p + q


@dataclass(frozen=True, slots=True)
class Ellipse:
    """The ellipse with the same second moments; its major axis has no direction."""

    a: float  # [px], semi-major axis
    b: float  # [px], semi-minor axis
    theta: float  # [rad], of the major axis, -pi/2 to pi/2


def ellipse(blob: Blob) -> Ellipse:
    """Return the inertial ellipse of a blob: eqs. (20) to (24) of Santos et al., corrected.

    (22) is theta = atan2(2 mu11, mu20 - mu02) / 2: as printed it lacks the factor and the quadrant. (23) and
    (24) have a square root on the bracket.
    """
    mu20, mu11, mu02 = (float(m) for m in blob.moments[:3])
    root = math.hypot(mu20 - mu02, 2.0 * mu11)
    major, minor = (mu20 + mu02 + root) / 2.0, (mu20 + mu02 - root) / 2.0
    return Ellipse(
        2.0 * math.sqrt(major / blob.area),
        2.0 * math.sqrt(max(minor, 0.0) / blob.area),  # a line of pixels has none, but for rounding
        0.5 * math.atan2(2.0 * mu11, mu20 - mu02),
    )


def normalised_moments(blob: Blob) -> Array:
    """Return eta_pq = mu_pq / mu00^gamma, (7,), which do not change with the blob's size.

    Eq. (18) of Santos et al., corrected: gamma = (p + q) / 2 + 1.
    """
    return np.asarray(blob.moments / float(blob.area) ** (_ORDER / 2.0 + 1.0))


def hu_moments(blob: Blob) -> Array:
    """Return Hu's seven invariants (7,) of a blob; a mirror image changes the sign of the last one.

    Eq. (17) of Santos et al., corrected after M.-K. Hu, Visual pattern recognition by moment invariants,
    1962: phi2 has the difference n20 - n02, phi5 begins with n30 - 3 n12, and the bracket of phi6 holds both
    squares.
    """
    n20, n11, n02, n30, n21, n12, n03 = (float(n) for n in normalised_moments(blob))
    s, t = n30 + n12, n21 + n03  # the two sums that turn with the blob
    c, d = n30 - 3.0 * n12, 3.0 * n21 - n03  # and three times as fast
    return np.array(
        [
            n20 + n02,
            (n20 - n02) ** 2 + 4.0 * n11**2,
            c**2 + d**2,
            s**2 + t**2,
            c * s * (s**2 - 3.0 * t**2) + d * t * (3.0 * s**2 - t**2),
            (n20 - n02) * (s**2 - t**2) + 4.0 * n11 * s * t,
            d * s * (s**2 - 3.0 * t**2) - c * t * (3.0 * s**2 - t**2),
        ]
    )


def shape_distance(phi_a: Array, phi_b: Array, least: float = 1e-12) -> float:
    """Return how far two shapes are apart by their Hu moments (7,); 0 when they are the same.

    Eq. (16) of Santos et al., corrected: max over i of |m_a - m_b| / |m_a| with m = sgn(phi) log |phi|; not
    symmetric, so `phi_a` is the pattern. An invariant not above `least` is rounding and its sign a coin's: it
    has no say where both shapes have such a one; where one has, it counts as `least` with the other's sign.
    """
    phi = np.stack([phi_a, phi_b]).astype(np.float64)
    tiny = np.abs(phi) <= least
    sign = np.where(tiny, np.sign(phi[::-1]), np.sign(phi))
    m_a, m_b = sign * np.log(np.maximum(np.abs(phi), least))
    apart = np.where(tiny.all(axis=0), 0.0, np.abs(m_a - m_b))
    ratio = np.divide(apart, np.abs(m_a), out=np.full_like(apart, np.inf), where=m_a != 0.0)
    return float(np.max(np.where(apart == 0.0, 0.0, ratio)))
