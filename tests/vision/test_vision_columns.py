import colorsys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from vision_photographs import HEIGHT, NAMES, WIDTH, noisy, photograph

from noctule.vision.columns import ColumnColour, detect_columns

MIDDLE = (HEIGHT - 1) / 2


def with_column(
    pixels, left, right, hue, top=40, bottom=440, lean=0.0, shaded=True, value=0.8, saturation=0.9
):
    """Draw a column with exact edges at mid-height; a round one is darker toward its sides."""
    out = np.asarray(pixels, dtype=np.float64).copy()
    colour = 255.0 * np.array(colorsys.hsv_to_rgb(hue / 360.0, saturation, value))
    x = np.arange(out.shape[1])
    for y in range(top, bottom):
        a, b = left + lean * (y - MIDDLE), right + lean * (y - MIDDLE)
        share = np.clip(np.minimum(x + 0.5, b) - np.maximum(x - 0.5, a), 0.0, 1.0)
        u = np.clip((x - (a + b) / 2) / ((b - a) / 2), -1.0, 1.0)
        light = (0.7 + 0.3 * np.sqrt(1.0 - u * u)) * (1.0 - 0.2 * u) if shaded else np.ones_like(u)
        light = light * (0.7 + 0.3 * y / HEIGHT)
        out[y] = out[y] * (1.0 - share[:, None]) + share[:, None] * light[:, None] * colour
    return out


def grays(name):
    """A photograph with little colour, so that only the column has any."""
    pixels = photograph(name).astype(np.float64)
    return 0.75 * pixels.mean(axis=2, keepdims=True) + 0.25 * pixels


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("hue", [0.0, 10.0, 60.0, 120.0, 200.0, 285.0, 352.0])
def test_a_column_of_any_hue_is_found_with_its_edges(name, hue):
    picture = noisy(with_column(grays(name), 401.3, 427.8, hue), 3.0)
    (box,) = detect_columns(picture, ColumnColour(hue=hue))
    np.testing.assert_allclose([box.p1[0], box.p2[0]], [401.3, 427.8], atol=0.8)
    assert box.p1[1] == box.p2[1] == MIDDLE
    np.testing.assert_allclose([box.left, box.right], [401.3, 427.8], atol=3.0)
    np.testing.assert_allclose([box.top, box.bottom], [40, 439], atol=12.0)


@settings(deadline=None, max_examples=40)
@given(st.floats(40, 780), st.floats(5, 60), st.floats(0, 359))
def test_edges_are_found_to_a_third_of_a_pixel_on_a_plain_wall(left, width, hue):
    wall = np.full((HEIGHT, WIDTH, 3), 170.0)
    picture = noisy(with_column(wall, left, left + width, hue, shaded=False), 2.0)
    (box,) = detect_columns(picture, ColumnColour(hue=hue))
    assert abs(box.p1[0] - left) < 0.35
    assert abs(box.p2[0] - left - width) < 0.35


@pytest.mark.parametrize("hue", [358.0, 0.0, 2.0])
def test_red_is_found_on_both_sides_of_the_end_of_the_circle(hue):
    picture = with_column(grays("coffee"), 300, 320, hue)
    for asked in (350.0, 0.0, 9.0):
        assert len(detect_columns(noisy(picture, 2.0), ColumnColour(hue=asked))) == 1
    for other in (40.0, 180.0, 310.0):
        assert detect_columns(noisy(picture, 2.0), ColumnColour(hue=other)) == ()


@pytest.mark.parametrize("hue", [40.0, 290.0, 320.0])
def test_what_is_nearly_red_is_not_red(hue):
    picture = noisy(with_column(grays("coffee"), 300, 320, hue), 2.0)
    assert detect_columns(picture, ColumnColour(hue=0.0)) == ()
    assert len(detect_columns(picture, ColumnColour(hue=hue))) == 1


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("noise", [0.0, 8.0])
def test_a_picture_without_a_column_has_none(name, noise):
    picture = noisy(grays(name), noise)
    for hue in range(0, 360, 45):
        assert detect_columns(picture, ColumnColour(hue=hue)) == ()


def test_several_columns_come_from_left_to_right():
    picture = with_column(grays("astronaut"), 600, 630, 120)
    picture = with_column(with_column(picture, 100, 112, 120), 350, 380, 280)
    boxes = detect_columns(noisy(picture, 3.0), [ColumnColour(hue=120), ColumnColour(hue=280)])
    np.testing.assert_allclose([b.p1[0] for b in boxes], [100, 350, 600], atol=1.0)


def test_two_columns_close_together_stay_two():
    picture = with_column(with_column(grays("coffee"), 300, 320, 120), 326, 346, 120)
    boxes = detect_columns(noisy(picture, 2.0), ColumnColour(hue=120))
    np.testing.assert_allclose([b.p1[0] for b in boxes], [300, 326], atol=1.5)


