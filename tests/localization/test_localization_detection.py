"""Detectors: fitted on a manual flight, they accept the drone and nothing outside of what was flown."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from localization_blobs import DRONE_SURFACE, blob_at, manual_flight_blobs
from numpy.polynomial import Polynomial

from noctule.camera import CEILING_CAMERA
from noctule.localization.detection.band import fit_band
from noctule.localization.detection.cubics import AreaCubics, fit_cubics, quantile_cubic
from noctule.localization.detection.detector import blob_altitude, blob_surface, is_cut
from noctule.localization.detection.samples import (
    AltitudeRangeError,
    AreaTrendError,
    FlightSamples,
    NotAloneError,
    TooFewSamplesError,
    flight_samples,
)

SAMPLES = flight_samples(manual_flight_blobs(0), CEILING_CAMERA)
CUBICS = fit_cubics(SAMPLES)
BAND = fit_band(SAMPLES)


def samples_of(altitude, area) -> FlightSamples:
    n = len(altitude)
    return FlightSamples(np.asarray(altitude), np.asarray(area), np.full(n, DRONE_SURFACE), np.ones((n, 7)))


def test_the_altitude_of_a_blob_is_that_of_its_points() -> None:
    assert blob_altitude(blob_at([0.2, 0.1, 1.3]), CEILING_CAMERA) == pytest.approx(1.3)


def test_the_surface_of_a_blob_does_not_depend_on_where_it_is() -> None:
    seen = [blob_surface(blob_at([0.1, y, z]), CEILING_CAMERA) for y in (-0.7, 0.6) for z in (0.4, 2.0)]
    assert np.allclose(seen, DRONE_SURFACE, rtol=1e-3)


@pytest.mark.parametrize("detector", [CUBICS, BAND])
def test_the_drone_is_accepted_at_every_height_that_was_flown(detector) -> None:
    unseen = [blobs[0] for blobs in manual_flight_blobs(1)]
    assert len(detector.propose(unseen, CEILING_CAMERA)) >= 0.97 * len(unseen)


@pytest.mark.parametrize("detector", [CUBICS, BAND])
@pytest.mark.parametrize("surface", [0.03, 0.4])
def test_much_smaller_and_much_larger_things_are_refused(detector, surface) -> None:
    things = [blob_at([0.0, -0.2, z], surface) for z in np.linspace(0.5, 2.0, 20)]
    assert detector.propose(things, CEILING_CAMERA) == ()


@pytest.mark.parametrize("detector", [CUBICS, BAND])
@pytest.mark.parametrize("z", [0.0, 0.3, 2.3, 2.8])
def test_nothing_is_accepted_at_a_height_that_was_not_flown(detector, z) -> None:
    """No extrapolation: even a thing of the drone's own size is refused there."""
    assert detector.propose([blob_at([0.0, -0.5, z])], CEILING_CAMERA) == ()


@pytest.mark.parametrize("detector", [CUBICS, BAND])
def test_accepted_blobs_keep_their_order_and_no_blobs_give_none(detector) -> None:
    blobs = [
        blob_at([0.0, y, 1.2], s, label=i) for i, (y, s) in enumerate([(0.3, 0.12), (0, 0.5), (-0.3, 0.12)])
    ]
    assert [blob.label for blob in detector.propose(blobs, CEILING_CAMERA)] == [0, 2]
    assert detector.propose([], CEILING_CAMERA) == ()


def test_the_published_rule_is_corrected_an_area_below_both_cubics_is_not_the_drone() -> None:
    cubics = AreaCubics(np.array([3000.0, 0, 0, 0]), np.array([2000.0, 0, 0, 0]), 0.5, 2.0)
    areas = [1999, 2000, 2001, 2999, 3000, 3001]
    depth = blob_at([0.0, 0.0, 1.0]).depth
    focal = CEILING_CAMERA.intrinsics.focal
    blobs = [blob_at([0.0, 0.0, 1.0], a * depth**2 / (focal[0] * focal[1])) for a in areas]
    assert [b.area for b in cubics.propose(blobs, CEILING_CAMERA)] == [2001, 2999]


def test_the_cubics_say_nan_outside_of_their_range() -> None:
    low, high = CUBICS.limits(
        np.array([CUBICS.lowest - 1e-6, CUBICS.lowest, CUBICS.highest, CUBICS.highest + 1e-6])
    )
    assert np.isnan(low[[0, 3]]).all()
    assert np.isnan(high[[0, 3]]).all()
    assert np.isfinite(low[1:3]).all()
    assert (low[1:3] < high[1:3]).all()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.4), st.integers(100, 300), st.floats(0.0, 0.3))
