"""A template with what the search for it needs, worked out once."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.geometry import Array
from noctule.localization import fitting, scoring
from noctule.localization.evidence import Grid, Map
from noctule.localization.template import Template

BLOCK = 0.04  # [m], side of the blocks of cells of the coarse search, and its step
MARGIN = 0.06  # [m], the evidence reaches this far beyond the template's own cells
_REACH = 3  # cells around the template's edges that may belong to them
_STEEP = 0.02  # change of the probability from cell to cell that makes an edge
_STEPS = 8  # of the refinement at most
TILT_SD = math.radians(3.0)  # how far the tilt may be from the predicted one
SURFACE_SD = 0.02  # [m], of one cell's height; cells err together, so this is more than their spread
_RELIEF_SD, _RELIEF_STEP = 0.004, 0.0014  # [m], [1/m], of one cell's height: the shape's part, and the sensor's
_TELLING, _TELLING_HEIGHT = 0.3, 0.007  # differences of probability and height [m] that tell nose from tail
_OUTLINE_SHARE = np.float32(0.5)  # neighbouring cells of an outline err together, more than heights do
_USUAL_DISTANCE = 2.0  # [m], from the camera, for the evidence that counts as usual

Seen = tuple[Map, Map, Map, Map]


@dataclass(frozen=True, slots=True)
class Matcher:
    """What `registration` lays over the evidence."""

    template: Template
    grid: Grid  # in which evidence is gathered
    expected: Map  # (n, n), expected log-likelihood ratio of a cell that is seen
    solid: Map  # (n, n), weight of a cell's height
    edges: NDArray[np.uint8]  # (n, n), 1 near the template's edges
    block: int  # cells along a side of a block
    coarse_drone: Map  # (n, n), log-likelihood ratios, blurred as the blocks are
    coarse_free: Map
    seen: float  # weight of all cells
    telling: Map  # (n, n), weight of a cell's outline for the half turn
    telling_solid: Map  # (n, n), weight of a cell's height for the half turn
    half_turn: float  # by how much these grow when the template itself is turned by pi

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
        half = math.ceil(used + MARGIN / cell)
        solid = np.asarray(np.where((p > 0.3) & (template.height != 0.0), p, 0.0), dtype=np.float32)
        matcher = cls(
            template,
            Grid(cell, 2 * half, template.grid.plane),
            np.asarray(p * template.log_drone + (1.0 - p) * template.log_free, dtype=np.float32),
            solid,
            np.asarray(edges),
            block,
            np.asarray(cv2.blur(template.log_drone, (block, block)), dtype=np.float32),
            np.asarray(cv2.blur(template.log_free, (block, block)), dtype=np.float32),
            float(template.weight.sum()),
            *_telling(template, solid),
            0.0,
        )
        # Itself, seen in full and without noise.
        here = np.zeros(3)
        seen = (p, template.weight, p, np.asarray(p * template.height, dtype=np.float32))
        turned, _ = matcher.refine(p, template.weight, np.array([0.0, 0.0, math.pi]))
        loss = matcher.contrast(seen, turned, matcher.surface(p, seen[3], turned)[0], _USUAL_DISTANCE)
        return replace(matcher, half_turn=loss - matcher.contrast(seen, here, here, _USUAL_DISTANCE))

    def search(self, share: Map, trust: Map, headings: Array, reach: int) -> tuple[Array, Array]:
        """Return for each heading [rad] the best of shifts up to `reach` steps, (k, 3), and its score (k,)."""
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

    def refine(self, share: Map, trust: Map, start: Array) -> tuple[Array, Array]:
        """Return x, y [m], heading [rad] of the template near `start` (3,), and the information (3, 3)."""
        t = self.template
        information, pose = np.zeros((3, 3)), start.copy()
        fitting.refine(
            share, trust, t.probability, t.variance, self.edges, t.grid.cell, pose, _STEPS, information
        )
        return pose, information

    def judge(self, share: Map, trust: Map, pose: Array) -> tuple[float, float, float]:
        """Return score, score expected of the seen cells, and their weight, of a pose (3,) in the evidence."""
        t = self.template
        return scoring.judge(
            share, trust, t.log_drone, t.log_free, self.expected, t.weight, t.grid.cell, pose
        )

    def surface(self, drone: Map, height: Map, pose: Array) -> tuple[Array, float]:
        """Return height offset [m] and slopes of the seen surface against the template's, (3,), and cells used."""
        t = self.template
        out = np.zeros(3)
        cells = fitting.fit_surface(
            drone, height, self.solid, t.height, t.grid.cell, pose, (SURFACE_SD / TILT_SD) ** 2, out
        )
        return out, cells

    def misfits(self, seen: Seen, pose: Array, surface: Array, distance: float) -> tuple[float, float]:
        """Return how badly outline and surface of the template fit at a pose (3,), per cell seen.

        `seen` is share, trust, drone and height of the cells, `distance` [m] that from the camera along its axis.
        Half is usual where the errors are those that the template was learned with.
        """
        t = self.template
        outline, relief, cells = self._misfit(seen, t.weight, self.solid, pose, surface, distance)
        weight = self.judge(seen[0], seen[1], pose)[2]
        return outline / max(weight, 1.0), relief / max(cells, 1.0)

    def contrast(self, seen: Seen, pose: Array, surface: Array, distance: float) -> float:
        """Return the misfit of the cells that tell a heading from its half turn."""
        outline, relief, _ = self._misfit(seen, self.telling, self.telling_solid, pose, surface, distance)
        return outline + relief

    def _misfit(
        self, seen: Seen, weight: Map, solid: Map, pose: Array, surface: Array, distance: float
    ) -> tuple[float, float, float]:
        t = self.template
        sd = math.hypot(_RELIEF_SD, _RELIEF_STEP * distance**2)
        return fitting.misfit(
            *seen, t.probability, t.variance, weight, solid, t.height, t.grid.cell, pose, surface, sd
        )


def _telling(template: Template, solid: Map) -> tuple[Map, Map]:
    """Return the weights of the cells that differ from those half a turn away, outline and surface.

    What hardly differs, like the rims of a hull, differs more from view to view than from nose to tail.
    """
    p, h = template.probability, template.height
    outline = template.weight * (np.abs(p - p[::-1, ::-1]) > _TELLING)
    differs = (np.abs(h - h[::-1, ::-1]) > _TELLING_HEIGHT) & (solid > 0.0) & (solid[::-1, ::-1] > 0.0)
    return _OUTLINE_SHARE * outline.astype(np.float32), solid * differs.astype(np.float32)
