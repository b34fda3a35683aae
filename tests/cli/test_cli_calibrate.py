"""`noctule calibrate`: what a person types, and what comes of it."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from cli_room import CAMERA, depth, flight, leave, leave_empty_room, leave_site

from noctule.camera import CEILING_CAMERA
from noctule.flight.depth_recording import DepthRecorder, read_depth_recording
from noctule.localization.detector_file import load_detectors
from noctule.localization.learning.template import LearnedTemplate, Round
from noctule.localization.site import SiteCamera, load_background, load_camera, save_background, save_camera
from noctule.localization.template import Template
from noctule.messages import DepthFrame
from noctule.vision.depth import learn_background

COMMANDS = ["camera", "background", "detector", "template", "offset", "record"]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_json_out_and_an_example_to_paste(noctule, command):
    said = noctule("calibrate", command, "--help")
    assert said.code == 0
    assert all(option in said.out for option in ("--json", "--out"))
    example = next(line for line in said.out.splitlines() if line.startswith("Example: "))
    assert shlex.split(example)[1:4] == ["noctule", "calibrate", command]
    if command != "camera":
        sources = ("--recording", "--folder", "--simulated", "--device", "--seed", "--hull", "--person")
        assert all(option in said.out for option in sources)


MISTAKES = [
    ([], "found none, expected exactly one of --recording FILE, --folder DIR, --simulated, --device NAME"),
    (
        ["--simulated", "--folder", "x"],
        "found --folder and --simulated, expected exactly one of --recording FILE, --folder DIR, "
        "--simulated, --device NAME",
    ),
    (["--recording", "x", "--seed", "1"], "--seed does not go with --recording; leave it out"),
    (["--folder", "x", "--hull"], "--hull does not go with --folder; leave it out"),
    (["--device", "x", "--markers"], "--markers does not go with --device; leave it out"),
    (["--device", "x", "--person"], "--person does not go with --device; leave it out"),
    (["--simulated", "--scale", "5000"], "--scale does not go with --simulated; leave it out"),
    (["--recording", "x", "--seconds", "3"], "--seconds does not go with --recording; leave it out"),
    (["--simulated", "--seconds", "0"], "--seconds is 0, expected above 0, up to 3600"),
]


@pytest.mark.parametrize(("options", "message"), MISTAKES)
def test_options_that_name_no_source_or_do_not_go_together_are_one_line(noctule, options, message):
    said = noctule("calibrate", "background", *options, "--out", "s")
    assert (said.code, said.err) == (2, f"noctule: calibrate background: {message}\n")
    assert not Path("s").exists()


def test_sources_that_are_not_there_are_one_line(noctule):
    leave_site(Path("s"))
    said = noctule("calibrate", "background", "--recording", "no.mcap", "--out", "s", "--json")
    line = (
        "recording no.mcap: cannot be read (No such file or directory); expected the .mcap file of a depth "
        "camera"
    )
    assert (said.code, said.err) == (2, f"noctule: {line}\n")
    assert said.last_json == {"error": line}
    assert noctule("calibrate", "background", "--folder", "no", "--out", "s").err.startswith(
        "noctule: folder no: there is no such folder"
    )
    assert noctule("calibrate", "background", "--device", "no", "--out", "s").err.startswith(
        "noctule: depth camera 'no' is not known"
    )


def test_an_empty_room_becomes_the_background_of_the_site(noctule):
    leave_site(Path("s"))
    leave_empty_room(Path("empty"))
    said = noctule("calibrate", "background", "--folder", "empty", "--out", "s")
    assert (said.code, said.err) == (0, "")
    assert said.out.splitlines() == [
        "background: learned from 20 frames of folder empty; nothing moved",
        "known: 100.0 % of the picture, usually 3.00 m away with a deviation of 13 mm",
        "site: s/background.npz",
    ]
    background = load_background(Path("s"), CAMERA)
    assert background.frames == 20
    assert np.median(background.mean) == pytest.approx(3000.0, abs=1.0)
    told = noctule("calibrate", "background", "--folder", "empty", "--out", "s", "--json").last_json
    assert told["background"] == "s/background.npz"
    assert (told["frames"], told["unusable"], told["known"]) == (20, {}, 1.0)


def test_a_room_in_which_something_moved_is_refused_and_the_old_background_stays(noctule):
    leave_site(Path("s"))
    leave_empty_room(Path("empty"))
    noctule("calibrate", "background", "--folder", "empty", "--out", "s")
    before = Path("s/background.npz").read_bytes()
    leave(Path("busy"), [depth([(0.03 * k - 0.3, 0.0, 0.5, 0.5, 0.4)], k) for k in range(20)])
    said = noctule("calibrate", "background", "--folder", "busy", "--out", "s")
    assert said.code == 2
    assert said.err.startswith("noctule: background: something moved between columns ")
    assert said.err.count("\n") == 1
    assert Path("s/background.npz").read_bytes() == before


def test_without_a_camera_the_background_has_no_home(noctule):
    leave_empty_room(Path("empty"))
    said = noctule("calibrate", "background", "--folder", "empty", "--out", "s")
    assert (said.code, said.err) == (
        2,
        "noctule: site file s/camera.toml: is missing; calibrate the camera with `noctule calibrate "
        "camera`\n",
    )


def test_the_simulated_room_brings_its_camera(noctule):
    said = noctule("calibrate", "background", "--simulated", "--seconds", "0.5", "--out", "s")
    assert (said.code, said.err) == (0, "")
    found = load_camera(Path("s")).camera
    assert found.intrinsics == CEILING_CAMERA.intrinsics
    assert found.R_world_camera == pytest.approx(CEILING_CAMERA.R_world_camera, abs=1e-12)
    assert found.t_world_camera == pytest.approx(CEILING_CAMERA.t_world_camera, abs=1e-12)
    said = noctule("calibrate", "background", "--simulated", "--person", "--seconds", "0.7", "--out", "s")
    assert said.code == 2
    assert "something moved" in said.err


def test_a_few_bad_frames_are_left_out_and_many_are_refused_by_name(noctule):
    leave_site(Path("s"))
    images = [depth([], k) for k in range(20)]
    images[3] = np.zeros((120, 160), np.uint16)
    images[4] = images[4] // 1000
    leave(Path("some"), images)
    said = noctule("calibrate", "background", "--folder", "some", "--out", "s")
    assert said.code == 0
    assert said.out.splitlines()[0] == (
        "background: learned from 18 frames of folder some (1 left out: all zero, 1 left out: wrong unit); "
        "nothing moved"
    )
    leave(Path("metres"), [image // 1000 for image in images])
    said = noctule("calibrate", "background", "--folder", "metres", "--out", "s")
    assert (said.code, said.err) == (
        2,
        "noctule: folder metres: 20 of 20 frames cannot be used: wrong unit: the usual depth is 3, expected "
        "about 3000 as far as the floor is [mm]; these look like metres, have the camera send millimetres, "
        "or give the --scale of the folder's images\n",
    )


def test_counts_of_another_scale_are_learned_with_the_scale(noctule):
    leave_site(Path("s"))
    leave(Path("tum"), [5 * depth([], k) for k in range(20)])
    said = noctule("calibrate", "background", "--folder", "tum", "--out", "s")
    assert "these look like fifths of a millimetre" in said.err
    assert noctule("calibrate", "background", "--folder", "tum", "--scale", "5000", "--out", "s").code == 0
    # Of these noise alone is left, which looks like something that moves.
    leave(Path("mm"), [depth([], k) for k in range(20)])
    said = noctule("calibrate", "background", "--folder", "mm", "--scale", "5000", "--out", "s")
    assert "wrong unit: the usual depth is 600, expected about 3000" in said.err
    assert "--scale" in said.err


def test_a_recording_of_another_camera_is_refused(noctule):
    leave_site(Path("s"))
    with DepthRecorder(Path("a.mcap"), CEILING_CAMERA) as recorder:
        recorder.frame(DepthFrame(0.0, np.full((480, 640), 3000, np.uint16)))
    said = noctule("calibrate", "background", "--recording", "a.mcap", "--out", "s")
    assert (said.code, said.err) == (
        2,
        "noctule: recording a.mcap: its camera has width 640 px, the site's camera.toml says 160; give the "
        "site of that camera\n",
    )


@pytest.fixture
def site(noctule):
    """A site with camera and background, beside the command."""
    leave_site(Path("s"))
    leave_empty_room(Path("empty"))
    assert noctule("calibrate", "background", "--folder", "empty", "--out", "s").code == 0
    return noctule


def test_a_flight_by_hand_becomes_the_detectors_and_fig_11(site):
    leave(Path("flight"), flight())
    said = site("calibrate", "detector", "--folder", "flight", "--site", "s")
    assert (said.code, said.err) == (0, "")
    lines = said.out.splitlines()
    assert lines[0].startswith(
        "detector: 150 frames show the drone whole and alone, of 150 frames of folder flight"
    )
    assert lines[1].startswith("altitudes: 0.4")
    assert lines[-1] == "site: s/detector.toml"
    detectors = load_detectors(Path("s"), CAMERA)
    assert detectors.band.smallest < 0.2 < detectors.band.largest
    told = site(
        "calibrate", "detector", "--folder", "flight", "--site", "s", "--out", "o", "--json"
    ).last_json
    assert told["detector"] == "o/detector.toml"
    assert told["samples"] == 150
    assert Path(told["figure"]).is_file()
    assert Path("o/detector.toml").read_bytes() == Path("s/detector.toml").read_bytes()


def test_a_flight_with_company_teaches_no_detector(site):
    leave(Path("flight"), flight(more=((-0.9, 1.1, 0.6, 0.3, 0.4),)))
    said = site("calibrate", "detector", "--folder", "flight", "--site", "s")
    assert said.code == 2
    assert said.err.startswith(
        "noctule: manual flight: 150 of 150 frames show a second thing beside the drone"
    )
    assert not Path("s/detector.toml").exists()


def test_a_flight_seen_by_a_moved_camera_teaches_nothing(site):
    lower = [np.where(image > 0, image - 250, 0).astype(np.uint16) for image in flight()]
    leave(Path("flight"), lower)
    said = site("calibrate", "detector", "--folder", "flight", "--site", "s")
    assert said.code == 2
    assert said.err.startswith("noctule: folder flight: 150 of 150 frames cannot be used: moved camera: ")


def test_a_detector_needs_a_background(noctule):
    leave_site(Path("s"))
    leave(Path("flight"), flight(10))
    said = noctule("calibrate", "detector", "--folder", "flight", "--site", "s")
    assert said.err == (
        "noctule: site file s/background.npz: is missing; learn the empty room with `noctule calibrate "
        "background`\n"
    )


def test_what_is_recorded_is_calibrated_from_later(noctule):
    said = noctule(
        "calibrate", "record", "--simulated", "--flight", "none", "--seconds", "0.5", "--out", "a.mcap"
    )
    assert (said.code, said.err) == (0, "")
    assert said.out.startswith("recording: a.mcap, 15 frames of simulated room 0, ")
    assert read_depth_recording(Path("a.mcap")).count == 15
    from_file = noctule("calibrate", "background", "--recording", "a.mcap", "--out", "file", "--json")
    assert from_file.last_json["frames"] == 15
    noctule("calibrate", "background", "--simulated", "--seconds", "0.5", "--out", "live")
    a, b = (load_background(Path(name), CEILING_CAMERA) for name in ("file", "live"))
    assert np.array_equal(a.mean, b.mean)
    assert np.array_equal(a.nearest, b.nearest)


def test_a_recording_is_not_overwritten(noctule):
    leave_empty_room(Path("empty"))
    assert (
        noctule("calibrate", "record", "--folder", "empty", "--out", "a.mcap", "--json").last_json["frames"]
        == 20
    )
    said = noctule("calibrate", "record", "--folder", "empty", "--out", "a.mcap")
    assert (said.code, said.err) == (
        2,
        "noctule: recording a.mcap: it is there already, and nothing is overwritten; choose another --out "
        "or remove it\n",
    )


@pytest.mark.parametrize("offset", [0.0, 0.003])
def test_a_template_learned_anew_says_that_the_offset_was_measured_with_another(noctule, monkeypatch, offset):
    n, folder = 8, Path("s")
    save_camera(folder, SiteCamera(CAMERA, offset=np.full(3, offset)))
    save_background(folder, learn_background([depth([], k) for k in range(12)]), CAMERA)
    leave(Path("f"), flight(30))
    maps = {name: np.full((n, n), 0.9) for name in ("probability", "variance", "height", "weight")}
    made = Template.from_arrays({"grid": np.array([0.02, 0.01]), "frames": np.array([9.0]), **maps})
    learned = LearnedTemplate(made, (Round(1.0, 9, 0.001, 0.001),), (), "axis", "start")
    monkeypatch.setattr("noctule.localization.learning.template.learn_template", lambda *_, **__: learned)
    monkeypatch.setattr("noctule.reports.template_figure.write_template_figure", lambda _, path: path)
    command = ("calibrate", "template", "--folder", "f", "--site", "s", "--start-yaw", "0")
    said = noctule(*command)
    assert said.code == 0, said.err
    hint = "next: noctule calibrate offset; that in camera.toml was measured with another template"
    assert (hint in said.out.splitlines()) == (offset > 0.0)
    assert json.loads(noctule(*command, "--json").out)["offset_outdated"] == (offset > 0.0)
