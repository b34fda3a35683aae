"""Registration on rendered frames of the simulated ceiling camera, bare and with a hull."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from noctule.geometry import Pose, wrap_angle
from noctule.localization.located import LocatorSettings
from noctule.localization.matcher import Matcher
from noctule.localization.registration import Registration, Scene, acquire, register
from noctule.localization.template import Template, build_template
from noctule.simulation.ceiling import CeilingSpec, DepthStage, ThingPose, manual_flight
from noctule.vision.depth.background import Background
from noctule.vision.depth.learning import learn_background

HOME = Pose(np.array([0.1, 0.0, 1.2]), 0.5)
START = LocatorSettings()


@dataclass(frozen=True)
class Room:
    """A camera, the empty room, and the drone's template from a short flight."""

    stage: DepthStage
    background: Background
    matcher: Matcher

    def scene(self, stamp: float, pose: Pose | None, *things: ThingPose, holes: float = 0.0) -> Scene:
        depth = self.stage.frame(stamp, pose, things).depth.copy()
        depth[np.random.default_rng(int(stamp)).random(depth.shape) < holes] = 0
        return Scene(depth, self.background.nearest, self.stage.camera, self.matcher)


@pytest.fixture(scope="module", params=[False, True], ids=["bare", "hull"])
def room(request) -> Room:
    spec = CeilingSpec(hull=request.param)
    stage = DepthStage(spec, 0)
    empty = learn_background(stage.frame(k / 30.0, None).depth for k in range(30))
    flight = manual_flight(0, 20.0, 3.0, spec)
    samples = [(stage.frame(10.0 + stamp, pose), pose) for stamp, pose in flight]
    return Room(stage, empty, Matcher.of(build_template(samples, empty.nearest, stage.camera)))


def off(found: Registration, true: Pose) -> tuple[float, float]:
    """How far off a pose is, [m] and [deg]."""
    turn = math.degrees(wrap_angle(found.pose.yaw - true.yaw))
    return float(np.linalg.norm(found.pose.position - true.position)), abs(turn)


def startable(found: Registration) -> bool:
    """Whether a locator would take it for the drone."""
    seen = found.visible >= START.start_visible and found.ratio >= START.start_ratio
    return seen and found.outline <= START.start_outline and found.relief <= START.start_relief


def test_the_drone_passes_the_gates_of_a_start_wherever_it_is(room):
    rng = np.random.default_rng(2)
    for i in range(8):
        true = Pose(np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(0.8, 1.5)]), rng.uniform(-3.0, 3.0))
        found = acquire(room.scene(100.0 + i, true), true.position + rng.normal(0.0, 0.02, 3))
        assert startable(found), found
        assert np.linalg.norm(found.pose.position - true.position) < 0.02


@pytest.mark.parametrize("thing", ["tray", "box", "person", "chair"])
def test_nothing_else_passes_them(room, thing):
    z = 1.0 if thing == "tray" else 0.0
    scenes = [room.scene(200.0 + k, None, ThingPose(thing, 0.1 * k, 0.1, 0.8 * k, z=z)) for k in range(5)]
    for k, scene in enumerate(scenes):
        near = scene.depth[(scene.depth > 0) & (scene.depth < scene.nearest)]
        top = room.stage.camera.t_world_camera[2] - np.percentile(near, 20) / 1000.0
        for z in (top, top - 0.05):
            assert not startable(acquire(scene, np.array([0.1 * k, 0.1, z])))


def test_an_empty_room_has_nothing_that_could_start(room):
    found = acquire(room.scene(300.0, None), HOME.position)
    assert found.ratio < 0.0
    assert not startable(found)


@pytest.mark.parametrize(("dx", "dy", "dz"), [(0.004, 0.0, 0.0), (0.3, -0.2, 0.1), (-0.4, 0.3, -0.2)])
@pytest.mark.parametrize("turn", [0.02, 1.3])
def test_the_answer_moves_and_turns_with_the_drone(room, dx, dy, dz, turn):
    there = Pose(HOME.position + np.array([dx, dy, dz]), wrap_angle(HOME.yaw + turn))
    a, b = register(room.scene(400.0, HOME), HOME), register(room.scene(400.0, there), there)
    step = b.pose.position - a.pose.position
    assert np.linalg.norm(step - [dx, dy, dz]) < 0.016
    assert abs(math.degrees(wrap_angle(b.pose.yaw - a.pose.yaw - turn))) < 3.0


