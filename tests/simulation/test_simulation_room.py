import colorsys
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

import noctule.simulation
from noctule.messages import Limits
from noctule.simulation import photos
from noctule.simulation.furniture import Block, Skin, furnish
from noctule.simulation.layout import draw_layout, room_layout, solid_polygon
from noctule.simulation.mesh import MeshSet
from noctule.simulation.photos import FILES, MOST_SATURATED, PhotoError, desaturate, fractal, photo
from noctule.simulation.placing import footprint, place_furniture
from noctule.simulation.shell import SHELL, paint_shell
from noctule.simulation.spec import (
    ColumnSpec,
    FurnitureSpec,
    KeepClear,
    LimitsSpec,
    RoomSpec,
    VehicleSpec,
    WorldFileError,
    WorldSpec,
    world_from_toml,
)
from noctule.simulation.textures import framed, paint

KINDS = ("bookcase", "cabinet", "table", "sofa", "crates", "plant", "panel", "person")
COLUMNS = (ColumnSpec(x=0.9, y=0.03, diameter=0.11), ColumnSpec(x=2.9, y=-0.03, width=0.05, depth=0.02))


def saturation(picture: np.ndarray) -> np.ndarray:
    x = picture.astype(float)
    high = x.max(axis=2)
    return (high - x.min(axis=2)) / np.maximum(high, 1.0)


def test_the_default_limits_are_those_that_travel_between_rooms() -> None:
    assert LimitsSpec().values() == Limits()
    assert VehicleSpec().limits.values() == Limits()


def test_the_example_file_describes_a_world() -> None:
    text = (Path(noctule.simulation.__file__).parent / "room.toml").read_text()
    spec = world_from_toml(text)
    assert [c.diameter for c in spec.room.columns] == [0.11, None]
    assert spec.vehicle.gusts == 0.5
    assert spec.room.size == RoomSpec().size


def test_an_empty_file_is_the_default_world() -> None:
    assert world_from_toml("") == WorldSpec()


def test_furniture_may_be_a_list() -> None:
    text = '[room]\nfurniture = [{kind = "person", x = 3.0, y = 1.0, height = 1.8}]'
    room = world_from_toml(text).room
    assert room.furniture == (FurnitureSpec(kind="person", x=3.0, y=1.0, height=1.8),)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[vehicle]\nlagg = 0.3",
            "world file: vehicle.lagg: Extra inputs are not permitted, found 0.3; "
            "see simulation/room.toml for an example",
        ),
        (
            "[vehicle]\nlag = -1.0",
            "world file: vehicle.lag: Input should be greater than 0.01, found -1.0; "
            "see simulation/room.toml for an example",
        ),
        (
            "[vehicle\n",
            "world file: not TOML: Expected ']' at the end of a table declaration (at line 1, column 9); "
            "mend that line",
        ),
    ],
)
def test_a_bad_world_file_is_told_in_one_line(text: str, message: str) -> None:
    with pytest.raises(WorldFileError) as caught:
        world_from_toml(text)
    assert str(caught.value) == message


def test_a_column_outside_the_walls_is_refused() -> None:
    with pytest.raises(
        ValidationError,
        match=r"columns\[0\] stands at \(9, 0\), outside the walls: x -3 to 7.5, y -3.5 to 3.5",
    ):
        RoomSpec(columns=(ColumnSpec(x=9.0, y=0.0, diameter=0.1),))


@pytest.mark.parametrize("shape", [{}, {"width": 0.1}, {"width": 0.1, "depth": 0.1, "diameter": 0.1}])
def test_a_column_is_a_box_or_a_cylinder(shape: dict) -> None:
    with pytest.raises(
        ValidationError, match=r"give either width and depth \(a box\) or diameter \(a cylinder\)"
    ):
        ColumnSpec(x=0.0, y=0.0, **shape)


def test_a_column_has_one_colour() -> None:
    with pytest.raises(ValidationError, match="give colour or hue, not both"):
        ColumnSpec(x=0.0, y=0.0, diameter=0.1, hue=0.2, colour=(1.0, 0.0, 0.0))
    assert ColumnSpec(x=0.0, y=0.0, diameter=0.1, colour=(0.1, 0.2, 0.3)).rgb(0.7) == (0.1, 0.2, 0.3)


@given(hue=st.floats(0.0, 0.999), drawn=st.floats(0.0, 0.999))
def test_a_columns_colour_is_saturated_whether_named_or_drawn(hue: float, drawn: float) -> None:
    named = ColumnSpec(x=0.0, y=0.0, diameter=0.1, hue=hue).rgb(drawn)
    assert colorsys.rgb_to_hsv(*named)[0] == pytest.approx(hue, abs=1e-6)
    for rgb in (named, ColumnSpec(x=0.0, y=0.0, diameter=0.1).rgb(drawn)):
        assert colorsys.rgb_to_hsv(*rgb)[1] > 2.0 * MOST_SATURATED


