"""`noctule locate` and `noctule calibrate offset`: what a person types, and what comes of it."""

from __future__ import annotations

import csv
import io
import json
import math
import shlex
from pathlib import Path

import numpy as np
import pytest
from cli_room import CAMERA, DETECTORS, depth, leave, leave_simulated_site, leave_site

from noctule.cli.locating import Status, Tally, in_words, status_line
from noctule.flight.depth_recording import read_depth_recording
from noctule.flight.depth_scene import STAND
from noctule.geometry import Pose
from noctule.localization.calibration.lens import Lens
from noctule.localization.detector_file import save_detectors
from noctule.localization.locator import Located, LocatorDiagnostics, LocatorState
from noctule.localization.site import (
    SiteCamera,
    load_camera,
    save_background,
    save_camera,
    save_template,
)
from noctule.localization.template import Template
from noctule.messages import PoseMeasurement
from noctule.vision.depth import learn_background


def tracked(stamp: float, x: float, yaw: float, certain: bool = True, slipped: bool = False) -> Located:
    covariance = np.diag([1e-6, 4e-6, 9e-6, math.radians(0.5) ** 2])
    seen = PoseMeasurement(stamp, np.array([x, -0.2, 1.5]), yaw, covariance, "registration")
    return Located(stamp, LocatorState.TRACKING, seen, "", certain, slipped, LocatorDiagnostics(ratio=0.9))


def lost(stamp: float, reason: str) -> Located:
    return Located(stamp, LocatorState.LOST, None, reason)


SCRIPT = [
    tracked(0.0, 1.0, 0.1, certain=False),
    tracked(1 / 30, 1.1, 0.2, slipped=True),
    lost(2 / 30, "occluded: 10 % of the drone can be seen, expected at least 25 %"),
    lost(3 / 30, "occluded: 12 % of the drone can be seen, expected at least 25 %"),
    lost(4 / 30, "nothing in view: no foreground is as large as a drone"),
]


@pytest.fixture
def pretended(noctule, monkeypatch):
    """A whole site, a folder of five frames, and a locator that says what stands in SCRIPT."""
    leave_site(Path("s"))
    background = learn_background([depth([], k) for k in range(12)])
    save_background(Path("s"), background, CAMERA)
    save_detectors(Path("s"), DETECTORS, CAMERA)
    maps = {name: np.full((8, 8), 0.9) for name in ("probability", "variance", "height", "weight")}
    grid = {"grid": np.array([0.02, 0.01]), "frames": np.array([9.0])}
    save_template(Path("s"), Template.from_arrays({**grid, **maps}))
    leave(Path("f"), [depth([], 50 + k) for k in range(5)])
    made = []

    class Scripted:
        def __init__(self, camera, background, template, detector=None, settings=None, offset=None) -> None:
            self.detector, self.offset, self.script = detector, offset, list(SCRIPT)
            self.seen = []
            made.append(self)

        def step(self, frame):
            self.seen.append(frame.depth)
            return self.script.pop(0)

    monkeypatch.setattr("noctule.localization.site.Locator", Scripted)
    noctule.made = made
    return noctule


def test_it_has_help_with_json_seed_out_and_an_example_to_paste(noctule):
    said = noctule("locate", "--help")
    assert said.code == 0
    options = ("--json", "--seed", "--out", "--site", "--recording", "--folder", "--simulated")
    assert all(option in said.out for option in options)
    example = next(line for line in said.out.splitlines() if line.startswith("Example: "))
    assert shlex.split(example)[1:3] == ["noctule", "locate"]


def test_it_ends_with_what_was_seen_and_the_reasons_where_nothing_was(pretended):
    said = pretended("locate", "--folder", "f", "--site", "s", "--out", "o")
    assert (said.code, said.err) == (0, "")
    lines = said.out.splitlines()
    # Somewhere else than a terminal: one line a second, here of the first frame alone.
    assert lines[0] == (
        "    0.00 s  x +1.000  y -0.200  z 1.500 m  heading   +5.7 deg or turned round  score 0.90"
    )
    assert lines[1:5] == [
        "located: 2 of 5 frames of folder f, the heading certain in 1",
        "slips: the heading was turned round 1 times",
        "not located: 2 frames, occluded",
        "not located: 1 frames, nothing in view",
    ]
    assert lines[5].startswith("time: ")
    assert lines[6:] == ["table: o/located.csv", "recording: o/located.mcap"]


def test_of_no_frame_no_time_is_told():
    counted = {"tracked": 0, "frames": 0, "slips": 0, "reasons": {}, "frame_ms": math.nan}
    said = in_words({**counted, "table": "t.csv", "recording": "r.mcap"}, "simulated room 0")
    assert said.splitlines() == [
        "located: 0 of 0 frames of simulated room 0", "table: t.csv", "recording: r.mcap"
    ]  # fmt: skip