@pytest.mark.parametrize(("left", "right"), [(-20.0, 15.0), (830.0, 880.0), (-10.0, 900.0)])
def test_a_column_that_leaves_the_picture_is_clipped_to_it(left, right):
    (box,) = detect_columns(
        noisy(with_column(grays("chelsea"), left, right, 240, 0, HEIGHT), 2.0), ColumnColour(hue=240)
    )
    assert bool(box.left == box.p1[0] == 0.0) is (left < 0)
    assert bool(box.right == box.p2[0] == WIDTH - 1) is (right > WIDTH)
    if left > 0:
        assert abs(box.p1[0] - left) < 1.5
    if right < WIDTH:
        assert abs(box.p2[0] - right) < 1.5


def test_a_column_outside_the_picture_is_not_seen():
    assert detect_columns(noisy(with_column(grays("coffee"), 900, 940, 0), 2.0), ColumnColour()) == ()


@pytest.mark.parametrize(
    ("left", "right", "top", "bottom"),
    [
        (100, 700, 220, 260),  # a bar
        (300, 520, 150, 330),  # a picture on the wall
        (400, 430, 200, 300),  # too short
        (400, 430, 10, 170),  # hangs high
        (400, 430, 320, 480),  # stands low
    ],
)
def test_what_does_not_stand_tall_at_mid_height_is_no_column(left, right, top, bottom):
    picture = with_column(grays("astronaut"), left, right, 0, top, bottom)
    assert detect_columns(noisy(picture, 3.0), ColumnColour()) == ()


@pytest.mark.parametrize(
    "patch",
    [(0, 855, 100, 130), (350, 400, 60, 120), (425, 520, 300, 400)],
    ids=["a bar across", "a patch on its left", "a patch on its right"],
)
def test_a_patch_of_its_colour_that_touches_a_column_does_not_widen_it(patch):
    left, right, top, bottom = patch
    picture = with_column(grays("coffee"), left, right, 0, top, bottom, shaded=False)
    picture = with_column(picture, 400, 425, 0, 20, 470)
    (box,) = detect_columns(noisy(picture, 3.0), ColumnColour())
    np.testing.assert_allclose([box.p1[0], box.p2[0]], [400, 425], atol=1.0)
    np.testing.assert_allclose([box.left, box.right], [400, 425], atol=12.0)


@pytest.mark.parametrize("lean", [-0.15, -0.05, 0.05, 0.15])
def test_a_column_seen_by_a_rolled_camera_has_its_edges_at_mid_height(lean):
    picture = noisy(with_column(grays("astronaut"), 400, 424, 200, lean=lean), 3.0)
    (box,) = detect_columns(picture, ColumnColour(hue=200))
    np.testing.assert_allclose([box.p1[0], box.p2[0]], [400, 424], atol=1.0)
    assert box.left < 400 - 0.7 * abs(lean) * 200
    assert box.right > 424 + 0.7 * abs(lean) * 200


def test_a_bar_that_leans_too_much_is_no_column():
    assert (
        detect_columns(noisy(with_column(grays("coffee"), 400, 440, 0, lean=0.6), 2.0), ColumnColour()) == ()
    )


@pytest.mark.parametrize("noise", [0.0, 5.0, 12.0])
@pytest.mark.parametrize("value", [0.35, 0.6, 1.0])
def test_light_and_noise_do_not_hide_a_column(noise, value):
    picture = noisy(with_column(grays("chelsea"), 400, 416, 20, value=value), noise)
    (box,) = detect_columns(picture, ColumnColour(hue=20))
    np.testing.assert_allclose([box.p1[0], box.p2[0]], [400, 416], atol=1.2)


def test_a_thin_far_column_is_found():
    (box,) = detect_columns(noisy(with_column(grays("rocket"), 300.0, 304.0, 0), 3.0), ColumnColour())
    assert abs(box.p2[0] - box.p1[0] - 4.0) < 1.0


def test_the_same_picture_gives_the_same_boxes():
    picture = noisy(with_column(photograph("astronaut"), 300, 340, 120), 5.0)
    once, again = (detect_columns(picture, ColumnColour(hue=120)) for _ in range(2))
    assert len(once) == 1
    assert repr(once) == repr(again)


def test_no_colours_means_no_columns():
    assert detect_columns(photograph("coffee"), ()) == ()


@pytest.mark.parametrize("size", [(240, 320), (481, 641), (720, 1280)])
def test_pictures_of_other_sizes_work(size):
    height, width = size
    wall = np.full((height, width, 3), 160, dtype=np.uint8)
    wall[20 : height - 20, 100:130] = (200, 30, 30)
    (box,) = detect_columns(wall, ColumnColour())
    np.testing.assert_allclose([box.p1[0], box.p2[0]], [99.5, 129.5], atol=0.6)
    assert box.p1[1] == (height - 1) / 2


@pytest.mark.parametrize(
    "wrong", [{"hue": 360.0}, {"hue": -1.0}, {"tolerance": 0.0}, {"min_height": 2.0}, {"x": 1}]
)
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        ColumnColour(**wrong)
