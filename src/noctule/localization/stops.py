"""Where rays stop in the drone's body: what it looks like from any side, nose and tail apart.

The body is cells in layers; each stops a ray that reaches it with a probability of its own, rotors seldom.
That is learned by counting, from rays of frames whose poses are known, and is the same whatever side they
come from: what the near rim of a hull hides, and how much of its flank is seen, follows. The log-likelihood
of a frame for the heading held, against the half turn, is then a sum over its rays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.geometry import Array, Pose
from noctule.localization.gathering import Map
from noctule.localization.stopping import count_stops, to_body, weigh_stops
from noctule.messages import DepthFrame

BOTTOM, LAYER, LAYERS = -0.05, 0.01, 10  # [m], [m] of a small quadrotor, over its origin
_RAYS = 100.0  # that a top view alone counts for, in each cell
_BLUR = 0.7  # [cells], of the counts: poses and depths err by about as much
_PRIOR, _USUAL = 2.0, 0.3  # rays that a cell counts for before it was seen, and how many of them stop
_LEAST, _MOST = 0.02, 0.95  # probabilities of stopping: bound what one ray can say
_TELLING_BLUR = 1.0  # [cells]
# differences of probability between nose and tail that tell, beside one that is clear: where the axis that
# the halves are turned about is off by a millimetre, all edges differ by a tenth
_TELLING, _CLEAR = 0.1, 0.2
_KNOWN = 30.0  # rays, in a cell and its neighbours' place, that tell
_STEEPEST = 0.7  # slope of a ray, against the body's z, that is still followed through all of them
_TOGETHER = 12.0  # neighbouring pixels that err as one


@dataclass(frozen=True, slots=True)
class Stops:
    """Rays counted in the cells of a body: index [i, j, k] along x (forward), y (left), z (up)."""

    cell: float  # [m]
    bottom: float  # [m], of the lowest layer, over the body's origin
    layer: float  # [m]
    hits: Map  # (n, n, m), rays that stopped in the cell
    passes: Map  # (n, n, m), rays that went on

    @classmethod
    def of_samples(
        cls,
        samples: Sequence[tuple[DepthFrame, Pose]],
        nearest: NDArray[np.uint16],
        camera: FixedCamera,
        cell: float,
        n: int,
    ) -> Stops:
        """Count the rays of frames at the drone's poses, in layers of n x n cells of `cell` [m]."""
        hits, passes = np.zeros((2, n, n, LAYERS), np.float32)
        for frame, pose in samples:
            E = _to_body(camera, pose)
            count_stops(frame.depth, nearest, _pinhole(camera), E, cell, LAYER, BOTTOM, hits, passes)
        return cls(cell, BOTTOM, LAYER, hits, passes)

    @classmethod
    def of_top_view(cls, cell: float, probability: Map, height: Map, weight: Map) -> Stops:
        """Suppose that the cells of a top view (n, n) stop rays at their surface's `height` [m] alone.

        For want of frames: flanks are not known.
        """
        k = np.clip(np.floor((height - BOTTOM) / LAYER), 0, LAYERS - 1)[..., None]
        p = np.where((height != 0.0) & (probability > 0.1), probability, 0.0)[..., None]
        layers = np.arange(LAYERS)
        reached = _RAYS * weight[..., None] * np.where(layers > k, 1.0, np.where(layers == k, 1.0, 1.0 - p))
        hits = reached * np.where(layers == k, p, 0.0)
        return cls(cell, BOTTOM, LAYER, hits.astype(np.float32), (reached - hits).astype(np.float32))


