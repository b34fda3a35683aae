"""The background: learned from valid readings, refused where something moved, and whether it still fits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pydantic import ValidationError
from vision_depth_rooms import GLOSS, HEIGHT, TABLE, WIDTH, U, V, frames, room, sensed, with_box

from noctule.vision.depth import (
    BackgroundSettings,
    DepthFormatError,
    EmptyBackgroundError,
    MovingBackgroundError,
    TooFewFramesError,
    fits,
    learn_background,
)

EDGES = np.zeros((HEIGHT, WIDTH), dtype=bool)
EDGES[38:92, 148:212] = True
EDGES[TABLE] = False


@pytest.fixture(scope="module")
def background():
    return learn_background(frames(60, np.random.default_rng(1)))


def test_the_mean_is_of_the_valid_readings_only(background):
    known = background.count > 30
    # Readings come in steps, so the mean of the room is exact only to a fraction of a step.
    assert abs((background.mean - room())[known]).max() < 20.0
    assert background.mean[TABLE].mean() == pytest.approx(2500.0, abs=3.0)
    assert background.frames == 60
    assert background.count.max() <= 60


def test_mean_and_deviation_agree_with_numpy_on_the_valid_readings():
    stack = np.stack(list(frames(40, np.random.default_rng(5))))
    learned = learn_background(stack, BackgroundSettings(step_at_1m=0.0))
    masked = np.ma.masked_equal(stack, 0)
    often = learned.count > 5
    np.testing.assert_array_equal(learned.count, (stack > 0).sum(axis=0))
    np.testing.assert_allclose(learned.mean[often], masked.mean(axis=0)[often], rtol=1e-6)
    spread = np.maximum(masked.std(axis=0, ddof=1), 1.0)
    np.testing.assert_allclose(learned.deviation[often], spread[often], rtol=1e-4)


def test_the_deviation_is_never_less_than_half_the_sensor_s_step(background):
    floor = 0.5 * 2.85 * (1e-3 * background.mean) ** 2
    assert (background.deviation >= floor * (1.0 - 1e-5)).all()
    still = learn_background([np.full((40, 50), 3000, dtype=np.uint16)] * 20)
    np.testing.assert_allclose(still.deviation, 0.5 * 2.85 * 9.0, rtol=1e-5)
    assert (still.nearest == np.ceil(3000 - 4 * 0.5 * 2.85 * 9.0)).all()


def test_the_empty_room_has_next_to_no_foreground(background):
    rng = np.random.default_rng(2)
    share = np.mean([background.foreground(sensed(room(), rng)).mean() for _ in range(20)])
    assert share < 2e-4


def test_a_thing_that_stands_before_the_floor_is_foreground_and_its_surroundings_are_not(background):
    rng = np.random.default_rng(3)
    depth = sensed(with_box(room(), 20, 20, 30, 30, 2200.0), rng)
    foreground = background.foreground(depth)
    inside = np.zeros_like(foreground)
    inside[20:50, 20:50] = True
    assert foreground[inside & (depth > 0)].all()
    assert foreground[~inside].mean() < 2e-4


@settings(deadline=None, max_examples=30)
@given(
    hnp.arrays(
        np.uint16, (HEIGHT, WIDTH), elements=st.sampled_from([0, 1, 900, 3300, 65535]), fill=st.just(0)
    )
)
def test_a_pixel_without_a_reading_is_never_foreground(depth):
    background = learn_background([np.full((HEIGHT, WIDTH), 3000, dtype=np.uint16)] * 10)
    foreground = background.foreground(depth)
    assert not foreground[depth == 0].any()
    assert foreground[(depth > 0) & (depth < 2900)].all()
    assert not foreground[depth >= 3000].any()


def test_a_drone_over_a_hole_of_the_floor_is_seen_whole(background):
    assert (background.count[GLOSS] < 0.2 * background.frames).mean() > 0.9
    rng = np.random.default_rng(4)
    depth = sensed(with_box(room(), 50, 110, 50, 50, 2400.0), rng)
    seen = background.foreground(depth)[110:160, 50:100]
    assert seen.mean() > 0.98
    # While the floor that shines through the hole at times stays background.
    flicker = np.mean(
        [background.foreground(sensed(room(), rng, gloss=0.5))[GLOSS].mean() for _ in range(10)]
    )
    assert flicker < 1e-3


def test_an_unknown_pixel_takes_the_nearest_threshold_beside_it():
    empty = np.full((60, 60), 3000, dtype=np.uint16)
    empty[:, 30:] = 2000
    empty[20:40, 20:40] = 0  # a hole between a floor and a table
    background = learn_background([empty] * 12)
    floor, table = int(background.nearest[0, 0]), int(background.nearest[0, 59])
    assert background.nearest[30, 20] == floor
    assert background.nearest[30, 39] == table
    assert set(np.unique(background.nearest)) == {floor, table}
    assert (background.count[20:40, 20:40] == 0).all()


def test_an_edge_that_flickers_between_two_depths_does_not_hide_a_drone_above_it():
    rng = np.random.default_rng(6)

    def scene(k):
        z = room()
        edge = EDGES & (rng.random(z.shape) < 0.4)
        z[edge] = 2500.0
        return z

    background = learn_background(frames(80, rng, scene))
    wide = EDGES & (background.deviation > 100.0)
    assert wide.sum() > 200
    # Four deviations would reach up to 1.6 m above the table; nothing ever came nearer than the table.
    assert (background.nearest[wide] > 2300).mean() > 0.99


def test_a_single_false_reading_does_not_make_a_pixel_blind():
    stack = np.full((100, 40, 40), 3000, dtype=np.uint16)
    stack[50, 20, 20] = 600
    background = learn_background(stack)
    assert background.nearest[20, 20] > 1900


@pytest.mark.parametrize("seed", range(4))
def test_noise_and_flickering_holes_are_not_motion(seed):
    rng = np.random.default_rng(seed)

    def scene(k):
        z = room()
        flicker = EDGES & (rng.random(z.shape) < 0.5)
        z[flicker] = 2500.0
        return z

    assert learn_background(frames(40, rng, scene)).frames == 40


def test_a_surface_that_never_reads_the_same_is_not_motion_and_is_trusted_little():
    rng = np.random.default_rng(7)

    def scene(k):
        z = room()
        z[10:30, 10:40] += rng.uniform(-600.0, 600.0, (20, 30))
        return z

    background = learn_background(frames(60, rng, scene))
    assert np.median(background.deviation[10:30, 10:40]) > 250.0


def walker(k):
    return with_box(room(), 10 + 3 * k, 60, 24, 40, 1700.0) if 10 <= k < 30 else room()


def leaver(k):
    return with_box(room(), 20, 30, 24, 24, 2900.0) if k < 20 else room()


def early_leaver(k):
    return with_box(room(), 20, 30, 24, 24, 2900.0) if k < 5 else room()


def knocked(k):
    return room() if k < 25 else room() + 150.0


@pytest.mark.parametrize(
    ("scene", "first", "last", "columns", "rows"),
    [
        (walker, 10, 29, (40, 120), (60, 99)),
        (leaver, 20, 39, (20, 43), (30, 53)),
        (early_leaver, 0, 4, (20, 43), (30, 53)),
        (knocked, 25, 39, (0, 255), (0, 191)),
    ],
)
def test_a_room_in_which_something_moved_is_refused_and_it_says_where_and_when(
    scene, first, last, columns, rows
):
    with pytest.raises(MovingBackgroundError) as caught:
        learn_background(frames(40, np.random.default_rng(8), scene))
    error = caught.value
    left, top, right, bottom = error.box
    assert (error.moved[0], error.moved[-1]) == (first, last)
    assert abs(top - rows[0]) <= 4
    assert abs(bottom - rows[1]) <= 4
    assert abs(left - columns[0]) <= 4
    assert abs(right - columns[1]) <= 4
    assert len(error.moved) >= 0.9 * (last - first + 1)


def test_the_refusal_says_what_was_found_and_what_to_do():
    empty = np.full((80, 100), 3000, dtype=np.uint16)
    seen = empty.copy()
    seen[20:40, 30:70] = 1800
    with pytest.raises(MovingBackgroundError) as caught:
        learn_background([empty] * 20 + [seen] * 5)
    assert str(caught.value) == (
        "background: something moved between columns 30 and 69, rows 20 and 39, up to 768 px at once, "
        "in 5 of 25 frames (number 21 to 25); expected an empty room that stands still; leave the camera's "
        "view, stop what moves there, and learn it again"
    )
    assert caught.value.area == 768  # at the corners most of the window is floor


def test_a_single_broken_frame_is_the_sensor_s_fault_and_does_not_enter_the_mean():
    empty = np.full((80, 100), 3000, dtype=np.uint16)
    background = learn_background([empty] * 20 + [empty // 2] + [empty] * 20)
    assert (background.mean[5:-5, 5:-5] == 3000.0).all()
    assert (background.count[5:-5, 5:-5] == 40).all()


def test_too_few_frames_are_refused():
    with pytest.raises(TooFewFramesError) as caught:
        learn_background([np.full((40, 50), 3000, dtype=np.uint16)] * 9)
    assert str(caught.value) == (
        "background: found 9 depth frames, expected at least 10, better 300 (10 s); record for longer, "
        "or check that the camera delivers frames"
    )
    with pytest.raises(TooFewFramesError, match="found 0 depth frames"):
        learn_background([])


def test_a_picture_without_readings_is_refused():
    frame = np.zeros((40, 50), dtype=np.uint16)
    frame[:8] = 3000
    with pytest.raises(EmptyBackgroundError) as caught:
        learn_background([frame] * 12)
    assert str(caught.value) == (
        "background: 20 % of the picture has depth readings, expected at least 30 %; is the sensor's "
        "projector on, and the floor in its range?"
    )


def test_frames_of_another_size_or_unit_are_refused():
    good = np.full((40, 50), 3000, dtype=np.uint16)
    with pytest.raises(DepthFormatError) as caught:
        learn_background([good] * 20 + [np.full((20, 25), 3000, dtype=np.uint16)])
    assert str(caught.value) == (
        "depth frame: found 25x20 of uint16, expected 50x40 of uint16 [mm]; set the camera's resolution and "
        "unit, or learn the background again with `noctule calibrate background`"
    )
    with pytest.raises(DepthFormatError, match=r"found 50x40 of float32, expected 50x40 of uint16 \[mm\]"):
        learn_background([np.full((40, 50), 3.0, dtype=np.float32)] * 20)
    with pytest.raises(DepthFormatError, match="found 50x40x3 of uint16, expected 50x40 of"):
        learn_background([np.full((40, 50, 3), 3, dtype=np.uint16)] * 20)


@pytest.mark.parametrize("field", [{"deviations": 1.0}, {"step_at_1m": -1.0}, {"nonsense": 1.0}])
def test_settings_outside_their_bounds_are_refused(field):
    with pytest.raises(ValidationError):
        BackgroundSettings(**field)


def test_the_empty_room_fits_its_background_in_every_frame(background):
    rng = np.random.default_rng(9)
    assert min(fits(background, sensed(room(), rng)) for _ in range(10)) > 0.98


def test_a_person_in_the_picture_does_not_make_a_background_misfit(background):
    rng = np.random.default_rng(10)
    crowd = with_box(with_box(room(), 0, 0, 140, 110, 1600.0), 180, 100, 60, 90, 1800.0)
    assert background.foreground(sensed(crowd, rng)).mean() > 0.35
    assert fits(background, sensed(crowd, rng)) > 0.98


@pytest.mark.parametrize(
    "seen",
    [
        room() + 40.0,  # the camera sank, or rose, by little more than one step of the sensor
        room() - 40.0,
        room() + 0.5 * (V - HEIGHT / 2),  # it turned by a degree and a half
        room() - 0.5 * (U - WIDTH / 2),
        np.roll(room(), 60, axis=0),
        room() - 800.0,
    ],
)
def test_a_camera_that_moved_no_longer_fits(background, seen):
    assert fits(background, sensed(seen, np.random.default_rng(11))) < 0.6


def test_a_moved_camera_is_found_with_a_person_in_the_picture_too(background):
    seen = with_box(room() + 0.5 * (V - HEIGHT / 2), 60, 20, 60, 150, 1700.0)
    assert fits(background, sensed(seen, np.random.default_rng(12))) < 0.6


def test_nothing_fits_when_nothing_can_be_seen(background):
    assert fits(background, np.zeros((HEIGHT, WIDTH), dtype=np.uint16)) == 0.0
    assert fits(background, np.full((HEIGHT, WIDTH), 900, dtype=np.uint16)) == 0.0


def test_a_frame_of_another_size_cannot_be_compared(background):
    with pytest.raises(DepthFormatError, match="found 320x240 of uint16, expected 256x192"):
        fits(background, np.zeros((240, 320), dtype=np.uint16))
    with pytest.raises(DepthFormatError, match="found 256x192 of float64"):
        background.foreground(room())