def test_for_programs_standard_output_is_one_line_of_json(pretended):
    said = pretended("locate", "--folder", "f", "--site", "s", "--out", "o", "--json")
    (line,) = said.out.splitlines()
    told = json.loads(line)
    assert told.pop("frame_ms") >= 0.0
    assert told == {
        "frames": 5,
        "tracked": 2,
        "tracked_share": 0.4,
        "heading_certain": 1,
        "slips": 1,
        "reasons": {"occluded": 2, "nothing in view": 1},
        "recording": "o/located.mcap",
        "table": "o/located.csv",
    }


def test_every_frame_is_in_the_table_and_in_the_recording(pretended):
    pretended("locate", "--folder", "f", "--site", "s", "--out", "o", "--frames")
    with Path("o/located.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["stamp_s"]) for row in rows] == [k / 30 for k in range(5)]
    first, third = rows[0], rows[2]
    assert [float(first[name]) for name in ("x_m", "y_m", "z_m")] == [1.0, -0.2, 1.5]
    assert float(first["yaw_deg"]) == pytest.approx(math.degrees(0.1), abs=1e-3)
    spread = [float(first[name]) for name in ("sd_x_m", "sd_y_m", "sd_z_m", "sd_yaw_deg")]
    assert spread == [0.001, 0.002, 0.003, 0.5]
    assert (first["score"], first["heading_certain"], first["reason"]) == ("0.900", "no", "")
    assert (third["x_m"], third["sd_yaw_deg"], third["reason"]) == ("", "", SCRIPT[2].reason)
    recording = read_depth_recording(Path("o/located.mcap"))
    assert recording.count == 5
    frames = list(recording.frames())
    assert np.array_equal(frames[0].depth, depth([], 50))
    located = list(recording.located())
    assert [list(one.position) for one in located] == [[1.0, -0.2, 1.5], [1.1, -0.2, 1.5], [], [], []]
    assert [one.reason for one in located] == [one.reason for one in SCRIPT]


def test_what_was_recorded_with_its_frames_can_be_located_again(pretended):
    pretended("locate", "--folder", "f", "--site", "s", "--out", "o", "--frames")
    said = pretended("locate", "--recording", "o/located.mcap", "--site", "s", "--out", "p", "--json")
    assert said.last_json["frames"] == 5


def test_frames_are_recorded_as_they_came_so_that_a_lens_is_taken_out_once(pretended, monkeypatch):
    known = load_camera(Path("s"))
    save_camera(Path("s"), SiteCamera(known.camera, Lens(-0.3, 0.1)))
    pretended("locate", "--folder", "f", "--site", "s", "--out", "o", "--frames")
    recorded = list(read_depth_recording(Path("o/located.mcap")).frames())
    assert all(np.array_equal(frame.depth, depth([], 50 + k)) for k, frame in enumerate(recorded))
    seen = [made.seen for made in pretended.made]
    pretended("locate", "--recording", "o/located.mcap", "--site", "s", "--out", "p")
    assert not np.array_equal(seen[0][0], recorded[0].depth)
    assert all(np.array_equal(*pair) for pair in zip(seen[0], pretended.made[-1].seen, strict=True))


def test_depth_frames_are_not_recorded_unless_asked_for(pretended):
    pretended("locate", "--folder", "f", "--site", "s", "--out", "o")
    said = pretended("locate", "--recording", "o/located.mcap", "--site", "s")
    assert said.err.startswith("noctule: recording o/located.mcap: it holds no whole depth frame")


def test_the_offset_of_the_site_is_taken_off_and_the_detector_is_the_one_asked_for(pretended):
    known = load_camera(Path("s"))
    save_camera(Path("s"), SiteCamera(known.camera, known.lens, np.array([0.01, -0.02, 0.03])))
    pretended("locate", "--folder", "f", "--site", "s", "--out", "o", "--detector", "cubics")
    (locator,) = pretended.made
    assert locator.offset.tolist() == [0.01, -0.02, 0.03]
    assert locator.detector.name == "cubics"
    pretended("locate", "--folder", "f", "--site", "s", "--out", "o")
    assert pretended.made[-1].detector.name == "band"


def test_a_drone_that_was_never_seen_is_exit_code_1(pretended, monkeypatch):
    monkeypatch.setitem(globals(), "SCRIPT", [lost(k / 30, "nothing in view: x") for k in range(5)])
    assert pretended("locate", "--folder", "f", "--site", "s", "--out", "o").code == 1


@pytest.mark.parametrize("file", ["camera.toml", "background.npz", "detector.toml", "template.npz"])
def test_a_site_without_one_of_its_files_is_one_line(pretended, file):
    Path("s", file).unlink()
    said = pretended("locate", "--folder", "f", "--site", "s", "--out", "o")
    assert said.code == 2
    assert said.err.startswith(f"noctule: site file s/{file}: is missing; ")
    assert said.err.count("\n") == 1
    assert not Path("o").exists()


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_on_a_terminal_one_line_is_rewritten():
    terminal = Terminal()
    status = Status(json=False, out=terminal)
    status.show(SCRIPT[0])
    status.show(SCRIPT[1])  # too soon for the eye
    status.end()
    shown = terminal.getvalue()
    assert shown == f"\r\x1b[K{status_line(SCRIPT[0])[:79]}\n"


def test_elsewhere_a_line_a_second_of_the_stream_is_printed_and_none_before_json():
    out = io.StringIO()
    status = Status(json=False, out=out)
    for k in range(61):
        status.show(tracked(k / 30, 1.0, 0.0))
    assert [line.split()[0] for line in out.getvalue().splitlines()] == ["0.00", "1.00", "2.00"]
    silent = io.StringIO()
    Status(json=True, out=silent).show(SCRIPT[0])
    assert silent.getvalue() == ""


def test_a_lost_drone_is_shown_with_the_reason():
    assert status_line(SCRIPT[4]) == (
        "    0.13 s  lost: nothing in view: no foreground is as large as a drone"
    )


def test_errors_against_the_truth_go_round_the_circle():
    truth = {k / 30: Pose(np.array([1.0, -0.2, 1.49]), math.pi - 0.01) for k in range(2)}
    tally = Tally(truth)
    tally.add(tracked(0.0, 1.002, -math.pi + 0.02), 0.4)
    tally.add(tracked(1 / 30, 0.998, math.pi - 0.01), 0.6)
    errors = tally.summary()["errors"]
    assert errors["position_rms_m"] == pytest.approx(math.hypot(0.002, 0.01))
    assert (errors["x_mean_m"], errors["x_sd_m"]) == pytest.approx((0.0, 0.002))
    assert (errors["z_mean_m"], errors["z_sd_m"]) == pytest.approx((0.01, 0.0))
    assert errors["yaw_mean_deg"] == pytest.approx(math.degrees(0.015))
    assert errors["yaw_sd_deg"] == pytest.approx(math.degrees(0.015))
    assert tally.summary()["frame_ms"] == pytest.approx(0.5)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory) -> Path:
    return leave_simulated_site(tmp_path_factory.mktemp("sites") / "lab")


