"""The loop of a node's process, what its sensors say and when, and what it leaves behind."""

from __future__ import annotations

import csv
import queue
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader

from noctule.devices.protocols import DeviceError
from noctule.estimation.delayed import DEFAULTS
from noctule.estimation.events import Input
from noctule.estimation.filter_state import Prior, start_at
from noctule.estimation.measurements import Component, Measurement
from noctule.estimation.node_messages import inputs_from_bytes, snapshot_from_bytes
from noctule.flight import codec
from noctule.flight.network import pacing
from noctule.flight.network.drill import Judge, made_up
from noctule.flight.network.estimate_log import EstimateLog, roll_text, status_line
from noctule.flight.network.member import HUNG, Member
from noctule.flight.network.pacing import TOO_LATE, Schedule, live_frames, paced, paced_frames
from noctule.flight.network.process import Nothing, expectation, run_node
from noctule.flight.network.roll_call import Beat, beat_from_bytes
from noctule.flight.network.sensing import located, marked, recorded_navdata, simulated_navdata
from noctule.flight.network.wire import Kind, NameTakenError, Received
from noctule.flight.reader import Recording, Tick
from noctule.flight.recording import RecordingError
from noctule.geometry import Pose
from noctule.localization.locator import Located, LocatorState
from noctule.messages import (
    Command,
    DepthFrame,
    FlightState,
    HeadingMeasurement,
    PoseMeasurement,
    VehicleState,
)

NEVER = threading.Event()


class FakeWire:
    """Keeps what a node says, and has the inbox that a test fills."""

    def __init__(self, *received) -> None:
        self.inbox: queue.Queue = queue.Queue()
        self.shared: list[tuple[Kind, bytes]] = []
        self.answers: list[bytes] = []
        self.asked = self.declined = 0
        self.namesakes: set[str] = set()
        self.younger: set[str] = set()
        for item in received:
            self.inbox.put(item)

    def share(self, kind, data) -> None:
        self.shared.append((kind, data))

    def ask(self) -> None:
        self.asked += 1

    def answer(self, received, data) -> None:
        self.answers.append(data)

    def decline(self, received) -> None:
        self.declined += 1

    def require_own_name(self) -> None:
        pass

    def said(self, kind) -> list[bytes]:
        return [data for k, data in self.shared if k is kind]


@pytest.fixture(autouse=True)
def met_at_once(monkeypatch):
    """Let a node know at once that its name is free."""
    monkeypatch.setattr("noctule.flight.network.process._MET", 0.0)


def member(stamp: float = 0.0) -> Member:
    return Member("depth", start_at(stamp, np.zeros(3), 0.0))


def seen(stamp: float, sequence: int = 0) -> Measurement:
    parts = np.array([Component.X, Component.Y, Component.Z, Component.YAW], dtype=np.int64)
    return Measurement(stamp, parts, np.zeros(4), 1e-4 * np.eye(4), "depth", sequence)


def joined(one: Member) -> Member:
    one.join = lambda now: None
    return one


def test_a_node_shares_what_it_measures_and_ends_with_its_readings():
    now = time.time()
    wire, one = FakeWire(), joined(member(now - 1.0))
    readings = [seen(now - 0.2), Input(now - 0.1, np.zeros(4)), seen(now - 0.05, 1)]
    run_node(one, wire, readings, [], threading.Event(), now + 60.0)
    assert len(wire.said(Kind.CONTRIBUTION)) == 2
    (commands,) = wire.said(Kind.COMMANDS)
    assert inputs_from_bytes(commands)[0].stamp == now - 0.1
    assert wire.asked == 1


def test_what_a_sensor_raises_ends_its_node():
    def broken():
        yield Nothing("it warms up")
        raise DeviceError("depth camera: it was unplugged")

    wire, one = FakeWire(), member(time.time())
    with pytest.raises(DeviceError, match="unplugged"):
        run_node(one, wire, broken(), [], threading.Event(), time.time() + 60.0)
    assert one.reason == "it warms up"


def test_who_asks_is_told_all_and_who_comes_is_asked():
    wire = FakeWire(Received(Kind.ASKED, "", query=object()), Received(Kind.ALIVE, "onboard"))
    one, stop = member(time.time()), threading.Event()

    def enough(now, it) -> None:
        if it.roll.there and wire.answers:
            stop.set()

    run_node(one, wire, None, [enough], stop, time.time() + 60.0)
    assert snapshot_from_bytes(wire.answers[0]).x.size == 11
    assert wire.asked == 2
    assert one.roll.there == ("onboard",)


