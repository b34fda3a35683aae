"""The published law in closed loop on the true geometry of a cloud of points."""

from dataclasses import replace

import numpy as np
import pytest
from pilots_cloud import CAMERA, DT, OPTICS, cloud, pixels, pose_at, scene_at, view_of

from noctule.control.transition import Transition
from noctule.geometry import rot_z, wrap_angle
from noctule.messages import ColumnBox, Limits
from noctule.pilots.published import PublishedLaw
from noctule.pilots.settings import PilotSettings

LIMITS = Limits()
UNLIMITED = Limits(10.0, 10.0, 10.0, 10.0, 1e6, 1e6)
HOME = (np.array([0.0, 0.0, 1.0]), 0.0)
POINTS = cloud()


def law_of(last=0, limits=LIMITS, **gains):
    return PublishedLaw(
        PilotSettings.model_validate({"law": "published", "published": gains}), limits, OPTICS, last
    )


def fly(law, targets, start, seconds=60.0, lag=0.3, columns=(), seed=0):
    """Fly; returns the place, the commands and the answers."""
    position, yaw = np.array(start[0], dtype=float), start[1]
    command, velocity, answers = np.zeros(4), np.zeros(4), []
    for n in range(int(seconds / DT)):
        stamp = n * DT
        views = {
            i: view_of(i, POINTS, targets[i], (position, yaw), pose_at(stamp), seed=[seed, n])
            for i in (law.target, law.target + 1)
            if i < len(targets)
        }
        answer = law.step(scene_at(stamp, views, command, columns))
        command = answer.command
        answers.append(answer)
        if law.arrived:
            break
        for _ in range(5):
            velocity = velocity + (command - velocity) * DT / 5.0 / lag
            position = position + rot_z(yaw) @ velocity[:3] * DT / 5.0
            yaw += velocity[3] * DT / 5.0
    return (position, yaw), np.array([a.command for a in answers]), answers


def column(left, right):
    return ColumnBox(left, 0.0, right, 479.0, np.array([left, 240.0]), np.array([right, 240.0]))


def column_of(width, centre=430.0):
    """A column of a normalised width."""
    half = width * 510.0 / 2.0
    return column(centre - half, centre + half)


def still(law, stamp, columns=(), points=POINTS, here=(np.array([-0.3, 0.0, 1.0]), 0.0), previous=None):
    """One step of the law at a place that does not change."""
    views = {law.target: view_of(law.target, points, HOME, here, pose_at(stamp))}
    return law.step(scene_at(stamp, views, np.zeros(4) if previous is None else previous, columns))


@pytest.mark.parametrize(
    "start",
    [([-0.6, 0.15, 1.1], 0.1), ([-0.4, -0.2, 0.9], -0.15), ([0.2, 0.1, 1.0], 0.0)],
    ids=["left of it", "right of it", "past it"],
)
def test_a_flight_converges_below_epsilon(start):
    law = law_of()
    (position, yaw), commands, answers = fly(law, [HOME], start)
    assert law.arrived
    p, p_ref = pixels(POINTS, position, yaw), pixels(POINTS, *HOME)
    assert np.linalg.norm(p - p_ref, axis=1).mean() < law.settings.published.epsilon_last_px
    # A few pixels are a weak certificate: yaw trades against sideways motion.
    assert np.linalg.norm(position - HOME[0]) < 0.2
    assert abs(wrap_angle(yaw)) < np.radians(3.0)
    steps = np.diff(np.vstack([np.zeros(4), commands]), axis=0)
    assert np.linalg.norm(steps[:, :3], axis=1).max() <= LIMITS.acceleration * DT
    assert np.linalg.norm(answers[-1].error) < np.linalg.norm(answers[0].error)


def test_the_command_points_at_the_target_in_all_four_freedoms():
    law = law_of(limits=UNLIMITED)
    here = (np.array([-0.3, 0.2, 1.1]), 0.0)
    forward, left, up, _ = still(law, 0.0, here=here).command
    assert forward > 0.0 > left
    assert up < 0.0
    turned = still(law_of(limits=UNLIMITED), 0.0, here=(HOME[0], 0.2)).command
    assert turned[3] < 0.0


def test_the_image_changes_below_epsilon_only_when_the_next_one_is_in_sight():
    law = law_of(last=1, epsilon_intermediate_px=12.0)
    near = (np.array([-0.02, 0.0, 1.0]), 0.0)
    first = view_of(0, POINTS, HOME, near, pose_at(0.0))
    assert first.epsilon_px < 12.0
    law.step(scene_at(0.0, {0: first}, np.zeros(4)))
    assert law.target == 0
    second = view_of(1, POINTS, (np.array([0.5, 0.0, 1.0]), 0.0), near, pose_at(DT))
    law.step(scene_at(DT, {0: first, 1: second}, np.zeros(4)))
    assert law.target == 1
    assert law.transition is not None


