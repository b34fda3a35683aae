"""Splinters: pieces of one thing are put together as if they had never come apart, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from localization_blobs import blob_at

from noctule.camera import CEILING_CAMERA
from noctule.localization.detection.band import SurfaceBand
from noctule.localization.detection.detector import blob_surface
from noctule.localization.detection.splinters import join_splinters, relabel
from noctule.vision.depth.background import Background
from noctule.vision.depth.blob import Blob
from noctule.vision.depth.blobs import find_blobs
from noctule.vision.depth.moments import hu_moments

HEIGHT, WIDTH = 480, 640
EMPTY = np.full((HEIGHT, WIDTH), 3000, dtype=np.uint16)
BACKGROUND = Background(
    EMPTY.astype(np.float32),
    np.full((HEIGHT, WIDTH), 5.0, dtype=np.float32),
    np.full((HEIGHT, WIDTH), 100, dtype=np.int32),
    np.full((HEIGHT, WIDTH), 2950, dtype=np.uint16),
    100,
    4.0,
)


def blobs_of(depth) -> tuple[np.ndarray, tuple[Blob, ...]]:
    return find_blobs(depth, BACKGROUND, CEILING_CAMERA.intrinsics, min_area=5)


def same(a: Blob, b: Blob) -> bool:
    arrays = ("centroid", "moments", "points")
    plain = ("area", "left", "top", "right", "bottom")
    close = [np.allclose(getattr(a, k), getattr(b, k), rtol=1e-9, atol=1e-6) for k in arrays]
    return all(close) and all(getattr(a, k) == getattr(b, k) for k in plain)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_joined_pieces_measure_as_the_whole_would(seed, pieces) -> None:
    rng = np.random.default_rng(seed)
    apart = EMPTY.copy()
    apart[220:260, 300:360] = 1600 + rng.integers(0, 20, (40, 60))
    for k in range(pieces):
        top, left = 215 + 12 * k, 363
        patch = 1600 + rng.integers(0, 20, (rng.integers(3, 10), rng.integers(3, 15)))
        apart[top : top + patch.shape[0], left : left + patch.shape[1]] = patch
    _, found = blobs_of(apart)
    joined, parts = join_splinters(found, CEILING_CAMERA)
    assert len(joined) == 1
    assert len(parts) == len(found) - 1
    v, u = np.nonzero(apart < 2950)
    z = apart[v, u] * 1e-3
    m = CEILING_CAMERA.intrinsics.normalise(np.column_stack([u, v]))
    a, b = u - u.mean(), v - v.mean()
    orders = [(2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)]
    whole = Blob(
        1,
        len(u),
        int(u.min()),
        int(v.min()),
        int(u.max()) + 1,
        int(v.max()) + 1,
        np.array([u.mean(), v.mean()]),
        np.array([(a**i * b**j).sum() for i, j in orders]),
        np.column_stack([m * z[:, None], z]).mean(axis=0),
        float(z.mean()),
    )
    assert same(joined[0], whole)
    assert joined[0].depth == pytest.approx(whole.depth)
    assert np.allclose(hu_moments(joined[0]), hu_moments(whole), rtol=1e-6, atol=1e-18)


def test_a_splinter_takes_the_label_of_its_blob_and_the_given_image_stays_as_it_was() -> None:
    depth = EMPTY.copy()
    depth[215:219, 320:326] = 1600  # above the body: the splinter has the smaller label
    depth[222:260, 300:360] = 1600
    depth[400:440, 100:160] = 1600
    labels, found = blobs_of(depth)
    before = labels.copy()
    joined, parts = join_splinters(found, CEILING_CAMERA)
    assert parts == {1: 2}
    changed = relabel(labels, found, parts)
    assert np.array_equal(labels, before)
    assert (changed[215:219, 320:326] == 2).all()
    assert (changed[222:260, 300:360] == 2).all()
    assert [blob.label for blob in joined] == [2, 3]
    assert np.array_equal(np.unique(changed), [0, 2, 3])
    assert relabel(labels, found, {}) is labels


def drone_and(piece: Blob) -> int:
    """How many things there are, of a drone's body at 1.2 m and a piece."""
    joined, _ = join_splinters([blob_at([0.0, 0.0, 1.2], 0.06, label=1), piece], CEILING_CAMERA)
    return len(joined)


def test_a_rotor_beside_the_body_is_part_of_it() -> None:
    assert drone_and(blob_at([0.15, 0.15, 1.22], 0.01, label=2)) == 1


@pytest.mark.parametrize(
    ("x_world", "surface"),
    [
        ([0.25, 0.25, 1.2], 0.01),  # further away than a rotor can be
        ([0.15, 0.0, 0.9], 0.01),  # below: a hand, a table's edge
        ([0.2, 0.0, 1.2], 0.04),  # a thing of its own
    ],
)
def test_what_is_far_or_below_or_large_is_a_thing_of_its_own(x_world, surface) -> None:
    assert drone_and(blob_at(x_world, surface, label=2)) == 2


def test_a_splinter_between_two_things_goes_to_the_nearer() -> None:
    things = [blob_at([x, 0.0, 1.2], 0.06, label=k) for k, x in ((1, 0.0), (2, 0.45))]
    joined, parts = join_splinters([*things, blob_at([0.27, 0.0, 1.2], 0.01, label=3)], CEILING_CAMERA)
    assert parts == {3: 2}
    assert [blob.label for blob in joined] == [1, 2]


def test_splinters_do_not_gather_splinters_into_a_chain() -> None:
    crumbs = [blob_at([0.2 * k, 0.0, 1.2], 0.01, label=k + 1) for k in range(4)]
    joined, _ = join_splinters(crumbs, CEILING_CAMERA)
    assert len(joined) == 4


def test_no_blob_and_one_blob_are_left_alone() -> None:
    blob = blob_at([0.0, 0.0, 1.0])
    assert join_splinters([], CEILING_CAMERA) == ((), {})
    assert join_splinters([blob], CEILING_CAMERA) == ((blob,), {})


def test_a_detector_judges_the_whole_and_returns_it() -> None:
    """Body alone: too small. Body with rotors: the drone."""
    body = blob_at([0.0, 0.0, 1.2], 0.06, label=1)
    rotors = [
        blob_at([x, y, 1.2], 0.012, label=2 + k) for k, (x, y) in enumerate([(0.15, 0.1), (-0.1, 0.15)])
    ]
    band = SurfaceBand(0.07, 0.1, 0.5, 2.0)
    assert band.propose([body], CEILING_CAMERA) == ()
    (found,) = band.propose([body, *rotors], CEILING_CAMERA)
    assert found.label == 1
    assert blob_surface(found, CEILING_CAMERA) == pytest.approx(0.084, rel=0.01)