def test_a_peer_with_a_name_that_no_node_has_is_not_listened_to():
    wire = FakeWire(Received(Kind.ALIVE, "\x1b[2J"), Received(Kind.GONE, "depth"))
    one, stop = member(time.time()), threading.Event()
    run_node(
        one, wire, None, [lambda now, it: stop.set() if it.malformed else None], stop, time.time() + 60.0
    )
    assert one.malformed == {"name": 1}
    assert one.roll.peers == {}


def test_the_heart_beats_and_tells_why_nothing_is_measured():
    wire, one = FakeWire(), member(time.time())
    one.reason = "occluded"
    run_node(one, wire, None, [], threading.Event(), time.time() + 0.3)
    beats = [beat_from_bytes(data) for data in wire.said(Kind.BEAT)]
    assert beats[0].reason == "occluded"
    assert len(beats) >= 2


def test_a_process_that_was_frozen_joins_anew_and_asks():
    times = iter([0.0, 0.0, *([0.01] * 8), *[HUNG + 0.1 + 0.2 * k for k in range(400)]])
    one, wire, joins = member(), FakeWire(), []
    one.join = joins.append
    run_node(one, wire, None, [], threading.Event(), 30.0, lambda: next(times))
    assert joins[0] == 0.0
    assert joins[1] >= HUNG
    assert wire.asked == len(joins) >= 2


def test_a_stopped_node_ends():
    stop = threading.Event()
    stop.set()
    wire = FakeWire()
    run_node(member(), wire, None, [], stop)
    assert wire.shared == []


def test_what_is_due_comes_and_what_is_late_is_told():
    now = [100.0]
    entries = [(99.5, ["late but useful"]), (100.0 - TOO_LATE - 2.0, ["gone"]), (100.0, ["a", "b"])]
    found = list(paced(entries, NEVER, lambda: now[0]))
    assert found == ["late but useful", Nothing("3.0 s late, left out"), "a", "b"]


def test_nothing_comes_once_a_node_is_stopped():
    stop = threading.Event()
    stop.set()
    assert list(paced([(0.0, ["a"])], stop, lambda: 0.0)) == []


def frame(stamp: float, colour: bool = False) -> DepthFrame:
    pixels = np.zeros((4, 4, 3), dtype=np.uint8) if colour else None
    return DepthFrame(stamp, np.zeros((4, 4), dtype=np.uint16), pixels)


def test_recorded_frames_come_with_stamps_of_the_shared_clock():
    frames = paced_frames([frame(7.0), frame(7.5)], lambda first: Schedule(50.0, first), NEVER, lambda: 50.6)
    assert [one.stamp for one in frames] == [50.0, 50.5]
    assert list(paced_frames([], lambda first: Schedule(0.0), NEVER)) == []


def test_frames_of_a_device_are_taken_over_to_the_shared_clock(monkeypatch):
    monkeypatch.setattr(pacing.time, "time", lambda: 1000.0)
    monkeypatch.setattr(pacing.time, "monotonic", lambda: 10.0)
    assert [one.stamp for one in live_frames([frame(11.0)], NEVER)] == [1001.0]


def test_a_recorded_flight_gives_its_reports_once_and_its_commands(monkeypatch):
    monkeypatch.setattr(pacing, "TOO_LATE", 60.0)
    state = VehicleState(3.0, FlightState.FLYING, yaw=0.1, v_body=np.array([0.1, 0.0, 0.0]), height=1.0)
    ticks = []
    for k, report in enumerate([state, state, replace(state, stamp=3.2)]):
        told = codec.encode_observation(3.0 + 0.1 * k, report, None, ())
        command = Command(forward=0.1 * k)
        ticks.append(Tick(3.0 + 0.1 * k, told, None, None, 0.0, command, command, "", "", "", None))
    recording = Recording(None, tuple(ticks), {}, {})
    begin = time.time() - 0.3
    found = list(recorded_navdata(recording, Schedule(begin, 3.0), "onboard", NEVER))
    inputs = [one for one in found if isinstance(one, Input)]
    reports = [one for one in found if isinstance(one, VehicleState)]
    assert [one.u[0] for one in inputs] == pytest.approx([0.0, 0.1, 0.2])
    assert [one.stamp - begin for one in reports] == pytest.approx([0.0, 0.2], abs=1e-6)
    assert {one.source for one in inputs} == {"onboard"}


