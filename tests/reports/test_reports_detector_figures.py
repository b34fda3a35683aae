"""Figures 11 and 12, and the learned top view: what is drawn is what was learned."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle

from noctule.localization.detection.band import SurfaceBand
from noctule.localization.detection.cubics import AreaCubics
from noctule.localization.detection.samples import FlightSamples
from noctule.localization.template import Template
from noctule.reports import ReportWriteError
from noctule.reports.detector_figures import (
    detector_figure,
    timing_figure,
    write_detector_figure,
    write_timing_figure,
)
from noctule.reports.style import FORWARD, LEFT, house_style
from noctule.reports.template_figure import template_figure, write_template_figure

RNG = np.random.default_rng(0)
Z = np.sort(RNG.uniform(0.5, 1.9, 120))
SAMPLES = FlightSamples(
    Z,
    2e4 / (3.3 - Z) ** 2 * RNG.uniform(0.9, 1.1, 120),
    0.07 * RNG.uniform(0.9, 1.1, 120),
    np.ones((120, 7)),
)
CUBICS = AreaCubics(np.array([3000.0, 500.0, 0.0, 900.0]), np.array([1500.0, 0.0, 0.0, 600.0]), 0.55, 1.85)
BAND = SurfaceBand(0.06, 0.08, 0.55, 1.85)
TIMES = {"cubics": np.full(40, 0.2), "hu": np.linspace(0.5, 2.5, 40)}


def template() -> Template:
    """A bar along the body's x with a knob on its left, in cells of 1 cm."""
    p = np.zeros((50, 50))
    p[10:40, 23:27] = 1.0
    p[30:34, 27:35] = 1.0
    arrays = {
        "grid": np.array([0.01, -0.02]),
        "frames": np.array([77.0]),
        "probability": p,
        "variance": 0.1 * np.ones_like(p),
        "height": 0.02 * p,
        "weight": np.ones_like(p),
    }
    return Template.from_arrays(arrays)


def drawn(axis, label):
    return next(line for line in axis.lines if line.get_label() == label)


def test_the_cubics_are_drawn_where_they_hold_and_nowhere_else() -> None:
    left = detector_figure(SAMPLES, CUBICS, BAND).axes[0]
    for label, colour, which in (("$g_1$, largest", LEFT, 1), ("$g_2$, smallest", FORWARD, 0)):
        line = drawn(left, label)
        x, y = line.get_xdata(), line.get_ydata()
        assert (x.min(), x.max()) == (CUBICS.lowest, CUBICS.highest)
        assert np.allclose(y, CUBICS.limits(x)[which])
        assert to_hex(line.get_color()) == colour.lower()


def test_every_frame_of_the_flight_is_a_dot_and_lies_inside_the_picture() -> None:
    left, right = detector_figure(SAMPLES, CUBICS, BAND).axes
    assert np.array_equal(drawn(left, "120 frames").get_ydata(), SAMPLES.area)
    assert np.array_equal(right.lines[0].get_ydata(), SAMPLES.surface)
    for axis, values in ((left, SAMPLES.area), (right, SAMPLES.surface)):
        assert axis.get_ylim()[0] == 0.0
        assert values.max() < axis.get_ylim()[1]
        assert axis.get_xlim()[0] < Z.min() < Z.max() < axis.get_xlim()[1]


def test_the_band_is_the_box_that_it_accepts() -> None:
    right = detector_figure(SAMPLES, CUBICS, BAND).axes[1]
    boxes = [patch for patch in right.patches if isinstance(patch, Rectangle)]
    for box in boxes:
        assert box.get_xy() == (0.55, 0.06)
        assert (box.get_width(), box.get_height()) == (pytest.approx(1.3), pytest.approx(0.02))
    assert len(boxes) == 2  # its ground and its edge


def test_times_of_a_frame_are_told_in_words_too() -> None:
    axis = timing_figure(TIMES).axes[0]
    words = [line.get_label() for line in axis.lines if not line.get_label().startswith("_")]
    assert words == [
        "cubics\n0.200 ms median\n0.200 $\\pm$ 0.000 ms",
        "hu\n1.500 ms median\n1.500 $\\pm$ 0.592 ms",
    ]
    assert axis.get_yscale() == "log"


def test_the_line_through_the_times_does_not_follow_a_single_hiccup() -> None:
    times = np.full(50, 1.0)
    times[25] = 400.0
    axis = timing_figure({"cubics": times}).axes[0]
    assert (axis.lines[1].get_ydata() == 1.0).all()
    assert axis.lines[0].get_ydata()[25] == 400.0


def test_the_top_view_has_the_nose_up_and_the_left_on_the_left() -> None:
    figure = template_figure(template())
    left = figure.axes[0]
    picture = left.images[0]
    shown = np.asarray(picture.get_array())
    right_edge, left_edge, low, high = picture.get_extent()
    # The knob is ahead of the middle and to the left: at larger x, larger y.
    rows, columns = np.nonzero(shown > 0.5)
    knob = columns < 50 - 27
    ahead = low + (rows[knob].mean() + 0.5) / 50 * (high - low)
    aside = right_edge + (columns[knob].mean() + 0.5) / 50 * (left_edge - right_edge)
    assert ahead == pytest.approx(7.0, abs=0.01)  # [cm]
    assert aside == pytest.approx(6.0, abs=0.01)
    assert left.get_xlim()[0] > left.get_xlim()[1]
    assert left.get_title(loc="left") + left.get_title() == "Top view, learned from 77 frames"
    assert {text.get_text() for text in left.texts} >= {"x", "y", "nose"}


def test_cells_that_say_nothing_are_left_white() -> None:
    blind = template().arrays()
    blind["weight"][:, :5] = 0.0
    shown = np.asarray(template_figure(Template.from_arrays(blind)).axes[0].images[0].get_array())
    assert np.isnan(np.ma.filled(shown, np.nan)[:, -5:]).all()


def test_the_same_data_gives_the_same_files(tmp_path) -> None:
    for name in ("a", "b"):
        write_detector_figure(SAMPLES, CUBICS, BAND, tmp_path / name / "detector.png")
        write_timing_figure(TIMES, tmp_path / name / "times.png")
        write_template_figure(template(), tmp_path / name / "template.png")
    for file in ("detector.png", "times.png", "template.png"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
        assert cv2.imread(str(tmp_path / "a" / file)).std() > 5.0


def test_a_place_that_cannot_be_written_is_one_line(tmp_path) -> None:
    (tmp_path / "file").touch()
    with house_style(), pytest.raises(ReportWriteError, match="cannot be written"):
        write_timing_figure(TIMES, tmp_path / "file" / "a.png")