@dataclass(frozen=True, slots=True)
class NoseOrTail:
    """The cells of a body in which it differs from its half turn, and what a ray says there."""

    stops: Stops
    box: Array  # (3, 2) [m], low and high along x, y, z of these cells; empty when there are none
    weights: Map  # (a, b, m, 2), log-likelihood ratio of a ray that passes, and of one that stops there
    crossed: NDArray[np.bool_]  # (a, b), where a ray crosses the middle layer that can meet such a cell

    @classmethod
    def of(cls, stops: Stops) -> NoseOrTail:
        """Find them.

        What hardly differs, like the rims of a hull, differs more from view to view than from nose to tail.
        """
        hits, rays = (_blurred(a, _BLUR) for a in (stops.hits, stops.hits + stops.passes))
        p = np.clip((hits + _PRIOR * _USUAL) / (rays + _PRIOR), _LEAST, _MOST)
        logs = np.stack([np.log1p(-p), np.log(p)], axis=-1)
        rays = _blurred(rays, _TELLING_BLUR)
        share = _blurred(hits, _TELLING_BLUR) / np.maximum(rays, 1e-3)
        known = (rays > _KNOWN) & (_around(rays) > _KNOWN)
        difference = np.where(known, np.abs(share - _around(share)), 0.0)
        tells = (difference > _TELLING) & _beside(difference > _CLEAR, difference > _TELLING)
        weights = np.where(tells[..., None], logs - _around(logs), 0.0).astype(np.float32)
        if not tells.any():
            return cls(stops, np.zeros((3, 2)), weights[:0], tells[:0, :, 0])
        first, past = (np.array([f(axis) for axis in np.nonzero(tells)]) for f in (np.min, np.max))
        past += 1
        reach = math.ceil(_STEEPEST * 0.5 * (past[2] - first[2]) * stops.layer / stops.cell)
        first[:2] = np.maximum(first[:2] - reach, 0)
        past = np.minimum(past + np.array([reach, reach, 0]), tells.shape)
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
        crossed = cv2.dilate(np.asarray(tells.any(axis=2), dtype=np.uint8), disc) > 0
        part = tuple(slice(i, j) for i, j in zip(first, past, strict=True))
        half = 0.5 * len(stops.hits) * stops.cell
        low, size = np.array([-half, -half, stops.bottom]), np.array([stops.cell, stops.cell, stops.layer])
        box = np.column_stack([low + size * first, low + size * past])
        return cls(stops, box, np.ascontiguousarray(weights[part]), np.ascontiguousarray(crossed[part[:2]]))

    def evidence(
        self, depth: NDArray[np.uint16], nearest: NDArray[np.uint16], camera: FixedCamera, pose: Pose
    ) -> float:
        """Return the log-likelihood ratio of a pose against its half turn, of one frame.

        `depth`, `nearest` (h, w) [mm]. The half turn is about the body's origin, where its halves are alike:
        two poses refined apart differ by more than nose and tail do.
        """
        s = self.stops
        if not len(self.weights):
            return 0.0
        high = s.bottom + s.hits.shape[2] * s.layer
        E = _to_body(camera, pose)
        total = weigh_stops(
            depth, nearest, _pinhole(camera), E, s.cell, s.layer, s.bottom, high, self.box, self.weights,
            self.crossed,
        )  # fmt: skip
        return total / _TOGETHER


def _to_body(camera: FixedCamera, pose: Pose) -> Array:
    return to_body(camera.R_world_camera, camera.t_world_camera, pose.R_world_body, pose.position)


def _pinhole(camera: FixedCamera) -> tuple[float, float, float, float]:
    k = camera.intrinsics
    return k.fx, k.fy, k.cx, k.cy


def _around(cells: Array) -> Array:
    """Return the cells half a turn about the body's z."""
    return cells[::-1, ::-1]


def _beside(clear: NDArray[np.bool_], perhaps: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the columns (n, n, 1) of `perhaps` (n, n, m) that hang together with one of `clear`."""
    _, pieces = cv2.connectedComponents(np.asarray(perhaps.any(axis=2), dtype=np.uint8))
    held = np.unique(np.asarray(pieces)[clear.any(axis=2)])
    return np.asarray(np.isin(pieces, held[held > 0])[..., None])


def _blurred(cells: NDArray[Any], sd: float) -> Array:
    """Return cells (n, n, m) blurred along all three axes; beyond them is nothing."""
    size = 2 * round(3.0 * sd) + 1
    kernel = cv2.getGaussianKernel(size, sd)
    one = np.ones((1, 1))
    out = cells.astype(np.float64)
    n, _, m = out.shape
    flat = cv2.sepFilter2D(out.reshape(n, n * m), -1, one, kernel, borderType=cv2.BORDER_CONSTANT)
    rows = flat.reshape(n, n, m)
    columns = [cv2.sepFilter2D(row, -1, kernel, kernel, borderType=cv2.BORDER_CONSTANT) for row in rows]
    return np.asarray(np.stack(columns))
