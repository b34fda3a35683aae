from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.quiver import Quiver
from synthetic_flight import TICK, box_outline, make_log, without_truth

from noctule.reports.flight_log import FlightLog, Solid
from noctule.reports.page import png_size
from noctule.reports.poster import HEIGHT, WIDTH, poster_figure, telling_snapshot
from noctule.reports.series import (
    avoidance_task,
    clearance_figure,
    errors_figure,
    tasks_figure,
    ticks_figure,
    velocities_figure,
)
from noctule.reports.strip import strip_figure
from noctule.reports.style import encode_png, house_style
from noctule.reports.top_view import closest_approach, nearest_point, path_extent
from noctule.reports.views import views_figure

LOG = make_log()


def drawn(draw, log=LOG):
    with house_style():
        return draw(log)


def vertical_lines(axis, style):
    """The x of every vertical line of that style."""
    lines = [line for line in axis.lines if line.get_linestyle() == style and len(line.get_xdata()) == 2]
    return [line.get_xdata()[0] for line in lines if line.get_xdata()[0] == line.get_xdata()[1]]


def line(axis, label):
    return next(line for line in axis.lines if line.get_label() == label)


def test_a_flight_s_switches_are_the_ticks_with_a_new_target():
    expected = [
        t for t, a, b in zip(LOG.times[1:], LOG.target_index, LOG.target_index[1:], strict=False) if a != b
    ]
    assert LOG.switches.tolist() == expected
    assert len(expected) == 3


@given(st.lists(st.booleans(), min_size=2, max_size=40))
def test_the_intervals_of_activity_hold_every_active_tick_and_no_other(on):
    n = len(on)
    log = replace(make_log(n, snapshots=0), activations={"avoidance": np.array(on, dtype=float)})
    spans = log.active("avoidance")
    inside = [any(a <= t < b or (b == log.times[-1] and t == b) for a, b in spans) for t in log.times]
    # The last tick closes an interval that was open before it.
    assert inside[:-1] == on[:-1]
    assert all(a <= b for a, b in spans)


def test_a_task_that_the_flight_did_not_have_is_never_active():
    assert LOG.active("levitation") == []


def test_command_steps_are_what_differs_between_neighbouring_commands():
    steps = LOG.command_steps
    assert np.isnan(steps[0]).all()
    assert steps[7, 0] == pytest.approx(np.linalg.norm(LOG.sent[7, :3] - LOG.sent[6, :3]))
    assert steps[7, 1] == pytest.approx(abs(LOG.sent[7, 3] - LOG.sent[6, 3]))


def test_the_errors_are_drawn_as_recorded_with_a_dotted_line_per_switch():
    figure = drawn(errors_figure)
    top, middle, bottom = figure.axes
    assert line(top, r"$\epsilon$").get_ydata().tolist() == LOG.epsilon.tolist()
    assert line(middle, "z forward").get_ydata().tolist() == LOG.errors[:, 2].tolist()
    assert line(bottom, "y down").get_ydata().tolist() == LOG.errors[:, 4].tolist()
    for axis in figure.axes:
        assert vertical_lines(axis, ":") == LOG.switches.tolist()


def test_each_panel_names_its_unit():
    labels = [axis.get_ylabel() for axis in drawn(velocities_figure).axes]
    assert labels == ["velocity [m/s]", "yaw rate [rad/s]", "activation h [1]", "step [% of limit]"]
    assert drawn(errors_figure).axes[-1].get_xlabel() == "time [s]"
    assert [axis.get_ylabel() for axis in drawn(views_figure).axes[:2]] == ["y [m], left", "z [m], up"]


def test_the_velocities_show_what_was_sent_and_every_activation():
    linear, yaw, activation, _ = drawn(velocities_figure).axes
    assert line(linear, "forward").get_ydata().tolist() == LOG.sent[:, 0].tolist()
    assert line(yaw, "yaw rate").get_ydata().tolist() == LOG.sent[:, 3].tolist()
    for name, h in LOG.activations.items():
        assert line(activation, name).get_ydata().tolist() == h.tolist()


