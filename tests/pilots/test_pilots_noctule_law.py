"""The law `noctule` on views: from true correspondences of a cloud of points to commands."""

from dataclasses import replace

import numpy as np
import pytest
from pilots_cloud import CAMERA, DT, MOUNT, OPTICS, cloud, pose_at, view_of

from noctule.estimation.odometry import Odometry, OdometryPose
from noctule.geometry import rot_z, wrap_angle
from noctule.messages import ColumnBox, Limits
from noctule.pilots.law import Scene
from noctule.pilots.noctule_law import NoctuleLaw, sighting_of
from noctule.pilots.progress import LinkGeometry
from noctule.pilots.settings import PilotSettings

LIMITS = Limits()
HOME = (np.array([0.0, 0.0, 1.0]), 0.0)
POINTS = cloud(120)


def law_of(links=(), **settings):
    return NoctuleLaw(PilotSettings.model_validate(settings), LIMITS, OPTICS, tuple(links))


def box_of(column, position, yaw):
    """The box of a column (x, y, radius) seen from a body's place, None out of sight."""
    x, y, radius = column
    axis = rot_z(-yaw) @ (np.array([x, y, position[2]]) - position) - MOUNT.t_body_camera
    if axis[0] < 0.05:
        return None
    bearing, half = np.arctan2(axis[1], axis[0]), np.arcsin(min(radius / np.hypot(*axis[:2]), 0.99))
    edges = np.column_stack([-np.tan([bearing + half, bearing - half]), np.zeros(2)])
    left, right = CAMERA.to_pixels(edges)[:, 0]
    if bearing + half > 1.4 or bearing - half < -1.4 or left > CAMERA.width - 1 or right < 0.0:
        return None
    left, right = max(left, 0.0), min(right, CAMERA.width - 1.0)
    return ColumnBox(left, 0.0, right, 479.0, np.array([left, 239.5]), np.array([right, 239.5]))


def fly(target, start, columns=(), seconds=25.0, seed=0):
    """Fly to `target`; returns the law, the places (n, 3), the last heading, clearance and answers."""
    law, odometry = law_of(), Odometry(0.3)
    position, yaw = np.array(start[0], dtype=float), start[1]
    command, velocity, clearance = np.zeros(4), np.zeros(4), np.inf
    answers, places = [], []
    for n in range(int(seconds / DT)):
        pose = odometry.step(n * DT, command, velocity[:3], yaw)
        view = view_of(0, POINTS, target, (position, yaw), pose, "upright", seed=[seed, n])
        boxes = [box_of(column, position, yaw) for column in columns]
        boxes = tuple(box for box in boxes if box is not None)
        answer = law.step(Scene(n * DT, DT, pose, command, {0: view}, boxes, pose))
        command = answer.command
        answers.append(answer)
        for _ in range(5):
            velocity = velocity + (command - velocity) * DT / 5.0 / 0.3
            position = position + rot_z(yaw) @ velocity[:3] * DT / 5.0
            yaw += velocity[3] * DT / 5.0
        places.append(position)
        gaps = [np.hypot(*(position[:2] - [x, y])) - radius - 0.2 for x, y, radius in columns]
        clearance = min([clearance, *gaps])
        if law.arrived:
            break
    return law, np.array(places), yaw, clearance, answers


@pytest.mark.parametrize(
    "start",
    [([-1.0, 0.2, 1.2], 0.2), ([-0.8, -0.3, 0.8], -0.2)],
    ids=["from the left", "from the right"],
)
def test_a_flight_ends_where_the_image_was_taken(start):
    law, places, yaw, _, answers = fly(HOME, start)
    assert law.arrived
    assert np.linalg.norm(places[-1] - HOME[0]) < 0.02
    assert abs(np.degrees(wrap_angle(yaw))) < 0.5
    commands = np.vstack([np.zeros(4), *(a.command for a in answers)])
    assert np.linalg.norm(np.diff(commands, axis=0)[:, :3], axis=1).max() <= LIMITS.acceleration * DT