def test_simulated_navdata_are_those_of_the_flown_path(monkeypatch):
    monkeypatch.setattr(pacing, "TOO_LATE", 60.0)
    poses = [(k / 30.0, Pose(np.array([0.3 * k / 30.0, 0.0, 1.2]), 0.5)) for k in range(31)]
    begin = time.time() - 1.0
    found = list(simulated_navdata(poses, 0, Schedule(begin), NEVER))
    reports = [one for one in found if isinstance(one, VehicleState)]
    assert len(reports) >= 15
    forward, left = (np.mean([one.v_body[i] for one in reports]) for i in (0, 1))
    height = np.mean([one.height for one in reports])
    assert forward == pytest.approx(0.3 * np.cos(0.5), abs=0.15)
    assert left == pytest.approx(-0.3 * np.sin(0.5), abs=0.15)
    assert height == pytest.approx(1.2, abs=0.05)


class Seeing:
    """A locator that sees the drone in every second frame."""

    camera = None

    def __init__(self) -> None:
        self.expected = []

    def step(self, one: DepthFrame, prediction=None) -> Located:
        self.expected.append(prediction)
        if round(10 * one.stamp) % 2:
            return Located(one.stamp, LocatorState.LOST, None, "occluded")
        pose = PoseMeasurement(one.stamp, np.array([1.0, 2.0, 1.5]), 0.3, np.eye(4), "registration")
        return Located(one.stamp, LocatorState.TRACKING, pose, "", heading_certain=True)


def test_a_depth_camera_says_where_the_drone_is_or_why_not():
    a, b, c = located([frame(0.0), frame(0.1), Nothing("late")], Seeing())
    assert (a.pose.stamp, a.pose.yaw, a.certain) == (0.0, 0.3, True)
    assert (b, c) == (Nothing("occluded"), Nothing("late"))


def test_a_depth_camera_looks_where_its_node_expects_the_drone():
    seeing = Seeing()
    list(located([frame(0.0), frame(0.2)], seeing, lambda stamp: f"around {stamp:g}"))
    assert seeing.expected == ["around 0", "around 0.2"]


def test_a_depth_camera_with_colour_can_tell_the_markers_where_it_saw_the_drone(monkeypatch):
    asked = []

    def near(method, one, position, background, camera):
        asked.append((one.stamp, position.tolist(), background))
        return HeadingMeasurement(one.stamp, 1.1, 0.01, "tape") if one.stamp else None

    monkeypatch.setattr("noctule.flight.network.sensing.heading_near", near)
    frames = [frame(0.0, colour=True), frame(0.1, colour=True), frame(0.2), frame(0.4, colour=True)]
    found = list(located(frames, Seeing(), markers="the room"))
    assert asked == [(0.0, [1.0, 2.0, 1.5], "the room"), (0.4, [1.0, 2.0, 1.5], "the room")]
    assert [type(one).__name__ for one in found] == [
        "Sight", "Nothing", "Sight", "Sight", "HeadingMeasurement",
    ]  # fmt: skip
    assert found[-1].source == "markers"


def test_a_sensors_thread_is_told_where_the_vehicle_is_expected():
    now = time.time()
    one, wire, found = joined(member(now - 1.0)), FakeWire(), []

    def readings():
        found.append(expectation(wire.inbox, now))
        yield seen(now)
        found.append(expectation(wire.inbox, now))

    run_node(one, wire, readings(), [], threading.Event(), now + 60.0)
    assert found[0] is None  # it may be anywhere
    np.testing.assert_allclose(found[1].pose.position, 0.0, atol=1e-3)
    assert found[1].covariance.shape == (4, 4)


def test_a_node_that_has_ended_answers_no_questions():
    assert expectation(queue.Queue(), 0.0) is None


