"""A person flies by keys, and what was seen on the way becomes a path."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from flight_fakes import FakeWorld

from noctule.camera import CameraMount, PinholeCamera
from noctule.devices.protocols import StaleFrameError
from noctule.flight.hand_chooser import ASKED, HandChooser, Reach, Shared, reach_of, worth_keeping
from noctule.flight.hand_controls import Bumper
from noctule.flight.key_script import INTERRUPT, KeyScript, read_key_script
from noctule.flight.mission import load_mission
from noctule.flight.path_check import check_folder
from noctule.flight.path_folder import load_path, load_truth
from noctule.flight.teach_by_hand import Ending, fly_by_hand, teach_by_hand
from noctule.flight.teach_video import PathExistsError, TeachInputError
from noctule.geometry import rot_y
from noctule.messages import Limits, Picture
from noctule.vision.key_images import Choice, Frame, KeyFrame, KeyImageWalk
from noctule.vision.links import LinkQuality

CAMERA = PinholeCamera.centred(320, 240, 200.0)
DT = 1.0 / 30.0


def wall() -> np.ndarray:
    rng = np.random.default_rng(1)
    pixels = np.full((500, 2400, 3), 90, dtype=np.uint8)
    for _ in range(3200):
        centre = tuple(int(v) for v in rng.integers(0, (2400, 500)))
        colour = tuple(int(v) for v in rng.integers(0, 255, 3))
        cv2.circle(pixels, centre, int(rng.integers(2, 12)), colour, -1, cv2.LINE_AA)
    return pixels


WALL = wall()
ON_WALL = np.array([[200.0, 0.0, 1200.0], [0.0, 200.0, 250.0], [0.0, 0.0, 1.0]])


class TurningCamera:
    """Sees a wall far away, ten times a second, a tick late: only turning the vehicle changes the picture."""

    intrinsics, live = CAMERA, True

    def __init__(self, world: FakeWorld, stabilised: bool = True) -> None:
        self.world, self.mount = world, CameraMount(stabilised=stabilised)
        self.pictures: list[Picture] = []
        self.broken_after = np.inf

    def latest(self, max_age: float) -> Picture:
        now = self.world.clock.now()
        if now < 1.5 * DT:
            raise StaleFrameError("turning camera: nothing yet")
        if now > self.broken_after:
            raise RuntimeError("turning camera: broken")
        if not self.pictures or now - self.pictures[-1].stamp > 0.1:
            H = CAMERA.K @ rot_y(self.world.vehicle.yaw) @ np.linalg.inv(ON_WALL)
            self.pictures.append(Picture(now, cv2.warpPerspective(WALL, H, (320, 240))))
        return self.pictures[-1]


@pytest.fixture(autouse=True)
def _the_choice_keeps_up(monkeypatch):
    """So that what a person is told is the same in every run of a flight that is faster than real time."""
    monkeypatch.setattr("noctule.flight.hand_chooser._BACKLOG", 0)


class Hand:
    """A flight by hand in a world where nothing but turning matters."""

    def __init__(self, automatic: bool = True, stabilised: bool = True) -> None:
        self.world = FakeWorld()
        self.world.rig = type(self.world.rig)(
            self.world.clock,
            self.world.vehicle,
            TurningCamera(self.world, stabilised),
            self.world.referee,
        )
        self.walk = KeyImageWalk(CAMERA, Choice(window=0.2, gaps=False), automatic=automatic)
        self.statuses = []

    def fly(self, *presses, pressed=None):
        bumper = Bumper(lambda pose: (), 0.3, Limits(), DT)
        keys = pressed or KeyScript(presses)
        return fly_by_hand(self.world.rig, self.walk, bumper, keys, self.statuses.append)

    def news(self) -> list[str]:
        """What the person was told, each once."""
        heard = [status.shared.news for status in self.statuses]
        return [news for news, before in zip(heard, ["", *heard], strict=False) if news != before]


def held(key: str, begin: float, seconds: float):
    return [(begin + i * DT, key) for i in range(round(seconds / DT))]


def test_key_images_are_taken_while_one_turns():
    hand = Hand()
    flown = hand.fly(*held("q", 0.5, 2.0), (4.0, "\n"))
    reasons = [key.reason for key in flown.keys]
    assert reasons[0] == "first"
    assert reasons[-1] == "last"
    assert 4 <= len(reasons) <= 7
    assert flown.ending is Ending.FINISHED
    assert flown.error is None
    turns = [np.degrees(key.link.yaw) for key in flown.keys[1:]]
    assert sum(turns) == pytest.approx(np.degrees(hand.world.vehicle.yaw), abs=1.5)


def test_only_a_person_takes_them_where_asked_so():
    flown = Hand(automatic=False).fly(
        (0.5, " "), *held("q", 0.6, 0.5), (2.0, " "), *held("q", 2.1, 0.5), (4.0, "\n")
    )
    assert [key.reason for key in flown.keys] == [ASKED, ASKED]


def test_undo_forgets_the_last_image_and_it_can_be_taken_again():
    hand = Hand(automatic=False)
    flown = hand.fly(
        (0.5, " "), *held("q", 0.6, 0.5), (2.0, " "), (2.1, "u"), *held("q", 2.2, 0.3), (3.5, " ")
    )
    assert [key.reason for key in flown.keys] == [ASKED, ASKED]
    assert flown.keys[1].frame.stamp > 3.0
    assert hand.news() == ["image 0 taken", "image 1 taken", "image 1 undone", "image 1 taken"]


def test_hover_stops_a_turn_at_once_within_the_acceleration():
    turned = []
    for presses in ([], [(1.0, "x")]):
        hand = Hand()
        hand.fly(*held("q", 0.5, 0.5), *presses, (2.5, "\x1b"))
        turned.append(hand.world.vehicle.yaw)
    assert 0.1 < turned[1] < turned[0] - 0.02


def test_enter_does_not_end_a_flight_that_took_no_path():
    hand = Hand()
    flown = hand.fly((0.5, "\n"), *held("q", 0.6, 1.0), (3.0, "\n"))
    assert flown.ending is Ending.FINISHED
    assert len(flown.keys) >= 2
    assert "no path yet: take an image (space), or leave (esc)" in hand.news()


@pytest.mark.parametrize(("key", "ending"), [("\x1b", Ending.LEFT), (INTERRUPT, Ending.INTERRUPTED)])
def test_who_leaves_keeps_what_was_taken_and_no_more(key, ending):
    flown = Hand().fly(*held("q", 0.5, 1.0), (3.0, key), (3.0, " "))
    assert flown.ending is ending
    assert [k.reason for k in flown.keys][:2] == ["first", "enough motion"]
    assert "last" not in [k.reason for k in flown.keys]
    assert flown.presses[-1][1] == key


@pytest.mark.parametrize("error", [RuntimeError("turning camera: broken"), KeyboardInterrupt()])
def test_an_error_ends_the_flight_and_what_was_taken_is_safe(error):
    hand = Hand()
    script = KeyScript(held("q", 0.5, 2.0))

    def pressed(stamp: float) -> list[str]:
        if stamp > 2.0 and isinstance(error, KeyboardInterrupt):
            raise error
        return script(stamp)

    if isinstance(error, RuntimeError):
        hand.world.rig.camera.broken_after = 2.0
    flown = hand.fly(pressed=pressed)
    assert len(flown.keys) >= 2
    assert repr(flown.error) == repr(error)


def test_an_error_of_the_choice_ends_the_flight_too():
    hand = Hand()
    hand.walk.look = lambda frame: 1 / 0
    assert isinstance(hand.fly((9.0, "\n")).error, ZeroDivisionError)


def test_the_same_keys_give_the_same_flight():
    presses = [*held("q", 0.5, 1.0), (2.0, " "), *held("e", 2.2, 1.0), (3.0, "u"), (5.0, "\n")]
    flown = [Hand().fly(*presses) for _ in range(2)]
    first, second = ([(k.index, k.reason, k.link) for k in f.keys] for f in flown)
    assert first == second
    assert flown[0].presses == flown[1].presses
    assert all(
        np.array_equal(a.frame.pixels, b.frame.pixels)
        for a, b in zip(flown[0].keys, flown[1].keys, strict=True)
    )


def test_what_was_pressed_is_kept_with_the_tick_at_which_it_came():
    flown = Hand().fly((0.501, "w"), (0.52, "w"), (1.0, "\x1b"))
    assert flown.presses == ((16 * DT, "w"), (16 * DT, "w"), (30 * DT, "\x1b"))


def test_an_image_is_where_the_vehicle_was_when_it_was_exposed():
    flown = Hand(automatic=False).fly(*held("q", 0.5, 2.0), (1.5, " "), (3.0, "\n"))
    (key,) = flown.keys
    seen = flown.truths[key.frame.stamp].yaw
    H = CAMERA.K @ rot_y(seen) @ np.linalg.inv(ON_WALL)
    np.testing.assert_array_equal(key.frame.pixels, cv2.warpPerspective(WALL, H, (320, 240)))


def test_a_camera_off_its_gimbal_keeps_the_attitude_that_was_reported():
    for stabilised, expected in ((True, (0.0, 0.0)), (False, (0.03, -0.02))):
        hand = Hand(stabilised=stabilised)
        reported = hand.world.vehicle.state

        def tilted(reported=reported):
            from dataclasses import replace

            return replace(reported(), roll=0.03, pitch=-0.02)

        hand.world.vehicle.state = tilted
        assert hand.fly((0.5, " "), (1.0, "\x1b")).keys[0].frame.attitude == expected


def test_a_person_is_warned_before_it_is_too_late():
    hand = Hand(automatic=False)
    hand.fly((0.5, " "), *held("q", 0.6, 3.0), (5.0, "\x1b"))
    reaches = [status.shared.reach for status in hand.statuses]
    assert reaches[0] is Reach.GOOD
    assert reaches == sorted(reaches, reverse=True)
    assert set(reaches) == {Reach.GOOD, Reach.SOON, Reach.LOST}
    warned = hand.statuses[reaches.index(Reach.SOON)]
    lost = hand.statuses[reaches.index(Reach.LOST)]
    assert np.degrees(warned.pose.yaw) < 40.0
    assert lost.stamp - warned.stamp > 0.2


def test_an_image_that_cannot_be_reached_is_taken_and_said_so():
    hand = Hand(automatic=False)
    hand.fly((0.5, " "), *held("q", 0.6, 3.0), (5.0, " "), (5.5, "\n"))
    (told,) = [news for news in hand.news() if "not to be reached" in news]
    assert told.startswith("image 1 taken, but not to be reached (u undoes it): they share ")


def test_what_is_in_the_way_is_shown():
    hand = Hand()
    hand.world.referee.wall_x = 0.1
    hand.fly(*held("w", 0.5, 2.0), (3.0, "\x1b"))
    assert hand.statuses[0].stopped_by == ()
    assert hand.statuses[-1].stopped_by == ("column_0",)


LINK = LinkQuality(shared=200, cells=20, displacement=20.0, share=0.9, baseline=0.2, conditioned=True)


def changed(**fields) -> LinkQuality:
    from dataclasses import replace

    return replace(LINK, **fields)


@pytest.mark.parametrize(
    ("link", "reach"),
    [
        (LINK, Reach.GOOD),
        (changed(shared=39), Reach.SOON),
        (changed(shared=15), Reach.LOST),
        (changed(cells=7), Reach.SOON),
        (changed(cells=4), Reach.LOST),
        (changed(baseline=0.5), Reach.SOON),
        (changed(baseline=0.71), Reach.LOST),
        (changed(yaw=-0.5), Reach.SOON),
        (changed(yaw=0.7), Reach.LOST),
        (changed(conditioned=False), Reach.LOST),
    ],
)
def test_reach_is_judged_as_the_check_does_with_a_warning_before(link, reach):
    assert reach_of(link) is reach
    assert Shared(1, link).reach is reach


def test_before_anything_was_compared_nothing_is_warned_of():
    assert Shared().reach is Reach.GOOD


def test_a_chooser_tells_what_it_cannot_do():
    chooser = HandChooser(KeyImageWalk(CAMERA, automatic=False))
    chooser.undo()
    assert chooser.finish(True) is False
    assert chooser.shared().news == "no path yet: take an image (space), or leave (esc)"
    chooser.take()
    assert chooser.finish(False) is False
    assert chooser.close() == ()


def test_one_image_is_a_path_only_where_a_person_took_it():
    frame = Frame(0.0, np.zeros((2, 2, 3), dtype=np.uint8))
    first, asked = KeyFrame(0, frame, "first"), KeyFrame(0, frame, ASKED)
    assert [worth_keeping(keys) for keys in ([], [first], [asked], [first, first])] == [
        False,
        False,
        True,
        True,
    ]


SCRIPT = [
    (0.5, " "),
    *held("w", 0.6, 1.5),
    (3.5, " "),
    *held("w", 3.6, 1.5),
    *held("q", 5.3, 0.3),
    (7.0, " "),
]


def small_mission():
    mission = load_mission("two-columns")
    camera = mission.camera.model_copy(update={"width": 428, "height": 240, "focal": 255.0})
    return mission.model_copy(update={"camera": camera})


@pytest.fixture(scope="module")
def taught(tmp_path_factory):
    """A path of three images, flown by a script in the simulated room."""
    folder = tmp_path_factory.mktemp("by-hand") / "path"
    return folder, *teach_by_hand(small_mission(), 3, folder, KeyScript(SCRIPT), automatic=False)


def test_a_path_of_three_images_taught_by_keys_can_be_repeated(taught):
    folder, taken, ending = taught
    assert [one.reason for one in taken] == [ASKED] * 3
    assert ending is Ending.FINISHED
    assert check_folder(folder, small_mission()) == []


def test_its_columns_were_absent_and_the_truth_is_kept_for_the_judge(taught):
    truth = load_truth(taught[0])
    x = [pose.position[0] for pose in truth]
    assert x[1] - x[0] == pytest.approx(0.6, abs=0.1)
    assert x[2] > 0.9  # where the mission's first column stands
    assert truth[2].yaw > truth[1].yaw + 0.1


def test_the_keys_are_kept_and_give_the_same_path_however_late_the_choice_is(taught, tmp_path, monkeypatch):
    monkeypatch.setattr("noctule.flight.hand_chooser._BACKLOG", 4)
    folder, taken, _ = taught
    keys = KeyScript(read_key_script(folder / "keys.txt"))
    again = teach_by_hand(small_mission(), 3, tmp_path / "again", keys, automatic=False)
    assert again == (taken, Ending.FINISHED)
    assert (tmp_path / "again" / "path.toml").read_text() == (folder / "path.toml").read_text()
    assert (tmp_path / "again" / "truth.toml").read_text() == (folder / "truth.toml").read_text()


def test_a_path_is_not_overwritten(taught):
    folder = taught[0]
    with pytest.raises(PathExistsError) as caught:
        teach_by_hand(small_mission(), 3, folder, KeyScript(SCRIPT))
    assert str(caught.value) == (
        f"path {folder}: this folder is not empty, and teaching overwrites nothing; choose another --out or "
        "remove it"
    )


def test_where_nothing_was_taken_nothing_is_written(tmp_path):
    with pytest.raises(TeachInputError) as caught:
        teach_by_hand(small_mission(), 3, tmp_path / "none", KeyScript([(0.2, "\x1b")]))
    assert str(caught.value) == (
        "teaching: left before an image was taken on the way, so nothing was written; fly farther, or press "
        "space"
    )
    assert not (tmp_path / "none").exists()


def test_what_was_taken_is_written_before_an_error_is_raised(tmp_path):
    script = KeyScript([(0.3, " ")])

    def pressed(stamp: float) -> list[str]:
        if stamp > 0.6:
            raise KeyboardInterrupt
        return script(stamp)

    with pytest.raises(KeyboardInterrupt):
        teach_by_hand(small_mission(), 3, tmp_path / "kept", pressed, automatic=False)
    assert len(load_path(tmp_path / "kept").images) == 1
