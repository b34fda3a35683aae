"""The compiled fits and measures on shapes made by hand, whose answers are known."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.localization import fitting, misfit, placing, scoring
from noctule.localization.evidence import Evidence, Grid
from noctule.localization.matcher import Matcher
from noctule.localization.template import Template

N, CELL = 64, 0.01
SMALL = st.floats(-0.03, 0.03)
TURNS = st.floats(-0.2, 0.2)
HOLD = (0.02 / math.radians(3.0)) ** 2
WHOLE = settings(deadline=None, max_examples=40)  # the first call compiles


def shape(x: float = 0.0, y: float = 0.0, heading: float = 0.0) -> np.ndarray:
    """A body with a long nose and one wing longer than the other, soft at its edges, moved and turned."""
    i, j = np.mgrid[0:N, 0:N]
    px, py = ((k + 0.5 - 0.5 * N) * CELL for k in (i, j))
    c, s = math.cos(heading), math.sin(heading)
    qx, qy = c * (px - x) + s * (py - y), c * (py - y) - s * (px - x)

    def soft(d: np.ndarray) -> np.ndarray:
        return 1.0 / (1.0 + np.exp(-d / 0.008))

    nose = soft(0.2 - np.abs(qx - 0.04)) * soft(0.05 - np.abs(qy))
    wings = soft(0.05 - np.abs(qx)) * soft(0.15 - np.abs(qy - 0.02))
    return np.maximum(nose, wings).astype(np.float32)


def made(p: np.ndarray | None = None, height: float = 0.04) -> Template:
    p = shape() if p is None else p
    weight = cv2.dilate((p > 0.3).astype(np.uint8), np.ones((9, 9), np.uint8))
    arrays = {
        "grid": np.array([CELL, -0.045]),
        "frames": np.array([50.0]),
        "probability": p.astype(float),
        "variance": (0.1 * p * (1.0 - p)).astype(float),
        "height": np.where(p > 0.1, height, 0.0),
        "weight": weight.astype(float),
    }
    return Template.from_arrays(arrays)


@pytest.fixture(scope="module")
def matcher() -> Matcher:
    return Matcher.of(made())


def evidence(share: np.ndarray, height: float = 0.04, trust: np.ndarray | None = None) -> Evidence:
    trust = np.ones_like(share) if trust is None else trust
    grid, eye = Grid(CELL, N, -0.045), np.eye(3)
    return Evidence(None, eye, 2.0, grid, share, 1.0 - share, share * np.float32(height), share, trust)


@WHOLE
@given(SMALL, SMALL, TURNS)
def test_a_shape_that_was_moved_and_turned_is_found_where_it_was_put(matcher, x, y, heading):
    share = shape(x, y, heading)
    pose, information = matcher.refine(share, np.ones_like(share), np.zeros(3), steps=20)
    assert (np.abs(pose - [x, y, heading]) < [3e-4, 3e-4, 3e-3]).all()
    assert np.linalg.eigvalsh(information).min() > 0.0


def test_only_seen_cells_at_the_edges_count(matcher):
    share = shape()
    trust = np.ones_like(share)
    trust[: N // 2] = 0.0
    out = np.empty((share.size, 4))
    listed = out[: fitting.edge_cells(share, trust, matcher.edges, CELL, np.zeros(3), out)]
    assert len(listed) == matcher.edges[N // 2 :].sum()
    assert listed[:, 0].min() > 0.0


def test_without_a_seen_cell_the_pose_stays_and_nothing_is_known(matcher):
    nothing = np.zeros((N, N), dtype=np.float32)
    pose, information = matcher.refine(nothing, nothing, np.array([0.01, 0.02, 0.3]))
    np.testing.assert_array_equal(pose, [0.01, 0.02, 0.3])
    np.testing.assert_array_equal(information, 0.0)
    fit = matcher.assess(evidence(nothing, trust=nothing), pose)
    assert (fit.score, fit.nominal, fit.seen, fit.outline, fit.relief) == (0.0, 0.0, 0.0, 0.0, 0.0)


def test_a_template_fits_itself_without_misfit_and_scores_its_nominal(matcher):
    t = matcher.template
    fit = matcher.assess(evidence(t.probability), np.zeros(3))
    assert fit.score == pytest.approx(t.nominal, rel=1e-5)
    assert fit.nominal == pytest.approx(t.nominal, rel=1e-5)
    assert fit.seen == matcher.seen
    assert fit.outline == pytest.approx(0.0, abs=1e-9)
    assert fit.relief == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(fit.surface, 0.0, atol=1e-6)


@WHOLE
@given(SMALL, SMALL, st.floats(-0.1, 0.1))
def test_no_other_pose_scores_more_than_the_right_one(matcher, x, y, heading):
    share = matcher.template.probability
    there = matcher.assess(evidence(share), np.array([x, y, heading]))
    assert there.score <= matcher.template.nominal * 1.01
    if math.hypot(x, y) > 0.02:
        assert there.score < 0.97 * matcher.template.nominal
        assert there.outline > 0.05


def test_what_is_not_seen_takes_away_weight_but_not_the_ratio(matcher):
    trust = np.ones((N, N), dtype=np.float32)
    trust[:, : N // 2] = 0.0
    fit = matcher.assess(evidence(matcher.template.probability, trust=trust), np.zeros(3))
    assert fit.score == pytest.approx(fit.nominal, rel=1e-5)
    assert 0.3 < fit.seen / matcher.seen < 0.7


@WHOLE
@given(st.floats(-0.05, 0.05), TURNS)
def test_the_surface_is_found_at_its_height_whatever_the_heading(matcher, up, heading):
    fit = matcher.assess(evidence(shape(0.0, 0.0, heading), 0.04 + up), np.array([0.0, 0.0, heading]))
    np.testing.assert_allclose(fit.surface, [up, 0.0, 0.0], atol=1e-5)


@WHOLE
@given(st.floats(-0.03, 0.03), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.integers(0, 999))
def test_a_plane_is_fitted_past_a_fifth_of_strangers(height, slope_x, slope_y, seed):
    rng = np.random.default_rng(seed)
    cells = np.column_stack([rng.uniform(-0.2, 0.2, (500, 2)), np.zeros(500), np.ones(500)])
    cells[:, 2] = height + cells[:, :2] @ [slope_x, slope_y] + rng.normal(0.0, 0.002, 500)
    cells[:100, 2] += 0.12
    out = np.zeros(3)
    used = fitting.fit_surface(cells, 0.0, out)
    assert (np.abs(out - [height, slope_x, slope_y]) < [2e-3, 0.02, 0.02]).all()
    assert 300 < used < 400


def test_a_few_cells_make_no_surface_and_a_held_one_stays_level():
    cells = np.array([[0.1, 0.0, 0.02, 1.0]] * 8)
    out = np.zeros(3)
    fitting.fit_surface(cells, HOLD, out)
    np.testing.assert_array_equal(out, 0.0)
    fitting.fit_surface(np.repeat(cells, 3, axis=0), 1e6, out)
    np.testing.assert_allclose(out, [0.02, 0.0, 0.0], atol=1e-5)


@WHOLE
@given(
    st.lists(st.floats(-300.0, 300.0), min_size=9, max_size=9), st.floats(0.0, 3000.0), st.floats(-3.2, 3.2)
)
def test_the_covariance_is_positive_definite_and_turns_with_the_heading(values, cells, yaw):
    J = np.array(values).reshape(3, 3)
    P, P0 = (placing.covariance(J.T @ J, cells, a) for a in (yaw, 0.0))
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P).min() > 1e-6  # no deviation is below a millimetre
    c, s = math.cos(yaw), math.sin(yaw)
    T = np.array([[c, -s, 0.0, 0.0], [s, c, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    np.testing.assert_allclose(P, T @ P0 @ T.T, rtol=1e-6, atol=1e-9 * P0.max())
    expected = 3.0 * np.linalg.inv(J.T @ J + np.diag([1.0, 1.0, 1e-2]))
    keep = np.ix_([0, 1, 3], [0, 1, 3])
    floor = np.diag(np.array([0.0015, 0.0015, 0.003]) ** 2)
    np.testing.assert_allclose(P0[keep], expected + floor, rtol=1e-4, atol=1e-6 * P0.max())
    assert P0[2, 2] == pytest.approx(0.02**2 / (1.0 + 0.1 * cells) + 0.0012**2)


def test_more_that_is_seen_is_never_worth_less():
    some = np.diag([1e4, 2e4, 300.0])
    assert (
        np.diag(placing.covariance(2.0 * some, 400.0, 0.4)) < np.diag(placing.covariance(some, 100.0, 0.4))
    ).all()


def test_an_even_shape_is_astray_nowhere():
    p = np.maximum(shape(), shape()[::-1, ::-1])
    np.testing.assert_allclose(Matcher.of(made(p)).astray, 0.0, atol=1e-6)


def test_right_headings_fit_best_among_quarter_turns(matcher):
    seen = evidence(shape(0.0, 0.0, 0.1))
    losses = [matcher.quarter_contrast(seen, np.array([0.0, 0.0, 0.1 + k * math.pi / 2.0])) for k in range(4)]
    assert int(np.argmin(losses)) == 0
    assert min(losses[1:]) > 2.0 * losses[0] + 1.0


def test_cells_that_tell_lie_in_fours_a_quarter_turn_apart(matcher):
    places = {tuple(np.round(row[:2], 6)) for row in matcher.telling}
    assert places == {(-y, x) for x, y in places}
    assert (matcher.telling[:, 4:] >= 0.0).all()


@WHOLE
@given(st.integers(0, 999), st.sampled_from([2, 4, 8]))
def test_blocks_keep_all_that_was_seen(seed, size):
    rng = np.random.default_rng(seed)
    share, trust = rng.random((2, 16, 16)).astype(np.float32)
    trust[rng.random((16, 16)) < 0.5] = 0.0
    out = np.empty((64, 4))
    out = out[: scoring.blocks(share, trust, size, CELL, out)]
    assert out[:, 3].sum() == pytest.approx(trust.sum(), rel=1e-5)
    assert (out[:, 2] * out[:, 3]).sum() == pytest.approx((share * trust).sum(), rel=1e-5)
    assert np.abs(out[:, :2]).max() < 8 * CELL


@pytest.mark.parametrize(("x", "y", "heading"), [(0.0, 0.0, 0.0), (0.04, -0.04, 0.6), (-0.08, 0.04, -2.4)])
def test_the_search_finds_heading_and_shift_to_its_steps(matcher, x, y, heading):
    headings = np.radians(np.arange(0.0, 360.0, 10.0))
    starts, scores = matcher.search(shape(x, y, heading), np.ones((N, N), np.float32), headings, 3)
    best = starts[int(np.argmax(scores))]
    assert math.hypot(best[0] - x, best[1] - y) < 0.04
    assert abs(math.remainder(best[2] - heading, 2.0 * math.pi)) < math.radians(11.0)


def test_a_cell_is_asked_from_one_place_in_memory(matcher):
    t = matcher.template
    assert matcher.cells.shape == (N, N, 8)
    np.testing.assert_array_equal(matcher.cells[..., misfit.LOG_DRONE], t.log_drone)
    np.testing.assert_array_equal(matcher.cells[..., misfit.WEIGHT], t.weight)
    assert matcher.cells[..., misfit.EXPECTED].sum() == pytest.approx(t.nominal, rel=1e-5)
    assert (matcher.cells[..., misfit.CERTAINTY] > 0.0).sum() == matcher.seen
