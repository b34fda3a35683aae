"""The constant error of positions, from a drone that stands still."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.camera import CEILING_CAMERA, FixedCamera
from noctule.errors import NoctuleError
from noctule.localization.calibration.offset import (
    LARGEST_OFFSET,
    LargeOffsetError,
    MovedDroneError,
    PlacesDisagreeError,
    ScatterError,
    SlantError,
    Standing,
    TooFewMeasurementsError,
    check_offset,
    corrected,
    measure_offset,
    next_place,
    on_floor,
)
from noctule.localization.placing import slanted
from noctule.messages import PoseMeasurement

EYE = np.array([0.2, -0.8, 3.3])
ASIDE = ((0.1, -0.7), (-0.4, 0.0), (0.6, 0.5), (-0.3, 1.0), (0.4, 1.3))
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


def seen_from(eye, places, slant, bias=BIAS, height=0.7, noise=0.0, known=(True, True)):
    standings = []
    for number, (x, y) in enumerate(places):
        true = np.array([x, y, height])
        spread = np.random.default_rng(number).normal(0.0, noise, (60, 3))
        at = true + bias + slanted(slant, eye, true + bias) + spread
        standings.append(Standing(np.where([*known, True], true, np.nan), at))
    return standings


@given(st.floats(-0.012, 0.012), st.lists(st.floats(-0.03, 0.03), min_size=3, max_size=3))
def test_places_seen_from_several_sides_tell_the_slant_from_the_offset(slant, bias):
    found = measure_offset(seen_from(EYE, ASIDE, slant, np.array(bias)), EYE)
    # The ray to what is measured is that to what is true, to some millimetres in metres.
    assert found.slant == pytest.approx(slant, abs=4e-4)
    np.testing.assert_allclose(found.bias, bias, atol=4e-4)
    assert (found.disagreement < 6e-4).all()


def test_noise_leaves_the_slant_to_a_millimetre():
    found = measure_offset(seen_from(EYE, ASIDE, -0.008, noise=0.004), EYE)
    assert found.slant == pytest.approx(-0.008, abs=0.001)


def test_without_the_cameras_place_the_slant_stays_in_the_offset():
    standings = seen_from(EYE, ASIDE, -0.008)
    plain, told = measure_offset(standings), measure_offset(standings, EYE)
    assert plain.slant == 0.0
    assert plain.disagreement[1] > 0.004 > 10.0 * told.disagreement[1]


def test_places_that_are_seen_from_one_side_tell_no_slant():
    together = [(x, y + 0.5) for x, y in ((0.0, 0.0), (0.2, 0.1), (-0.1, 0.2))]
    for places in (together, ASIDE[:1]):
        standings = seen_from(EYE, places, -0.008)
        found, plain = measure_offset(standings, EYE), measure_offset(standings)
        assert found.slant == 0.0
        np.testing.assert_array_equal(found.bias, plain.bias)


@given(st.floats(-0.03, 0.03), st.floats(-0.03, 0.03))
def test_a_slant_from_before_is_taken_off_where_the_places_do_not_tell_it(slant, before):
    one = measure_offset(seen_from(EYE, ASIDE[4:], slant), EYE, slant)
    assert (one.slant, one.told) == (slant, False)
    np.testing.assert_allclose(one.bias, BIAS, atol=1.5e-3)  # the slope is that to what is measured
    several = measure_offset(seen_from(EYE, ASIDE, slant), EYE, before)
    assert several.told
    assert several.slant == measure_offset(seen_from(EYE, ASIDE, slant), EYE).slant
    # Without the camera's place there is no ray along which it would be.
    assert measure_offset(seen_from(EYE, ASIDE[4:], slant), slant=before).slant == 0.0


def test_what_is_left_at_each_place_is_without_offset_and_slant():
    standings = seen_from(EYE, ASIDE, -0.008)
    np.testing.assert_allclose(measure_offset(standings, EYE).left, 0.0, atol=3e-4)
    wrong = Standing(standings[2].true - [0.0, 0.0, 0.01], standings[2].measured)
    left = measure_offset([*standings[:2], wrong, *standings[3:]], EYE).left
    np.testing.assert_allclose(left[:, 2], [-0.002, -0.002, 0.008, -0.002, -0.002], atol=1e-9)


def test_a_slant_that_no_drone_has_is_refused():
    with pytest.raises(SlantError) as told:
        measure_offset(seen_from(EYE, ASIDE, -0.06), EYE)
    assert str(told.value) == (
        "offset: the places agree with a slant of -63 mm, expected 40 mm or less; measure the places again, "
        "or calibrate again where the camera hangs"
    )


@pytest.mark.parametrize("begun", [ASIDE[:1], ASIDE[4:], ((0.0, 0.5), (0.2, 0.6), (-0.1, 0.7))])
def test_the_next_place_is_seen_whole_and_tells_the_slant(begun):
    eye = CEILING_CAMERA.t_world_camera
    standings = seen_from(eye, begun, -0.008)
    assert not measure_offset(standings, eye).told
    place = next_place(standings, CEILING_CAMERA)
    assert CEILING_CAMERA.inside(place[None])[0] >= 0.4
    assert place[2] == pytest.approx(0.7 + BIAS[2])
    more = seen_from(eye, [*begun, (place[0], place[1])], -0.008)
    assert measure_offset(more, eye).told


def test_a_camera_that_sees_no_whole_drone_knows_no_next_place():
    up = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    camera = FixedCamera(CEILING_CAMERA.intrinsics, up, CEILING_CAMERA.t_world_camera)
    assert next_place(seen_from(EYE, ASIDE, 0.0), camera) is None


@pytest.mark.parametrize(("known", "told"), [((False, True), True), ((False, False), False)])
def test_the_slant_is_told_along_axes_where_the_places_are_known(known, told):
    found = measure_offset(seen_from(EYE, ASIDE, -0.008, known=known), EYE)
    assert found.slant == pytest.approx(-0.008 if told else 0.0, abs=2e-4)
    assert found.bias[0] == 0.0
    assert found.bias[2] == pytest.approx(BIAS[2])


TYPED_WRONGLY = [
    ([-9.9, 69.3, 0.0], "x -9900, y +69300, z +0 mm"),  # centimetres for metres
    ([0.001, -1.3968, 0.0], "x +1, y -1397, z +0 mm"),  # another sign
    ([0.002, -0.003, -0.5], "x +2, y -3, z -500 mm"),  # another stool's height
]


@pytest.mark.parametrize(("bias", "found"), TYPED_WRONGLY)
@pytest.mark.parametrize("places", [ASIDE[:1], ASIDE])
def test_an_offset_of_a_wrong_place_is_refused(places, bias, found):
    """At one place, and where all places are wrong by the same."""
    standings = [
        Standing(s.true - bias, s.measured) for s in seen_from(EYE, places, -0.008, bias=np.zeros(3))
    ]
    with pytest.raises(LargeOffsetError) as told:
        measure_offset(standings, EYE, slant=-0.008)
    assert str(told.value) == (
        f"offset: measured minus true is {found}, expected 150 mm or less along each (25 to 30 mm are "
        "usual); check where the drone stood (--at and --height, or the file of places: metres, and their "
        "signs), and where camera.toml says that the camera hangs"
    )


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_offset_is_plausible_up_to_the_limit_along_every_axis(axis, sign):
    bias = np.zeros(3)
    bias[axis] = sign * LARGEST_OFFSET
    check_offset(bias)
    for beyond in (np.nextafter(bias[axis], sign * 1.0), np.nan, sign * np.inf):
        bias[axis] = beyond
        with pytest.raises(LargeOffsetError):
            check_offset(bias)


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


def test_a_place_with_a_name_is_refused_by_it():
    few = Standing(np.zeros(3), np.zeros((3, 3)), "recording b.mcap")
    assert refusal(TooFewMeasurementsError, standing(), few).startswith(
        "offset: place 2 (recording b.mcap): the drone was measured 3 times, expected 30 or more; "
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