def test_a_second_node_of_the_same_name_ends_once_what_was_killed_is_forgotten():
    class Doubled(FakeWire):
        def require_own_name(self) -> None:
            raise NameTakenError("two of them")

    times = (0.1 * k for k in range(1000))
    with pytest.raises(NameTakenError):
        run_node(member(), Doubled(), None, [], threading.Event(), 30.0, lambda: next(times))
    assert 1.2 < next(times) < 5.0


def test_a_node_shares_nothing_before_it_knows_that_its_name_is_free(monkeypatch):
    monkeypatch.setattr("noctule.flight.network.process._MET", 0.3)
    begun = time.time()
    wire, one = FakeWire(Received(Kind.ASKED, "", query=object())), joined(member(begun - 1.0))
    told: list[float] = []
    wire.share = lambda kind, data: told.append(time.time() - begun)
    run_node(one, wire, None, [], threading.Event(), begun + 0.6)
    assert 0.3 <= min(told) < 0.55
    assert (wire.answers, wire.declined) == ([], 1)


def test_the_younger_of_two_of_one_name_shares_nothing_as_long_as_it_is_there():
    now = time.time()
    wire, one = FakeWire(), joined(member(now - 1.0))
    wire.namesakes.add("an elder")
    readings = [seen(now - 0.2), Input(now - 0.1, np.zeros(4)), seen(now - 0.05, 1)]
    run_node(one, wire, readings, [], threading.Event(), now + 60.0)
    assert wire.shared == []
    assert one.doubled


def test_the_elder_of_two_of_one_name_says_that_there_is_another_and_not_that_it_is_missing():
    wire, one = FakeWire(Received(Kind.BEAT, "depth", b"whatever it says")), member(time.time())
    wire.younger.add("a younger one")
    run_node(one, wire, None, [], threading.Event(), time.time() + 0.2)
    assert one.namesakes == 1
    assert roll_text(one, 0.0) == "another node calls itself depth"


def test_markers_say_the_heading_or_why_not(monkeypatch):
    sightings = iter([None, "sighting", "sighting"])
    headings = iter([None, HeadingMeasurement(0.3, 1.1, 0.01, "markers")])
    monkeypatch.setattr("noctule.flight.network.sensing.drone_sighting", lambda *_: next(sightings))
    monkeypatch.setattr(
        "noctule.localization.heading.markers.MarkerHeading.measure", lambda *_: next(headings)
    )
    frames = [Nothing("late"), frame(0.0), *(frame(0.1 * k, colour=True) for k in (1, 2, 3))]
    found = list(marked(frames, None, None, "tape"))
    reasons = ["late", "the camera gives no colour", "no drone in view", "its markers are not seen"]
    assert found[:4] == [Nothing(reason) for reason in reasons]
    assert (found[4].source, found[4].yaw) == ("tape", 1.1)


def test_every_process_makes_up_the_same_drill_and_measures_its_own_part(monkeypatch):
    monkeypatch.setattr(pacing, "TOO_LATE", 60.0)
    begin = time.time() - 3.0
    a, b = made_up(3, 2.0, begin), made_up(3, 2.0, begin)
    assert all(np.array_equal(x, y) for x, y in zip(a.flight.truths, b.flight.truths, strict=True))
    own = list(a.readings("markers", NEVER))
    assert {one.source for one in own} == {"markers"}
    assert all(begin <= one.stamp <= begin + 2.5 for one in own)
    assert list(a.readings("fusion", NEVER)) == []
    assert any(isinstance(one, Input) for one in a.readings("onboard", NEVER))


def test_the_judge_finds_who_believes_too_much():
    drill = made_up(0, 3.0, 0.0)
    believes = Member("fusion", drill.start, drill.model, drill.settings)
    doubts = Member("fusion", replace(drill.start, P=drill.start.P * 1e-4), drill.model, DEFAULTS)
    honest, proud = Judge(drill), Judge(drill)
    for k in range(60):
        honest(0.05 * k, believes)
        proud(0.05 * k, doubts)
    assert honest.summary()["judged"] > 20
    assert proud.summary()["nees_per_state"] > 10.0 * honest.summary()["nees_per_state"]
    assert set(honest.summary()["nees_by_second"]) == {0, 1, 2}


def test_the_judge_leaves_out_what_it_could_not_see_in_time():
    drill = made_up(0, 3.0, 0.0)
    judge = Judge(drill)
    judge(100.0, Member("fusion", drill.start, drill.model, drill.settings))
    assert judge.summary() == {"judged": 0, "nees_per_state": None, "nees_by_second": {}}


