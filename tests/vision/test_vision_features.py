import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from vision_photographs import HEIGHT, NAMES, WIDTH, motion, moved, photograph, view

from noctule.vision.features import DETECTORS, UnknownFeatureKindError, detect, gray
from noctule.vision.matching import match
from noctule.vision.spreading import bucket, spread

KINDS = sorted(DETECTORS)


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_picture_gives_the_same_features_in_the_same_order(kind):
    first, second = detect(photograph("coffee"), kind), detect(photograph("coffee").copy(), kind)
    np.testing.assert_array_equal(first.p, second.p)
    np.testing.assert_array_equal(first.descriptors, second.descriptors)
    assert first.kind == kind


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("brightness", [0, 128, 255])
def test_a_blank_picture_has_no_features(kind, brightness):
    found = detect(np.full((HEIGHT, WIDTH, 3), brightness, dtype=np.uint8), kind)
    assert len(found) == 0
    assert found.p.shape == (0, 2)
    assert found.descriptors.shape[0] == 0


@pytest.mark.parametrize("shape", [(1, 1), (7, 300), (24, 24)])
def test_a_tiny_picture_does_no_harm(shape):
    rng = np.random.default_rng(0)
    found = detect(rng.integers(0, 255, shape, dtype=np.uint8))
    assert len(found) <= shape[0] * shape[1]


@pytest.mark.parametrize("kind", KINDS)
def test_the_limit_is_kept_and_reached(kind):
    assert len(detect(photograph("astronaut"), kind, limit=150)) == 150


def test_gray_and_colour_of_a_picture_have_the_same_features():
    colour = photograph("chelsea")
    np.testing.assert_array_equal(detect(colour).p, detect(gray(colour)).p)


@pytest.mark.parametrize("name", NAMES)
def test_features_cover_the_picture(name):
    p = detect(photograph(name)).p
    cells = set(zip((p[:, 0] // (WIDTH / 4)).astype(int), (p[:, 1] // (HEIGHT / 3)).astype(int), strict=True))
    assert len(cells) >= 11  # of 12


def test_sift_descriptors_have_unit_length():
    found = detect(photograph("astronaut"))
    assert found.descriptors.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(found.descriptors, axis=1), 1.0, atol=1e-5)


@pytest.mark.parametrize(("x", "y"), [(100.0, 60.0), (100.5, 60.25), (400.3, 200.7)])
@pytest.mark.parametrize("radius", [1.5, 3.0, 7.0])
def test_a_spot_is_found_where_its_centre_is(x, y, radius):
    # The convention: the centre of the top left pixel is (0, 0). A quarter pixel of bias would be seen here.
    across, down = np.meshgrid(np.arange(500), np.arange(300))
    spot = 200.0 * np.exp(-((across - x) ** 2 + (down - y) ** 2) / (2.0 * radius**2))
    found = detect(np.rint(spot + 20.0).astype(np.uint8))
    strongest = found.p[np.argmin(np.linalg.norm(found.p - [x, y], axis=1))]
    np.testing.assert_allclose(strongest, [x, y], atol=0.08)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("H", "fewest", "median_px"),
    [
        (motion(1.0, 0.0, 8.3, -5.7), 150, 0.35),
        (motion(1.25, 0.02, 4.0, 3.0), 90, 0.4),
        (motion(1.7), 40, 0.5),
        (motion(0.7, 0.0, 10.0), 70, 0.4),
        (motion(1.1, np.deg2rad(10.0)), 80, 0.4),
        (motion(1.1, tilt=3e-4), 90, 0.4),
    ],
)
def test_features_of_two_views_of_a_photograph_match_where_they_should(name, H, fewest, median_px):
    a, b = detect(view(name, np.eye(3), seed=1)), detect(view(name, H, seed=2))
    index_a, index_b = match(a, b)
    away = b.p[index_b] - moved(H, a.p[index_a])
    distance = np.linalg.norm(away, axis=1)
    good = distance < 3.0
    assert good.sum() >= fewest
    assert good.mean() > 0.75
    assert np.median(distance[good]) < median_px
    assert np.all(np.abs(np.median(away[good], axis=0)) < 0.12)


def test_an_unknown_kind_is_an_error_that_names_the_known_ones():
    with pytest.raises(UnknownFeatureKindError) as caught:
        detect(photograph("coffee"), "surf")
    assert str(caught.value) == "feature kind: found 'surf', expected one of orb, sift; change the kind"


points = st.lists(st.tuples(st.floats(0, 855), st.floats(0, 479)), max_size=200).map(
    lambda rows: np.array(rows, dtype=np.float64).reshape(-1, 2)
)


@settings(deadline=None, max_examples=60)
@given(points, st.integers(1, 80))
def test_bucket_chooses_as_many_as_asked_and_none_twice(p, limit):
    chosen = bucket(p, np.arange(len(p), dtype=np.float64), (HEIGHT, WIDTH), limit)
    assert len(chosen) == len(set(chosen.tolist())) == min(limit, len(p))


def test_bucket_takes_a_lonely_weak_point_before_the_second_of_a_crowd():
    crowd = np.column_stack([np.linspace(10, 12, 50), np.full(50, 10.0)])
    p = np.vstack([crowd, [[800.0, 400.0]]])
    strength = np.append(np.linspace(5, 9, 50), 0.1)
    assert bucket(p, strength, (HEIGHT, WIDTH), 40).tolist()[:3] == [49, 50, 48]


@settings(deadline=None, max_examples=60)
@given(points, st.integers(1, 80))
def test_spread_chooses_as_many_as_asked_in_ascending_order(p, most):
    chosen = spread(p, WIDTH, HEIGHT, most)
    assert len(chosen) == min(most, len(p))
    assert np.all(np.diff(chosen) > 0)


def test_spread_points_are_farther_apart_than_the_first_or_random_ones():
    p = detect(photograph("astronaut")).p
    rng = np.random.default_rng(0)

    def closest(index):
        d = np.linalg.norm(p[index][:, None] - p[index][None], axis=2) + 1e9 * np.eye(len(index))
        return np.median(d.min(axis=1))

    chosen = spread(p, WIDTH, HEIGHT, 60)
    assert closest(chosen) > 1.5 * closest(rng.permutation(len(p))[:60])


def test_spread_keeps_the_better_of_two_neighbours():
    grid = np.stack(np.meshgrid(np.linspace(60, 790, 8), np.linspace(60, 420, 5)), axis=-1).reshape(-1, 2)
    p = np.vstack([grid, grid + 2.0])
    weights = np.concatenate([np.full(40, 0.5), np.ones(40)])
    np.testing.assert_array_equal(spread(p, WIDTH, HEIGHT, 40, weights), np.arange(40, 80))
    np.testing.assert_array_equal(spread(p, WIDTH, HEIGHT, 40, weights[::-1]), np.arange(40))