@pytest.mark.parametrize("y", [0.05, -0.05])
def test_a_column_in_the_way_is_passed_on_its_nearer_side(y):
    column = (-0.75, y, 0.03)
    law, places, _, clearance, answers = fly(HOME, ([-1.7, 0.0, 1.0], 0.0), (column,))
    assert law.arrived
    assert np.linalg.norm(places[-1] - HOME[0]) < 0.02
    assert clearance >= 0.1
    assert max(a.activations["avoidance"] for a in answers) == 1.0
    abeam = places[np.argmin(np.abs(places[:, 0] - column[0])), 1]
    assert np.sign(abeam) == -np.sign(y)


def test_a_sighting_is_the_camera_seen_from_the_camera_in_the_heading_frame():
    here, target = (np.array([-0.4, 0.1, 1.1]), 0.15), (np.array([0.0, 0.0, 1.0]), -0.05)
    sighting = sighting_of(view_of(3, POINTS, target, here, pose_at(0.5), "upright", noise=0.02))
    way = target[0] + rot_z(target[1]) @ MOUNT.t_body_camera - here[0] - rot_z(here[1]) @ MOUNT.t_body_camera
    way = rot_z(-here[1]) @ way
    direction = sighting.t_heading / np.linalg.norm(sighting.t_heading)
    assert direction @ way / np.linalg.norm(way) > np.cos(np.radians(1.0))
    assert sighting.yaw == pytest.approx(0.2, abs=0.003)
    assert (sighting.index, sighting.pose.stamp) == (3, 0.5)


def test_the_covariance_of_a_sighting_is_turned_with_its_axes():
    view = view_of(0, POINTS, HOME, ([-0.4, 0.1, 1.1], 0.0), pose_at(0.0), "upright")
    marked = replace(view, estimate=replace(view.estimate, covariance=np.diag([1.0, 2.0, 3.0, 4.0])))
    # Of (yaw, right, down, forward) in the camera: of (yaw, forward, left, up) in the heading frame.
    assert np.diag(sighting_of(marked).covariance).tolist() == [1.0, 4.0, 2.0, 3.0]


def scene(stamp, views=None, columns=None, position=(0.0, 0.0, 0.0), previous=(0.0, 0.0, 0.0, 0.0)):
    pose = OdometryPose(stamp, np.array(position), 0.0, np.zeros(3))
    return Scene(stamp, DT, pose, np.array(previous), views or {}, columns, pose)


def view_at(stamp, x=-0.6, index=0, **changes):
    return replace(view_of(index, POINTS, HOME, ([x, 0.0, 1.0], 0.0), pose_at(stamp), "upright"), **changes)


def test_before_the_first_view_there_is_no_command():
    assert law_of().step(scene(0.0)) is None


def test_pictures_without_the_target_are_bridged_for_a_moment():
    law = law_of()
    first = law.step(scene(0.0, {0: view_at(0.0)}))
    assert first.command[0] > 0.0
    for n in range(1, 10):
        held = law.step(scene(n * DT, previous=first.command))
        assert held.command[0] > 0.0
        assert np.isnan(held.error).all()
    assert law.step(scene(0.3 + PilotSettings().picture_latency_s + 0.02)) is None


def test_a_sighting_that_is_refused_does_not_count_as_seen():
    law = law_of()
    for n in range(20):
        law.step(scene(n * DT, {0: view_at(n * DT)}))
    wrong = view_of(0, POINTS, HOME, ([-0.6, 0.5, 0.7], 0.3), pose_at(0.0), "upright")
    for n in range(20, 29):
        stamp = n * DT
        law.step(scene(stamp, {0: replace(wrong, pose=pose_at(stamp))}))
    assert law._seen == pytest.approx(19 * DT)


