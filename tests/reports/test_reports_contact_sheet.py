"""The contact sheet: every key image is in it, and the weakest link is marked."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle

from noctule.camera import CameraMount, PinholeCamera
from noctule.pilots.visual_path import KeyImage, KeyLink, VisualPath
from noctule.reports import ReportWriteError
from noctule.reports.contact_sheet import contact_sheet, weakest_link, write_contact_sheet
from noctule.reports.style import FORWARD, WARN, house_style
from noctule.vision.features import Features
from noctule.vision.links import LinkQuality

LINK = LinkQuality(100, 18, 30.0, 0.9, 0.3, 0.2, 0.1, True)
NOTHING = Features(np.empty((0, 2)), np.empty((0, 128), dtype=np.float32), "sift")


def path_of(count: int) -> VisualPath:
    pictures = [np.full((48, 86, 3), 5 * i + 40, dtype=np.uint8) for i in range(count)]
    images = tuple(KeyImage(f"{i:03d}.png", p, NOTHING) for i, p in enumerate(pictures))
    empty = KeyLink(np.empty((0, 2)), np.empty((0, 2)))
    return VisualPath(PinholeCamera.centred(86, 48, 50.0), CameraMount(), images, (empty,) * (count - 1))


def links_of(*shared: int) -> list[LinkQuality]:
    return [replace(LINK, shared=n) for n in shared]


def texts(figure) -> list[str]:
    return [t.get_text() for axis in figure.axes for t in axis.texts]


def bars(figure) -> list[tuple[float, str]]:
    """Width and colour of the bars, without their ground."""
    found = [[p for p in axis.patches if isinstance(p, Rectangle)] for axis in figure.axes]
    return [(patches[1].get_width(), to_hex(patches[1].get_facecolor())) for patches in found if patches]


@pytest.mark.parametrize("count", [1, 2, 4, 9, 15, 35])
def test_every_key_image_is_there_with_its_number(count):
    with house_style():
        figure = contact_sheet(path_of(count), links_of(*[50] * (count - 1)), "walk")
    pictures = [axis for axis in figure.axes if axis.images]
    assert len(pictures) == count
    assert [axis.texts[0].get_text() for axis in pictures] == [str(i) for i in range(count)]
    boxes = [axis.get_position() for axis in pictures]
    assert all(0.0 <= b.x0 < b.x1 <= 1.0 and 0.0 <= b.y0 < b.y1 <= 1.0 for b in boxes)
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_bars_show_what_neighbours_share_and_the_weakest_is_red():
    figure = contact_sheet(path_of(4), links_of(200, 50, 100), "walk")
    widths, colours = zip(*bars(figure), strict=True)
    assert widths == pytest.approx((1.0, 0.25, 0.5))
    assert colours == tuple(c.lower() for c in (FORWARD, WARN, FORWARD))
    assert "to 2: 50, weakest" in texts(figure)
    assert sum("weakest" in text for text in texts(figure)) == 1


def test_links_that_cannot_be_flown_are_red_and_say_so():
    figure = contact_sheet(path_of(4), links_of(0, 50, 100), "walk", faulty=[0, 2])
    assert [colour for _, colour in bars(figure)] == [c.lower() for c in (WARN, FORWARD, WARN)]
    assert "to 1: 0, refused" in texts(figure)
    assert "to 3: 100, refused" in texts(figure)


def test_no_words_run_into_the_next_picture():
    with house_style():
        figure = contact_sheet(path_of(35), links_of(*[888] * 34), "walk", faulty=range(34))
    figure.canvas.draw()
    for axis in figure.axes:
        for text in axis.texts:
            assert text.get_window_extent().x1 <= axis.get_window_extent().x1


def test_the_weakest_link_is_the_first_of_those_that_share_least():
    assert weakest_link(links_of(9, 7, 8, 7)) == 1
    assert weakest_link([]) is None


def test_the_same_path_gives_the_same_file(tmp_path):
    path, links = path_of(3), links_of(60, 70)
    a = write_contact_sheet(path, links, "walk", tmp_path / "a.png")
    b = write_contact_sheet(path, links, "walk", tmp_path / "b.png")
    assert a.read_bytes() == b.read_bytes()
    assert cv2.imread(str(a)).shape[1] == 1350


def test_a_place_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ReportWriteError, match="cannot be written"):
        write_contact_sheet(path_of(2), links_of(60), "walk", tmp_path / "file" / "a.png")
