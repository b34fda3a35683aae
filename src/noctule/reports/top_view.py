"""The room from above, with the flight in it: what the report and the poster share."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps, patheffects
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.patches import Circle, Polygon, Rectangle

from noctule.geometry import Array
from noctule.reports.flight_log import FlightLog, Solid, TruthLog
from noctule.reports.style import INK, LEFT, WARN

_FILL = {"column": "#C9A227", "furniture": "#cbd5e1", "person": "#d8b4e2", "wall": "#6b7280"}
_EDGE = {"column": "#3b3b3b", "furniture": "#94a3b8", "person": "#8e5ba6", "wall": "#374151"}
WALLS = _EDGE["wall"]
KEY_COLOUR = LEFT
# Without its yellow end, which is faint on white and, on a dark page, faint again when inverted.
_SPEED_COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.8, 256)))
_HALO = [patheffects.withStroke(linewidth=2.2, foreground="white")]


def fill(solid: Solid) -> str | tuple[float, float, float]:
    """Give a column its own colour, as in the pictures; everything else keeps in the background."""
    return solid.rgb if solid.kind == "column" and solid.rgb is not None else _FILL[solid.kind]


def nearest_point(solid: Solid, point: Array) -> Array:
    """Return the point (2,) of the solid's outline that is nearest to `point` (2,), world x and y [m]."""
    start = solid.outline
    edge = np.roll(start, -1, axis=0) - start
    length = np.maximum(np.einsum("ij,ij->i", edge, edge), 1e-12)
    along = np.clip(np.einsum("ij,ij->i", point - start, edge) / length, 0.0, 1.0)
    feet = start + along[:, None] * edge
    return np.asarray(feet[np.argmin(np.linalg.norm(feet - point, axis=1))], dtype=np.float64)


def closest_approach(log: FlightLog) -> int | None:
    """Return the row of the truth with the least clearance, None without truth or anything to meet."""
    if log.truth is None or not np.isfinite(log.truth.clearance).any():
        return None
    return int(np.nanargmin(np.where(np.isfinite(log.truth.clearance), log.truth.clearance, np.nan)))


def path_extent(log: FlightLog, truth: TruthLog, margin: float = 0.6) -> tuple[Array, Array]:
    """Return the corners (2,) [m] of what the flight needs to be seen whole, with `margin` [m] around it."""
    points = [truth.position[:, :2], log.key_poses[:, :2]]
    points += [s.outline for s in log.solids if s.kind == "column"]
    everything = np.vstack(points)
    low, high = everything.min(axis=0) - margin, everything.max(axis=0) + margin
    short = np.maximum(1.6 - (high - low), 0.0) / 2.0
    return low - short, high + short


def draw_room(axis: Axes, log: FlightLog) -> None:
    """Draw the walls and everything that stands between them, from above."""
    if log.room is not None:
        size = log.room[1] - log.room[0]
        walls = Rectangle((log.room[0, 0], log.room[0, 1]), size[0], size[1], fill=False, ec=WALLS, lw=3)
        axis.add_patch(walls)
    for solid in log.solids:
        axis.add_patch(Polygon(solid.outline, fc=fill(solid), ec=_EDGE[solid.kind], lw=1, zorder=2))


def draw_top(axis: Axes, log: FlightLog, truth: TruthLog, limits: tuple[Array, Array]) -> LineCollection:
    """Draw the room from above and the true trajectory coloured by speed; return it for a colour bar."""
    draw_room(axis, log)
    _draw_key_images(axis, log)
    line = draw_trajectory(axis, truth, truth.position[:, :2])
    for row, marker, label in ((0, "o", "start"), (-1, "s", "end")):
        axis.plot(
            *truth.position[row, :2],
            marker,
            ms=7,
            color="white",
            mec=INK,
            mew=1.6,
            zorder=6,
            ls="",
            label=label,
        )
    _draw_closest(axis, log, truth)
    axis.set_aspect("equal")
    axis.set_xlim(limits[0][0], limits[1][0])
    axis.set_ylim(limits[0][1], limits[1][1])
    axis.set(xlabel="x [m], along the room", ylabel="y [m], left")
    return line