def test_the_smallest_area_stays_below_the_largest_over_the_whole_range(seed, spread, n, outliers) -> None:
    rng = np.random.default_rng(seed)
    altitude = np.concatenate([rng.uniform(0.4, 2.2, n // 2), rng.normal(1.2, 0.05, n - n // 2)])
    area = 5e4 / (3.3 - altitude) ** 2 * (1.0 + spread * rng.standard_normal(n))
    bad = rng.random(n) < outliers * (altitude < 0.7)  # what made raw extremes cross: dropouts at one end
    area = np.maximum(np.where(bad, 0.3 * area, area), 10.0)
    fitted = fit_cubics(samples_of(altitude, area))
    low, high = fitted.limits(np.linspace(fitted.lowest, fitted.highest, 500))
    assert (low < high).all()


def test_a_quantile_cubic_leaves_its_share_below_everywhere() -> None:
    rng = np.random.default_rng(3)
    x = rng.uniform(0.5, 2.0, 4000)
    y = (2.0 + x**3) * (1.0 + 0.1 * rng.standard_normal(4000))
    for quantile in (0.1, 0.5, 0.9):
        below = y < quantile_cubic(x, y, quantile)(x)
        for start in (0.5, 1.0, 1.5):
            here = (x >= start) & (x < start + 0.5)
            assert below[here].mean() == pytest.approx(quantile, abs=0.03)


def test_a_quantile_cubic_of_points_on_a_cubic_is_that_cubic() -> None:
    cubic = Polynomial([3.0, 1.0, -0.5, 0.4])
    x = np.linspace(0.3, 2.5, 50)
    assert np.allclose(quantile_cubic(x, cubic(x), 0.5)(x), cubic(x), atol=1e-9)


def test_one_bad_frame_does_not_move_the_fits() -> None:
    area = SAMPLES.area.copy()
    area[200] *= 8.0
    moved = fit_cubics(samples_of(SAMPLES.altitude, area))
    z = np.linspace(CUBICS.lowest, CUBICS.highest, 50)
    assert np.allclose(moved.limits(z), CUBICS.limits(z), rtol=0.06)


def test_the_largest_blob_of_a_frame_is_the_drone_and_frames_without_blobs_do_not_count() -> None:
    frames = manual_flight_blobs(4, frames=150)
    splinter = blob_at([0.4, 0.4, 0.9], 0.01)
    with_splinters = [(splinter, *blobs) for blobs in frames] + [()] * 50
    plain, splintered = flight_samples(frames, CEILING_CAMERA), flight_samples(with_splinters, CEILING_CAMERA)
    assert np.array_equal(plain.area, splintered.area)
    assert np.array_equal(plain.altitude, splintered.altitude)


def test_blobs_cut_by_the_border_are_not_learned_from() -> None:
    cut = blob_at([0.0, 2.2, 1.0])
    assert is_cut(cut, CEILING_CAMERA)
    frames = manual_flight_blobs(5, frames=150)
    assert len(flight_samples([*frames, *[(cut,)] * 40], CEILING_CAMERA)) == len(
        flight_samples(frames, CEILING_CAMERA)
    )


def test_too_few_frames_are_refused() -> None:
    with pytest.raises(TooFewSamplesError) as caught:
        flight_samples(manual_flight_blobs(0, frames=40), CEILING_CAMERA)
    assert str(caught.value) == (
        "manual flight: 40 frames show the drone whole, at least 100 are needed; fly longer, inside the "
        "camera's view"
    )


def test_a_flight_at_one_height_is_refused() -> None:
    with pytest.raises(AltitudeRangeError) as caught:
        flight_samples(manual_flight_blobs(0, low=1.0, high=1.2), CEILING_CAMERA)
    assert str(caught.value) == (
        "manual flight: altitudes from 1.00 to 1.20 m, a range of at least 0.5 m is needed; climb and "
        "descend over the heights that you want to fly at"
    )


def test_a_thing_that_does_not_grow_towards_the_camera_is_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(AreaTrendError) as caught:
        fit_band(samples_of(rng.uniform(0.5, 2.0, 300), np.full(300, 5000.0)))
    assert str(caught.value) == (
        "manual flight: the area is 5000 px at the lowest altitudes and 5000 px at the highest, it should "
        "grow by 10% or more; is it the drone that moves, and does the camera's calibration fit?"
    )


def test_a_person_in_the_manual_flight_is_refused() -> None:
    person = blob_at([0.5, 0.5, 1.6], 0.2, label=2)
    frames = [(*blobs, person) for blobs in manual_flight_blobs(0, frames=200)]
    with pytest.raises(NotAloneError) as caught:
        flight_samples(frames, CEILING_CAMERA)
    assert str(caught.value) == (
        "manual flight: 200 of 200 frames show a second thing beside the drone, at most 10% may; empty the "
        "room, or take the background again, and repeat the flight"
    )
