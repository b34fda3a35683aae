"""Figures 17 and 18: what is drawn is what was measured and fitted."""

import math

import cv2
import numpy as np
import pytest

from noctule.estimation.sensor_calibration import HeadingErrors, heading_table
from noctule.estimation.sensors import HeadingCorrection
from noctule.reports.sensor_figures import flight_figure, heading_figure, write_heading_figures
from noctule.reports.style import house_style


@pytest.fixture
def headings():
    """An onboard sensor with a bias by its heading, and depth without one."""
    stamps = np.arange(0.0, 60.0, 0.02)
    reference = 0.3 * stamps
    rng = np.random.default_rng(0)
    correction = HeadingCorrection(constant=0.2, cosines=(-0.1,), sines=(0.0,))
    noise = 0.02 * rng.standard_normal(stamps.size)
    before = 0.2 - 0.1 * np.cos(reference) + noise
    onboard = HeadingErrors(stamps, reference, before, noise, correction, 0.02, 0.001)
    depth = HeadingErrors(stamps, reference, noise, noise, HeadingCorrection(), 0.02, 0.001)
    return {"onboard": onboard, "depth": depth}


def test_every_sensor_has_a_panel_with_its_error_before_and_after(headings):
    with house_style():
        figure = flight_figure(headings)
    titles = [axis.get_title(loc="left") for axis in figure.axes]
    before = np.degrees(headings["onboard"].before)
    after = np.degrees(headings["onboard"].after)
    assert titles[0] == "What the sensors say of the heading"
    assert titles[1] == (
        f"onboard: {before.mean():+.2f} ± {before.std():.2f} deg, corrected {after.mean():+.2f} ± "
        f"{after.std():.2f} deg"
    )
    said, corrected, _ = figure.axes[1].lines
    np.testing.assert_allclose(said.get_ydata(), before)
    np.testing.assert_allclose(corrected.get_ydata(), after)


def test_headings_are_drawn_from_0_to_360_and_broken_where_they_start_anew(headings):
    axis = flight_figure(headings).axes[0]
    assert [line.get_label() for line in axis.lines] == ["onboard", "depth", "reference"]
    for line in axis.lines:
        shown = line.get_ydata()
        assert np.nanmin(shown) >= 0.0
        assert np.nanmax(shown) < 360.0
        jumps = np.abs(np.diff(shown))
        assert np.nanmax(jumps) < 180.0
    assert np.isnan(axis.lines[-1].get_ydata()).sum() == int(0.3 * 60.0 / (2.0 * math.pi))


def test_the_errors_are_drawn_over_the_heading_with_the_table_and_the_fit(headings):
    with house_style():
        figure = heading_figure(headings)
    axis = figure.axes[0]
    rows = heading_table(headings["onboard"])
    points, fit, means = axis.lines[0], axis.lines[1], axis.containers[0].lines[0]
    np.testing.assert_allclose(means.get_xdata(orig=False), [math.degrees(row.heading) for row in rows])
    np.testing.assert_allclose(means.get_ydata(orig=False), [math.degrees(row.mean) for row in rows])
    assert points.get_xdata().size == headings["onboard"].before.size
    # The fit is by the heading that is said, the axis is the reference's.
    said = np.radians(np.array(fit.get_xdata()) + np.array(fit.get_ydata()))
    np.testing.assert_allclose(fit.get_ydata(), np.degrees(0.2 - 0.1 * np.cos(said)), atol=1e-9)
    assert "harmonics, order 1" in [text.get_text() for text in axis.get_legend().get_texts()]


def test_both_figures_are_written_and_the_same_again(headings, tmp_path):
    files = write_heading_figures(headings, tmp_path)
    assert [file.name for file in files] == ["sensors-flight.png", "sensors-heading.png"]
    for file in files:
        picture = cv2.imread(str(file))
        assert picture.shape[1] == 1350
        assert picture.std() > 5.0
    first = [file.read_bytes() for file in files]
    assert [file.read_bytes() for file in write_heading_figures(headings, tmp_path)] == first