def test_where_it_was_predicted_matters_little(room):
    scene, rng = room.scene(500.0, HOME), np.random.default_rng(4)
    found = [
        register(scene, Pose(HOME.position + rng.normal(0.0, 0.012, 3), HOME.yaw + rng.normal(0.0, 0.05)))
        for _ in range(10)
    ]
    positions = np.array([f.pose.position for f in found])
    assert positions.std(axis=0).max() < 0.003
    assert np.degrees(np.std([f.pose.yaw for f in found])) < 0.8


def test_half_turns_are_told_apart_by_frames_that_are_summed(room):
    rng, right, wrong = np.random.default_rng(6), [], []
    for i in range(8):
        true = Pose(np.array([*rng.uniform(-0.4, 0.4, 2), 1.2]), rng.uniform(-3.0, 3.0))
        scene = room.scene(600.0 + i, true)
        right.append(register(scene, true).half_turn)
        wrong.append(register(scene, Pose(true.position, wrap_angle(true.yaw + math.pi))).half_turn)
    assert np.mean(right) > 5.0
    assert np.mean(wrong) < -5.0


@pytest.mark.parametrize("yaw", [-2.6, -0.8, 0.1, 1.9])
def test_quarter_turns_are_told_apart_in_a_frame(room, yaw):
    true = Pose(HOME.position, yaw)
    found = acquire(room.scene(700.0, true), HOME.position)
    assert abs(math.degrees(wrap_angle(2.0 * (found.pose.yaw - yaw)))) < 8.0


def test_the_covariance_is_positive_definite_and_grows_with_what_is_hidden(room):
    whole = register(room.scene(800.0, HOME), HOME)
    less = register(room.scene(800.0, HOME, holes=0.9), HOME)
    for found in (whole, less):
        np.testing.assert_array_equal(found.covariance, found.covariance.T)
        assert np.linalg.eigvalsh(found.covariance).min() > 0.0
    assert np.trace(less.covariance) > np.trace(whole.covariance)
    assert less.visible < whole.visible


def test_a_frame_with_half_of_its_readings_missing_still_finds_it(room):
    metres, degrees = off(register(room.scene(900.0, HOME, holes=0.5), HOME), HOME)
    assert metres < 0.012
    assert degrees < 2.0


def test_a_frame_without_readings_is_evidence_of_nothing(room):
    found = register(room.scene(1000.0, HOME, holes=1.0), HOME)
    assert (found.score, found.ratio, found.visible, found.half_turn) == (0.0, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(found.pose.position, HOME.position, atol=1e-12)
    assert np.isfinite(found.covariance).all()


def test_a_template_read_back_registers_the_same_bit_for_bit(room):
    again = Matcher.of(Template.from_arrays(room.matcher.template.arrays()))
    scene = room.scene(1100.0, HOME)
    a = register(scene, HOME)
    b = register(Scene(scene.depth, scene.nearest, scene.camera, again), HOME)
    np.testing.assert_array_equal(a.pose.position, b.pose.position)
    np.testing.assert_array_equal(a.covariance, b.covariance)
    assert (a.score, a.outline, a.relief, a.half_turn) == (b.score, b.outline, b.relief, b.half_turn)


def test_a_person_close_by_leaves_the_drone_where_it_is(room):
    for k in range(6):
        way = 2.0 * math.pi * k / 6.0
        x, y = HOME.position[:2] + 0.6 * np.array([math.cos(way), math.sin(way)])
        metres, degrees = off(
            register(room.scene(1200.0 + k, HOME, ThingPose("person", x, y, way)), HOME), HOME
        )
        assert metres < 0.02
        assert degrees < 3.5
