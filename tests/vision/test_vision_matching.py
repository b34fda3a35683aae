import numpy as np
import pytest
import skimage.data
from hypothesis import given, settings
from hypothesis import strategies as st
from vision_photographs import HEIGHT, WIDTH, motion, moved, photograph, view

from noctule.camera import PinholeCamera
from noctule.geometry import rot_y
from noctule.vision.features import Features, detect
from noctule.vision.matching import FeatureKindError, match, match_robust, robust_geometry

CAMERA = PinholeCamera.centred(WIDTH, HEIGHT, 510.0)
FOCAL = 510.0


def scene(seed, kind, n=80, outliers=0.3, noise_px=0.4):
    """Normalised points of two views; returns m_ref, m_current and which pairs are wrong."""
    rng = np.random.default_rng(seed)
    m_ref = np.column_stack([rng.uniform(-0.8, 0.8, n), rng.uniform(-0.45, 0.45, n)])
    depth, t, yaw = rng.uniform(2.0, 6.0, n), np.array([0.1, 0.0, 0.25]), np.deg2rad(8.0)
    if kind == "planar":
        depth = 4.0 / (1.0 + 0.3 * m_ref[:, 0])
    elif kind == "mostly planar":
        depth = np.where(rng.random(n) < 0.8, 4.0, depth)
    elif kind == "pure rotation":
        t = np.zeros(3)
    elif kind == "tiny baseline":
        t, yaw = 0.02 * t, 0.01
    elif kind == "standing still":
        t, yaw = np.zeros(3), 0.0
    elif kind == "far":
        t, depth = np.array([0.1, -0.1, 1.5]), depth + 1.0
    x = np.column_stack([m_ref, np.ones(n)]) * depth[:, None] @ rot_y(yaw).T - t
    m_current = x[:, :2] / x[:, 2:] + rng.normal(0.0, noise_px / FOCAL, (n, 2))
    wrong = rng.random(n) < outliers
    m_current[wrong] = np.column_stack(
        [rng.uniform(-0.8, 0.8, wrong.sum()), rng.uniform(-0.45, 0.45, wrong.sum())]
    )
    return m_ref, m_current, wrong


@pytest.mark.parametrize(
    "kind",
    ["deep", "planar", "mostly planar", "pure rotation", "tiny baseline", "standing still", "far"],
)
@pytest.mark.parametrize("outliers", [0.0, 0.3, 0.5])
def test_robust_geometry_keeps_the_good_and_drops_the_bad_whatever_the_scene(kind, outliers):
    recall, wrong_kept = [], []
    for seed in range(6):
        m_ref, m_current, wrong = scene(seed, kind, n=(40, 80, 200)[seed % 3], outliers=outliers)
        keep = robust_geometry(m_ref, m_current, 2.0 / FOCAL)
        recall.append((keep & ~wrong).sum() / (~wrong).sum())
        wrong_kept.append((keep & wrong).sum() / keep.sum())
    assert np.mean(recall) > 0.97
    assert min(recall) > 0.8
    assert np.mean(wrong_kept) < 0.11


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 10_000))
def test_robust_geometry_gives_the_same_answer_twice(seed):
    m_ref, m_current, _ = scene(seed, "deep", outliers=0.5)
    np.testing.assert_array_equal(robust_geometry(m_ref, m_current), robust_geometry(m_ref, m_current))


@pytest.mark.parametrize("n", [0, 1, 7])
def test_robust_geometry_of_too_few_pairs_says_nothing(n):
    m = np.random.default_rng(0).uniform(-0.5, 0.5, (n, 2))
    assert robust_geometry(m, m).tolist() == [False] * n


def test_robust_geometry_survives_points_that_are_all_the_same():
    assert robust_geometry(np.zeros((20, 2)), np.zeros((20, 2))).shape == (20,)


@pytest.mark.parametrize("kind", ["sift", "orb"])
def test_every_feature_of_a_picture_matches_itself(kind):
    found = detect(photograph("astronaut"), kind, limit=200)
    index_ref, index_current = match(found, found)
    np.testing.assert_array_equal(index_ref, index_current)
    assert len(index_ref) > 150


@pytest.mark.parametrize("kind", ["sift", "orb"])
def test_matching_the_other_way_round_finds_the_same_pairs_without_a_ratio(kind):
    a, b = detect(photograph("coffee"), kind, 300), detect(view("coffee", np.eye(3)), kind, 300)
    forward, back = match(a, b, ratio=1.01), match(b, a, ratio=1.01)
    there = set(zip(*(i.tolist() for i in forward), strict=True))
    again = {(j, i) for i, j in zip(*(i.tolist() for i in back), strict=True)}
    assert len(there & again) >= 0.97 * max(len(there), len(again))


