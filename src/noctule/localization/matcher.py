"""A template with what the search for it needs, worked out once."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.geometry import Array, Pose
from noctule.localization import fitting, misfit, placing, scoring
from noctule.localization.evidence import Evidence, Grid, Map
from noctule.localization.placing import SURFACE_SD
from noctule.localization.stops import NoseOrTail
from noctule.localization.template import Template

BLOCK = 0.04  # [m], side of the blocks of cells of the coarse search, and its step
# [m], the evidence reaches this far beyond the template's cells, tracking and searching
MARGIN, WIDE = 0.03, 0.1
_REACH = 2  # cells around the template's edges that may belong to them
_STEEP = 0.03  # change of the probability from cell to cell that makes an edge
_STEPS = 8  # of the refinement at most
TILT_SD = math.radians(3.0)  # how far the tilt may be from the predicted one
_HOLD = (SURFACE_SD / TILT_SD) ** 2
# [m], [1/m], of one cell's height: the shape's part, and the sensor's
_RELIEF_SD, _RELIEF_STEP = 0.004, 0.0014
_TELLING, _TELLING_HEIGHT = 0.3, 0.007  # differences of probability and height [m] that tell quarter turns
_OUTLINE_SHARE = 0.5  # neighbouring cells of an outline err together, more than heights do


@dataclass(frozen=True, slots=True)
class Fit:
    """How well a template fits at a pose, and the surface that is seen there."""

    score: float  # sum of log-likelihood ratios
    nominal: float  # what the seen cells would score if the pose were right
    seen: float  # weight of the seen cells
    outline: float  # misfit, per cell seen
    relief: float  # misfit of the surface, per cell
    cells: float  # used for the surface
    surface: Array  # (3,) height offset [m] and slopes against the template's


@dataclass(frozen=True, slots=True)
class Matcher:
    """What `registration` lays over the evidence."""

    template: Template
    grid: Grid  # in which evidence is gathered while tracking
    wide: Grid  # in which it is gathered to search
    cells: Map  # (n, n, 8), all that `misfit.assess` needs of a cell
    solid: Map  # (n, n), weight of a cell's height
    edges: NDArray[np.uint8]  # (n, n), 1 near the template's edges
    block: int  # cells along a side of a block
    coarse_drone: Map  # (n, n), log-likelihood ratios, blurred as the blocks are
    coarse_free: Map
    seen: float  # weight of all cells
    telling: Array  # (k, 6), cells that tell the quarter turns, as in `misfit.contrast`
    nose_or_tail: NoseOrTail  # what tells the half turn
    astray: Array  # (2, 3), what a fit with the wrong heading is off by: x, y [m], heading [rad]; surface

    @classmethod
    def of(cls, template: Template) -> Matcher:
        """Prepare a template."""
        p, cell = template.probability, template.grid.cell
        gx, gy = np.gradient(p)
        kernel = np.ones((2 * _REACH + 1, 2 * _REACH + 1), np.uint8)
        edges = cv2.dilate((np.hypot(gx, gy) > _STEEP).astype(np.uint8), kernel)
        block = max(1, round(BLOCK / cell))
        i, j = np.nonzero(template.weight)
        used = np.abs(np.concatenate([i, j]) - 0.5 * (template.grid.n - 1)).max() + 0.5
        near, wide = (2 * math.ceil(used + margin / cell) for margin in (MARGIN, WIDE))
        solid = np.asarray(np.where((p > 0.3) & (template.height != 0.0), p, 0.0), dtype=np.float32)
        matcher = cls(
            template,
            Grid(cell, near, template.grid.plane),
            Grid(cell, wide, template.grid.plane),
            _cells(template, solid),
            solid,
            np.asarray(edges),
            block,
            np.asarray(cv2.blur(template.log_drone, (block, block)), dtype=np.float32),
            np.asarray(cv2.blur(template.log_free, (block, block)), dtype=np.float32),
            float(template.weight.sum()),
            _telling(template, solid),
            NoseOrTail.of(template.stops),
            np.zeros((2, 3)),
        )
        # Turned around over itself, seen in full.
        at, _ = matcher.refine(p, template.weight, np.array([0.0, 0.0, math.pi]))
        surface = matcher._surface(p, np.asarray(p * template.height, dtype=np.float32), at)
        return replace(matcher, astray=np.array([[-at[0], -at[1], at[2] - math.pi], surface]))

    def search(self, share: Map, trust: Map, headings: Array, reach: int) -> tuple[Array, Array]:
        """Return for each heading [rad] the best shift up to `reach` steps, (k, 3), and scores (k,)."""
        points = np.empty(((len(share) // self.block) ** 2, 4))
        points = points[: scoring.blocks(share, trust, self.block, self.template.grid.cell, points)]
        side = 2 * reach + 1
        scores = np.empty((len(headings), side, side))
        cell = self.template.grid.cell
        scoring.correlate(
            points, self.coarse_drone, self.coarse_free, cell, headings, self.block, reach, scores
        )
        flat = scores.reshape(len(headings), -1)
        best = flat.argmax(axis=1)
        x, y = (best // side - reach) * self.block * cell, (best % side - reach) * self.block * cell
        c, s = np.cos(headings), np.sin(headings)
        return np.column_stack([c * x - s * y, s * x + c * y, headings]), flat.max(axis=1)

    def refine(self, share: Map, trust: Map, start: Array, steps: int = _STEPS) -> tuple[Array, Array]:
        """Return x, y [m], heading [rad] of the template near `start` (3,), and the information (3, 3)."""
        t = self.template
        information, pose = np.zeros((3, 3)), start.copy()
        fitting.refine(
            share, trust, t.probability, t.variance, self.edges, t.grid.cell, pose, steps, information
        )
        return pose, information

    def assess(self, seen: Evidence, pose: Array) -> Fit:
        """Return how well the template fits at a pose (3,)."""
        surface = np.zeros(3)
        fit = misfit.assess(
            seen.share, seen.trust, seen.drone, seen.height, self.cells, self.template.grid.cell, pose, _HOLD,
            _relief_sd(seen.distance), surface,
        )  # fmt: skip
        return Fit(*fit, surface)

    def quarter_contrast(self, seen: Evidence, pose: Array) -> float:
        """Return the misfit at a pose (3,) of the cells that tell it from its quarter turns."""
        return misfit.contrast(
            seen.share, seen.trust, seen.drone, seen.height, self.telling, self.template.grid.cell, pose,
            self._surface(seen.drone, seen.height, pose), _relief_sd(seen.distance),
        )  # fmt: skip

    def against_half_turn(
        self, depth: NDArray[np.uint16], nearest: NDArray[np.uint16], camera: FixedCamera, pose: Pose
    ) -> float:
        """Return the log-likelihood ratio of a pose that was found against its half turn.

        With the wrong heading it was found a little astray, where that fits best; asked half way back from
        there, right and wrong are off by the same and say as much.
        """
        x, y, z, yaw, roll, pitch = placing.moved(
            pose.R_world_body, pose.position, -0.5 * self.astray[0], -0.5 * self.astray[1]
        )
        between = Pose(np.array([x, y, z]), yaw, roll, pitch)
        return self.nose_or_tail.evidence(depth, nearest, camera, between)

    def _surface(self, drone: Map, height: Map, pose: Array) -> Array:
        t, out, cells = self.template, np.zeros(3), np.empty((drone.size, 4))
        count = fitting.surface_cells(drone, height, self.solid, t.height, t.grid.cell, pose, cells)
        fitting.fit_surface(cells[:count], _HOLD, out)
        return out


def _relief_sd(distance: float) -> float:
    return math.hypot(_RELIEF_SD, _RELIEF_STEP * distance**2)


def _cells(template: Template, solid: Map) -> Map:
    t, p = template, template.probability
    cells = np.zeros((*p.shape, 8), dtype=np.float32)
    cells[..., misfit.LOG_DRONE], cells[..., misfit.LOG_FREE] = t.log_drone, t.log_free
    cells[..., misfit.EXPECTED] = p * t.log_drone + (1.0 - p) * t.log_free
    cells[..., misfit.WEIGHT], cells[..., misfit.PROBABILITY] = t.weight, p
    cells[..., misfit.CERTAINTY] = t.weight / (t.variance + fitting.FLOOR)
    cells[..., misfit.SOLID], cells[..., misfit.HEIGHT] = solid, t.height
    return cells


def _telling(template: Template, solid: Map) -> Array:
    """Return the cells that differ from those some quarter turns away, (k, 6) as in `misfit.contrast`.

    What hardly differs, like the rims of a hull, differs more from view to view than from turn to turn.
    """
    p, h = template.probability, template.height
    outline, relief = np.zeros(p.shape, dtype=np.bool_), np.zeros(p.shape, dtype=np.bool_)
    for k in (1, 2, 3):
        there = (solid > 0.0) & (np.rot90(solid, k) > 0.0)
        outline |= np.abs(p - np.rot90(p, k)) > _TELLING
        relief |= there & (np.abs(h - np.rot90(h, k)) > _TELLING_HEIGHT)
    # The same places count whichever of the headings is supposed.
    places = np.logical_or.reduce([np.rot90(outline, k) for k in range(4)])
    tops = np.logical_or.reduce([np.rot90(relief, k) for k in range(4)])
    known = np.logical_and.reduce([np.rot90(template.weight, k) > 0.0 for k in range(4)])
    i, j = np.nonzero((places & known) | tops)
    sure = _OUTLINE_SHARE * (places & known)[i, j] / (template.variance[i, j] + fitting.FLOOR)
    x, y = ((k + 0.5 - 0.5 * len(p)) * template.grid.cell for k in (i, j))
    return np.column_stack([x, y, p[i, j], h[i, j], sure, (solid * tops)[i, j]]).astype(np.float64)
