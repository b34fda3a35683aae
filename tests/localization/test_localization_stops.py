"""Where rays stop in a body: counted from frames, and what tells its nose from its tail."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from localization_flights import CAMERA, HOME, background, drone, random_pose, template
from localization_rays import TRAY, Solid, Thing, cast, floor_threshold

from noctule.geometry import Pose, wrap_angle
from noctule.localization.stopping import to_body, window
from noctule.localization.stops import BOTTOM, LAYER, LAYERS, NoseOrTail, Stops
from noctule.localization.template import Template, TemplateError
from noctule.localization.tracker import turned
from noctule.messages import DepthFrame

N, CELL = 60, 0.01
NEAREST = floor_threshold(CAMERA)
# a bar of the same width and height at both ends, and something on one of them, ahead
NOSED = (Solid((0.0, 0.0, 0.0), (0.2, 0.05, 0.01)), Solid((0.14, 0.0, 0.0), (0.03, 0.1, 0.01)))
PINHOLE = (CAMERA.intrinsics.fx, CAMERA.intrinsics.fy, CAMERA.intrinsics.cx, CAMERA.intrinsics.cy)


def counted(solids: tuple[Solid, ...], frames: int = 12, seed: int | None = None) -> Stops:
    rng = np.random.default_rng(5)
    poses = [random_pose(rng) for _ in range(frames)]
    samples = [
        (cast(CAMERA, (Thing(p, solids),), seed=None if seed is None else seed + i), p)
        for i, p in enumerate(poses)
    ]
    return Stops.of_samples(samples, NEAREST, CAMERA, CELL, N)


@pytest.fixture(scope="module")
def nosed() -> NoseOrTail:
    return NoseOrTail.of(counted(NOSED, 30, seed=50))


@pytest.fixture(scope="module")
def learned() -> NoseOrTail:
    return NoseOrTail.of(template().stops)


def layer_of(z: float) -> int:
    return math.floor((z - BOTTOM) / LAYER)


def test_rays_stop_at_the_surface_and_pass_what_is_over_and_beside_it():
    stops = counted(TRAY)  # 0.5 x 0.4 m, its top at 2 cm
    inside, top = np.s_[N // 2 - 15 : N // 2 + 15, N // 2 - 15 : N // 2 + 15], layer_of(0.0199)
    hits, rays = stops.hits[inside], (stops.hits + stops.passes)[inside]
    at_surface = hits[..., top - 1 : top + 2].sum()
    assert at_surface > 0.99 * hits.sum()
    assert (stops.passes[inside][..., top + 2 :] > 0.0).all()
    assert stops.hits[inside][..., top + 2 :].sum() == 0.0
    assert rays[..., : top - 1].sum() < 0.01 * rays.sum()  # nothing sees through a tray
    assert stops.hits[2:, 2][..., layer_of(0.0)].sum() == 0.0
    assert stops.passes[N // 2, 2, 0] > 0.0


def test_a_flank_is_seen_where_rays_come_from_the_side():
    block = (Solid((0.0, 0.0, 0.0), (0.1, 0.1, 0.04)),)
    stops = counted(block, 30)
    foot = stops.hits[..., layer_of(-0.02)]
    assert foot[N // 2 - 5 : N // 2 + 5, N // 2 - 5 : N // 2 + 5].sum() == 0.0
    assert foot.sum() > 100.0


def test_what_was_not_read_and_what_something_hides_is_not_counted():
    for seen in (cast(CAMERA, (Thing(HOME, TRAY),)), cast(CAMERA)):
        frame = DepthFrame(seen.stamp, np.zeros_like(seen.depth))
        nothing = Stops.of_samples([(frame, HOME)], NEAREST, CAMERA, CELL, N)
        assert nothing.hits.sum() + nothing.passes.sum() == 0.0
    lid = Thing(Pose(HOME.position + np.array([0.0, 0.0, 0.4]), HOME.yaw), TRAY)
    hidden = Stops.of_samples([(cast(CAMERA, (lid, Thing(HOME, TRAY))), HOME)], NEAREST, CAMERA, CELL, N)
    middle = np.s_[N // 2 - 5 : N // 2 + 5, N // 2 - 5 : N // 2 + 5]
    assert hidden.hits[middle].sum() + hidden.passes[middle].sum() == 0.0


def test_close_to_the_floor_a_background_is_no_passing():
    low = Pose(np.array([0.1, 0.1, 0.05]), 0.0)
    stops = Stops.of_samples([(cast(CAMERA), low)], NEAREST, CAMERA, CELL, N)
    assert stops.passes.sum() == 0.0


def test_a_part_is_found_at_the_end_where_it_is(nosed):
    low, high = nosed.box.T
    assert low[0] == pytest.approx(-high[0], abs=1e-6)  # the same places, whichever heading is supposed
    assert 0.15 < high[0] < 0.22
    a, _, m, _ = nosed.weights.shape
    rays = nosed.weights[..., 0].sum(axis=(1, 2)), nosed.weights[..., 1].sum(axis=(1, 2))
    assert rays[0][a // 2 :].sum() < 0.0  # to pass ahead speaks against the nose being there
    assert rays[1][a // 2 :].sum() > 0.0
    assert m == round((high[2] - low[2]) / LAYER)


def test_weights_are_opposite_half_a_turn_apart(nosed):
    np.testing.assert_allclose(nosed.weights, -nosed.weights[::-1, ::-1], atol=1e-6)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 9999))
def test_the_half_turn_has_the_opposite_evidence_and_the_right_heading_is_favoured(nosed, seed):
    true = random_pose(np.random.default_rng(seed))
    depth = cast(CAMERA, (Thing(true, NOSED),), seed=seed).depth
    right = nosed.evidence(depth, NEAREST, CAMERA, true)
    assert right > 2.0
    assert nosed.evidence(depth, NEAREST, CAMERA, turned(true)) == pytest.approx(-right, rel=0.05, abs=1.0)


def test_the_side_it_is_seen_from_does_not_matter(learned):
    for bearing in np.arange(0.0, 2.0 * math.pi, 0.7):
        true = Pose(HOME.position + np.array([0.3, 0.4, 0.3]), wrap_angle(float(bearing)))
        depth = cast(CAMERA, (drone(true),), seed=3).depth
        assert learned.evidence(depth, background().nearest, CAMERA, true) > 3.0


def test_an_even_shape_says_nothing_of_its_half_turn():
    even = NoseOrTail.of(counted(TRAY, 20, seed=30))
    depth = cast(CAMERA, (Thing(HOME, TRAY),), seed=1).depth
    assert abs(even.evidence(depth, NEAREST, CAMERA, HOME)) < 1.0


def test_cells_that_were_hardly_seen_tell_nothing():
    few = counted(NOSED, 1)
    scarce = Stops(few.cell, few.bottom, few.layer, few.hits * 0.01, few.passes * 0.01)
    nothing = NoseOrTail.of(scarce)
    assert nothing.weights.size == 0
    assert nothing.evidence(cast(CAMERA, (Thing(HOME, NOSED),)).depth, NEAREST, CAMERA, HOME) == 0.0


def test_no_evidence_where_the_drone_is_not_before_the_camera(nosed):
    depth = cast(CAMERA).depth
    above = Pose(CAMERA.t_world_camera + np.array([0.0, 0.0, 1.0]), 0.0)
    aside = Pose(np.array([30.0, 0.0, 1.0]), 0.0)
    for pose in (above, aside):
        assert nosed.evidence(depth, NEAREST, CAMERA, pose) == 0.0


def test_a_top_view_is_taken_for_a_body_as_high_as_it_says():
    p, h = np.zeros((2, 8, 8), np.float32)
    p[2:6, 2:6], h[2:6, 2:6] = 0.8, 0.021
    weight = np.ones((8, 8), np.float32)
    weight[0] = 0.0
    stops = Stops.of_top_view(CELL, p, h, weight)
    k = layer_of(0.021)
    hit = stops.hits / np.maximum(stops.hits + stops.passes, 1e-9)
    assert hit[3, 3, k] == pytest.approx(0.8)
    assert stops.hits.sum() == pytest.approx(stops.hits[2:6, 2:6, k].sum())
    assert (stops.hits + stops.passes)[3, 3, 0] == pytest.approx(0.2 * (stops.hits + stops.passes)[3, 3, k])
    assert (stops.passes[0] == 0.0).all()
    assert (stops.passes[1] > 0.0).all()


def test_a_template_from_before_rays_were_counted_tells_nose_from_tail_by_its_top_view(learned):
    arrays = template().arrays()
    old = Template.from_arrays({k: v for k, v in arrays.items() if k not in ("layers", "hits", "passes")})
    np.testing.assert_array_equal(old.probability, template().probability)
    by_top_view, right = NoseOrTail.of(old.stops), 0
    rng = np.random.default_rng(3)
    for i in range(10):
        true = random_pose(rng)
        depth = cast(CAMERA, (drone(true),), seed=i).depth
        right += by_top_view.evidence(depth, background().nearest, CAMERA, true) > 0.0
    assert right >= 9


def test_counted_rays_are_the_same_after_their_arrays():
    again = Template.from_arrays(template().arrays()).stops
    assert (again.cell, again.bottom, again.layer) == (0.01, BOTTOM, LAYER)
    np.testing.assert_array_equal(again.hits, template().stops.hits)
    np.testing.assert_array_equal(again.passes, template().stops.passes)


@pytest.mark.parametrize("spoil", ["nan", "shape", "negative", "missing", "layers"])
def test_spoiled_counts_are_refused(spoil):
    arrays = {k: v.copy() for k, v in template().arrays().items()}
    if spoil == "nan":
        arrays["hits"][1, 2, 3] = np.nan
    elif spoil == "shape":
        arrays["hits"] = arrays["hits"][:-1]
    elif spoil == "negative":
        arrays["passes"][0, 0, 0] = -1.0
    elif spoil == "missing":
        del arrays["passes"]
    else:
        arrays["layers"][1] = 0.0
    with pytest.raises(TemplateError) as refused:
        Template.from_arrays(arrays)
    assert str(refused.value) == (
        "not a template: its rays are not counted in layers of 70 x 70 cells; learn it again"
    )


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 9999))
def test_the_window_holds_all_that_is_in_a_box(seed):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng, 0.2)
    box = np.sort(rng.uniform(-0.3, 0.3, (3, 2)), axis=1)
    E = to_body(CAMERA.R_world_camera, CAMERA.t_world_camera, pose.R_world_body, pose.position)
    shape = (CAMERA.intrinsics.height, CAMERA.intrinsics.width)
    left, right, top, bottom, there = window(shape, PINHOLE, E, box)
    inside = pose.position + rng.uniform(box[:, 0], box[:, 1], (50, 3)) @ pose.R_world_body.T
    for u, v in CAMERA.project(inside):
        if 0.0 <= u < shape[1] and 0.0 <= v < shape[0]:
            assert left <= u < right + 1
            assert top <= v < bottom + 1
    assert CAMERA.to_camera(inside)[:, 2].min() >= there - 1e-9
    assert LAYERS == template().stops.hits.shape[2]
