import cv2
import numpy as np
import pytest
import skimage.data
from hypothesis import given, settings
from hypothesis import strategies as st
from vision_photographs import HEIGHT, NAMES, WIDTH, motion, moved, noisy, photograph, view

from noctule.vision.features import detect
from noctule.vision.spreading import spread
from noctule.vision.tracking import Pyramid, align, correlation, inside, track

STILL = np.eye(3)


def points_of(pixels, most=60):
    p = detect(pixels).p
    return p[spread(p, WIDTH, HEIGHT, most)]


def error_of(p_new, ok, H, p):
    return np.linalg.norm(p_new - moved(H, p), axis=1)[ok]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("H", "median_px"),
    [
        (motion(right=0.4, down=0.3), 0.08),
        (motion(1.005, 0.002, 2.3, -1.4), 0.1),
        (motion(1.02, 0.01, 14.3, -6.4), 0.18),
        (motion(0.98, -0.01, -9.0, 4.0), 0.18),
    ],
)
def test_points_are_followed_to_a_fraction_of_a_pixel(name, H, median_px):
    first, second = view(name, STILL, seed=1), view(name, H, seed=2)
    p = points_of(first)
    p_new, ok = track(Pyramid.of(first), Pyramid.of(second), p)
    in_view = inside(moved(H, p), (HEIGHT, WIDTH), 10.0)
    assert ok[in_view].mean() > 0.93
    assert np.median(error_of(p_new, ok, H, p)) < median_px
    assert np.mean(error_of(p_new, ok, H, p) < 1.0) > 0.97


def test_nothing_moves_when_the_picture_is_the_same():
    pyramid = Pyramid.of(photograph("astronaut"))
    p = points_of(photograph("astronaut"))
    p_new, ok = track(pyramid, pyramid, p)
    assert ok.mean() > 0.95  # a point on a wide blur may lack texture
    np.testing.assert_allclose(p_new[ok], p[ok], atol=1e-3)


def test_a_guess_makes_a_long_jump_possible():
    H = motion(right=95.0, down=-40.0)
    first, second = view("coffee", STILL, seed=1), view("coffee", H, seed=2)
    p = points_of(first)
    in_view = inside(moved(H, p), (HEIGHT, WIDTH), 10.0)
    guess = moved(H, p) + np.random.default_rng(0).normal(0.0, 3.0, p.shape)
    _, blind = track(Pyramid.of(first), Pyramid.of(second), p)
    p_new, ok = track(Pyramid.of(first), Pyramid.of(second), p, guess)
    assert ok[in_view].mean() > 0.95 > blind[in_view].mean()
    assert np.median(error_of(p_new, ok, H, p)) < 0.15


def test_points_that_leave_the_picture_are_dropped():
    H = motion(right=60.0)
    first, second = view("astronaut", STILL, seed=1), view("astronaut", H, seed=2)
    p = detect(first).p
    p_new, ok = track(Pyramid.of(first), Pyramid.of(second), p, moved(H, p))
    gone = moved(H, p)[:, 0] > WIDTH + 1.0
    assert gone.sum() > 10
    assert not ok[gone].any()
    assert inside(p_new[ok], (HEIGHT, WIDTH)).all()


def test_points_behind_something_new_are_dropped():
    first = view("chelsea", STILL, seed=1)
    covered = view("chelsea", motion(right=3.0), seed=2)
    covered[100:380, 300:560] = noisy(np.full((280, 260, 3), 128.0), 2.0, seed=3)
    p = points_of(first, 200)
    hidden = (np.abs(p[:, 0] + 3.0 - 430) < 115) & (np.abs(p[:, 1] - 240) < 125)
    _, ok = track(Pyramid.of(first), Pyramid.of(covered), p)
    assert hidden.sum() > 15
    assert ok[hidden].mean() < 0.25
    assert ok[~hidden].mean() > 0.8


def test_a_point_may_not_jump_farther_than_allowed():
    first, second = view("coffee", STILL), view("coffee", motion(right=12.0))
    p = points_of(first)
    _, free = track(Pyramid.of(first), Pyramid.of(second), p)
    _, bound = track(Pyramid.of(first), Pyramid.of(second), p, jump_limit=8.0)
    assert free.mean() > 0.9
    assert bound.mean() < 0.1


def test_a_picture_without_texture_keeps_no_point():
    blank = Pyramid.of(np.full((HEIGHT, WIDTH, 3), 90, dtype=np.uint8))
    _, ok = track(Pyramid.of(photograph("coffee")), blank, points_of(photograph("coffee")))
    assert not ok.any()


def test_no_points_are_no_problem():
    pyramid = Pyramid.of(photograph("coffee"))
    p_new, ok = track(pyramid, pyramid, np.empty((0, 2)))
    assert (p_new.shape, ok.shape) == ((0, 2), (0,))
    aligned = align(pyramid, pyramid, np.empty((0, 2)), np.empty((0, 2)))
    assert (aligned.p.shape, aligned.ok.shape, aligned.score.shape) == ((0, 2), (0,), (0,))


