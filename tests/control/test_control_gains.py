import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.control.gains import AdaptiveGain, GainError, gain_vector

PAPER = AdaptiveGain(at_zero=2.8, at_infinity=0.1, slope=5.0)


def test_the_gain_has_its_two_ends():
    assert PAPER(np.zeros(6)) == pytest.approx(2.8)
    assert PAPER(np.full(6, 1e3)) == pytest.approx(0.1)


def test_the_slope_is_the_derivative_at_zero_with_its_sign_turned():
    step = 1e-7
    assert (PAPER(np.array([step])) - PAPER(np.zeros(1))) / step == pytest.approx(-5.0, rel=1e-5)


def test_only_the_norm_of_the_error_counts():
    assert PAPER(np.array([0.3, 0.4])) == pytest.approx(PAPER(np.array([0.0, -0.5, 0.0])))


@given(st.floats(0.0, 50.0), st.floats(0.0, 50.0))
def test_the_gain_never_grows_with_the_error(a, b):
    small, large = sorted((a, b))
    assert PAPER(np.array([large])) <= PAPER(np.array([small]))


def test_equal_ends_make_a_constant_gain():
    assert AdaptiveGain(0.7, 0.7, 5.0)(np.array([0.2])) == 0.7


@pytest.mark.parametrize(("at_zero", "at_infinity"), [(0.1, 2.8), (1.0, 0.0), (float("nan"), 0.1)])
def test_ends_in_the_wrong_order_are_refused(at_zero, at_infinity):
    with pytest.raises(GainError) as caught:
        AdaptiveGain(at_zero, at_infinity, 5.0)
    assert str(caught.value) == (
        f"adaptive gain: at_zero is {at_zero:g} and at_infinity {at_infinity:g}, "
        "expected 0 < at_infinity <= at_zero; raise at_zero or lower at_infinity"
    )


def test_a_negative_slope_is_refused():
    with pytest.raises(GainError) as caught:
        AdaptiveGain(2.8, 0.1, -5.0)
    assert str(caught.value) == "adaptive gain: slope is -5, expected 0 or more; drop its sign"


def test_the_lateral_gain_is_that_of_the_cameras_x_axis():
    gains = gain_vector(1.2, lateral_extra=2.5, angular_scale=0.5)
    np.testing.assert_allclose(gains, [3.7, 1.2, 1.2, 0.6, 0.6, 0.6])