def test_a_step_at_the_acceleration_limit_reads_one_hundred_per_cent():
    sent = np.zeros((3, 4))
    sent[1, 0] = LOG.limits.acceleration * TICK
    log = replace(make_log(3, snapshots=0), sent=sent)
    assert line(drawn(velocities_figure, log).axes[-1], "linear").get_ydata()[1] == pytest.approx(100.0)


def test_avoidance_is_found_by_what_it_does():
    assert avoidance_task(LOG) == "avoidance"
    assert (
        avoidance_task(replace(LOG, activations={"collision": LOG.activations["avoidance"]})) == "collision"
    )
    assert avoidance_task(replace(LOG, activations={"visibility": LOG.activations["visibility"]})) is None


def test_there_is_a_panel_for_the_error_of_every_task():
    titles = [axis.get_title(loc="left") for axis in drawn(tasks_figure).axes]
    assert titles == ["Task: avoidance", "Task: visibility", "Task: servoing"]
    assert drawn(tasks_figure, replace(LOG, task_errors={})) is None


def test_the_clearance_figure_marks_the_least_clearance():
    axis = drawn(clearance_figure).axes[0]
    least = LOG.truth.clearance.min()
    marker = line(axis, f"least: {least:.2f} m")
    assert marker.get_ydata().tolist() == [least]


def test_a_room_with_nothing_in_it_has_no_closest_approach_and_is_drawn():
    log = replace(LOG, truth=replace(LOG.truth, clearance=np.full(len(LOG.times), np.inf)), solids=())
    assert closest_approach(log) is None
    assert drawn(clearance_figure, log) is not None
    assert drawn(views_figure, log) is not None


def test_the_tick_histogram_counts_the_long_tail_in_words():
    log = replace(LOG, tick_ms=np.concatenate([np.full(297, 2.0), [2.5, 2.5, 80.0]]))
    labels = [text.get_text() for text in drawn(ticks_figure, log).axes[0].get_legend().get_texts()]
    assert labels == [
        "median: 2.00 ms",
        "95th percentile: 2.00 ms",
        "1 of 300 are longer,\nthe worst 80.0 ms",
    ]
    assert drawn(ticks_figure, replace(LOG, tick_ms=np.empty(0))) is None


def test_without_the_truth_there_is_neither_map_nor_clearance():
    assert drawn(views_figure, without_truth(LOG)) is None
    assert drawn(clearance_figure, without_truth(LOG)) is None


def test_the_map_holds_the_whole_flight_the_key_images_and_the_columns():
    low, high = path_extent(LOG, LOG.truth)
    columns = [s.outline for s in LOG.solids if s.kind == "column"]
    for points in (LOG.truth.position[:, :2], LOG.key_poses[:, :2], *columns):
        assert (points >= low).all()
        assert (points <= high).all()


@pytest.mark.parametrize(("gap", "length"), [(0.1, 0.1), (0.3, 0.18), (2.0, 0.28)])
def test_the_arrows_of_a_dense_path_do_not_run_into_one_another(gap, length):
    poses = np.array([[gap * i, 0.0, 1.0, 0.0] for i in range(5)])
    axes = drawn(views_figure, replace(LOG, key_poses=poses)).axes
    above = next(axis for axis in axes if axis.get_title(loc="left") == "The flight from above")
    arrows = next(c for c in above.collections if isinstance(c, Quiver))
    assert 1.0 / arrows.scale == pytest.approx(length)


def test_a_flight_without_a_described_room_has_no_map_of_the_whole_room():
    with_room = [axis.get_title(loc="left") for axis in drawn(views_figure).axes]
    without = [axis.get_title(loc="left") for axis in drawn(views_figure, replace(LOG, room=None)).axes]
    assert "The whole room" in with_room
    assert "The whole room" not in without
    assert {"The flight from above", "The flight from the side"} <= {*with_room} & {*without}


@given(st.floats(-3, 3), st.floats(-3, 3))
def test_the_nearest_point_of_a_box_is_on_its_rim_and_no_corner_is_nearer(x, y):
    solid = Solid("column", box_outline(0.0, 0.0, 1.0, 0.5), 0.0, 2.0)
    point = np.array([x, y])
    foot = nearest_point(solid, point)
    on_rim = min(abs(foot[0]), abs(foot[0] - 1.0), abs(foot[1]), abs(foot[1] - 0.5))
    assert on_rim == pytest.approx(0.0, abs=1e-12)
    corners = np.linalg.norm(solid.outline - point, axis=1)
    assert np.linalg.norm(foot - point) <= corners.min() + 1e-12