def test_the_drone_of_the_simulated_room_is_located_to_millimetres(noctule, simulated):
    told = noctule(
        "locate", "--simulated", "--seconds", "1.5", "--site", str(simulated), "--out", "o", "--json"
    ).last_json
    assert told["tracked"] >= 42
    assert set(told["reasons"]) <= {"confirming"}
    assert told["errors"]["position_rms_m"] < 0.02
    assert told["errors"]["yaw_sd_deg"] < 3.0


def test_the_offset_of_a_standing_drone_is_found_and_kept(noctule, simulated):
    stand = ("--flight", "stand", "--seconds", "1.5", "--out", "stand.mcap")
    assert noctule("calibrate", "record", "--simulated", *stand).code == 0
    recorded = ("calibrate", "offset", "--recording", "stand.mcap", "--site", str(simulated), "--out", "o")
    said = noctule(*recorded, "--height", "1.22", "--at", "0.01,0")
    assert (said.code, said.err) == (0, "")
    assert said.out.startswith("offset: measured minus true is x -")
    # It stands 10 mm less ahead and 20 mm lower than was said.
    offset = load_camera(Path("o")).offset
    assert offset == pytest.approx([STAND[0] - 0.01, STAND[1], STAND[2] - 1.22], abs=0.008)
    told = noctule(*recorded, "--height", "1.2", "--json").last_json
    assert told["offset_m"][:2] == [0.0, 0.0]
    assert load_camera(simulated).offset.tolist() == [0.0, 0.0, 0.0]


PLACES = [
    (["--height", "0.6", "--at", "here"], "--at is 'here', expected x,y [m], as 0.5,-1"),
    (["--height", "0.6", "--at", "1,2,3"], "--at is '1,2,3', expected x,y [m], as 0.5,-1"),
    (["--height", "-1"], "--height is -1, expected 0 to 10 m"),
]


@pytest.mark.parametrize(("options", "message"), PLACES)
def test_a_place_that_cannot_be_is_one_line(noctule, options, message):
    said = noctule("calibrate", "offset", "--simulated", "--site", "s", *options)
    assert (said.code, said.err) == (2, f"noctule: {message}\n")


def test_a_drone_that_was_not_seen_has_no_offset(pretended, monkeypatch):
    monkeypatch.setitem(globals(), "SCRIPT", [lost(k / 30, "nothing in view: x") for k in range(5)])
    before = Path("s/camera.toml").read_bytes()
    said = pretended("calibrate", "offset", "--folder", "f", "--site", "s", "--height", "0.5")
    assert said.code == 2
    assert said.err.startswith("noctule: offset: place 1: the drone was measured 0 times, expected 30")
    assert Path("s/camera.toml").read_bytes() == before
