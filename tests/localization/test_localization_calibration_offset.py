"""The constant error of positions, from a drone that stands still."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.errors import NoctuleError
from noctule.localization.calibration.offset import (
    MovedDroneError,
    PlacesDisagreeError,
    ScatterError,
    Standing,
    TooFewMeasurementsError,
    corrected,
    measure_offset,
    on_floor,
)
from noctule.messages import PoseMeasurement

BIAS = np.array([0.004, -0.003, 0.027])


def standing(x=0.0, y=0.0, bias=BIAS, count=90, noise=0.003, seed=0, known=True):
    place = on_floor(0.12, x, y)
    measured = place + bias + np.random.default_rng(seed).normal(0.0, noise, (count, 3))
    return Standing(place if known else on_floor(0.12), measured)


def refusal(kind, *standings):
    with pytest.raises(kind) as told:
        measure_offset(standings)
    assert isinstance(told.value, NoctuleError)
    return str(told.value)


def test_the_offset_is_the_mean_of_the_places():
    found = measure_offset([standing(), standing(1.0, -0.5, seed=1), standing(-1.0, 0.3, seed=2)])
    np.testing.assert_allclose(found.bias, BIAS, atol=0.001)
    np.testing.assert_allclose(found.scatter, 0.003, rtol=0.2)
    assert (found.disagreement < 0.002).all()
    assert found.places == 3


def test_a_place_that_is_not_known_gives_the_altitude_alone():
    found = measure_offset([standing(known=False)])
    assert found.bias[2] == pytest.approx(0.027, abs=0.001)
    np.testing.assert_array_equal(found.bias[:2], 0.0)
    both = measure_offset([standing(known=False), standing(1.0, 0.0, seed=1)])
    np.testing.assert_allclose(both.bias, BIAS, atol=0.001)


@given(st.lists(st.floats(-0.1, 0.1), min_size=3, max_size=3), st.floats(0.02, 0.5))
def test_any_offset_is_found_and_taken_out(bias, height):
    place = on_floor(height, 0.3, 0.4)
    found = measure_offset([Standing(place, np.tile(place + bias, (40, 1)))])
    np.testing.assert_allclose(found.bias, bias, atol=1e-12)
    measurement = PoseMeasurement(2.0, place + bias, 0.5, np.eye(4), "registration")
    answer = corrected(measurement, found.bias)
    np.testing.assert_allclose(answer.position, place, atol=1e-12)
    assert (answer.stamp, answer.yaw, answer.source) == (2.0, 0.5, "registration")


def test_the_origin_of_a_standing_drone_is_half_its_hull_above_the_floor():
    np.testing.assert_array_equal(on_floor(0.12, 1.0, 2.0), [1.0, 2.0, 0.06])
    assert np.isnan(on_floor(0.12)[:2]).all()


def test_no_place_and_few_measurements_are_refused():
    assert refusal(TooFewMeasurementsError) == (
        "offset: no place is given, expected a drone standing at one or more"
    )
    assert refusal(TooFewMeasurementsError, standing(), standing(count=12)) == (
        "offset: place 2: the drone was measured 12 times, expected 30 or more; let it stand there for some "
        "seconds, in sight of the camera"
    )


def test_a_drone_that_moved_is_refused():
    still = standing(noise=0.002)
    drift = np.linspace(0.0, 0.03, 90)[:, None] * np.array([0.0, 1.0, 0.0])
    assert refusal(MovedDroneError, Standing(still.true, still.measured + drift)) == (
        "offset: place 1: the drone moved by 20 mm along y, expected 6 mm or less; let it stand still, "
        "motors off"
    )
    jump = np.where(np.arange(90)[:, None] < 60, 0.0, 0.011) * np.array([1.0, 0.0, 0.0])
    assert "the drone moved by 11 mm along x" in refusal(
        MovedDroneError, Standing(still.true, still.measured + jump)
    )


def test_noise_is_not_taken_for_motion():
    for seed in range(200):
        measure_offset([standing(noise=0.008, count=30, seed=seed)])


def test_measurements_that_scatter_are_refused():
    noisy = standing()
    measured = noisy.measured.copy()
    measured[:, 2] += 0.03 * np.where(np.arange(90) % 2 == 0, 1.0, -1.0)
    said = refusal(ScatterError, Standing(noisy.true, measured))
    assert said == (
        "offset: place 1: measurements scatter by 30 mm (sd) along z, expected 15 mm or less; is the drone "
        "alone, whole in the picture, and its template its own?"
    )


def test_places_that_disagree_are_refused():
    apart = standing(1.0, 0.0, BIAS + np.array([0.0, 0.03, 0.0]), noise=0.0)
    said = refusal(PlacesDisagreeError, standing(noise=0.0), apart)
    assert said == (
        "offset: the places disagree along y (-3, +27 mm), expected to agree within 20 mm; measure the "
        "places again, or calibrate again where the camera hangs"
    )