def test_estimates_are_written_into_a_table_and_a_recording(tmp_path):
    one = member(5.0)
    one.measure(seen(5.1), 5.1)
    one.roll.alive("onboard", 5.0)
    with EstimateLog(tmp_path) as log:
        for now in (4.0, 5.2, 5.3):  # before it began there is nothing to write
            log(now, one)
    with (tmp_path / "estimates.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["stamp"]) for row in rows] == [5.2, 5.3]
    assert rows[0]["there"] == "onboard"
    known = one.node.estimate(5.3)
    assert float(rows[1]["sd_x"]) == pytest.approx(float(known.sd[0]), abs=1e-6)
    with (tmp_path / "estimates.mcap").open("rb") as file:
        messages = [
            (channel.topic, message.log_time) for _, channel, message in make_reader(file).iter_messages()
        ]
    topics = {topic for topic, _ in messages}
    assert topics == {"/located", "/pose"}
    assert sorted(at for topic, at in messages if topic == "/pose") == [5_200_000_000, 5_300_000_000]


def test_what_an_earlier_run_wrote_is_kept(tmp_path):
    one = member(5.0)
    (tmp_path / "estimates-2.mcap").touch()  # its table is lost
    for now in (5.2, 5.4):
        with EstimateLog(tmp_path) as log:
            log(now, one)
    assert (log.table.name, log.recording.name, log.others) == ("estimates-3.csv", "estimates-3.mcap", 2)
    for name, stamp in (("estimates", 5.2), ("estimates-3", 5.4)):
        with (tmp_path / f"{name}.csv").open(newline="") as file:
            assert [float(row["stamp"]) for row in csv.DictReader(file)] == [stamp]
        with (tmp_path / f"{name}.mcap").open("rb") as file:
            assert {m.log_time for *_, m in make_reader(file).iter_messages()} == {round(1e9 * stamp)}


def test_two_nodes_that_begin_at_once_in_one_folder_do_not_share_a_file(tmp_path):
    with EstimateLog(tmp_path) as a, EstimateLog(tmp_path) as b:
        assert {a.table.name, b.table.name} == {"estimates.csv", "estimates-2.csv"}
        assert a.recording != b.recording


def test_a_table_that_cannot_be_written_is_told(tmp_path):
    with pytest.raises(RecordingError) as told, EstimateLog(tmp_path / "missing"):
        pass
    assert str(told.value) == (
        f"table {tmp_path}/missing/estimates.csv: cannot be written (No such file or directory); "
        "name another folder with --out"
    )


def test_the_live_line_tells_where_how_well_and_who():
    one = member(10.0)
    one.measure(seen(10.1), 10.1)
    one.roll.alive("depth", 10.0)
    one.roll.beat("markers", Beat(10.0, 0, "no drone in view"), 10.1)
    line = status_line(10.1, one, 10.0)
    assert line.startswith(
        "    0.10 s  x +0.000  y +0.000  z 0.000 m +- 17 mm  heading   +0.0 +- 0.6 deg  | "
    )
    assert line.endswith("depth, markers (no drone in view)")
    one.roll.gone("depth", 12.0)
    assert roll_text(one, 10.0) == (
        "markers (no drone in view), depth missing since 0.0 s (its connection ended)"
    )


def test_the_live_line_of_a_node_that_is_alone_and_has_not_begun():
    assert status_line(9.0, member(10.0), 10.0) == "   -1.00 s  not begun  | no other node yet"


def test_the_live_line_says_what_nobody_knows_yet():
    assert status_line(10.0, Member("fusion", start_at(10.0, np.zeros(3), 0.0, Prior(2.0, 2.0))), 10.0) == (
        "    0.00 s  position unknown  heading unknown  | no other node yet"
    )


def test_the_live_line_names_the_few_that_went_last():
    one = member()
    for k in range(7):
        one.roll.beat(f"n{k}", Beat(float(k), 0), float(k))
        one.roll.gone(f"n{k}", float(k))
    assert roll_text(one, 0.0) == (
        ", ".join(f"n{k} missing since {k}.0 s (its connection ended)" for k in (6, 5, 4, 3))
        + ", 3 more missing"
    )
