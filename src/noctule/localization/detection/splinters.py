"""Pieces of one thing: holes in the depth part a drone's rotors from its body, so its blob is splintered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.geometry import Array
from noctule.vision.depth.blob import Blob

MIN_AREA = 15  # [px], of a piece: rotors far from the camera are small
REACH = 0.30  # [m], from the middle of the thing to that of a splinter, seen from above
HEIGHT = 0.13  # [m], between their mean altitudes
LARGEST = 0.03  # [m^2], a splinter is smaller than this
_SHARE = 0.5  # and than this share of the piece that it belongs to

Labels = NDArray[np.uint16]


def join_splinters(blobs: Sequence[Blob], camera: FixedCamera) -> tuple[tuple[Blob, ...], Mapping[int, int]]:
    """Join small blobs with the larger one that they lie beside, at its height.

    Returns the blobs that are left, in the order given, each with its splinters counted in and with the label
    of its largest piece; and, for each splinter, label -> label of the blob that it is part of.
    """
    if len(blobs) < 2:
        return tuple(blobs), {}
    focal = camera.intrinsics.focal
    middles = np.array([b.points for b in blobs]) @ camera.R_world_camera.T
    surfaces = [b.area * b.depth**2 / (focal[0] * focal[1]) for b in blobs]
    members: dict[int, list[int]] = {}
    for i in sorted(range(len(blobs)), key=lambda k: -surfaces[k]):
        near = [
            (float(np.hypot(*(middles[i, :2] - middles[k, :2]))), k)
            for k in members
            if surfaces[i] < min(LARGEST, _SHARE * surfaces[k])
            and abs(middles[i, 2] - middles[k, 2]) < HEIGHT
        ]
        distance, owner = min(near, default=(np.inf, -1))
        if distance < REACH:
            members[owner].append(i)
        else:
            members[i] = [i]
    joined = tuple(_join([blobs[k] for k in members[i]]) for i in sorted(members))
    parts = {blobs[k].label: blobs[i].label for i, pieces in members.items() for k in pieces[1:]}
    return joined, parts


def relabel(labels: Labels, blobs: Sequence[Blob], parts: Mapping[int, int]) -> Labels:
    """Return the label image (h, w) with every splinter of `blobs` under the label of what it is part of."""
    if not parts:
        return labels
    changed = labels.copy()
    for blob in blobs:
        if blob.label in parts:
            box = np.s_[blob.top : blob.bottom, blob.left : blob.right]
            changed[box][labels[box] == blob.label] = parts[blob.label]
    return changed


def _join(pieces: Sequence[Blob]) -> Blob:
    if len(pieces) == 1:
        return pieces[0]
    areas = np.array([float(p.area) for p in pieces])
    weights = areas / areas.sum()
    centroid = weights @ np.array([p.centroid for p in pieces])
    points = weights @ np.array([p.points for p in pieces])
    return Blob(
        pieces[0].label,
        sum(p.area for p in pieces),
        min(p.left for p in pieces),
        min(p.top for p in pieces),
        max(p.right for p in pieces),
        max(p.bottom for p in pieces),
        centroid,
        np.sum([_about(p, centroid) for p in pieces], axis=0),
        points,
        float(points[2]),
    )


def _about(blob: Blob, centre: Array) -> Array:
    """Return the moments (7,) of a blob about another point (2,) [px]: the parallel axis theorem."""
    a, b = (float(d) for d in blob.centroid - centre)
    mu20, mu11, mu02, mu30, mu21, mu12, mu03 = (float(m) for m in blob.moments)
    n = float(blob.area)
    return np.array(
        [
            mu20 + n * a * a,
            mu11 + n * a * b,
            mu02 + n * b * b,
            mu30 + 3.0 * a * mu20 + n * a**3,
            mu21 + 2.0 * a * mu11 + b * mu20 + n * a * a * b,
            mu12 + 2.0 * b * mu11 + a * mu02 + n * a * b * b,
            mu03 + 3.0 * b * mu02 + n * b**3,
        ]
    )
