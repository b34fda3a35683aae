"""The state machine of the visual pilot, with a perception and a law that do as they are told."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
from pilots_pictures import path_of, picture_of

from noctule.messages import FlightState, Limits, MatchRequest, Observation, Outcome, Picture, VehicleState
from noctule.pilots import PilotSettings, make_matcher, make_pilot
from noctule.pilots.law import Answer, View
from noctule.pilots.visual import VisualPilot
from noctule.vision.homography import HomographyEstimate

DT = 1.0 / 30.0
LIMITS = Limits()
GRAY = np.full((48, 64, 3), 128, dtype=np.uint8)
FAST = np.array([0.45, -0.2, 0.1, 0.5])


@dataclass
class FakePerception:
    """Sees every image named in `seen`, whatever the picture shows."""

    names: tuple[str, ...] = ("door", "window")
    seen: dict = field(default_factory=dict)
    tracks: dict = field(default_factory=dict)
    reasons: dict = field(default_factory=dict)
    picture_stamp: float = -np.inf
    asked: list = field(default_factory=list)
    wanted: list = field(default_factory=list)

    @property
    def path(self):
        return SimpleNamespace(images=tuple(SimpleNamespace(name=name) for name in self.names))

    def step(self, observation, odometry, wanted):
        self.wanted.append(wanted)
        if observation.picture is None:
            return {}
        self.picture_stamp = observation.picture.stamp
        return dict(self.seen)

    def requests(self, now, current, following, search=()):
        self.asked.append((current, following, list(search)))
        return [MatchRequest(current)]


@dataclass
class FakeLaw:
    """Answers with `command` as long as it is not None."""

    command: np.ndarray | None = None
    target: int = 0
    wants_next: bool = False
    arrived: bool = False
    scenes: list = field(default_factory=list)
    pauses: list = field(default_factory=list)
    jumps: list = field(default_factory=list)

    def step(self, scene):
        self.scenes.append(scene)
        return None if self.command is None else Answer(self.command, activations={"avoidance": 0.25})

    def pause(self, scene):
        self.pauses.append(scene)

    def jump(self, index):
        self.target = index
        self.jumps.append(index)


class Flight:
    """A pilot of fakes, ticked."""

    def __init__(self, names=("door", "window"), **settings):
        self.perception, self.law = FakePerception(names), FakeLaw()
        told = PilotSettings.model_validate({"give_up_s": 2.0, **settings})
        self.pilot = VisualPilot(told, LIMITS, self.perception, self.law, DT)
        self.stamp = 5.0 - DT

    def tick(self, pixels=GRAY, **state):
        self.stamp += DT
        picture = None if pixels is None else Picture(self.stamp, pixels)
        vehicle = VehicleState(self.stamp, FlightState.FLYING, **state)
        return self.pilot.step(Observation(self.stamp, vehicle, picture))

    def ticks(self, seconds, pixels=GRAY):
        return [self.tick(pixels) for _ in range(round(seconds / DT))]


def test_it_hovers_until_the_image_is_recognised_then_flies_searches_and_flies_again():
    f = Flight()
    phases = [f.tick().phase]
    f.law.command = FAST
    phases.append(f.tick().phase)
    f.law.command = None
    phases.append(f.tick().phase)
    f.law.command = FAST
    phases.append(f.tick().phase)
    assert phases == ["matching", "flying", "searching", "flying"]


def test_what_the_law_answers_is_flown_as_it_is():
    f = Flight()
    f.law.command = FAST
    decision = f.tick()
    assert decision.command.as_array() == pytest.approx(FAST, abs=0.0)
    assert decision.diagnostics.activations == {"avoidance": 0.25}
    assert decision.outcome is None


def test_a_law_is_told_the_last_command_and_the_time_since():
    f = Flight()
    f.law.command = FAST
    f.tick()
    f.stamp += 0.05
    f.tick()
    first, second = f.law.scenes
    assert not first.previous.any()
    assert first.dt == DT
    assert second.previous == pytest.approx(FAST, abs=0.0)
    assert second.dt == pytest.approx(DT + 0.05)


def test_searching_brakes_to_a_hover_within_the_limits():
    f = Flight()
    f.law.command = FAST
    f.tick()
    f.law.command = None
    commands = np.array([FAST, *(d.command.as_array() for d in f.ticks(1.0))])
    steps = np.diff(commands, axis=0)
    assert np.linalg.norm(steps[:, :3], axis=1).max() <= LIMITS.acceleration * DT
    assert np.abs(steps[:, 3]).max() <= LIMITS.yaw_acceleration * DT
    assert not commands[-1].any()
    # As soon as it may: 0.5025 m/s takes 16 ticks.
    assert not commands[17:].any()


def test_an_image_that_is_never_found_gives_up_with_the_workers_reason():
    f = Flight()
    f.perception.reasons[0] = "7 features look alike, 14 are needed"
    decisions = f.ticks(2.1)
    ends = [d for d in decisions if d.outcome is not None]
    assert len(ends) == 1
    assert ends[0].outcome is Outcome.LOST
    assert ends[0].reason == (
        "key image 'door' was not found again within 2 s: 7 features look alike, 14 are needed; "
        "start nearer to it or teach the path again"
    )
    assert decisions[-1].phase == "done"


def test_an_image_that_is_matched_but_cannot_be_flown_on_gives_up_with_the_number_of_points():
    f = Flight()
    f.law.target = 1
    f.perception.tracks[1] = list(range(11))
    lost = next(d for d in f.ticks(2.2) if d.outcome is not None)
    assert lost.reason == (
        "key image 'window' was not found again within 2 s: of 11 tracked points fewer than 16 agree on one "
        "geometry; start nearer to it or teach the path again"
    )


def test_without_pictures_it_hovers_then_gives_up():
    f = Flight()
    f.law.command = FAST
    f.tick()
    f.ticks(0.27, pixels=None)
    steps = len(f.law.scenes)
    blind = f.ticks(2.2, pixels=None)
    assert len(f.law.scenes) <= steps + 2  # after 0.3 s the law is not asked any more
    assert len(f.law.pauses) >= 60  # but it takes notice
    lost = next(d for d in blind if d.outcome is not None)
    assert lost.outcome is Outcome.LOST
    assert lost.reason == (
        "no picture for 2 s, one is expected every 0.3 s at least; is the video stream running?"
    )
    commands = np.array([FAST, *(d.command.as_array() for d in blind)])
    assert np.linalg.norm(np.diff(commands[:, :3], axis=0), axis=1).max() <= LIMITS.acceleration * DT
    assert not commands[-1].any()


def test_the_clock_of_giving_up_begins_again_with_every_search():
    f = Flight()
    for _ in range(3):
        assert all(d.outcome is None for d in f.ticks(1.5))
        f.law.command = FAST
        f.tick()
        f.law.command = None


def test_the_end_is_told_once_and_hovered_at():
    f = Flight()
    f.law.command = FAST
    f.tick()
    f.law.arrived = True
    reached = f.tick()
    assert (reached.phase, reached.outcome) == ("done", Outcome.REACHED)
    assert reached.reason == "the last image is reached"
    after = f.ticks(1.0)
    assert {(d.phase, d.outcome, d.reason, d.requests) for d in after} == {("done", None, "", ())}
    commands = np.array([FAST, *(d.command.as_array() for d in [reached, *after])])
    assert np.linalg.norm(np.diff(commands[:, :3], axis=0), axis=1).max() <= LIMITS.acceleration * DT
    assert not commands[-1].any()


def test_after_giving_up_a_sight_of_the_image_does_not_move_it_again():
    f = Flight()
    f.ticks(2.2)
    f.law.command = FAST
    assert all(not d.command.as_array().any() for d in f.ticks(0.5))


def test_a_search_says_so_to_perception_and_a_flight_does_not():
    f = Flight()
    f.tick()
    f.law.command = FAST
    f.tick()
    assert f.perception.asked == [(0, None, [0]), (0, None, [])]


def test_the_next_image_is_asked_for_when_the_law_wants_it_and_there_is_one():
    f = Flight()
    f.law.command, f.law.wants_next = FAST, True
    assert f.tick().requests == (MatchRequest(0),)
    f.law.target = 1  # the last
    f.tick()
    assert f.perception.asked == [(0, 1, []), (1, None, [])]


def test_the_image_and_the_next_one_are_followed_and_the_next_one_gets_a_smaller_share():
    f = Flight(max_points=80)
    f.law.target = 4
    f.perception.names = tuple("abcdefgh")
    f.tick()
    (wanted,) = f.perception.wanted
    assert set(wanted) == {4, 5}
    assert wanted[4] == 80
    assert f.pilot.settings.min_points <= wanted[5] < 80


def view(epsilon=3.5):
    estimate = HomographyEstimate(
        np.eye(3), "upright", 1.0, np.ones(2, bool), yaw=0.1, t=np.array([0.1, 0.2, 0.3])
    )
    p = np.array([[1.0, 2.0], [3.0, 4.0]])
    return View(0, None, estimate, p, p + 1.0, epsilon)


def test_what_is_seen_is_told_in_the_diagnostics():
    f = Flight()
    f.law.command, f.perception.seen = FAST, {0: view()}
    seen = f.tick().diagnostics
    assert (seen.target_index, seen.epsilon_px, seen.yaw_error) == (0, 3.5, 0.1)
    assert seen.translation.tolist() == [0.1, 0.2, 0.3]
    assert seen.points_current.tolist() == [[2.0, 3.0], [4.0, 5.0]]
    f.perception.seen = {}
    unseen = f.tick().diagnostics
    assert np.isnan(unseen.epsilon_px)
    assert len(unseen.points_current) == 0


def test_an_epsilon_without_points_is_told_as_none():
    f = Flight()
    f.law.command, f.perception.seen = FAST, {0: view(float("inf"))}
    assert np.isnan(f.tick().diagnostics.epsilon_px)


def column_picture(left=300, right=340):
    pixels = np.full((480, 856, 3), 128, dtype=np.uint8)
    pixels[:, left:right] = [220, 20, 20]
    return pixels


def test_columns_are_looked_for_in_every_new_picture_when_their_hue_is_told():
    f = Flight(column_hue_deg=0.0)
    f.law.command = FAST
    seen = f.tick(column_picture())
    assert [(b.left, b.right) for b in seen.diagnostics.columns] == [pytest.approx((300, 339), abs=1.0)]
    kept = f.tick(None)
    assert kept.diagnostics.columns == seen.diagnostics.columns  # still the newest that is known
    assert [scene.columns is None for scene in f.law.scenes] == [False, True]


def test_without_a_hue_no_columns_are_looked_for():
    f = Flight()
    f.law.command = FAST
    assert f.tick(column_picture()).diagnostics.columns == ()
    assert f.law.scenes[0].columns is None


def test_the_reported_attitude_goes_with_the_pose():
    f = Flight()
    f.law.command = FAST
    f.tick(roll=0.02, pitch=-0.03)
    f.tick()
    assert (f.law.scenes[0].pose.roll, f.law.scenes[0].pose.pitch) == (0.02, -0.03)
    assert (f.law.scenes[1].pose.roll, f.law.scenes[1].pose.pitch) == (0.0, 0.0)


@pytest.mark.parametrize("law", ["noctule", "published"])
def test_the_same_observations_give_the_same_decisions_bit_for_bit(law):
    path, settings = path_of("astronaut"), PilotSettings(law=law, rematch_s=0.2)
    matcher = make_matcher(settings, path)

    def fly():
        pilot, decisions, matches = make_pilot(settings, path, LIMITS, DT), [], ()
        for i in range(12):
            picture = Picture(i * DT, picture_of("astronaut", 18.0 - 2.0 * i, scale=0.95))
            state = VehicleState(i * DT, FlightState.FLYING, 0.0, 0.0, 0.01 * i, np.array([0.1, 0.0, 0.0]))
            decision = pilot.step(Observation(i * DT, state, picture, matches))
            matches = tuple(matcher(picture, r.key_index) for r in decision.requests)
            decisions.append(decision)
        return decisions

    once, again = fly(), fly()
    assert once[-1].phase == "flying"
    assert once[-1].command.forward > 0.0
    for a, b in zip(once, again, strict=True):
        assert (a.command, a.phase, a.requests, a.outcome) == (b.command, b.phase, b.requests, b.outcome)
        assert (a.diagnostics.points_current == b.diagnostics.points_current).all()
        assert a.diagnostics.translation.tobytes() == b.diagnostics.translation.tobytes()


def sight(index, distance=0.1):
    """Return a view of image `index` from `distance` [mean depths] away."""
    estimate = HomographyEstimate(
        np.eye(3), "upright", 1.0, np.ones(20, dtype=bool), t=np.array([0.0, 0.0, distance])
    )
    return View(index, None, estimate, np.zeros((20, 2)), np.zeros((20, 2)), 1.0)


def test_a_lost_image_is_searched_for_among_all_the_nearest_along_the_path_first():
    f = Flight(names=("a", "b", "c", "d", "e"))
    f.law.command, f.law.target = FAST, 2
    f.tick()
    f.law.command = None
    f.tick()
    assert f.perception.asked[-1] == (2, None, [2, 3, 1, 4, 0])
    f.tick()
    assert set(f.perception.wanted[-1]) == {0, 1, 2, 3, 4}


def test_a_search_goes_on_with_the_image_that_it_finds():
    f = Flight(names=("a", "b", "c", "d", "e"))
    f.law.command, f.law.target = FAST, 1
    f.tick()
    f.law.command = None
    f.perception.seen = {4: sight(4), 3: sight(3)}
    f.tick()
    assert f.law.jumps == [3]
    f.law.command = FAST
    assert f.tick().phase == "flying"


def test_before_the_first_recognition_nothing_is_skipped():
    f = Flight()
    f.perception.seen = {1: sight(1)}
    f.ticks(0.5)
    assert f.law.jumps == []


def test_a_flight_that_may_begin_anywhere_looks_for_every_image_and_takes_the_nearest():
    f = Flight(names=("a", "b", "c", "a"), start="nearest")
    f.law.command = FAST
    found = {1: sight(1, 0.3), 2: sight(2, 0.05)}
    for i in range(3):  # the fourth is the first again
        decision = f.tick()
        assert decision.phase == "matching"
        assert not decision.command.as_array().any()
        assert f.perception.asked[-1][2] == list(range(i, 3))
        f.perception.reasons[i] = "" if i in found else "0 features look alike, 14 are needed"
        f.perception.seen = {j: found[j] for j in found if j <= i}
    f.tick()
    assert f.law.jumps == [2]
    assert f.tick().phase == "flying"


def test_a_flight_that_may_begin_anywhere_and_finds_nothing_gives_up_as_ever():
    f = Flight(start="nearest")
    f.perception.reasons = {0: "7 features look alike, 14 are needed", 1: "none"}
    ends = [d for d in f.ticks(2.5) if d.outcome is not None]
    assert f.law.jumps == []
    assert [d.outcome for d in ends] == [Outcome.LOST]
