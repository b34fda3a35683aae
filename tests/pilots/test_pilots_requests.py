"""When the worker beside the loop is asked to match which key image."""

import numpy as np
from pilots_pictures import DT, Watcher, path_of, picture_of

from noctule.messages import MatchResult

NONE = np.empty((0, 2))


def test_at_most_one_request_is_under_way():
    w = Watcher(path_of("astronaut", "coffee"))
    w.show(picture_of("astronaut"))
    assert w.ask(0, 1) == [0]
    for _ in range(40):
        w.show(picture_of("astronaut"))
        assert w.ask(0, 1) == []
    w.show(picture_of("astronaut"), MatchResult(DT, 0, NONE, NONE, "nothing"))
    assert len(w.ask(0, 1)) == 1


def test_an_answer_that_never_comes_does_not_keep_it_from_asking_again():
    w = Watcher(path_of("astronaut"))
    w.show(picture_of("astronaut"))
    assert w.ask() == [0]
    w.tick += round(1.9 / DT)
    assert w.ask() == []
    w.tick += round(0.2 / DT)
    assert w.ask() == [0]


def test_an_answer_in_a_tick_without_a_picture_waits_for_the_next_one():
    w = Watcher(path_of("astronaut"))
    w.show(picture_of("astronaut"))
    w.ask()
    w.tick += 30
    w.show(None, MatchResult(DT, 0, NONE, NONE, "nothing"))
    assert (
        w.ask() == []
    )  # it is still under way: asked again here, the answers could go on missing each other
    w.show(picture_of("astronaut"))
    assert w.perception.reasons[0] == "nothing"
    assert w.ask() == [0]


def test_an_answer_that_never_comes_is_asked_for_again():
    w = Watcher(path_of("astronaut"))
    w.show(picture_of("astronaut"))
    assert w.ask() == [0]
    w.tick += round(1.9 / DT)
    w.show(picture_of("astronaut"))
    assert w.ask() == []
    w.tick += round(0.2 / DT)
    w.show(picture_of("astronaut"))
    assert w.ask() == [0]


def test_nothing_is_asked_before_the_first_picture():
    w = Watcher(path_of("astronaut"))
    w.show(None)
    assert w.ask() == []


def answered(w, index, seconds):
    """Let the request under way fail, and time go by."""
    stamp = next(s for s, i in w.perception._pending if i == index)
    w.tick += round(seconds / DT) - 1
    w.show(picture_of("astronaut"), MatchResult(stamp, index, NONE, NONE, "nothing"))


def test_a_missing_image_is_asked_for_again_soon_but_not_at_once():
    w = Watcher(path_of("astronaut"))
    w.show(picture_of("astronaut"))
    assert w.ask() == [0]
    answered(w, 0, 0.1)
    assert w.ask() == []
    w.tick += 7
    assert w.ask() == [0]


def test_a_strong_image_is_asked_for_now_and_then():
    w = Watcher(path_of("astronaut"), rematch_s=1.0)
    w.begin(picture_of("astronaut"))
    w.tick += 15
    w.show(picture_of("astronaut"))
    assert w.ask() == []
    w.tick += 15
    w.show(picture_of("astronaut"))
    assert w.ask() == [0]


def test_the_following_image_is_asked_for_when_it_is_wanted():
    w = Watcher(path_of("astronaut", "coffee"))
    w.begin(picture_of("astronaut"))
    assert w.ask(0, None) == []
    assert w.ask(0, 1) == [1]


def test_the_weaker_image_comes_before_the_periodic_match():
    w = Watcher(path_of("astronaut", "coffee"))
    w.begin(picture_of("astronaut"))
    w.tick += 60
    w.show(picture_of("astronaut"))
    assert w.ask(0, 1) == [1]  # the first image is strong, though its turn has come too


def test_when_lost_the_images_searched_for_are_asked_for_in_turn():
    w = Watcher(path_of("astronaut", "coffee", "chelsea"))
    w.show(picture_of("astronaut"))
    asked = []
    for _ in range(6):
        asked += w.ask(1, search=[1, 2, 0])
        answered(w, asked[-1], 0.1)
    assert asked == [1, 2, 0, 1, 2, 0]
