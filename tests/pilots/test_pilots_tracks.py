import numpy as np
import pytest

from noctule.pilots.tracks import TrackSet, empty_tracks
from noctule.vision.homography import HomographyEstimate

SHAPE = (480, 856)


def tracks(p_ref, p=None, bad=None, matched=0.0):
    p_ref = np.array(p_ref, dtype=float)
    p = p_ref + 5.0 if p is None else np.array(p, dtype=float)
    bad = np.zeros(len(p), dtype=np.intp) if bad is None else np.array(bad, dtype=np.intp)
    return TrackSet(3, p_ref, p, bad, matched)


def judgement(*good):
    """What `judged` takes: an estimate and which points are good."""
    good = np.array(good)
    return HomographyEstimate(np.eye(3), "upright", 1.0, good), good


def grid(n, spacing=10.0):
    return np.array([(spacing * (i % 40) + 20.0, spacing * (i // 40) + 20.0) for i in range(n)])


def test_empty_tracks_were_never_matched():
    none = empty_tracks(2)
    assert len(none) == 0
    assert none.index == 2
    assert none.matched == -np.inf


def test_points_stay_with_their_partners_when_some_are_dropped():
    kept = tracks(grid(4), bad=[0, 1, 2, 3]).kept(np.array([True, False, False, True]))
    assert kept.p_ref == pytest.approx(grid(4)[[0, 3]])
    assert kept.p == pytest.approx(grid(4)[[0, 3]] + 5.0)
    assert kept.bad.tolist() == [0, 3]
    assert kept.index == 3


def test_a_point_is_dropped_after_six_ticks_of_disagreement_in_a_row():
    points = tracks(grid(3))
    for _ in range(5):
        points = points.judged(*judgement(True, True, False))
        assert len(points) == 3
    assert len(points.judged(*judgement(True, True, False))) == 2


def test_one_tick_of_agreement_forgives():
    points = tracks(grid(2))
    for _ in range(5):
        points = points.judged(*judgement(True, False))
    points = points.judged(*judgement(True, True))
    assert points.bad.tolist() == [0, 0]
    for _ in range(5):
        points = points.judged(*judgement(True, False))
    assert len(points) == 2


def test_the_estimate_is_kept_to_start_the_next_one_from():
    estimate, good = judgement(True, True)
    assert tracks(grid(2)).judged(estimate, good).estimate is estimate


def test_a_fresh_match_takes_the_place_of_a_track_of_the_same_feature():
    old = tracks(grid(3), bad=[4, 4, 4])
    p_ref, p = grid(3)[:1] + 1.0, np.array([[99.0, 98.0]])  # 1.4 px off in the key image: the same feature
    both = old.joined(p_ref, p, 2.5, SHAPE, 60)
    assert len(both) == 3
    assert both.p[0] == pytest.approx([99.0, 98.0])
    assert both.bad.tolist() == [0, 4, 4]
    assert both.matched == 2.5


def test_other_features_are_added():
    both = tracks(grid(2)).joined(grid(4)[2:], grid(4)[2:] + 7.0, 1.0, SHAPE, 60)
    assert len(both) == 4
    assert np.linalg.norm(both.p - both.p_ref, axis=1).max() == pytest.approx(7.0 * np.sqrt(2.0))


def test_a_match_without_points_only_tells_the_time():
    none = np.empty((0, 2))
    both = tracks(grid(5)).joined(none, none, 1.5, SHAPE, 60)
    assert len(both) == 5
    assert both.matched == 1.5


def test_tracks_can_begin_with_a_match():
    both = empty_tracks(0).joined(grid(5), grid(5), 0.4, SHAPE, 60)
    assert len(both) == 5


def test_no_more_than_the_most_are_kept_and_they_are_spread_over_the_picture():
    crowd = np.random.default_rng(0).uniform(20.0, 60.0, (100, 2))  # in one corner
    alone = np.array([[800.0, 400.0], [700.0, 60.0], [60.0, 430.0], [400.0, 240.0]])
    p = np.vstack([crowd, alone])
    kept = empty_tracks(0).joined(p, p, 0.0, SHAPE, 20)
    assert len(kept) == 20
    for point in alone:
        assert np.abs(kept.p - point).sum(axis=1).min() == 0.0


def test_of_neighbours_the_one_that_agreed_is_kept():
    p = np.array([[100.0, 100.0], [104.0, 100.0], [500.0, 300.0]])
    kept = tracks(p, p, bad=[5, 0, 0]).joined(np.empty((0, 2)), np.empty((0, 2)), 0.0, SHAPE, 2)
    assert kept.p.tolist() == [[104.0, 100.0], [500.0, 300.0]]
