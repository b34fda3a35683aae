"""The drone's top view: how probable it is that a cell of the body, seen from above, is drone.

Learned from frames whose poses are known (or estimated: see `learning`), used by `registration`. The score of
a pose is a sum of log-likelihood ratios over the cells that are seen, `log_drone` where drone is seen and
`log_free` where the camera sees past it, against a thing of which nothing is known (one half everywhere).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.camera import FixedCamera
from noctule.errors import NoctuleError
from noctule.geometry import Array, Pose
from noctule.localization.evidence import FULL, Evidence, Grid, Map, gather
from noctule.localization.fitting import FLOOR
from noctule.localization.stops import Stops
from noctule.messages import DepthFrame

CELL = 0.01  # [m]
SIDE = 0.7  # [m]
PLANES = (-0.045,)
"""Heights over the body's origin [m] tried for that at which a ray counts as free: its underside. Rays that
pass the drone on the near side then end right at it, as do those on the far side at its top. Sharpness alone
would choose heights around the origin (the shadow of the projector takes the free readings of one side), and
positions would be off by 1.5 mm more for every metre from below the camera.
"""
_SURPRISE = 0.04  # share of cells that no template explains: bounds what one cell can say
_SURROUNDINGS = 0.05  # [m], cells this far outside the drone still count as evidence that it ends there
_LEAST_FRAMES = 3  # a cell seen in fewer frames says nothing
_LEAST_AREA = 0.01  # [m^2] that must be drone in most frames


class TemplateError(NoctuleError):
    """A template cannot be made of what was seen, or what was read is not a template."""


@dataclass(frozen=True, slots=True)
class TemplateSums:
    """What was seen so far, in body axes; `add` evidence, `finish` for a template."""

    grid: Grid
    frames: int
    share: Array  # (n, n), sum over frames of how far the cell was drone
    square: Array  # (n, n), sum of its square
    seen: Array  # (n, n), frames that saw the cell
    height: Array  # (n, n) [m], heights over the body's origin, summed over the areas of drone readings
    area: Array  # (n, n), areas of drone readings

    @classmethod
    def empty(cls, cell: float = CELL, side: float = SIDE, plane: float = PLANES[0]) -> TemplateSums:
        """Return sums over nothing; `plane` [m] as in `Grid`."""
        n = round(side / cell)
        zeros = np.zeros((n, n))
        return cls(Grid(cell, n, plane), 0, zeros, zeros, zeros, zeros, zeros)

    def add(self, evidence: Evidence) -> TemplateSums:
        """Return the sums with a frame's evidence, gathered in the same grid around the drone's pose."""
        drone, free = evidence.drone.astype(np.float64), evidence.free.astype(np.float64)
        share = np.minimum(drone / FULL, 1.0)
        return TemplateSums(
            self.grid,
            self.frames + 1,
            self.share + share,
            self.square + share**2,
            self.seen + (drone + free > 0.0),
            self.height + evidence.height,
            self.area + drone,
        )


@dataclass(frozen=True, slots=True)
class Template:
    """The learned top view; maps are (n, n), index [i, j] along the body's x (forward) and y (left)."""

    grid: Grid
    frames: int  # it was learned from
    probability: Map  # that a cell is drone
    variance: Map  # of how far a cell was drone
    height: Map  # [m], of the seen surface over the body's origin; 0 where there is none
    weight: Map  # 1 where the cell is evidence, 0 far outside the drone
    log_drone: Map  # log-likelihood ratio of a drone cell, weighted
    log_free: Map  # log-likelihood ratio of a free cell, weighted
    stops: Stops  # where rays stop in it, in the same cells: of which nose and tail are told apart
    slant: float = 0.0  # [m], what positions seen from aside are off by, as in `placing.slanted`

    @property
    def nominal(self) -> float:
        """The score that is expected when every cell is seen."""
        p = self.probability
        return float((p * self.log_drone + (1.0 - p) * self.log_free).sum())

    @property
    def sharpness(self) -> float:
        """How well the template's edges hold it, the information about a shift [1 / cell^2]."""
        gx, gy = np.gradient(self.probability)
        return float(((gx**2 + gy**2) / (self.variance + FLOOR)).sum())

    @property
    def extent(self) -> float:
        """The largest distance of a cell that is probably drone from the origin, [m]."""
        i, j = np.nonzero(self.probability > 0.5)
        middle = 0.5 * (self.grid.n - 1)
        return float(np.hypot(i - middle, j - middle).max() * self.grid.cell)

    @property
    def surface(self) -> float:
        """The mean height of the seen surface over the body's origin, [m]: what a blob's mean point is at."""
        return float(np.average(self.height, weights=np.where(self.height != 0.0, self.probability, 0.0)))

    def arrays(self) -> dict[str, Array]:
        """Return what `from_arrays` needs, as plain arrays (for an .npz file)."""
        return {
            "grid": np.array([self.grid.cell, self.grid.plane]),
            "frames": np.array([float(self.frames)]),
            "probability": self.probability.astype(np.float64),
            "variance": self.variance.astype(np.float64),
            "height": self.height.astype(np.float64),
            "weight": self.weight.astype(np.float64),
            "layers": np.array([self.stops.bottom, self.stops.layer]),
            "hits": self.stops.hits.astype(np.float64),
            "passes": self.stops.passes.astype(np.float64),
            "slant": np.array([self.slant]),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array]) -> Template:
        """Make a template of what `arrays` returned; raises TemplateError when it is something else.

        Templates from before rays were counted have no layers: their top view is taken for a body.
        """
        needed = ("grid", "frames", "probability", "variance", "height", "weight")
        missing = [name for name in needed if name not in arrays]
        if missing:
            raise TemplateError(f"not a template: {', '.join(missing)} missing; learn it again")
        grid, frames, *maps = (np.asarray(arrays[name], dtype=np.float64) for name in needed)
        shape = maps[0].shape
        square = len(shape) == 2 and shape[0] == shape[1] and all(m.shape == shape for m in maps)
        finite = all(np.isfinite(a).all() for a in (grid, frames, *maps))
        if not square or not finite or grid.shape != (2,) or frames.size != 1 or grid[0] <= 0.0:
            raise TemplateError("not a template: its maps are not finite squares of one size; learn it again")
        probability, variance, height, weight = maps
        empty = _empty(probability, variance, height, weight)
        if empty:
            raise TemplateError(f"not a template: {empty}; learn it again")
        size = Grid(float(grid[0]), shape[0], float(grid[1]))
        template = _complete(size, int(frames.item()), probability, variance, height, weight)
        slant = np.asarray(arrays.get("slant", np.zeros(1)), dtype=np.float64)
        if slant.size != 1 or not np.isfinite(slant).all():
            raise TemplateError("not a template: its slant is not one number; learn it again")
        template = replace(template, slant=float(slant.item()))
        if "layers" not in arrays:
            return template
        return replace(template, stops=_stops(size, arrays))


