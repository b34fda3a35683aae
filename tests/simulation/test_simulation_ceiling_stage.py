"""What the camera on the ceiling sees: the room, the quadrotor from above, things that move, markers."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest

from noctule.camera import CEILING_CAMERA
from noctule.geometry import Array, Pose
from noctule.messages import DepthFrame
from noctule.simulation.ceiling import CeilingSpec, DepthStage, ThingPose, lab_room
from noctule.simulation.ceiling.quadrotor import MARKER_X, TOP, quadrotor
from noctule.simulation.ceiling.shapes import pack
from noctule.simulation.ceiling.things import SIZES
from noctule.simulation.layout import draw_layout
from noctule.simulation.placing import footprint
from noctule.simulation.renderer import Renderer
from noctule.simulation.scene import build_scene

HOVER = Pose(np.array([0.1, 0.15, 1.2]), 0.0)


@lru_cache(maxsize=4)
def stage(hull: bool = False, markers: bool = False, seed: int = 0) -> DepthStage:
    return DepthStage(CeilingSpec(hull=hull, markers=markers), seed)


def seen_from_above(
    pose: Pose | None, things: Sequence[ThingPose] = (), hull: bool = False, markers: bool = False
) -> Array:
    """Return the exact points (n, 3) [m] of what is not the room, in the body's axes, else in the world's."""
    s = stage(hull, markers)
    empty, full = s.exact(None), s.exact(pose, things)
    v, u = np.nonzero(np.abs(full - empty) > 1e-4)
    points = s.camera.to_world(np.column_stack([u, v]), full[v, u])
    return points if pose is None else (points - pose.position) @ pose.R_world_body


def extents(hull: bool) -> tuple[Array, Array]:
    """Return the corners of a box about all parts but the rotors, body axes."""
    rows = pack([p for p in quadrotor(hull, False) if p.opacity == 1.0])
    reach = np.abs(rows[:, 4:13].reshape(-1, 3, 3)) @ rows[:, 13:16, None]
    return (rows[:, 1:4] - reach[..., 0]).min(axis=0), (rows[:, 1:4] + reach[..., 0]).max(axis=0)


def test_a_bare_quadrotor_has_the_makers_measures() -> None:
    low, high = extents(hull=False)
    assert high[0] - low[0] == pytest.approx(0.45, abs=0.01)
    assert high[1] - low[1] == pytest.approx(0.29, abs=0.01)
    rotors = pack([p for p in quadrotor(False, False) if p.opacity < 1.0])
    assert len(rotors) == 4
    assert 2.0 * (rotors[:, 2] + rotors[:, 13]).max() == pytest.approx(0.452, abs=0.005)


def test_a_quadrotor_with_its_hull_has_the_makers_measures() -> None:
    low, high = extents(hull=True)
    assert high[:2] - low[:2] == pytest.approx([0.52, 0.52], abs=0.01)
    assert high[2] == pytest.approx(0.033, abs=0.005)


@pytest.mark.parametrize("hull", [False, True])
def test_left_and_right_are_alike_and_front_and_back_are_not(hull: bool) -> None:
    # A camera straight above, its picture's top ahead, so that columns go to the right and rows back.
    level = {"x_m": 0.0, "y_m": 0.0, "yaw_deg": 0.0, "pitch_deg": 0.0, "roll_deg": 0.0}
    above = CeilingSpec(hull=hull, cx_px=319.5, cy_px=239.5, **level)
    s = DepthStage(above, 0)
    shape = s.exact(Pose(np.array([0.0, 0.0, 1.6]), 0.0)) < s.exact(None) - 1e-4
    assert shape.sum() > 3000
    assert np.mean(shape ^ shape[:, ::-1]) < 0.02 * shape.mean()
    assert np.mean(shape ^ shape[::-1]) > 0.04 * shape.mean()
    # The nose is blunt, the tail slender.
    rows = np.nonzero(shape[:, 319])[0]
    ahead, behind = shape[rows.min() + 8, 300:340].sum(), shape[rows.max() - 8, 300:340].sum()
    assert ahead > 1.2 * behind


@pytest.mark.parametrize("hull", [False, True])
@pytest.mark.parametrize("yaw", [0.0, 1.1, -2.3])
def test_what_is_seen_of_the_quadrotor_lies_on_it_whatever_its_attitude(hull: bool, yaw: float) -> None:
    points = seen_from_above(Pose(HOVER.position, yaw, 0.1, -0.15), hull=hull)
    low, high = extents(hull)
    assert (points >= low - 0.002).all()
    assert (points <= high + 0.002).all()
    # From above it is seen to its ends.
    assert points[:, :2].max(axis=0) == pytest.approx(high[:2], abs=0.012)
    assert points[:, :2].min(axis=0) == pytest.approx(low[:2], abs=0.012)
    assert 0.02 < points[:, 2].max() <= TOP


def test_a_hull_covers_more_than_a_bare_quadrotor() -> None:
    bare, hull = len(seen_from_above(HOVER)), len(seen_from_above(HOVER, hull=True))
    assert 1.5 * bare < hull < 4.0 * bare


def test_a_bare_quadrotor_is_longer_than_wide() -> None:
    points = seen_from_above(HOVER)
    assert points[:, 0].var() > 2.0 * points[:, 1].var()


def near(frame: DepthFrame, s: DepthStage, pose: Pose, height: float = 0.1) -> np.ndarray:
    """Return where the depth is that of the quadrotor (height, width)."""
    v, u = np.nonzero(frame.depth)
    points = s.camera.to_world(np.column_stack([u, v]), frame.depth[v, u] / 1000.0) - pose.position
    mask = np.zeros(frame.depth.shape, bool)
    ours = (np.linalg.norm(points[:, :2], axis=1) < 0.35) & (np.abs(points[:, 2]) < height)
    mask[v[ours], u[ours]] = True
    return mask


def test_a_sensed_quadrotor_stands_where_it_is() -> None:
    s = stage()
    for k, x in enumerate([[-0.5, -0.3, 0.8], [0.1, 0.15, 1.2], [0.4, 0.9, 1.0]]):
        pose = Pose(np.array(x), 0.5 * k)
        v, u = np.nonzero(near(s.frame(k / 30, pose), s, pose))
        depth = s.frame(k / 30, pose).depth[v, u] / 1000.0
        middle = s.camera.to_world(np.column_stack([u, v]), depth).mean(axis=0)
        # Only the side that faces the eye is seen, so the middle of it is a little off.
        assert middle[:2] == pytest.approx(x[:2], abs=0.03)
        assert middle[2] - x[2] == pytest.approx(0.01, abs=0.02)


def test_rotors_send_back_a_part_and_not_the_same_in_two_frames() -> None:
    s = stage()
    pose = Pose(np.array([0.1, 0.15, 1.5]), 0.0)
    exact = s.exact(pose) < s.exact(None) - 1e-4
    # Outside of the solid parts, grown by what edges are displaced by, but within the rotors.
    solid = np.zeros_like(exact)
    for dv in range(-4, 5):
        for du in range(-4, 5):
            solid |= np.roll(exact, (dv, du), (0, 1))
    frames = [near(s.frame(k / 30, pose), s, pose) & ~solid for k in range(8)]
    disc = np.any(frames, axis=0)
    share = np.mean(frames, axis=0)[disc].mean()
    assert 0.05 < share < 0.4
    overlap = np.mean([(a & b).sum() / a.sum() for a, b in pairwise(frames)])
    assert overlap < 0.4


def test_without_a_pose_there_is_no_quadrotor() -> None:
    s = stage()
    assert not near(s.frame(0.0, None), s, HOVER).any()
    assert near(s.frame(0.0, HOVER), s, HOVER).sum() > 800


def test_the_lab_is_empty_where_one_flies_and_furnished_at_its_walls() -> None:
    for seed in range(4):
        room = lab_room(seed)
        assert room.size == (6.0, 6.0, 3.6)
        pieces = [footprint(piece) for piece in draw_layout(room).furniture]
        assert len(pieces) >= 6
        for piece in pieces:
            assert max(abs(piece.x_min), abs(piece.x_max), abs(piece.y_min), abs(piece.y_max)) > 2.0
            inside = min(piece.x_max, 1.7) > max(piece.x_min, -1.7)
            inside &= min(piece.y_max, 1.9) > max(piece.y_min, -1.7)
            assert not inside


def test_nothing_but_dropouts_is_missing_of_the_floor() -> None:
    depth = stage().frame(0.0, None).depth
    assert (depth[:, 100:] == 0).mean() < 0.02
    assert 3000 < np.median(depth) < 3600


def test_a_flat_floor_is_flat_to_millimetres_after_averaging() -> None:
    s = stage()
    frames = np.stack([s.frame(k / 30, None).depth[100:400:5, 150:600:5] for k in range(60)]).astype(float)
    frames[frames == 0] = np.nan
    mean = np.nanmean(frames, axis=0) / 1000.0
    v, u = np.mgrid[100:400:5, 150:600:5]
    points = s.camera.to_world(np.column_stack([u.ravel(), v.ravel()]), mean.ravel())
    assert abs(points[:, 2].mean()) < 0.002
    assert points[:, 2].std() < 0.005


def test_the_room_agrees_with_what_opengl_draws_of_it() -> None:
    s = stage()
    eye = Renderer(build_scene(draw_layout(s.room)), s.camera.intrinsics)
    try:
        eye._renderer.enable_depth_rendering()
        R, t = s.camera.R_world_camera, s.camera.t_world_camera
        for camera in eye._renderer.scene.camera:
            camera.pos, camera.forward, camera.up = t, R[:, 2], -R[:, 1]
        drawn = eye._renderer.render()
    finally:
        eye.close()
    difference = np.abs(drawn - s.exact(None))
    assert np.mean(difference < 1e-3) > 0.999
    assert np.median(difference) < 1e-4


def test_a_frame_depends_on_stamp_and_poses_only_not_on_what_was_drawn_before() -> None:
    s, other = stage(), DepthStage(CeilingSpec(), 0)
    person = ThingPose("person", -0.4, 0.5, 1.0)
    first = s.frame(2.0, HOVER, [person]).depth
    s.frame(2.1, Pose(np.array([0.5, 0.5, 0.6]), 1.0)).depth.sum()
    assert np.array_equal(s.frame(2.0, HOVER, [person]).depth, first)
    assert np.array_equal(other.frame(2.0, HOVER, [person]).depth, first)
    assert not np.array_equal(s.frame(2.1, HOVER, [person]).depth, first)


def test_a_stamp_may_be_that_of_any_clock() -> None:
    s = stage()
    depths = [s.frame(stamp, None).depth for stamp in (-3.0, 0.0, 1.7e9)]
    assert all((depth > 0).mean() > 0.95 for depth in depths)
    assert not np.array_equal(depths[0], depths[1])


def test_another_seed_is_another_room_and_other_noise() -> None:
    room = lab_room(0)
    same_room = DepthStage(CeilingSpec(), 1, room)
    assert np.array_equal(same_room.exact(None), stage().exact(None))
    assert not np.array_equal(same_room.frame(0.0, None).depth, stage().frame(0.0, None).depth)
    assert not np.array_equal(DepthStage(CeilingSpec(), 1).exact(None), stage().exact(None))


def test_asking_for_colour_changes_no_depth() -> None:
    s = stage(markers=True)
    assert np.array_equal(s.frame(1.0, HOVER, (), True).depth, s.frame(1.0, HOVER).depth)
    assert s.frame(1.0, HOVER).colour is None


@pytest.mark.parametrize("hull", [False, True])
@pytest.mark.parametrize("yaw", [0.3, 2.0, -2.6])
def test_markers_are_seen_in_their_colours_at_their_places(hull: bool, yaw: float) -> None:
    s = stage(hull, True)
    pose = Pose(HOVER.position, yaw, 0.08, 0.05)
    colour = s.frame(0.5, pose, colour=True).colour
    assert colour is not None
    red, green, blue = (colour[..., i].astype(int) for i in range(3))
    for x, mask in ((MARKER_X, (red > 150) & (green < 70)), (-MARKER_X, (blue > 150) & (green < 80))):
        v, u = np.nonzero(mask)
        assert len(u) > 100
        place = pose.position + pose.R_world_body @ [x, 0.0, TOP]
        assert [u.mean(), v.mean()] == pytest.approx(s.camera.project(place[None])[0], abs=1.0)


def test_without_markers_nothing_is_saturated_on_the_quadrotor() -> None:
    colour = stage().frame(0.5, HOVER, colour=True).colour
    assert colour is not None
    u, v = stage().camera.project(HOVER.position[None])[0].round().astype(int)
    patch = colour[v - 8 : v + 9, u - 8 : u + 9].astype(int)
    assert (patch.max(axis=2) - patch.min(axis=2)).mean() < 25


def test_rotors_dim_what_is_below_them_in_colour() -> None:
    s = stage()
    pose = Pose(np.array([0.1, 0.15, 1.5]), 0.0)
    rotor = pose.position + np.array([0.186, 0.156, 0.02])
    u, v = s.camera.project(rotor[None])[0].round().astype(int)
    here, there = (s.frame(0.0, p, colour=True).colour for p in (pose, None))
    assert here is not None
    assert there is not None
    patch = (slice(v - 4, v + 5), slice(u - 4, u + 5))
    assert 0.6 < here[patch].mean() / there[patch].mean() < 0.97


def test_colour_noise_has_its_strength() -> None:
    s = stage()
    a, b = (s.frame(k / 30, None, colour=True).colour for k in (0, 1))
    assert a is not None
    assert b is not None
    assert (a.astype(int) - b.astype(int)).std() == pytest.approx(2.0 * np.sqrt(2.0), rel=0.1)


@pytest.mark.parametrize("kind", ["person", "box", "tray", "chair"])
def test_a_thing_is_seen_as_large_as_it_is_where_it_stands(kind: str) -> None:
    thing = ThingPose(kind, 0.2, 0.1, 0.0, z=0.9 if kind == "tray" else 0.0)  # type: ignore[arg-type]
    points = seen_from_above(None, [thing])
    size = SIZES[thing.kind]
    assert points[:, 2].max() == pytest.approx(thing.z + size[2], abs=0.02)
    assert points[:, 2].min() >= thing.z - 1e-3
    limit = 0.4 if kind == "person" else 0.51 * max(size[:2])  # a person's feet reach out
    assert np.abs(points[:, :2] - [0.2, 0.1]).max() < limit
    assert len(points) > 1000


@pytest.mark.parametrize("height", [1.6, 1.85])
def test_people_have_the_height_that_is_asked_for(height: float) -> None:
    points = seen_from_above(None, [ThingPose("person", 0.1, -0.4, 0.7, size=(0.28, 0.46, height))])
    assert points[:, 2].max() == pytest.approx(height, abs=0.01)
    head = points[points[:, 2] > 0.93 * height]
    shoulders = points[(points[:, 2] > 0.75 * height) & (points[:, 2] < 0.84 * height)]
    assert np.ptp(head[:, :2], axis=0).max() < 0.25 < np.ptp(shoulders[:, :2], axis=0).max()


def test_a_person_looks_along_its_heading_and_swings_its_legs() -> None:
    still = seen_from_above(None, [ThingPose("person", 0.2, 0.1, walked=0.0)])
    stride = seen_from_above(None, [ThingPose("person", 0.2, 0.1, walked=0.35)])
    turned = seen_from_above(None, [ThingPose("person", 0.2, 0.1, np.pi / 2.0, walked=0.35)])
    feet = [points[points[:, 2] < 0.3] for points in (still, stride, turned)]
    along_x = [np.ptp(f[:, 0]) for f in feet]
    assert along_x[1] > along_x[0] + 0.2
    assert along_x[1] > along_x[2] + 0.2


def test_a_person_hides_the_quadrotor_that_is_behind_it() -> None:
    s = stage()
    pose = Pose(np.array([0.1, 0.15, 0.5]), 0.0)
    eye = CEILING_CAMERA.t_world_camera
    # On the line of sight, with the head between eye and quadrotor.
    share = (1.6 - 0.5) / (eye[2] - 0.5)
    x, y = (pose.position + share * (eye - pose.position))[:2]
    seen, hidden = (
        near(s.frame(0.0, pose), s, pose),
        near(s.frame(0.0, pose, [ThingPose("person", x, y)]), s, pose),
    )
    assert hidden.sum() < 0.7 * seen.sum()


def test_a_shadow_falls_on_the_quadrotor_from_a_thing_on_its_right_in_the_picture() -> None:
    s = stage()
    pose = Pose(np.array([0.1, 0.15, 0.6]), 0.0)
    alone = s.exact(pose) < s.exact(None) - 1e-4
    # The picture's right is the world's -y: a tray held high, moved there until it hides nothing of it.
    for y in np.arange(-0.3, -1.0, -0.01):
        tray = ThingPose("tray", 0.1, float(y), z=1.6)
        ours = (s.exact(pose, [tray]) < s.exact(None, [tray]) - 1e-4) & alone
        if ours.sum() == alone.sum():
            break
    assert ours.sum() == alone.sum()
    # 527 px x 0.075 m x (1 / 1.7 m - 1 / 2.7 m) is a shadow of 8 px: the end toward the tray is in it.
    end = ours & (np.arange(640) > np.nonzero(ours)[1].max() - 6)
    lost = [(s.frame(0.0, pose, things).depth == 0)[end].mean() for things in ([tray], [])]
    assert lost[0] > 0.8
    assert lost[1] < 0.5