def test_rooms_may_be_high() -> None:
    layout = draw_layout(RoomSpec(size=(10.5, 7.0, 3.6)))
    assert layout.spec.size[2] == 3.6


@given(seed=st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_drawn_furniture_stays_away_from_where_flights_go(seed: int) -> None:
    spec = RoomSpec(seed=seed, columns=COLUMNS)
    clear = spec.keep_clear
    for solid in draw_layout(spec).solids:
        if solid.kind == "column":
            continue
        corners = solid_polygon(solid)
        dx = np.maximum(np.maximum(clear.x_min - corners[:, 0], corners[:, 0] - clear.x_max), 0.0)
        dy = np.maximum(np.maximum(clear.y_min - corners[:, 1], corners[:, 1] - clear.y_max), 0.0)
        assert np.hypot(dx, dy).min() >= clear.margin - 1e-9, solid.name


@given(seed=st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_pieces_of_furniture_do_not_stand_in_each_other_or_in_walls(seed: int) -> None:
    spec = RoomSpec(seed=seed)
    prints = [footprint(piece) for piece in place_furniture(spec, np.random.default_rng(seed))]
    for i, a in enumerate(prints):
        assert spec.x_min <= a.x_min
        assert a.x_max <= spec.x_max
        assert spec.y_min <= a.y_min
        assert a.y_max <= spec.y_max
        assert all(a.distance(b) > 0.1 for b in prints[:i])


@pytest.mark.parametrize("seed", range(5))
def test_every_direction_has_furniture_at_several_depths(seed: int) -> None:
    pieces = draw_layout(RoomSpec(seed=seed)).furniture
    ahead = [p.x for p in pieces if p.x > 6.0]
    assert len(ahead) >= 3
    assert max(ahead) - min(ahead) > 0.2
    assert any(p.y > 2.0 for p in pieces)
    assert any(p.y < -2.0 for p in pieces)
    assert any(p.x < -2.0 for p in pieces)


def test_a_room_without_space_gets_fewer_pieces() -> None:
    spec = RoomSpec(size=(6.4, 2.8, 2.5), corner=(-1.2, -1.4), furniture=10)
    assert draw_layout(spec).furniture == ()


def test_the_seed_draws_the_room() -> None:
    assert draw_layout(RoomSpec(seed=4)) == draw_layout(RoomSpec(seed=4))
    assert draw_layout(RoomSpec(seed=4)).furniture != draw_layout(RoomSpec(seed=5)).furniture


def test_other_furniture_does_not_recolour_the_columns() -> None:
    def colours(spec: RoomSpec) -> list:
        return [s.rgb for s in draw_layout(spec).solids if s.kind == "column"]

    assert colours(RoomSpec(columns=COLUMNS)) == colours(RoomSpec(columns=COLUMNS, furniture=2, pictures=0))
    assert colours(RoomSpec(columns=COLUMNS[:1])) == colours(RoomSpec(columns=COLUMNS))[:1]


@pytest.mark.parametrize("kind", KINDS)
def test_a_piece_is_solid_where_it_is_drawn(kind: str) -> None:
    spec = FurnitureSpec(kind=kind, x=1.0, y=2.0, yaw=0.4, width=1.0, depth=0.5, height=1.6)
    solids, blocks = furnish(spec, f"{kind}_0", np.random.default_rng(1))
    assert solids
    assert blocks
    assert {s.name for s in solids} == {f"{kind}_0"}
    assert {s.kind for s in solids} == {"person" if kind == "person" else "furniture"}
    for block in blocks:
        # What is seen can be hit; a cushion or a leaf may stick out a little.
        inside = [_contains(s, block.centre, 0.12) for s in solids]
        assert any(inside), block
    low = min(s.centre[2] - s.half[2] for s in solids)
    assert low == pytest.approx(0.0, abs=1e-9)


def _contains(solid, point, slack: float) -> bool:
    d = np.array(point) - np.array(solid.centre)
    c, s = math.cos(solid.yaw), math.sin(solid.yaw)
    local = np.array([c * d[0] + s * d[1], c * d[1] - s * d[0], d[2]])
    if solid.shape == "cylinder":
        return (
            math.hypot(local[0], local[1]) <= solid.half[0] + slack and abs(local[2]) <= solid.half[2] + slack
        )
    return bool(np.all(np.abs(local) <= np.array(solid.half) + slack))


def test_the_map_shows_walls_furniture_and_columns() -> None:
    prints = room_layout(RoomSpec(columns=COLUMNS))
    kinds = [p.kind for p in prints]
    assert kinds[0] == "wall"
    assert kinds.count("column") == 2
    assert "furniture" in kinds
    box = next(p for p in prints if p.name == "column_1")
    assert np.allclose(box.polygon.min(axis=0), [2.89, -0.055])
    assert np.allclose(box.polygon.max(axis=0), [2.91, -0.005])
    for p in prints:
        x, y = p.polygon.T
        assert np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0.0, "counterclockwise"


def test_a_person_is_a_person_on_the_map() -> None:
    spec = RoomSpec(
        furniture=(FurnitureSpec(kind="person", x=2.0, y=0.5, width=0.5, depth=0.4, height=1.8),), pictures=0
    )
    assert {p.kind for p in room_layout(spec)} >= {"wall", "person"}


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_desaturating_bounds_saturation_and_keeps_luminance(seed: int) -> None:
    picture = np.random.default_rng(seed).integers(0, 256, (16, 16, 3)).astype(np.uint8)
    mild = desaturate(picture)
    bright = picture.max(axis=2) > 40
    assert saturation(mild)[bright].max() <= MOST_SATURATED + 0.02
    weights = np.array([0.299, 0.587, 0.114])
    assert np.abs(mild @ weights - picture @ weights).max() <= 2.0


def test_desaturating_leaves_grey_pictures_alone() -> None:
    grey = np.repeat(np.arange(256, dtype=np.uint8)[:, None, None], 3, axis=2)
    assert np.array_equal(desaturate(grey), grey)


@pytest.mark.parametrize("name", sorted(FILES))
def test_every_photograph_is_in_the_installed_package(name: str) -> None:
    picture = photo(name)
    assert picture.ndim == 3
    assert max(picture.shape) <= 640
    assert picture.std() > 10.0


def test_a_missing_photograph_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(photos.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(PhotoError) as caught:
        photo.__wrapped__("coffee")
    assert str(caught.value) == (
        "simulation: photograph 'coffee.png' is not in .; "
        "expected it in the installed scikit-image: install scikit-image>=0.25 again"
    )


@pytest.mark.parametrize(
    "name", ["wood_dark", "fabric_b", "books_a", "poster_3", "window", "drawers_a", "leaves", "crate"]
)
def test_a_texture_depends_on_its_name_and_seed_alone(name: str) -> None:
    first = paint.__wrapped__(name, 3)
    assert np.array_equal(first, paint.__wrapped__(name, 3))
    assert not np.array_equal(first, paint.__wrapped__(name, 4))
    assert first.std() > 5.0


@pytest.mark.parametrize("seed", [0, 7])
def test_nothing_that_is_painted_is_as_saturated_as_a_column(seed: int) -> None:
    layout = draw_layout(RoomSpec(seed=seed))
    names = {b.skin.texture for b in layout.blocks} | {b.front.texture for b in layout.blocks if b.front}
    for name in sorted(names):
        picture = framed(name.removeprefix("framed:"), seed) if ":" in name else paint(name, seed)
        hsv_v = picture.max(axis=2)
        assert saturation(picture)[hsv_v > 40].max(initial=0.0) <= MOST_SATURATED + 0.03, name
    for name in SHELL:
        picture = paint_shell(name, layout)
        assert saturation(picture)[picture.max(axis=2) > 40].max() <= MOST_SATURATED + 0.03, name


def test_walls_have_features_at_many_places() -> None:
    wall = paint_shell("wall_front", draw_layout(RoomSpec()))
    corners = cv2.goodFeaturesToTrack(cv2.cvtColor(wall, cv2.COLOR_RGB2GRAY), 400, 0.01, 10)
    x = corners[:, 0, 0]
    assert len(corners) > 200
    assert np.histogram(x, bins=8, range=(0, wall.shape[1]))[0].min() > 10


def test_fractal_noise_has_mean_0_and_sd_1() -> None:
    noise = fractal(np.random.default_rng(0), 100, 173)
    assert noise.shape == (100, 173)
    assert abs(float(noise.mean())) < 1e-4
    assert float(noise.std()) == pytest.approx(1.0, abs=1e-3)


def test_every_face_of_a_block_looks_outward() -> None:
    for shape in ("box", "cylinder"):
        meshes = MeshSet(np.random.default_rng(0))
        meshes.block(Block(shape, (1.0, 2.0, 3.0), (0.3, 0.3, 0.5), 0.7, Skin("clay", 0.4)))
        for corners in meshes.meshes["clay"].corners:
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            assert normal @ (corners.mean(axis=0) - np.array([1.0, 2.0, 3.0])) > 0.0


def test_the_front_of_a_block_has_its_own_skin_once() -> None:
    meshes = MeshSet(np.random.default_rng(0))
    meshes.block(Block("box", (0.0, 0.0, 0.0), (0.1, 0.5, 0.5), 0.0, Skin("paint", 1.0), Skin("coffee")))
    front = meshes.meshes["coffee"]
    assert len(front.corners) == 1
    assert np.allclose(front.corners[0][:, 0], 0.1)
    assert np.array_equal(front.uv[0], [[0, 0], [1, 0], [1, 1], [0, 1]])


def test_drawn_furniture_respects_another_keep_clear() -> None:
    spec = RoomSpec(keep_clear=KeepClear(x_min=-3.0, x_max=7.5, y_min=-3.5, y_max=0.0, margin=0.5))
    assert all(footprint(p).y_min >= 0.5 for p in draw_layout(spec).furniture)