def draw_trajectory(axis: Axes, truth: TruthLog, points: Array) -> LineCollection:
    """Draw the true trajectory at `points` (m, 2) [m], coloured by speed."""
    segments = np.stack([points[:-1], points[1:]], axis=1)
    line = LineCollection(list(segments), cmap=_SPEED_COLOURS, lw=3.0, capstyle="round", zorder=5)
    line.set_array(truth.speed[1:])
    line.set_clim(0.0, max(float(np.nanmax(truth.speed, initial=0.0)), 0.1))
    axis.add_collection(line)
    return line


def _draw_key_images(axis: Axes, log: FlightLog) -> None:
    """Draw an arrow per key image, the way it looks; the numbers thin out on long paths."""
    if not len(log.key_poses):
        return
    x, y, yaw = log.key_poses[:, 0], log.key_poses[:, 1], log.key_poses[:, 3]
    # Short enough that neighbours on a dense path do not run into one another.
    gaps = np.hypot(np.diff(x), np.diff(y))
    length = float(np.clip(0.6 * np.median(gaps), 0.1, 0.28)) if len(gaps) else 0.28
    axis.quiver(
        x, y, np.cos(yaw), np.sin(yaw), angles="xy", scale_units="xy", scale=1.0 / length, width=0.004,
        color=KEY_COLOUR, zorder=7,
    )  # fmt: skip
    axis.plot(x, y, "o", ms=4, color=KEY_COLOUR, zorder=7)
    axis.plot([], [], marker=r"$\rightarrow$", ms=14, color=KEY_COLOUR, ls="", label="key image")
    every = -(-len(x) // 8)
    for i in range(0, len(x), every):
        axis.annotate(
            f"{i + 1}", (x[i], y[i]), xytext=(-8 * np.sin(yaw[i]), 8 * np.cos(yaw[i])),
            textcoords="offset points", ha="center", va="center", color=KEY_COLOUR, fontsize=9,
            fontweight="bold", zorder=8, path_effects=_HALO,
        )  # fmt: skip


def _draw_closest(axis: Axes, log: FlightLog, truth: TruthLog) -> None:
    """Draw the hull where the clearance was least, and the line to what it came close to."""
    row = closest_approach(log)
    if row is None:
        return
    centre, clearance = truth.position[row], float(truth.clearance[row])
    colour = WARN if clearance < 0.0 else INK
    axis.add_patch(
        Circle(tuple(centre[:2]), log.hull.radius, fill=False, ec=colour, lw=1.5, ls="--", zorder=6)
    )
    axis.plot([], [], "--", color=colour, lw=1.5, label=f"hull at its closest, {clearance:.2f} m")
    half = log.hull.height / 2.0
    # The clearance is measured in space; the line is drawn only to things that reach the hull's height.
    beside = [
        s for s in log.solids
        if s.kind != "wall" and s.bottom - half <= centre[2] <= s.top + half
    ]  # fmt: skip
    if beside:
        feet = [nearest_point(s, centre[:2]) for s in beside]
        foot = min(feet, key=lambda f: float(np.linalg.norm(f - centre[:2])))
        away = (foot - centre[:2]) / max(float(np.linalg.norm(foot - centre[:2])), 1e-9)
        rim = centre[:2] + log.hull.radius * away
        axis.plot(*np.vstack([rim, foot]).T, color=colour, lw=1.5, zorder=6)
        axis.annotate(
            f"{clearance:.2f} m", tuple((rim + foot) / 2.0), xytext=(9 * away[1], -9 * away[0]), color=colour,
            textcoords="offset points", ha="left" if away[1] > 0.0 else "right", va="center", fontsize=9,
            zorder=8, path_effects=_HALO,
        )  # fmt: skip
