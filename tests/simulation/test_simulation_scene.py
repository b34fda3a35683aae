"""That what is painted hangs where it should, upright, the right way round and lit."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from noctule.camera import PinholeCamera
from noctule.geometry import Pose
from noctule.simulation import scene
from noctule.simulation.furniture import Block, Skin
from noctule.simulation.hangings import hang
from noctule.simulation.layout import Layout, draw_layout, solid_polygon
from noctule.simulation.photos import photo
from noctule.simulation.renderer import Renderer, camera_pose
from noctule.simulation.scene import build_scene
from noctule.simulation.shell import paint_shell
from noctule.simulation.spec import ColumnSpec, FurnitureSpec, LightSpec, RoomSpec
from noctule.simulation.textures import framed

BARE = RoomSpec(furniture=0, pictures=0, lamps=0)
CAMERA = PinholeCamera.centred(428, 240, 255.0)
EYE = Pose(np.array([0.0, 0.0, 1.0]), 0.0)


def draw(layout: Layout, pose: Pose, stabilised: bool = True) -> np.ndarray:
    renderer = Renderer(build_scene(layout), CAMERA)
    pixels = renderer.draw(*camera_pose(pose, np.zeros(3), stabilised)).copy()
    renderer.close()
    return pixels


def with_blocks(*blocks: Block, room: RoomSpec = BARE) -> Layout:
    return Layout(room, (), (), blocks)


def project(points: np.ndarray, pose: Pose) -> np.ndarray:
    R, t = camera_pose(pose, np.zeros(3), stabilised=True)
    return CAMERA.project((points - t) @ R)


@pytest.mark.parametrize(
    ("yaw", "centre"), [(0.0, (2.0, 0.3, 1.1)), (math.pi / 2, (-0.2, 2.0, 0.9)), (-2.5, (-1.5, -1.2, 1.0))]
)
def test_a_picture_hangs_upright_and_not_mirrored(yaw: float, centre: tuple) -> None:
    pose = Pose(EYE.position, yaw)
    # The block's front looks back at the camera.
    block = Block("box", centre, (0.02, 0.6, 0.4), yaw + math.pi, Skin("paint", 1.0), Skin("coffee"))
    c, s = math.cos(yaw), math.sin(yaw)
    forward, left = np.array([c, s, 0.0]), np.array([-s, c, 0.0])
    near = np.array(centre) - 0.02 * forward
    up = np.array([0.0, 0.0, 0.4])
    corners = np.array(
        [near + 0.6 * left + up, near - 0.6 * left + up, near - 0.6 * left - up, near + 0.6 * left - up]
    )
    p = project(corners, pose).astype(np.float32)
    wide, tall = 240, 160
    frame = np.array([[0, 0], [wide, 0], [wide, tall], [0, tall]], np.float32)
    seen = draw(with_blocks(block), pose)
    flat = cv2.warpPerspective(seen, cv2.getPerspectiveTransform(p, frame), (wide, tall)).astype(float)
    wanted = cv2.resize(photo("coffee"), (wide, tall), interpolation=cv2.INTER_AREA).astype(float)

    def likeness(picture: np.ndarray) -> float:
        return float(np.corrcoef(flat.ravel(), picture.ravel())[0, 1])

    assert likeness(wanted) > 0.95
    assert likeness(wanted[:, ::-1]) < 0.8
    assert likeness(wanted[::-1]) < 0.8


def test_nothing_is_seen_through_a_wall_or_from_behind() -> None:
    block = Block("box", (9.0, 0.0, 1.0), (0.5, 3.0, 1.0), 0.0, Skin("hubble"))
    assert np.array_equal(draw(with_blocks(block), EYE), draw(with_blocks(), EYE))


def test_a_nearer_block_hides_a_farther_one() -> None:
    near = Block("box", (1.5, 0.0, 1.0), (0.05, 0.5, 0.5), 0.0, Skin("paint", 1.0))
    far = Block("box", (4.0, 0.0, 1.0), (0.05, 0.5, 0.5), 0.0, Skin("hubble"))
    alone, both = draw(with_blocks(near), EYE), draw(with_blocks(near, far), EYE)
    middle = np.s_[80:160, 170:260]
    assert alone[middle].mean() > 120.0
    assert both[middle].mean() == pytest.approx(alone[middle].mean(), rel=0.05)
    assert np.array_equal(draw(with_blocks(far, near), EYE)[0], both[0])


def test_the_ambient_light_and_lamps_brighten_the_room() -> None:
    def brightness(**light: object) -> float:
        return float(draw(draw_layout(BARE.model_copy(update=light)), EYE).mean())

    dark = brightness(ambient=0.4, lights=())
    assert brightness(ambient=0.8, lights=()) == pytest.approx(2.0 * dark, rel=0.05)
    lamp = LightSpec(x=3.0, y=0.0, z=1.5, intensity=0.8)
    assert brightness(ambient=0.4, lights=(lamp,)) > 1.05 * dark


FLAT = {
    "wall_front": (200, 0, 0),
    "wall_left": (0, 200, 0),
    "wall_right": (0, 0, 200),
    "floor": (200, 200, 0),
}


def test_a_room_of_another_size_is_drawn_to_its_walls(monkeypatch: pytest.MonkeyPatch) -> None:
    def flat(name: str, layout: Layout) -> np.ndarray:
        return np.full((8, 8, 3), FLAT.get(name, (0, 200, 200)), np.uint8)

    monkeypatch.setattr(scene, "_texture", flat)
    room = BARE.model_copy(
        update={"size": (6.0, 4.0, 3.6), "corner": (-3.0, -1.5), "lights": (), "ambient": 1.0}
    )
    renderer = Renderer(build_scene.__wrapped__(draw_layout(room)), CAMERA)
    pixels = renderer.draw(*camera_pose(EYE, np.zeros(3), stabilised=True))
    renderer.close()
    corners = project(np.array([[3.0, 2.5, 0.0], [3.0, -1.5, 3.6]]), EYE)

    def colour_at(u: float, v: float) -> tuple:
        return tuple(int(c) for c in pixels[round(v), round(u)])

    (left, bottom), (right, _) = corners
    middle = (left + right) / 2.0
    assert colour_at(middle, bottom - 1.5) == FLAT["wall_front"]
    assert colour_at(middle, bottom + 1.5) == FLAT["floor"]
    assert colour_at(left - 1.5, 100) == FLAT["wall_left"]
    assert colour_at(left + 1.5, 100) == FLAT["wall_front"]
    assert colour_at(right - 1.5, 100) == FLAT["wall_front"]
    assert colour_at(right + 1.5, 100) == FLAT["wall_right"]


def test_things_on_the_floor_darken_it_around_them() -> None:
    crate = FurnitureSpec(kind="crates", x=2.0, y=1.0, width=0.6, depth=0.6, height=1.0)
    room = BARE.model_copy(update={"furniture": (crate,)})
    with_it, without = (paint_shell("floor", draw_layout(r)).astype(float) for r in (room, BARE))
    ratio = with_it.mean(axis=2) / np.maximum(without.mean(axis=2), 1.0)
    per_metre = ratio.shape[1] / room.size[0]

    def at(x: float, y: float) -> float:
        row = ratio.shape[0] - (y - room.y_min) * per_metre
        column = (x - room.x_min) * per_metre
        return float(ratio[int(row) - 4 : int(row) + 4, int(column) - 4 : int(column) + 4].mean())

    assert at(2.0, 1.0) < 0.6
    assert 0.6 < at(2.0, 1.4) < 0.97
    assert at(2.0, -1.0) == pytest.approx(1.0, abs=0.02)


def test_a_lamp_is_painted_on_the_ceiling_above_its_light() -> None:
    room = BARE.model_copy(update={"lights": (LightSpec(x=1.0, y=-1.5),)})
    ceiling = paint_shell("ceiling", draw_layout(room)).mean(axis=2)
    per_metre = ceiling.shape[1] / room.size[0]
    # Seen from below with x to the right, y grows downward.
    row, column = int((-1.5 - room.y_min) * per_metre), int((1.0 - room.x_min) * per_metre)
    assert ceiling[row - 5 : row + 5, column - 20 : column + 20].mean() > 235.0


def test_a_framed_photograph_has_paper_and_frame_around_it() -> None:
    picture = framed("cat", 3)
    assert picture[2].mean() < 100.0
    assert picture[14].mean() > 180.0
    assert np.array_equal(picture, framed("cat", 3))


def test_walls_keep_their_own_paint() -> None:
    layout = draw_layout(RoomSpec())
    walls = [paint_shell(name, layout) for name in ("wall_front", "wall_back")]
    assert walls[0].shape == walls[1].shape
    assert not np.array_equal(walls[0], walls[1])


@given(seed=st.integers(0, 5000))
@settings(max_examples=25, deadline=None)
def test_what_hangs_on_walls_is_inside_and_faces_the_room(seed: int) -> None:
    room = RoomSpec(seed=seed)
    _, blocks = hang(room, np.random.default_rng(seed))
    fronts = [b for b in blocks if b.front is not None]
    assert len(fronts) > 10
    for block in fronts:
        x, y, z = block.centre
        gaps = np.array([room.x_max - x, y - room.y_min, x - room.x_min, room.y_max - y])
        assert gaps.min() == pytest.approx(block.half[0], abs=1e-9), "its back is on a wall"
        inward = np.array([[-1, 0], [0, 1], [1, 0], [0, -1]])[gaps.argmin()]
        assert np.allclose([math.cos(block.yaw), math.sin(block.yaw)], inward, atol=1e-9)
        assert z - block.half[2] >= -1e-9
        assert z + block.half[2] <= room.size[2] + 1e-9


@given(seed=st.integers(0, 5000))
@settings(max_examples=25, deadline=None)
def test_pictures_on_a_wall_do_not_overlap(seed: int) -> None:
    _, blocks = hang(RoomSpec(seed=seed), np.random.default_rng(seed))
    fronts = [b for b in blocks if b.front is not None]
    for i, a in enumerate(fronts):
        for b in fronts[:i]:
            if a.yaw == b.yaw:
                along = math.hypot(a.centre[0] - b.centre[0], a.centre[1] - b.centre[1])
                apart = (
                    along >= a.half[1] + b.half[1] or abs(a.centre[2] - b.centre[2]) >= a.half[2] + b.half[2]
                )
                assert apart


@given(seed=st.integers(0, 5000))
@settings(max_examples=25, deadline=None)
def test_hanging_lamps_are_solid_high_and_away_from_flights(seed: int) -> None:
    room = RoomSpec(seed=seed)
    solids, _ = hang(room, np.random.default_rng(seed))
    clear = room.keep_clear
    for solid in solids:
        if not solid.name.startswith("lamp"):
            continue
        assert solid.centre[2] - solid.half[2] >= 1.8
        assert solid.centre[2] + solid.half[2] == pytest.approx(room.size[2])
        corners = solid_polygon(solid)
        inside_x = (corners[:, 0] > clear.x_min) & (corners[:, 0] < clear.x_max)
        inside_y = (corners[:, 1] > clear.y_min) & (corners[:, 1] < clear.y_max)
        assert not np.any(inside_x & inside_y)


def test_a_low_room_has_no_hanging_lamps_and_no_door() -> None:
    solids, blocks = hang(
        BARE.model_copy(update={"size": (10.5, 7.0, 2.0), "lamps": 9}), np.random.default_rng(0)
    )
    assert solids == []
    assert blocks == []


def test_columns_are_drawn_in_one_colour_over_their_whole_height() -> None:
    room = BARE.model_copy(
        update={"columns": (ColumnSpec(x=2.0, y=0.0, width=0.3, depth=0.05, height=1.6, hue=0.0),)}
    )
    pixels = draw(draw_layout(room), EYE)
    top, bottom = project(np.array([[1.975, 0.0, 1.6], [1.975, 0.0, 0.3]]), EYE)[:, 1]
    strip = pixels[int(top) + 2 : int(bottom), int(CAMERA.cx)].astype(int)
    assert np.ptp(strip, axis=0).max() < 30
    assert strip[:, 0].min() > 3 * strip[:, 1].max()
    above = pixels[int(top) - 3, int(CAMERA.cx)].astype(int)
    assert above[0] < 2 * above[1]
