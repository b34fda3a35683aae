"""Figures 14 and 15: what was sent, what was measured and what the model has."""

import cv2
import numpy as np
import pytest

from noctule.estimation.identification import EXCITATIONS, Validation
from noctule.reports.flight_report import ReportWriteError
from noctule.reports.identification_figures import velocities_figure, write_velocities_figure
from noctule.reports.style import house_style

STAMPS = np.arange(0.0, 82.0, 1.0 / 30.0)


@pytest.fixture
def flight():
    """Forward is moved, left is not, up is measured from its second stamp on only."""
    inputs = np.zeros((STAMPS.size, 4))
    inputs[:, 0] = EXCITATIONS[0].inputs(STAMPS)
    inputs[:, 2] = EXCITATIONS[2].inputs(STAMPS)
    simulated = np.cumsum(inputs, axis=0) / 30.0
    measured = simulated + 0.01 * np.random.default_rng(0).standard_normal(simulated.shape)
    measured[0, 2] = simulated[0, 2] = np.nan
    measured[:, 3] = np.nan
    return Validation(STAMPS, inputs, STAMPS, measured, simulated, (True, False, True, False))


def test_each_axis_has_a_panel_with_its_fit_or_says_that_it_was_not_moved(flight):
    with house_style():
        figure = velocities_figure(flight, "Validation")
    titles = [axis.get_title(loc="left") for axis in figure.axes]
    fit = 100.0 * flight.fit
    assert titles == [f"Validation: fit {fit[0]:.1f} %", "not moved", f"fit {fit[2]:.1f} %", "not moved"]
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert labels == ["forward\n[m/s]", "left\n[m/s]", "up\n[m/s]", "yaw rate\n[rad/s]"]


def test_measured_model_and_input_are_drawn_as_they_are(flight):
    axis = velocities_figure(flight, "x").axes[0]
    measured, model, sent = axis.lines
    assert np.array_equal(measured.get_ydata(), flight.measured[:, 0])
    assert np.array_equal(model.get_ydata(), flight.simulated[:, 0])
    u = np.asarray(sent.get_ydata())
    straight = np.polyfit(flight.inputs[:, 0], u, 1)
    assert np.allclose(np.polyval(straight, flight.inputs[:, 0]), u)
    assert straight[0] > 0.0
    assert sent.get_label() == f"input, at most\n{np.abs(flight.inputs[:, 0]).max():.2g}"


def test_the_input_lies_below_what_was_measured_and_the_scale_is_not_drawn_there(flight):
    axis = velocities_figure(flight, "x").axes[0]
    low = np.percentile(flight.measured[:, 0], 0.1)
    assert np.asarray(axis.lines[2].get_ydata()).max() < low
    assert len(axis.get_yticks()) >= 3
    assert min(axis.get_yticks()) > low - 0.2 * np.ptp(flight.measured[:, 0])
    assert axis.get_ylim()[0] < np.asarray(axis.lines[2].get_ydata()).min()


def test_an_axis_without_inputs_has_no_line_of_them(flight):
    assert len(velocities_figure(flight, "x").axes[1].lines) == 2


def test_the_file_is_a_picture_and_the_same_twice(flight, tmp_path):
    first = write_velocities_figure(flight, "Identification", tmp_path / "a" / "identification.png")
    second = write_velocities_figure(flight, "Identification", tmp_path / "b.png")
    assert first.read_bytes() == second.read_bytes()
    assert cv2.imread(str(first)).shape[1] == 1350


def test_a_folder_that_is_a_file_is_one_line(flight, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ReportWriteError):
        write_velocities_figure(flight, "x", tmp_path / "file" / "a.png")