def test_tracking_twice_gives_the_same_bits():
    first, second = view("rocket", STILL, seed=1), view("rocket", motion(1.01, right=4.0), seed=2)
    p = points_of(first)
    once, again = (track(Pyramid.of(first), Pyramid.of(second), p) for _ in range(2))
    np.testing.assert_array_equal(once[0], again[0])
    np.testing.assert_array_equal(once[1], again[1])


def test_tracking_drifts_over_sixty_pictures_and_alignment_takes_the_drift_away():
    name = "astronaut"
    key = view(name, STILL, seed=100)
    p_ref = points_of(key)
    p, previous = p_ref, Pyramid.of(key)
    H = STILL
    for k in range(1, 61):
        H = motion(1.0 + 0.003 * k, 0.001 * k, 0.8 * k, -0.5 * k)
        current = Pyramid.of(view(name, H, seed=100 + k))
        p, ok = track(previous, current, p)
        p, p_ref, previous = p[ok], p_ref[ok], current
    drift = np.linalg.norm(p - moved(H, p_ref), axis=1)
    aligned = align(Pyramid.of(key), previous, p_ref, p)
    assert len(p) > 35
    assert np.median(drift) < 2.0
    assert aligned.ok.mean() > 0.8
    assert np.median(error_of(aligned.p, aligned.ok, H, p_ref)) < 0.15 < np.median(drift)


@pytest.mark.parametrize("scale", [0.6, 0.9, 1.0, 1.1, 1.3, 1.8])
def test_alignment_from_a_key_image_holds_over_a_wide_range_of_scales(scale):
    H = motion(scale, 0.01, 9.0, 5.0, 1e-4)
    for seed, name in enumerate(NAMES):
        key, live = view(name, STILL, seed=seed), view(name, H, seed=seed + 10)
        p = points_of(key)
        p = p[inside(moved(H, p), (HEIGHT, WIDTH), 8.0)]
        guess = moved(H, p) + np.random.default_rng(seed).normal(0.0, 4.0, p.shape)
        aligned = align(Pyramid.of(key), Pyramid.of(live), p, guess)
        assert aligned.ok.mean() > 0.8
        assert np.median(error_of(aligned.p, aligned.ok, H, p)) < 0.25
        assert np.mean(error_of(aligned.p, aligned.ok, H, p) < 1.0) > 0.93
        assert np.median(aligned.score) > 0.9


def test_a_few_wild_guesses_do_not_spoil_the_alignment_of_the_others():
    H = motion(1.2, 0.0, 6.0, 3.0)
    key, live = view("astronaut", STILL, seed=1), view("astronaut", H, seed=2)
    p = points_of(key)
    p = p[inside(moved(H, p), (HEIGHT, WIDTH), 8.0)]
    guess = moved(H, p)
    guess[:6] += 60.0
    aligned = align(Pyramid.of(key), Pyramid.of(live), p, guess)
    assert aligned.ok[6:].mean() > 0.85
    assert np.median(error_of(aligned.p, aligned.ok, H, p)) < 0.25


def test_alignment_with_another_picture_says_that_it_does_not_agree():
    p = points_of(photograph("coffee"))
    aligned = align(Pyramid.of(photograph("coffee")), Pyramid.of(photograph("rocket")), p, p)
    assert aligned.ok.mean() < 0.1
    assert np.median(aligned.score) < 0.6


def test_a_real_stereo_pair_aligns_at_its_disparity():
    left, right, disparity = skimage.data.stereo_motorcycle()
    p = detect(left).p
    x, y = np.rint(p).astype(int).T
    true = disparity[y, x]
    known = np.isfinite(true) & (true > 0) & (p[:, 0] - true > 15)
    p, true = p[known][:120], true[known][:120]
    guess = p - np.column_stack([true, np.zeros(len(p))]) + np.random.default_rng(0).normal(0, 3.0, p.shape)
    aligned = align(Pyramid.of(left), Pyramid.of(right), p, guess)
    away = aligned.p - (p - np.column_stack([true, np.zeros(len(p))]))
    assert aligned.ok.mean() > 0.5
    assert np.median(np.abs(away[aligned.ok])) < 0.35
    assert np.mean(np.linalg.norm(away[aligned.ok], axis=1) < 3.0) > 0.85


patches = st.integers(0, 1000).map(lambda seed: np.random.default_rng(seed).uniform(0, 255, (4, 225)))


@settings(deadline=None, max_examples=30)
@given(patches, st.floats(0.2, 5.0), st.floats(-50, 50))
def test_correlation_does_not_mind_brightness_and_contrast(a, gain, offset):
    a = a.astype(np.float32)
    np.testing.assert_allclose(correlation(a, np.float32(gain) * a + np.float32(offset)), 1.0, atol=1e-4)
    np.testing.assert_allclose(correlation(a, -a), -1.0, atol=1e-4)


def test_correlation_with_a_flat_patch_is_zero():
    a = np.random.default_rng(0).uniform(0, 255, (2, 225)).astype(np.float32)
    np.testing.assert_array_equal(correlation(a, np.full_like(a, 80.0)), 0.0)


def test_a_pyramid_of_colour_is_that_of_its_brightness():
    colour = photograph("coffee")
    pyramid = Pyramid.of(colour)
    np.testing.assert_array_equal(pyramid.brightness, cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY))
    assert pyramid.shape == (HEIGHT, WIDTH)
