"""Detection by area cubics: the drone's area as a function of its altitude lies between two polynomials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyval

from noctule.camera import FixedCamera
from noctule.geometry import Array
from noctule.localization.detection.detector import blob_altitude
from noctule.localization.detection.samples import FlightSamples, check_samples
from noctule.localization.detection.splinters import join_splinters
from noctule.vision.depth.blob import Blob

_DEGREE = 3
_STEPS = 60  # of the descent on the pinball loss; it moves less than a pixel long before
_SHARPNESS = 1e-3  # residuals below this share of the area count as zero
_LEAST_GAP = 0.1  # of the mean area at an altitude, between g2 and g1


@dataclass(frozen=True, slots=True)
class AreaCubics:
    """Accepts a blob if g2(z) < area < g1(z), inside the altitudes that were flown.

    Section 3.1.2 of Santos et al., corrected: g1 is the maximum, g2 the minimum, and the printed rule
    accepts only areas below both. Nothing is extrapolated: outside of the range nothing is accepted.
    """

    name: ClassVar[str] = "cubics"
    g1: Array  # (4,) [px], coefficients of 1, z, z^2, z^3 with z in [m]: largest area
    g2: Array  # (4,) smallest area
    lowest: float  # [m], of the altitudes that the fit holds for
    highest: float  # [m]

    def limits(self, altitude: Array) -> tuple[Array, Array]:
        """Return the smallest and the largest area (n,) [px] at altitudes (n,) [m], NaN outside the range."""
        altitude = np.asarray(altitude, dtype=np.float64)
        inside = (altitude >= self.lowest) & (altitude <= self.highest)
        z = np.where(inside, altitude, np.nan)
        return np.asarray(polyval(z, self.g2)), np.asarray(polyval(z, self.g1))

    def propose(self, blobs: Sequence[Blob], camera: FixedCamera) -> tuple[Blob, ...]:
        """Return the blobs whose area lies between the cubics at their altitude."""
        blobs, _ = join_splinters(blobs, camera)
        if not blobs:
            return ()
        low, high = self.limits(np.array([blob_altitude(blob, camera) for blob in blobs]))
        return tuple(b for b, g2, g1 in zip(blobs, low, high, strict=True) if g2 < b.area < g1)


def fit_cubics(samples: FlightSamples, share: float = 0.98, margin: float = 0.05) -> AreaCubics:
    """Fit both cubics on a manual flight.

    Quantiles, not extremes: one bad frame moves a maximum, not a quantile, and fitted extremes cross. `share`
    of the samples lie between the quantiles; `margin` (a share of the area) is added on both sides for what
    the flight did not show. g2 < g1 holds over the whole range. Raises as `check_samples`.
    """
    check_samples(samples)
    lowest, highest = (float(z) for z in np.quantile(samples.altitude, [0.005, 0.995]))
    kept = (samples.altitude >= lowest) & (samples.altitude <= highest)
    z, area = samples.altitude[kept], samples.area[kept]
    g1 = (1.0 + margin) * quantile_cubic(z, area, 0.5 + 0.5 * share)
    g2 = (1.0 - margin) * quantile_cubic(z, area, 0.5 - 0.5 * share)
    # Where samples are thin two quantile curves may meet. Moving both by a constant parts them for certain.
    mean = (g1 + g2) * 0.5
    short = -_least(g1 - g2 - _LEAST_GAP * mean, lowest, highest)
    if short > 0.0:
        g1, g2 = g1 + 0.5 * short, g2 - 0.5 * short
    return AreaCubics(_coefficients(g1), _coefficients(g2), lowest, highest)


def quantile_cubic(x: Array, y: Array, quantile: float) -> Polynomial:
    """Return the cubic with `quantile` of the positive values `y` (n,) below it, by regression on `x` (n,).

    Minimises the pinball loss of residuals relative to the trend by reweighted least squares (Hunter and
    Lange, 2000, "Quantile regression via an MM algorithm"). The relative ones, because the spread of an area
    grows with the area.
    """
    trend = np.maximum(Polynomial.fit(x, y, _DEGREE)(x), 0.1 * float(np.median(y)))
    cubic = Polynomial.fit(x, y, _DEGREE, w=1.0 / trend)
    for _ in range(_STEPS):
        spread = _SHARPNESS + np.abs(y - cubic(x)) / trend
        pulled = y + (2.0 * quantile - 1.0) * spread * trend
        cubic = Polynomial.fit(x, pulled, _DEGREE, w=1.0 / (np.sqrt(spread) * trend))
    return cubic.convert()


def _coefficients(cubic: Polynomial) -> Array:
    return np.pad(cubic.coef, (0, _DEGREE + 1 - len(cubic.coef)))


def _least(cubic: Polynomial, low: float, high: float) -> float:
    """Return the exact minimum of a polynomial over [low, high]."""
    turns = cubic.deriv().roots()
    turns = turns[np.abs(turns.imag) < 1e-9].real
    inside = turns[(turns > low) & (turns < high)]
    return float(np.min(cubic(np.concatenate([[low, high], inside]))))