def test_the_image_does_not_change_above_epsilon():
    law = law_of(last=1, epsilon_intermediate_px=1.0)
    near = (np.array([-0.05, 0.0, 1.0]), 0.0)
    views = {i: view_of(i, POINTS, HOME, near, pose_at(0.0)) for i in (0, 1)}
    law.step(scene_at(0.0, views, np.zeros(4)))
    assert law.target == 0


def test_only_the_last_image_ends_the_flight():
    at = (HOME[0], 0.0)
    law = law_of(last=1)
    law.step(scene_at(0.0, {0: view_of(0, POINTS, HOME, at, pose_at(0.0))}, np.zeros(4)))
    assert not law.arrived
    law = law_of(last=0)
    law.step(scene_at(0.0, {0: view_of(0, POINTS, HOME, at, pose_at(0.0))}, np.zeros(4)))
    assert law.arrived


def test_the_next_image_is_wanted_when_this_one_is_near():
    law = law_of(last=1, epsilon_intermediate_px=12.0)
    still(law, 0.0, here=(np.array([-1.2, 0.0, 1.0]), 0.0))
    assert not law.wants_next
    still(law, DT, here=(np.array([-0.1, 0.0, 1.0]), 0.0))
    assert law.wants_next


def test_a_path_is_flown_to_its_last_image_within_the_limits():
    targets = [HOME, (np.array([0.5, 0.05, 1.05]), 0.05)]
    law = law_of(last=1, epsilon_intermediate_px=12.0)
    (position, _), commands, answers = fly(law, targets, ([-0.4, 0.1, 1.0], 0.05))
    assert law.arrived
    assert np.linalg.norm(position - targets[1][0]) < 0.2
    steps = np.diff(np.vstack([np.zeros(4), commands]), axis=0)
    assert np.linalg.norm(steps[:, :3], axis=1).max() <= LIMITS.acceleration * DT
    assert np.abs(steps[:, 3]).max() <= LIMITS.yaw_acceleration * DT
    assert {a.activations["transition"] for a in answers} > {1.0}


def switch(h_0):
    """The commands around a switch, at a place and speed that do not change, without limits."""
    law = law_of(last=1, limits=UNLIMITED, h_0=h_0, transition_s=1.0)
    here, beyond = (np.array([-0.02, 0.0, 1.0]), 0.0), (np.array([0.5, 0.2, 1.0]), 0.1)
    first = view_of(0, POINTS, HOME, here, pose_at(0.0))
    second = view_of(1, POINTS, beyond, here, pose_at(0.0))
    last, commands = np.array([0.1, 0.0, 0.0, 0.0]), []
    for n in range(40):
        last = law.step(scene_at(n * DT, {0: first, 1: second}, last)).command
        commands.append(last)
    return np.array(commands)


def test_blending_at_a_switch_is_continuous_even_without_limits():
    commands = np.vstack([[0.1, 0.0, 0.0, 0.0], switch(0.0)])
    change = np.linalg.norm(commands[-1] - commands[0])
    steps = np.linalg.norm(np.diff(commands, axis=0), axis=1)
    assert change > 0.1  # there was something to blend
    # A raised cosine over a second at 30 Hz is never steeper than pi / 2 of its height a second.
    assert steps.max() <= 1.05 * np.pi / 2.0 * DT * change


def test_the_share_that_is_new_right_after_a_switch_is_h_0():
    commands = switch(0.2)
    change = commands[-1] - [0.1, 0.0, 0.0, 0.0]
    assert commands[0] - [0.1, 0.0, 0.0, 0.0] == pytest.approx(0.2 * change, rel=0.1, abs=0.01)


def test_hovering_ends_the_blending_of_a_switch():
    law = law_of(last=1)
    at = (HOME[0], 0.0)
    views = {i: view_of(i, POINTS, HOME, at, pose_at(0.0)) for i in (0, 1)}
    law.step(scene_at(0.0, views, np.array([0.3, 0.0, 0.0, 0.0])))
    assert law.transition is not None
    law.pause(scene_at(DT, {}, np.zeros(4)))
    assert law.transition is None


def test_avoidance_begins_when_a_column_is_wider_than_sigma_and_fades_when_it_leaves():
    law = law_of(sigma=0.05, activation_s=0.5)
    answer = still(law, 0.0, (column_of(0.04),))
    assert answer.activations["avoidance"] == 0.0
    assert answer.task_errors["avoidance"] == pytest.approx(-0.01)
    rising = [still(law, n * DT, (column_of(0.08),)).activations["avoidance"] for n in range(1, 17)]
    assert rising[-1] == 1.0
    assert rising == sorted(rising)
    falling = [still(law, n * DT).activations["avoidance"] for n in range(17, 34)]
    assert falling[0] == pytest.approx(1.0, abs=0.02)
    assert falling == sorted(falling, reverse=True)
    assert falling[-1] == 0.0
    h = np.array([answer.activations["avoidance"], *rising, *falling])
    assert np.abs(np.diff(h)).max() <= np.pi / 2.0 * DT / 0.5 + 1e-9


