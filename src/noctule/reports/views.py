"""Where the drone flew: the room, and the flight from above and from the side, to scale."""

from __future__ import annotations

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Rectangle

from noctule.geometry import Array
from noctule.reports.flight_log import FlightLog, TruthLog
from noctule.reports.style import INK, MUTED, WIDTH_IN, new_figure
from noctule.reports.top_view import KEY_COLOUR, draw_room, draw_top, draw_trajectory, fill, path_extent

_OVERVIEW_IN = 2.9  # height of the map of the whole room [in]
_LOWEST = -0.08  # [m], a little floor in the side view


def views_figure(log: FlightLog) -> Figure | None:
    """Return the room, the flight from above and from the side; None without the truth."""
    truth = log.truth
    if truth is None or len(truth.times) < 2:
        return None
    low, high = path_extent(log, truth)
    width, depth = float(high[0] - low[0]), float(high[1] - low[1])
    top = max(float(truth.position[:, 2].max()) + 0.35, 1.4)
    per_metre = min((WIDTH_IN - 1.7) / width, 6.5 / (depth + top - _LOWEST))
    flight_in = per_metre * (depth + top - _LOWEST) + 1.2
    if log.room is None:
        figure = new_figure(WIDTH_IN, flight_in + 0.4)
        handles = _draw_flight(figure, log, truth, (low, high), top)
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), handletextpad=0.6)
        return figure
    figure = new_figure(WIDTH_IN, _OVERVIEW_IN + flight_in)
    whole, flight = figure.subfigures(2, 1, squeeze=False, height_ratios=(_OVERVIEW_IN, flight_in))[:, 0]
    handles = _draw_flight(flight, log, truth, (low, high), top)
    size = log.room[1] - log.room[0]
    share = min(_OVERVIEW_IN * size[0] / size[1] / WIDTH_IN, 0.75)
    axis, words = whole.subplots(1, 2, width_ratios=(share, 1.0 - share))
    _draw_overview(axis, log, truth, (low, high))
    words.set_axis_off()
    words.legend(handles=handles, loc="center left", handletextpad=1.0, labelspacing=0.9)
    return figure


def _draw_overview(axis: Axes, log: FlightLog, truth: TruthLog, section: tuple[Array, Array]) -> None:
    """Draw the whole room, small, and the section of it that the view from above shows."""
    assert log.room is not None
    draw_room(axis, log)
    axis.plot(*truth.position[:, :2].T, color=INK, lw=1.6, zorder=5)
    low, high = section
    axis.add_patch(
        Rectangle((low[0], low[1]), *(high - low), fill=False, ec=KEY_COLOUR, lw=1.2, ls=":", zorder=6)
    )
    axis.set_aspect("equal")
    axis.set_xlim(log.room[0, 0] - 0.1, log.room[1, 0] + 0.1)
    axis.set_ylim(log.room[0, 1] - 0.1, log.room[1, 1] + 0.1)
    axis.set(title="The whole room", xlabel="x [m]", ylabel="y [m]")
    axis.grid(visible=False)


def _draw_flight(
    figure: Figure | SubFigure, log: FlightLog, truth: TruthLog, limits: tuple[Array, Array], top: float
) -> list[Artist]:
    """Draw the flight from above and from the side; return what belongs into the legend."""
    ratios = (float(limits[1][1] - limits[0][1]), top - _LOWEST)
    above, beside = figure.subplots(2, 1, sharex=True, height_ratios=ratios)
    line = draw_top(above, log, truth, limits)
    above.set(xlabel="", title="The flight from above")
    _draw_side(beside, log, truth, limits, top)
    bar = figure.colorbar(line, ax=[above, beside], shrink=0.6, pad=0.02, aspect=30)
    bar.set_label("speed [m/s]")
    bar.outline.set_visible(False)
    handles: list[Artist] = above.get_legend_handles_labels()[0]
    return handles


def _draw_side(axis: Axes, log: FlightLog, truth: TruthLog, limits: tuple[Array, Array], top: float) -> None:
    for solid in log.solids:
        low, high = float(solid.outline[:, 0].min()), float(solid.outline[:, 0].max())
        column = solid.kind == "column"
        body = Rectangle((low, solid.bottom), high - low, solid.top - solid.bottom, fc=fill(solid), lw=0.8)
        body.set(
            edgecolor=INK if column else "none", alpha=0.85 if column else 0.28, zorder=2 if column else 1
        )
        axis.add_patch(body)
    draw_trajectory(axis, truth, truth.position[:, [0, 2]])
    if len(log.key_poses):
        axis.plot(log.key_poses[:, 0], log.key_poses[:, 2], "o", ms=5, color=KEY_COLOUR, zorder=7)
    for row, marker in ((0, "o"), (-1, "s")):
        axis.plot(*truth.position[row, [0, 2]], marker, ms=7, color="white", mec=INK, mew=1.6, zorder=6)
    axis.axhline(0.0, color=MUTED, lw=2)
    axis.set_aspect("equal")
    axis.set_xlim(limits[0][0], limits[1][0])
    axis.set_ylim(_LOWEST, top)
    axis.set(xlabel="x [m], along the room", ylabel="z [m], up", title="The flight from the side")
