"""`noctule node`: what a person types, and what comes of it."""

from __future__ import annotations

import io
import json
import signal
import socket
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from cli_room import CAMERA, depth, leave, leave_site

from noctule.cli.depth_options import SourceOptions
from noctule.cli.node_options import NodeOptions, prepare
from noctule.cli.node_running import Status, in_words
from noctule.cli.nodes import CameraTakenError, _live_simulation, _of_device
from noctule.devices.protocols import DeviceError
from noctule.estimation.filter_state import start_at
from noctule.estimation.identification import VehicleModelSettings
from noctule.estimation.sensors import OnboardSensors, Sensors
from noctule.flight.network.member import Member
from noctule.flight.recording import FlightRecorder, sent_message
from noctule.localization.locator import Located, LocatorState
from noctule.localization.sensors_file import save_sensors
from noctule.localization.site import SiteCamera, save_background
from noctule.localization.vehicle_file import save_vehicle_model
from noctule.messages import (
    Command,
    DepthFrame,
    FlightState,
    HeadingMeasurement,
    PoseMeasurement,
    VehicleState,
)
from noctule.vision.depth import learn_background

ROLES = ("onboard", "depth", "markers", "fusion")


@pytest.fixture
def port():
    """A port of this machine where nobody listens."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@pytest.fixture
def alone(noctule, port, monkeypatch):
    """Run a node that nobody answers, that joins at once and leaves nothing out for being late."""
    monkeypatch.setattr("noctule.flight.network.member.JOINING", 0.0)
    monkeypatch.setattr("noctule.flight.network.process._MET", 0.0)
    monkeypatch.setattr("noctule.flight.network.pacing.TOO_LATE", 600.0)

    def call(role, *tokens):
        return noctule("node", role, *tokens, "--listen", f"127.0.0.1:{port}", "--connect", "127.0.0.1:9")

    return call


@pytest.mark.parametrize("role", ROLES)
def test_every_node_has_help_with_json_and_an_example_to_paste(noctule, role):
    said = noctule("node", role, "--help")
    assert said.code == 0
    assert all(option in said.out for option in ("--json", "--listen", "--connect", "--drill", "--begin"))
    assert f"Example: noctule node {role}" in said.out


@pytest.mark.parametrize(
    ("tokens", "message"),
    [
        (
            ["onboard"],
            "node onboard: found none, expected exactly one of --recording, --simulated, --drill",
        ),
        (
            ["onboard", "--simulated", "--drill", "0"],
            "node onboard: found --simulated and --drill, expected exactly one of --recording, --simulated, "
            "--drill",
        ),
        (
            ["onboard", "--recording", "f.mcap", "--seed", "3"],
            "node onboard: --seed goes with --simulated only; leave it out",
        ),
        (["depth", "--simulated"], "node depth: found none, expected exactly one of --site, --drill"),
        (["markers"], "node markers: found none, expected exactly one of --site, --drill"),
        (
            ["fusion", "--drill", "0", "--from", "3"],
            "node: --drill does not go with --site, --vehicle and --from; leave them out",
        ),
        (
            ["fusion", "--drill", "0", "--drill-seconds", "0"],
            "node: --drill-seconds is 0, expected above 0, up to 600",
        ),
        (
            ["fusion", "--drill", "-1"],
            "node: --drill is -1, expected a seed of 0 or more",
        ),
        *(
            (
                ["fusion", "--begin", given],
                f"node: --begin is {told}, expected seconds as `date +%s` prints them, at most a day ahead",
            )
            for given, told in (
                ("nan", "nan"),
                ("inf", "inf"),
                ("-1", "-1"),
                ("1795414370000", "1.79541e+12"),
            )
        ),
        (
            ["onboard", "--recording", "f.mcap", "--from", "nan"],
            "node: --from is nan, expected a stamp of the recording [s]",
        ),
        (
            ["onboard", "--simulated", "--site", "nowhere"],
            "site nowhere: is no folder; give that of `noctule calibrate camera`, or make one",
        ),
        (["fusion", "--seconds", "-1"], "node: --seconds is -1, expected above 0, up to 86400"),
        (
            ["fusion", "--listen", "everywhere"],
            "node: --listen is 'everywhere', expected HOST:PORT, for example 192.168.1.7:17450",
        ),
        (
            ["fusion", "--name", "No Name"],
            "node: its name is 'No Name', expected 1 to 16 of a to z, 0 to 9, - and _; give another with "
            "--name",
        ),
    ],
)
def test_a_mistake_is_one_line(noctule, tokens, message):
    said = noctule("node", *tokens)
    assert (said.code, said.out, said.err) == (2, "", f"noctule: {message}\n")


def test_a_port_that_is_taken_is_one_line_that_says_what_to_do(noctule, port):
    with socket.socket() as one:
        one.bind(("127.0.0.1", port))
        one.listen()
        said = noctule("node", "fusion", "--listen", f"127.0.0.1:{port}", "--seconds", "1")
    assert (said.code, said.err) == (
        2,
        f"noctule: node 'fusion': tcp/127.0.0.1:{port} is taken; does this node already run? stop it, or "
        "name another address with --listen, and tell the others with --connect\n",
    )


def test_without_the_optional_package_it_says_how_to_install_it(noctule, monkeypatch):
    monkeypatch.setitem(sys.modules, "zenoh", None)
    said = noctule("node", "fusion", "--seconds", "1")
    assert (said.code, said.err) == (
        2,
        "noctule: node: the package eclipse-zenoh is not installed; install it: "
        'pip install "noctule[network]"\n',
    )


def test_a_fusion_that_nobody_told_anything_ends_with_code_1_and_its_files(alone):
    said = alone("fusion", "--seconds", "0.5", "--out", "o", "--json")
    told = said.last_json
    assert said.code == 1
    assert len(said.out.splitlines()) == 1  # the live line is on standard error
    assert "no other node yet" in said.err
    assert (told["node"], told["assimilated"], told["there"]) == ("fusion", 0, [])
    assert (told["table"], told["recording"]) == ("o/estimates.csv", "o/estimates.mcap")


def test_a_drill_alone_measures_its_part_and_judges_itself(alone):
    said = alone("depth", "--drill", "0", "--drill-seconds", "2", "--json")
    told = said.last_json
    assert said.code == 0
    assert 0 < told["shared"] <= told["measured"]
    assert told["drill"].keys() == {"judged", "nees_per_state", "nees_by_second"}


def test_a_service_manager_ends_a_node_as_ctrl_c_does(alone, monkeypatch):
    def run_node(member, wire, readings, watchers, stop, until, senses) -> None:
        assert not stop.is_set()
        signal.raise_signal(signal.SIGTERM)
        assert stop.is_set()

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr("noctule.flight.network.process.run_node", run_node)
    said = alone("fusion", "--out", "o", "--json")
    assert said.last_json["node"] == "fusion"
    assert signal.getsignal(signal.SIGTERM) is before


class Scripted:
    """A locator that sees the drone at once."""

    def __init__(self, *_: object, **__: object) -> None:
        pass

    def step(self, frame, prediction=None) -> Located:
        pose = PoseMeasurement(frame.stamp, np.array([0.1, 0.2, 1.2]), 0.3, 1e-4 * np.eye(4), "registration")
        return Located(frame.stamp, LocatorState.TRACKING, pose, "")


def test_the_depth_node_shares_what_the_locator_sees(alone, tmp_path, monkeypatch):
    leave(tmp_path / "f", [depth([], k) for k in range(5)])
    site = SimpleNamespace(
        camera=SiteCamera(CAMERA),
        background="the room",
        template=None,
        detectors=SimpleNamespace(named=lambda name: None),
    )
    monkeypatch.setattr("noctule.localization.site.load_site", lambda folder: site)
    monkeypatch.setattr("noctule.localization.locator.Locator", Scripted)
    (tmp_path / "s").mkdir()
    said = alone("depth", "--site", "s", "--folder", "f", "--name", "ceiling", "--json")
    told = said.last_json
    assert said.code == 0
    assert (told["node"], told["measured"], told["shared"]) == ("ceiling", 5, 5)


def test_a_depth_node_can_share_the_markers_of_its_own_camera_too(alone, tmp_path, monkeypatch):
    leave(tmp_path / "f", [depth([], k) for k in range(3)])
    (tmp_path / "s").mkdir()
    site = SimpleNamespace(
        camera=SiteCamera(CAMERA),
        background="the room",
        template=None,
        detectors=SimpleNamespace(named=lambda name: None),
    )
    backgrounds = []

    def located(frames, locator, expected, markers=None):
        backgrounds.append(markers)
        return iter(())

    monkeypatch.setattr("noctule.localization.site.load_site", lambda folder: site)
    monkeypatch.setattr("noctule.localization.locator.Locator", Scripted)
    monkeypatch.setattr("noctule.flight.network.sensing.located", located)
    for tokens in ([], ["--with-markers"]):
        alone("depth", "--site", "s", "--folder", "f", "--json", *tokens)
    assert backgrounds == [None, "the room"]


@pytest.mark.parametrize(("role", "other"), [("depth", "markers"), ("markers", "depth")])
def test_a_camera_that_another_node_has_open_is_one_line_that_says_what_to_do(role, other):
    def busy():
        raise DeviceError("depth camera: it is busy")
        yield

    with pytest.raises(CameraTakenError) as told:
        list(_of_device(busy(), "ceiling", role))
    assert str(told.value) == (
        f"node {role}: camera 'ceiling' gives no frame (depth camera: it is busy); where "
        f"`noctule node {other}` has it open, stop it: `noctule node depth --with-markers` does both"
    )


def test_a_camera_that_fails_later_is_told_as_it_is():
    def failing():
        yield DepthFrame(0.0, depth([], 0))
        raise DeviceError("depth camera: unplugged")

    frames = _of_device(failing(), "ceiling", "depth")
    assert next(frames).stamp == 0.0
    with pytest.raises(DeviceError, match="unplugged"):
        next(frames)


def test_a_node_takes_off_what_the_site_was_calibrated_to(tmp_path):
    (tmp_path / "bare").mkdir()
    save_sensors(tmp_path, Sensors(onboard=OnboardSensors(heading_walk=0.5)))
    walks = [
        prepare("onboard", NodeOptions(site=folder)).member.node.filter.settings.noise.heading_bias
        for folder in (tmp_path, tmp_path / "bare")
    ]
    assert walks == [0.5, Sensors().onboard.heading_walk]


def test_the_markers_node_shares_their_heading(alone, tmp_path, monkeypatch):
    leave(tmp_path / "f", [depth([], k) for k in range(4)])
    leave_site(tmp_path / "s")
    save_background(tmp_path / "s", learn_background([depth([], k) for k in range(12)]), CAMERA)
    said = alone("markers", "--site", "s", "--folder", "f", "--json")
    assert (said.code, said.last_json["measured"]) == (1, 0)  # the folder has no colour

    def seen(frames, background, camera, name):
        return (HeadingMeasurement(frame.stamp, 0.2, 1e-3, name) for frame in frames)

    from noctule.estimation.measurements import of_heading

    monkeypatch.setattr(
        "noctule.flight.network.sensing.marked",
        lambda *given: (of_heading(heading, k) for k, heading in enumerate(seen(*given))),
    )
    said = alone("markers", "--site", "s", "--folder", "f", "--json")
    assert (said.code, said.last_json["shared"]) == (0, 4)


def test_the_onboard_node_plays_a_recorded_flight(alone, tmp_path):
    with FlightRecorder(tmp_path / "flight.mcap") as recorder:
        for k in range(10):
            stamp = 5.0 + 0.02 * k
            state = VehicleState(stamp, FlightState.FLYING, yaw=0.1, v_body=np.zeros(3), height=1.0)
            sent = sent_message(stamp, Command(), Command(), "flying", "", "")
            recorder.tick(stamp, state, None, (), None, sent)
    said = alone("onboard", "--recording", "flight.mcap", "--json")
    told = said.last_json
    assert said.code == 0
    assert told["measured"] == 10
    assert told["shared"] >= 9


def test_a_recording_that_is_over_before_the_beginning_asked_for_tells_its_range(alone, tmp_path):
    with FlightRecorder(tmp_path / "flight.mcap") as recorder:
        for stamp in (5.0, 5.25):
            sent = sent_message(stamp, Command(), Command(), "flying", "", "")
            recorder.tick(stamp, VehicleState(stamp, FlightState.FLYING), None, (), None, sent)
    said = alone("onboard", "--recording", "flight.mcap", "--from", "5.5")
    assert (said.code, said.err) == (
        2,
        "noctule: node onboard: --from is 5.5, recording flight.mcap holds 5.000 to 5.250 s; give a stamp "
        "within them\n",
    )


def test_frames_that_are_over_before_the_beginning_asked_for_tell_their_range(alone, tmp_path):
    leave(tmp_path / "f", [depth([], k) for k in range(5)])
    leave_site(tmp_path / "s")
    save_background(tmp_path / "s", learn_background([depth([], k) for k in range(12)]), CAMERA)
    said = alone("markers", "--site", "s", "--folder", "f", "--from", "99", "--json")
    assert said.code == 2
    assert said.err.splitlines()[-1].startswith(
        "noctule: node markers: --from is 99, folder f holds 0.000 to "
    )


def test_a_fusion_that_is_started_again_keeps_what_it_wrote_before_and_says_so(alone):
    first, second = (alone("fusion", "--seconds", "0.2", "--out", "o", "--json") for _ in range(2))
    assert first.last_json["table"] == "o/estimates.csv"
    assert (second.last_json["table"], second.last_json["recording"]) == (
        "o/estimates-2.csv",
        "o/estimates-2.mcap",
    )
    assert "table o/estimates-2.csv: what earlier runs left in this folder is kept" in second.err
    assert "kept" not in first.err


def test_the_onboard_node_of_the_simulated_room_reports(alone):
    said = alone("onboard", "--simulated", "--seconds", "2", "--json")
    assert said.code == 0
    assert said.last_json["shared"] >= 1


def test_a_node_predicts_with_the_model_that_it_is_given(tmp_path):
    save_vehicle_model(tmp_path / "vehicle.toml", VehicleModelSettings(delay_s=0.05))
    ready = prepare("fusion", NodeOptions(vehicle=tmp_path / "vehicle.toml"))
    assert ready.member.node.filter.model.delay == 0.05
    assert prepare("fusion", NodeOptions()).member.node.filter.model is None


def test_a_recording_begins_when_it_is_asked_to():
    ready = prepare("onboard", NodeOptions(begin=100.0, from_=7.0))
    assert ready.schedule(5.0).shared(8.0) == 101.0
    later = prepare("onboard", NodeOptions()).schedule(5.0)
    assert later.first == 5.0
    assert later.begin >= time.time() - 60.0


def test_the_live_line_is_rewritten_on_a_terminal_and_comes_once_a_second_elsewhere():
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    one = Member("fusion", start_at(0.0, np.zeros(3), 0.0))
    terminal, file = Terminal(), io.StringIO()
    for out in (terminal, file):
        status = Status(0.0, out)
        for k in range(20):
            status.show(0.1 * k, one)
        status.end()
    assert terminal.getvalue().count("\r\x1b[K") >= 7
    assert terminal.getvalue().endswith("\n")
    assert len(file.getvalue().splitlines()) == 2


def test_the_end_in_words_names_what_was_lost_and_why():
    found = {
        "node": "fusion", "measured": 0, "measures_nothing": "no drone in view", "shared": 0,
        "assimilated": 9, "rejoined": 1,
        "refused": {"depth: yaw gate": 2}, "dropped": {"too late": 3}, "malformed": {"beat": 4},
        "why_malformed": {"beat": "depth: heartbeat: 3 bytes"}, "overruns": 5, "half_turns": 1,
        "namesakes": 6,
        "drill": {"nees_per_state": 1.02}, "table": "o/estimates.csv", "recording": "o/estimates.mcap",
    }  # fmt: skip
    assert in_words(found).splitlines() == [
        "node fusion: measured 0, shared 0, assimilated 9, joined again 1 times",
        "nothing measured at the end: no drone in view",
        "refused: 2 depth: yaw gate",
        "dropped: 3 too late",
        "no message: 4 beat",
        "the last of them: depth: heartbeat: 3 bytes",
        "another node called itself fusion: 6 messages left out",
        "half turns: the heading was found to be the other one 1 times",
        "too many messages: 5 were lost; is this machine too slow?",
        "drill: NEES per state 1.02, 1 when it knows its errors",
        "table: o/estimates.csv",
        "recording: o/estimates.mcap",
    ]


def test_what_is_printed_for_programs_is_json_without_numbers_that_are_none(alone):
    said = alone("fusion", "--drill", "0", "--drill-seconds", "0.2", "--out", "o", "--json")
    assert "NaN" not in said.out
    assert json.loads(said.out)["drill"].keys() == {"judged", "nees_per_state", "nees_by_second"}


def test_a_simulated_frame_that_is_past_is_not_drawn(monkeypatch):
    drawn = []

    class Stage:
        def __init__(self, *_: object) -> None:
            pass

        def frame(self, stamp, *_: object) -> DepthFrame:
            drawn.append(stamp)
            return DepthFrame(stamp, depth([], 0))

    monkeypatch.setattr("noctule.flight.depth_scene.DepthStage", Stage)
    ready = prepare("depth", NodeOptions(begin=time.time() - 100.0))
    options = SourceOptions(simulated=True, seconds=100.2)
    list(_live_simulation(options, ready, threading.Event()))
    assert all(stamp > 99.9 for stamp in drawn)
