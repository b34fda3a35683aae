"""A blob: a connected piece of foreground in a depth image."""

from __future__ import annotations

from dataclasses import dataclass

from noctule.geometry import Array


@dataclass(frozen=True, slots=True)
class Blob:
    """A connected piece of the foreground, measured while it was found."""

    label: int  # its value in the label image, from 1
    area: int  # [px]
    left: int  # [px], bounding box; right and bottom lie just outside
    top: int  # [px]
    right: int  # [px]
    bottom: int  # [px]
    centroid: Array  # (2,) [px], u and v
    moments: Array  # (7,) [px^2, px^3 summed] central: mu20, mu11, mu02, mu30, mu21, mu12, mu03, not divided
    points: Array  # (3,) [m], mean of its pixels back-projected, camera coordinates (RDF)
    depth: float  # [m], mean depth of its pixels
