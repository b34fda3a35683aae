"""Detection by Hu's moments: the shape decides, whatever its size, and only the shape."""

from __future__ import annotations

import numpy as np
import pytest
from localization_blobs import blob_at

from noctule.camera import CEILING_CAMERA
from noctule.localization.detection.hu import HuPatterns, fit_hu
from noctule.localization.detection.samples import FlightSamples, TooFewSamplesError, flight_samples
from noctule.vision.depth.blob import Blob
from noctule.vision.depth.moments import hu_moments


def shaped(x_world, outline, turn: float = 0.0, scale: float = 40.0, label: int = 1) -> Blob:
    """A blob of the pixels where outline(x, y) holds, turned and scaled."""
    v, u = np.mgrid[-120:121, -120:121]
    c, s = np.cos(turn), np.sin(turn)
    x, y = (c * u + s * v) / scale, (c * v - s * u) / scale
    inside = outline(x, y)
    a, b = u[inside] - u[inside].mean(), v[inside] - v[inside].mean()
    orders = [(2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)]
    moments = np.array([(a**i * b**j).sum() for i, j in orders])
    depth = float(CEILING_CAMERA.to_camera(np.asarray(x_world, dtype=float)[None])[0, 2])
    surface = inside.sum() * depth**2 / np.prod(CEILING_CAMERA.intrinsics.focal)
    return blob_at(x_world, surface, moments, label)


def arrow(x, y):
    """Longer than wide and blunt in front: like a drone without hull."""
    return (np.abs(y) < 0.25 + 0.2 * (x > 0)) & (np.abs(x) < 1.0)


def triangle(x, y):
    return (x > -0.5) & (np.abs(y) < 0.8 - 0.6 * (x + 0.5)) & (x < 0.8)


def flight(seed: int = 0, n: int = 150) -> list[tuple[Blob, ...]]:
    rng = np.random.default_rng(seed)
    places = rng.uniform([-0.2, -0.4, 0.5], [0.2, 0.2, 2.0], (n, 3))
    # Nearer to the camera is larger in the picture.
    return [(shaped(x, arrow, rng.uniform(-3, 3), 90.0 / (3.3 - x[2])),) for x in places]


SAMPLES = flight_samples(flight(), CEILING_CAMERA)
FITTED = fit_hu(SAMPLES)


def test_the_shape_of_the_flight_is_accepted_however_it_is_turned() -> None:
    seen = [blobs[0] for blobs in flight(1, 60)]
    assert len(FITTED.propose(seen, CEILING_CAMERA)) >= 0.95 * len(seen)


def test_another_shape_is_refused() -> None:
    things = [shaped([0.0, 0.0, 1.2], triangle, t) for t in np.linspace(-3, 3, 12)]
    assert FITTED.propose(things, CEILING_CAMERA) == ()


def test_it_knows_no_size_so_a_thing_of_the_same_shape_is_accepted_at_any_height() -> None:
    """This is why it is published and not the default."""
    large = shaped([0.0, 0.0, 0.1], arrow, 0.4, 100.0)
    assert FITTED.propose([large], CEILING_CAMERA) == (large,)


def test_the_distance_is_that_to_the_nearest_pattern() -> None:
    blob = shaped([0.0, 0.0, 1.2], triangle)
    own = HuPatterns(np.array([SAMPLES.hu[0], hu_moments(blob)]), 0.1)
    assert own.distance(blob) == 0.0
    assert own.propose([blob], CEILING_CAMERA) == (blob,)


def test_patterns_stand_for_all_the_shapes_of_the_flight() -> None:
    """Half of the flight shows another outline, and a pattern of each half is chosen."""
    rng = np.random.default_rng(0)
    hu = np.array(
        [hu_moments(shaped([0, 0, 1.0], o, rng.uniform(-3, 3))) for o in (arrow, triangle) for _ in range(60)]
    )
    n = len(hu)
    samples = FlightSamples(SAMPLES.altitude[:n], SAMPLES.area[:n], SAMPLES.surface[:n], hu)
    patterns = fit_hu(samples, patterns=2).patterns
    firsts = sorted(patterns[:, 0])
    assert firsts == pytest.approx(sorted([np.median(hu[:60, 0]), np.median(hu[60:, 0])]), rel=0.02)


def test_the_threshold_holds_the_share_of_the_flight_that_was_asked_for() -> None:
    loose, tight = fit_hu(SAMPLES, share=1.0), fit_hu(SAMPLES, share=0.5, margin=0.0)
    assert tight.threshold < loose.threshold
    inside = [tight.distance(blobs[0]) <= tight.threshold for blobs in flight()]
    assert np.mean(inside) == pytest.approx(0.5, abs=0.05)


def test_too_short_a_flight_is_refused() -> None:
    few = FlightSamples(SAMPLES.altitude[:30], SAMPLES.area[:30], SAMPLES.surface[:30], SAMPLES.hu[:30])
    with pytest.raises(TooFewSamplesError, match="30 frames show the drone whole"):
        fit_hu(few)