def test_hamming_distances_decide_between_orb_features():
    bits = np.zeros((3, 32), dtype=np.uint8)
    bits[1, 0], bits[2] = 0b111, 255
    p = np.zeros((3, 2))
    ref = Features(p[:1], bits[:1], "orb")
    index_ref, index_current = match(Features(p, bits, "orb"), Features(p, bits[::-1].copy(), "orb"))
    assert (index_ref.tolist(), index_current.tolist()) == ([0, 1, 2], [2, 1, 0])
    assert match(ref, Features(p, bits, "orb"))[0].size == 0  # one feature is too few to compare


def test_a_stricter_ratio_keeps_fewer_matches():
    a, b = detect(photograph("chelsea")), detect(view("chelsea", np.eye(3)))
    assert len(match(a, b, 0.6)[0]) < len(match(a, b, 0.8)[0]) < len(match(a, b, 0.95)[0])


@pytest.mark.parametrize("name", ["astronaut", "coffee", "chelsea", "rocket"])
@pytest.mark.parametrize("kind", ["sift", "orb"])
def test_robust_matches_of_a_warped_photograph_are_right(name, kind):
    H = motion(1.15, 0.02, 12.0, -6.0, 1e-4)
    ref, current = detect(view(name, np.eye(3), seed=1), kind), detect(view(name, H, seed=2), kind)
    found = match_robust(ref, current, CAMERA)
    assert found.reason == ""
    assert 50 <= len(found) <= found.n_ratio
    error = np.linalg.norm(found.p_current - moved(H, found.p_ref), axis=1)
    assert np.median(error) < (0.4 if kind == "sift" else 1.3)
    assert np.mean(error < 4.0) > 0.97
    assert np.all((found.quality > 0.0) & (found.quality <= 1.0))


def test_a_real_stereo_pair_matches_along_its_rows_and_at_its_disparity():
    left, right, disparity = skimage.data.stereo_motorcycle()
    first = PinholeCamera(left.shape[1], left.shape[0], 994.978, 994.978, 311.193, 254.877)
    second = PinholeCamera(left.shape[1], left.shape[0], 994.978, 994.978, 342.279, 254.877)
    found = match_robust(detect(left), detect(right), first, second)
    assert len(found) > 150
    shift = found.p_ref - found.p_current
    assert np.median(np.abs(shift[:, 1])) < 0.3
    x, y = np.rint(found.p_ref).astype(int).T
    true = disparity[np.clip(y, 0, disparity.shape[0] - 1), np.clip(x, 0, disparity.shape[1] - 1)]
    known = np.isfinite(true) & (true > 0)
    assert known.sum() > 100
    assert np.median(np.abs(shift[known, 0] - true[known])) < 0.5
    assert np.mean(np.abs(shift[known, 0] - true[known]) < 3.0) > 0.85


@pytest.mark.parametrize("kind", ["sift", "orb"])
def test_unrelated_photographs_do_not_match_and_the_result_says_why(kind):
    found = match_robust(detect(photograph("coffee"), kind), detect(photograph("rocket"), kind), CAMERA)
    assert len(found) == 0
    assert found.p_ref.shape == found.p_current.shape == (0, 2)
    assert "are needed" in found.reason


def test_a_blank_picture_is_a_reason_and_not_an_exception():
    blank = detect(np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8))
    found = match_robust(detect(photograph("coffee")), blank, CAMERA)
    assert (len(found), found.n_ratio) == (0, 0)
    assert found.reason == "0 features look alike, 14 are needed"


def test_looks_without_geometry_are_a_reason_too():
    rng = np.random.default_rng(3)
    descriptors = detect(photograph("astronaut"), limit=40).descriptors
    far = [np.column_stack([rng.uniform(0, 855, 40), rng.uniform(0, 479, 40)]) for _ in range(2)]
    found = match_robust(
        Features(far[0], descriptors, "sift"), Features(far[1], descriptors, "sift"), CAMERA, fewest=30
    )
    assert len(found) == 0
    assert found.n_ratio == 40
    assert found.reason.endswith("of 40 features that look alike fit one geometry, 30 are needed")


def test_features_of_two_kinds_are_an_error():
    a, b = detect(photograph("coffee"), "sift", 50), detect(photograph("coffee"), "orb", 50)
    with pytest.raises(FeatureKindError) as caught:
        match(a, b)
    assert str(caught.value) == (
        "matching: the key image has 'sift' features and the live picture 'orb'; "
        "both must be of one kind: teach the path again or change the kind"
    )