def finish(sums: TemplateSums) -> Template:
    """Make a template of the sums; raises TemplateError when they show no drone."""
    seen = np.maximum(sums.seen, 1.0)
    known = sums.seen >= _LEAST_FRAMES
    probability = np.where(known, sums.share / seen, 0.0)
    cell = sums.grid.cell
    area = float((probability > 0.5).sum()) * cell**2
    if area < _LEAST_AREA:
        raise TemplateError(
            f"no template: {1e4 * area:.0f} cm^2 were drone in most of {sums.frames} frames, expected at "
            f"least {1e4 * _LEAST_AREA:.0f}; are the poses right, and does the drone fly alone?"
        )
    variance = np.maximum(sums.square / seen - probability**2, 0.0)
    solid = (probability > 0.1) & (sums.area > 0.0)
    height = np.where(solid, sums.height / np.maximum(sums.area, 1e-9), 0.0)
    size = 2 * round(_SURROUNDINGS / cell) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    near = cv2.dilate((probability > 0.3).astype(np.uint8), disc) > 0
    weight = (near & known).astype(np.float64)
    return _complete(sums.grid, sums.frames, probability, variance, height, weight)


def build_template(
    samples: Sequence[tuple[DepthFrame, Pose]],
    nearest: NDArray[np.uint16],
    camera: FixedCamera,
    planes: Sequence[float] = PLANES,
) -> Template:
    """Learn a template from frames and the poses of the drone in them; `nearest` as in `evidence.gather`.

    Of the heights `planes` [m] the one with the sharpest template is taken: there
    what is drone and what is free fit together best when seen from many sides. Raises TemplateError.
    """
    learned = []
    for plane in planes:
        sums = TemplateSums.empty(plane=plane)
        for frame, pose in samples:
            sums = sums.add(gather(frame.depth, nearest, camera, pose, sums.grid))
        learned.append(finish(sums))
    best = max(learned, key=lambda template: template.sharpness)
    stops = Stops.of_samples(samples, nearest, camera, best.grid.cell, best.grid.n)
    return replace(best, stops=stops)


def _empty(probability: Array, variance: Array, height: Array, weight: Array) -> str:
    """Return what keeps maps (n, n) from showing a drone, "" when they do."""
    if (probability < 0.0).any() or (probability > 1.0).any() or not (probability > 0.5).any():
        return "its probability is not 0 to 1, with more than a half in some cells"
    if (variance < 0.0).any() or not variance.any():
        return "its variance is negative, or 0 in every cell"
    if (weight < 0.0).any() or not weight.any():
        return "its weight is negative, or 0 in every cell"
    if not ((height != 0.0) & (probability > 0.0)).any():
        return "its height is 0 in every cell of the drone"
    return ""


def _stops(grid: Grid, arrays: Mapping[str, Array]) -> Stops:
    layers, hits, passes = (
        np.asarray(arrays.get(k, np.empty(0)), dtype=np.float64) for k in ("layers", "hits", "passes")
    )
    square = hits.ndim == 3 and hits.shape == passes.shape and hits.shape[:2] == (grid.n, grid.n)
    counted = square and layers.shape == (2,) and np.isfinite(layers).all() and layers[1] > 0.0
    if not counted or not all(np.isfinite(a).all() and (a >= 0.0).all() for a in (hits, passes)):
        raise TemplateError(
            f"not a template: its rays are not counted in layers of {grid.n} x {grid.n} cells; learn it again"
        )
    counts = (np.ascontiguousarray(a, dtype=np.float32) for a in (hits, passes))
    return Stops(grid.cell, float(layers[0]), float(layers[1]), *counts)


def _complete(
    grid: Grid, frames: int, probability: Array, variance: Array, height: Array, weight: Array
) -> Template:
    # From single precision, as it is stored: a template read back is the same to the last bit.
    maps = [np.ascontiguousarray(m, dtype=np.float32) for m in (probability, variance, height, weight)]
    p = _SURPRISE + (1.0 - 2.0 * _SURPRISE) * maps[0].astype(np.float64)
    log_drone, log_free = ((maps[3] * np.log(2.0 * q)).astype(np.float32) for q in (p, 1.0 - p))
    stops = Stops.of_top_view(grid.cell, maps[0], maps[2], maps[3])
    return Template(grid, frames, maps[0], maps[1], maps[2], maps[3], log_drone, log_free, stops)
