"""Blobs: the compiled pass against OpenCV's components and moments, and against plain sums over pixels."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from vision_depth_rooms import CAMERA, HEIGHT, WIDTH, frames, plain_background, room, sensed, with_box

from noctule.camera import CEILING_CAMERA, PinholeCamera
from noctule.vision.depth import DepthFormatError, find_blobs, learn_background

ORDERS = ("20", "11", "02", "30", "21", "12", "03")
SIZES = st.tuples(st.integers(1, 40), st.integers(1, 40))
MASKS = SIZES.flatmap(lambda size: hnp.arrays(np.bool_, size, elements=st.booleans(), fill=st.nothing()))


@st.composite
def lumps(draw):
    """Masks of a few overlapping rectangles, some of them cut out again: larger pieces than noise has."""
    mask = np.zeros((draw(st.integers(5, 60)), draw(st.integers(5, 90))), dtype=bool)
    for _ in range(draw(st.integers(1, 8))):
        v, u = draw(st.integers(0, mask.shape[0] - 1)), draw(st.integers(0, mask.shape[1] - 1))
        height, width = draw(st.integers(1, 25)), draw(st.integers(1, 40))
        mask[v : v + height, u : u + width] = draw(st.integers(0, 3)) > 0
    return mask


def blobs_of(mask, **options):
    depth = np.where(mask, 1000, 0).astype(np.uint16)
    return find_blobs(depth, plain_background(mask.shape), CAMERA, **{"min_area": 1, **options})


@settings(deadline=None, max_examples=150)
@given(st.one_of(MASKS, lumps()))
def test_the_labels_agree_with_opencv_s_components(mask):
    labels, blobs = blobs_of(mask)
    n, expected, stats, centroids = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    assert len(blobs) == n - 1
    assert ((labels > 0) == mask).all()
    for blob in blobs:
        other = expected[labels == blob.label]
        assert (other == other[0]).all()
        left, top, width, height, area = stats[other[0]]
        assert blob.area == area == len(other)
        assert (blob.left, blob.top, blob.right, blob.bottom) == (left, top, left + width, top + height)
        np.testing.assert_allclose(blob.centroid, centroids[other[0]], atol=1e-9)


@settings(deadline=None, max_examples=100)
@given(lumps())
def test_the_moments_agree_with_opencv_s(mask):
    labels, blobs = blobs_of(mask)
    for blob in blobs:
        m = cv2.moments((labels == blob.label).astype(np.uint8), binaryImage=True)
        expected = np.array([m[f"mu{order}"] for order in ORDERS])
        np.testing.assert_allclose(blob.moments, expected, rtol=1e-9, atol=1e-9 * m["m30"] + 1e-6)


def test_moments_keep_their_digits_far_from_the_origin():
    shape = np.zeros((40, 50), dtype=bool)
    shape[3:9, 5:31] = shape[9:20, 5:12] = True
    far = np.zeros((1080, 1920), dtype=bool)
    far[-40:, -50:] = shape
    near = blobs_of(shape)[1][0]
    away = blobs_of(far)[1][0]
    np.testing.assert_allclose(away.moments, near.moments, rtol=1e-12)
    np.testing.assert_allclose(away.centroid - near.centroid, [1870.0, 1040.0], rtol=1e-14)


@settings(deadline=None, max_examples=60)
@given(
    hnp.arrays(np.uint16, (23, 37), elements=st.integers(0, 4000), fill=st.nothing()), st.integers(0, 4000)
)
def test_what_has_no_reading_or_is_not_nearer_belongs_to_no_blob(depth, nearest):
    background = plain_background(depth.shape, nearest)
    labels, blobs = find_blobs(depth, background, CAMERA, min_area=1)
    assert ((labels > 0) == background.foreground(depth)).all()
    assert not labels[depth == 0].any()
    assert sum(blob.area for blob in blobs) == np.count_nonzero(labels)


@settings(deadline=None, max_examples=60)
@given(lumps(), st.integers(0, 2**32 - 1))
def test_the_points_are_the_mean_of_the_back_projected_pixels(mask, seed):
    rng = np.random.default_rng(seed)
    depth = np.where(mask, rng.integers(900, 1000, mask.shape), 0).astype(np.uint16)
    camera = CEILING_CAMERA.intrinsics
    labels, blobs = find_blobs(depth, plain_background(mask.shape), camera, min_area=1)
    for blob in blobs:
        v, u = np.nonzero(labels == blob.label)
        z = 1e-3 * depth[v, u]
        m = camera.normalise(np.column_stack([u, v]).astype(float))
        points = np.column_stack([m * z[:, None], z])
        np.testing.assert_allclose(blob.points, points.mean(axis=0), rtol=1e-12, atol=1e-12)
        assert blob.depth == pytest.approx(z.mean(), rel=1e-12)


@settings(deadline=None, max_examples=100)
@given(
    hnp.arrays(np.uint16, (9, 11), elements=st.sampled_from([0, 1000, 1100, 1250, 1500]), fill=st.nothing()),
    st.sampled_from([0.05, 0.1, 0.2, 0.3, None]),
)
def test_pixels_are_one_blob_iff_a_way_of_small_steps_joins_them(depth, depth_step):
    """Against the plainest flood fill there is."""
    labels, _ = find_blobs(depth, plain_background(depth.shape), CAMERA, min_area=1, depth_step=depth_step)
    step = 65535 if depth_step is None else round(1000 * depth_step)
    expected = np.zeros(depth.shape, dtype=int)
    n = 0
    for seed in zip(*np.nonzero(depth), strict=True):
        if expected[seed]:
            continue
        n += 1
        expected[seed] = n
        ways = [seed]
        while ways:
            v, u = ways.pop()
            for b in range(max(v - 1, 0), min(v + 2, 9)):
                for a in range(max(u - 1, 0), min(u + 2, 11)):
                    near = abs(int(depth[b, a]) - int(depth[v, u])) <= step
                    if depth[b, a] and near and not expected[b, a]:
                        expected[b, a] = n
                        ways.append((b, a))
    np.testing.assert_array_equal(labels, expected)  # numbered in raster order in both


def test_a_drone_over_a_person_is_a_blob_of_its_own_and_merges_without_the_step():
    background = learn_background(frames(20, np.random.default_rng(0)))
    scene = with_box(with_box(room(), 60, 40, 70, 100, 1900.0), 110, 70, 50, 40, 1600.0)
    depth = sensed(scene, np.random.default_rng(1))
    _, apart = find_blobs(depth, background, CAMERA)
    person, drone = sorted(apart, key=lambda blob: -blob.depth)
    assert drone.area == pytest.approx(2000, rel=0.03)
    assert drone.depth == pytest.approx(1.6, abs=0.005)
    assert person.area == pytest.approx(70 * 100 - 20 * 40, rel=0.03)
    _, merged = find_blobs(depth, background, CAMERA, depth_step=None)
    assert len(merged) == 1


def test_what_is_smaller_than_the_least_area_is_left_out_of_the_labels_too():
    mask = np.zeros((30, 40), dtype=bool)
    mask[2:5, 2:5] = True  # 9
    mask[10:20, 10:20] = True  # 100
    mask[25, 30:40] = True  # 10
    labels, blobs = blobs_of(mask, min_area=10)
    assert [(blob.label, blob.area) for blob in blobs] == [(1, 100), (2, 10)]
    assert not labels[:6].any()
    assert set(np.unique(labels)) == {0, 1, 2}


@settings(deadline=None, max_examples=60)
@given(lumps(), st.tuples(*[st.integers(-10, 100)] * 4))
def test_a_region_gives_what_a_mask_of_the_region_gives(mask, region):
    left, top, right, bottom = region
    outside = np.ones_like(mask)
    outside[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = False
    labels, blobs = blobs_of(mask, region=region)
    expected_labels, expected = blobs_of(mask & ~outside)
    np.testing.assert_array_equal(labels, expected_labels)
    assert [blob.area for blob in blobs] == [blob.area for blob in expected]
    for blob, other in zip(blobs, expected, strict=True):
        np.testing.assert_array_equal(blob.moments, other.moments)
        np.testing.assert_array_equal(blob.points, other.points)


def test_a_frame_that_is_not_contiguous_or_read_only_is_read_as_it_is():
    rng = np.random.default_rng(2)
    large = rng.integers(0, 3, (80, 120)).astype(np.uint16) * 500
    view = large[::2, ::3]
    frozen = view.copy()
    frozen.setflags(write=False)
    for depth in (view, frozen):
        labels, blobs = find_blobs(depth, plain_background((40, 40)), CAMERA, min_area=3)
        expected_labels, expected = find_blobs(view.copy(), plain_background((40, 40)), CAMERA, min_area=3)
        np.testing.assert_array_equal(labels, expected_labels)
        assert len(blobs) == len(expected) > 0


def test_the_same_frame_gives_the_same_bits_and_leaves_the_last_answer_alone():
    background = plain_background((HEIGHT, WIDTH), 2400)
    depth = sensed(with_box(room(), 30, 30, 40, 50, 2000.0), np.random.default_rng(3))
    labels, (blob,) = find_blobs(depth, background, CAMERA)
    kept, moments = labels.copy(), blob.moments.copy()
    again, (other,) = find_blobs(depth, background, CAMERA)
    find_blobs(np.zeros_like(depth), background, CAMERA)
    np.testing.assert_array_equal(labels, kept)
    np.testing.assert_array_equal(again, kept)
    np.testing.assert_array_equal(other.moments, moments)


def test_an_empty_room_and_a_blind_camera_have_no_blobs():
    background = learn_background(frames(20, np.random.default_rng(4)))
    empty = sensed(room(), np.random.default_rng(5))
    for depth in (empty, np.zeros_like(empty)):
        labels, blobs = find_blobs(depth, background, CAMERA)
        assert blobs == ()
        assert not labels.any()


def test_a_picture_full_of_foreground_is_one_blob_and_its_sums_do_not_overflow():
    depth = np.full((1080, 1920), 65534, dtype=np.uint16)
    camera = PinholeCamera.centred(1920, 1080, 1000.0)
    _, (blob,) = find_blobs(depth, plain_background(depth.shape), camera)
    assert blob.area == 1080 * 1920
    np.testing.assert_allclose(blob.centroid, [959.5, 539.5], rtol=1e-12)
    np.testing.assert_allclose(blob.points, [0.0, 0.0, 65.534], atol=1e-9)
    mu20 = 1080 * 1920 * (1920.0**2 - 1.0) / 12.0
    mu02 = 1080 * 1920 * (1080.0**2 - 1.0) / 12.0
    np.testing.assert_allclose(blob.moments[[0, 2]], [mu20, mu02], rtol=1e-12)
    assert abs(blob.moments[[1, 3, 4, 5, 6]]).max() < 1.0


def test_more_blobs_than_labels_are_cut_off_in_raster_order():
    depth = np.zeros((530, 530), dtype=np.uint16)
    depth[::2, ::2] = 1000
    labels, blobs = find_blobs(depth, plain_background(depth.shape), CAMERA, min_area=1)
    assert len(blobs) == 65535 < 265 * 265
    assert labels.max() == blobs[-1].label == 65535
    assert not labels[528].any()


def test_a_frame_that_is_not_like_the_background_is_refused():
    background = plain_background((480, 640))
    with pytest.raises(DepthFormatError) as caught:
        find_blobs(np.zeros((240, 320), dtype=np.uint16), background, CAMERA)
    assert str(caught.value) == (
        "depth frame: found 320x240 of uint16, expected 640x480 of uint16 [mm]; set the camera's resolution "
        "and unit, or learn the background again with `noctule calibrate background`"
    )
    with pytest.raises(DepthFormatError, match="found 640x480 of float32, expected 640x480 of uint16"):
        find_blobs(np.zeros((480, 640), dtype=np.float32), background, CAMERA)