def test_the_strip_says_time_phase_and_image_of_each_picture():
    figure = drawn(strip_figure)
    words = [text.get_text() for axis in figure.axes for text in axis.texts]
    assert len(words) == 2 * len(LOG.snapshots)
    assert words[0] == "0.0 s   following path"
    assert words[-1] == "image 4 of 4"
    assert drawn(strip_figure, replace(LOG, snapshots=())) is None


def test_a_picture_without_points_or_columns_is_drawn_bare():
    bare = replace(LOG.snapshots[0], points_current=np.empty((0, 2)), points_ref=np.empty((0, 2)), columns=())
    axis = drawn(strip_figure, replace(LOG, snapshots=(bare,), safety_area=None)).axes[0]
    assert not axis.lines
    assert not axis.patches


def test_the_poster_shows_a_large_column_near_the_middle_of_the_picture():
    width, box = LOG.snapshots[2].pixels.shape[1], LOG.snapshots[2].columns[0]
    middle = replace(LOG.snapshots[2], columns=(replace(box, left=width / 2 - 20, right=width / 2 + 20),))
    aside = replace(LOG.snapshots[3], columns=(replace(box, left=0.0, right=60.0),))
    assert telling_snapshot(replace(LOG, snapshots=(*LOG.snapshots[:2], middle, aside))) is middle
    assert telling_snapshot(replace(LOG, snapshots=())) is None


def test_a_task_s_error_is_bold_only_while_the_task_is_active():
    axis = drawn(tasks_figure).axes[0]
    bold = line(axis, "while active").get_ydata()
    active = LOG.activations["avoidance"] > 0.0
    assert np.isfinite(bold).tolist() == active.tolist()
    assert bold[active].tolist() == LOG.task_errors["avoidance"][active].tolist()
    assert line(axis, "while inactive").get_ydata().tolist() == LOG.task_errors["avoidance"].tolist()


@pytest.mark.parametrize("log", [LOG, without_truth(LOG), replace(LOG, snapshots=())])
def test_the_poster_has_its_size_whatever_the_recording_lacks(log):
    with house_style():
        png = encode_png(poster_figure(log))
    assert png_size(png) == (WIDTH, HEIGHT)


def test_the_same_flight_gives_the_same_bytes_whatever_the_reader_s_own_style_is():
    import matplotlib as mpl

    with house_style():
        first = encode_png(errors_figure(LOG))
    with mpl.rc_context({"lines.linewidth": 9.0, "font.size": 30.0, "axes.grid": False}):
        with house_style():
            second = encode_png(errors_figure(LOG))
        assert mpl.rcParams["lines.linewidth"] == 9.0
    assert first == second


@pytest.mark.parametrize("ticks", [1, 2])
@pytest.mark.parametrize(
    "draw", [errors_figure, velocities_figure, tasks_figure, clearance_figure, ticks_figure]
)
def test_a_flight_of_a_tick_or_two_can_be_drawn(ticks, draw):
    with house_style():
        assert png_size(encode_png(draw(short(ticks))))[0] == 1350


def short(ticks: int) -> FlightLog:
    return cut(LOG, ticks)


def cut(log: FlightLog, n: int) -> FlightLog:
    truth = log.truth
    return replace(
        log,
        times=log.times[:n],
        asked=log.asked[:n],
        sent=log.sent[:n],
        phases=log.phases[:n],
        target_index=log.target_index[:n],
        epsilon=log.epsilon[:n],
        errors=log.errors[:n],
        activations={k: v[:n] for k, v in log.activations.items()},
        task_errors={k: v[:n] for k, v in log.task_errors.items()},
        tick_ms=log.tick_ms[:n],
        truth=replace(
            truth,
            times=truth.times[:n],
            position=truth.position[:n],
            yaw=truth.yaw[:n],
            speed=truth.speed[:n],
            clearance=truth.clearance[:n],
        ),
    )