def test_only_the_target_counts_as_the_target():
    law = law_of([LinkGeometry(np.array([0.2, 0.0, 0.0]), 1.0)])
    law.step(scene(0.0, {0: view_at(0.0)}))
    assert law.step(scene(0.35, {1: view_at(0.35, index=1)})) is None
    assert 1 in law.progress.targets  # but it is remembered


def test_the_error_of_the_diagnostics_is_turn_and_way_apart():
    view = view_at(0.0)
    error = law_of().step(scene(0.0, {0: view})).error
    assert error[:3] == pytest.approx(view.estimate.t)
    assert error[3:] == pytest.approx([0.0, 2.0 * np.sin(view.estimate.yaw), 0.0])


def test_the_next_image_is_wanted_when_this_one_is_near():
    for x, near in ((-1.6, False), (-0.4, True)):
        law = law_of(progress={"cruise": 0.4})
        law.step(scene(0.0, {0: view_at(0.0, x)}))
        # The depth is not known yet, so what counts is how far it is thought to be.
        assert law.wants_next is near
        assert law.wants_next == (law.progress.remaining < 0.9)


def test_while_the_pilot_hovers_columns_are_dead_reckoned_and_seen():
    law = law_of()
    box = box_of((1.0, 0.2, 0.03), np.array([0.0, 0.0, 1.0]), 0.0)
    law.pause(scene(0.0, columns=(box,)))
    law.pause(scene(DT, columns=(box,)))
    (column,) = law.progress.detour.columns
    assert column.hits == 2
    law.pause(scene(2 * DT, position=(0.1, 0.0, 0.0)))
    (moved,) = law.progress.detour.columns
    assert moved.estimate.centre == pytest.approx(column.estimate.centre - [0.1, 0.0], abs=1e-6)


def test_without_a_new_picture_no_column_is_missed():
    law = law_of()
    box = box_of((1.0, 0.2, 0.03), np.array([0.0, 0.0, 1.0]), 0.0)
    law.pause(scene(0.0, columns=(box,)))
    law.pause(scene(DT))
    assert law.progress.detour.columns[0].hits == 1


def test_visibility_begins_when_a_point_leaves_the_safety_box_and_fades_when_it_is_back():
    law = law_of()
    view = view_at(0.0)
    whole = replace(view, p_current=np.clip(view.p_current, [50.0, 30.0], [800.0, 450.0]))
    leaving = whole.p_current.copy()
    leaving[0] = [20.0, 240.0]

    def activation(stamp, p):
        seen = {0: replace(whole, pose=pose_at(stamp), p_current=p)}
        return law.step(scene(stamp, seen)).activations["visibility"]

    assert activation(0.0, whole.p_current) == 0.0
    rising = [activation(n * DT, leaving) for n in range(1, 17)]
    assert rising == sorted(rising)
    assert rising[-1] == 1.0
    falling = [activation(n * DT, whole.p_current) for n in range(17, 34)]
    assert falling == sorted(falling, reverse=True)
    assert falling[-1] == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["right", "left"])
def test_visibility_turns_the_camera_toward_points_that_are_leaving(side):
    # The estimate says that there is nothing to fly, so whatever moves is visibility.
    view = view_of(0, POINTS, HOME, HOME, pose_at(0.0), "upright")
    p = np.clip(
        view.p_ref + np.array([200.0 * side, 0.0]), [2.0, 2.0], [CAMERA.width - 3.0, CAMERA.height - 3.0]
    )
    law, command = law_of(), np.zeros(4)
    for n in range(15):
        seen = {0: replace(view, pose=pose_at(n * DT), p_current=p)}
        command = law.step(scene(n * DT, seen, previous=command)).command
    # Points at the right come back when the camera turns right or moves right.
    assert side * command[3] <= 0.0
    assert side * command[1] <= 0.0
    assert np.linalg.norm(command[[1, 3]]) > 0.05