def test_a_column_in_the_way_brakes_the_flight():
    free, held = law_of(), law_of(activation_s=0.1)
    for n in range(10):
        onward = still(free, n * DT).command
        braked = still(held, n * DT, (column_of(0.1),)).command
    assert braked[0] < 0.5 * onward[0]


def test_the_widest_column_is_avoided_and_one_cut_by_the_border_is_not():
    law = law_of(sigma=0.05)
    two = still(law, 0.0, (column_of(0.06, 200.0), column_of(0.09, 600.0)))
    assert two.task_errors["avoidance"] == pytest.approx(0.04)
    cut = still(law_of(), 0.0, (column(0.0, 80.0), column(CAMERA.width - 60.0, CAMERA.width - 1.0)))
    assert cut.activations["avoidance"] == 0.0
    assert cut.task_errors["avoidance"] == 0.0


def test_visibility_begins_when_a_point_leaves_the_safety_box():
    law = law_of(activation_s=0.5)
    view = view_of(0, POINTS, HOME, (np.array([-0.2, 0.0, 1.0]), 0.0), pose_at(0.0))
    whole = replace(view, p_current=np.clip(view.p_current, [50.0, 30.0], [800.0, 450.0]))
    assert law.step(scene_at(0.0, {0: whole}, np.zeros(4))).activations["visibility"] == 0.0
    leaving = whole.p_current.copy()
    leaving[0] = [30.0, 240.0]  # still in the picture, not in the box
    rising = [
        law.step(scene_at(n * DT, {0: replace(whole, p_current=leaving)}, np.zeros(4))).activations[
            "visibility"
        ]
        for n in range(1, 17)
    ]
    assert rising == sorted(rising)
    assert rising[-1] == 1.0
    falling = [
        law.step(scene_at(n * DT, {0: whole}, np.zeros(4))).activations["visibility"] for n in range(17, 34)
    ]
    assert falling[-1] == 0.0


def test_the_tasks_have_clocks_of_their_own():
    law = law_of(activation_s=0.5)
    for n in range(8):
        half = still(law, n * DT, (column_of(0.08),))
    assert 0.3 < half.activations["avoidance"] < 0.7
    assert half.activations["visibility"] == 0.0


def test_the_last_command_is_held_for_a_moment_without_a_view_and_no_longer():
    law = law_of()
    command = still(law, 0.0).command
    for n in range(1, 10):
        assert law.step(scene_at(n * DT, {}, command, None)).command.tolist() == command.tolist()
    assert law.step(scene_at(0.3 + PilotSettings().picture_latency_s + 0.01, {}, command, None)) is None


def test_before_the_first_view_there_is_no_command():
    assert law_of().step(scene_at(0.0, {}, np.zeros(4))) is None


def test_views_of_other_images_are_not_flown_to():
    law = law_of(last=1)
    view = view_of(1, POINTS, HOME, HOME, pose_at(0.0))
    assert law.step(scene_at(0.0, {1: view}, np.zeros(4))) is None


def test_losing_the_target_ends_the_blend_of_a_switch():
    law = law_of(last=1)
    law.transition = Transition(np.array([0.4, 0.0, 0.0, 0.0]), 1.6)
    assert law.step(scene_at(5.0, {}, np.zeros(4))) is None
    assert law.transition is None


def test_feed_forward_is_that_of_the_segment_being_flown_and_none_on_the_last():
    ahead = (np.array([0.3, 0.0, 0.0, 0.1]), np.array([0.0, 0.3, 0.0, 0.0]))
    law = PublishedLaw(
        PilotSettings.model_validate(
            {"law": "published", "published": {"feed_forward": 0.5, "feed_forward_weight": 0.25}}
        ),
        UNLIMITED,
        OPTICS,
        2,
        ahead,
    )
    nu = np.array([0.1, 0.2, 0.3, 0.4])
    assert law._with_feed_forward(nu) == pytest.approx(nu)  # the way to the first image is no segment
    law.jump(1)
    assert law._with_feed_forward(nu) == pytest.approx(0.25 * nu + 0.75 * 0.5 * ahead[0])
    law.jump(2)
    assert law._with_feed_forward(nu) == pytest.approx(nu)


@pytest.mark.parametrize(("avoiding", "switched"), [(False, True), (True, False)])
def test_an_error_that_rises_five_times_passes_an_image_unless_a_column_is_being_passed(avoiding, switched):
    law = law_of(last=1, feed_forward=0.5)
    law.segments = (np.zeros(4),)
    if avoiding:
        law.avoidance = law.avoidance.step((np.eye(1, 4), np.zeros(1)), 0.1)
    targets = [(np.array([1.0, 0.0, 1.0]), 0.0), (np.array([2.0, 0.0, 1.0]), 0.0)]
    for n in range(8):
        here = (np.array([0.5 - 0.03 * n, 0.0, 1.0]), 0.0)  # drifting away
        views = {i: view_of(i, POINTS, targets[i], here, pose_at(n * DT), seed=[0, n]) for i in (0, 1)}
        law.step(scene_at(n * DT, views, np.zeros(4), None))  # no word of columns: what is active stays so
    assert (law.target == 1) is switched
