"""`noctule teach` and `noctule path`: what a person types, and what comes of it."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest

from noctule.camera import PinholeCamera
from noctule.geometry import rot_y

CAMERA = PinholeCamera.centred(320, 240, 200.0)


def pan(degrees: float) -> np.ndarray:
    """A wall of blobs from a camera that has turned on the spot, BGR."""
    rng = np.random.default_rng(1)
    wall = np.full((500, 1400, 3), 90, dtype=np.uint8)
    for _ in range(1900):
        centre = tuple(int(v) for v in rng.integers(0, (1400, 500)))
        colour = tuple(int(v) for v in rng.integers(0, 255, 3))
        cv2.circle(wall, centre, int(rng.integers(2, 12)), colour, -1, cv2.LINE_AA)
    on_wall = np.array([[200.0, 0.0, 700.0], [0.0, 200.0, 250.0], [0.0, 0.0, 1.0]])
    H = CAMERA.K @ rot_y(np.radians(degrees)) @ np.linalg.inv(on_wall)
    return cv2.warpPerspective(wall, H, (320, 240))


def film(name: str, angles) -> None:
    writer = cv2.VideoWriter(name, cv2.VideoWriter_fourcc(*"MJPG"), 5.0, (320, 240))
    for angle in angles:
        writer.write(pan(angle))
    writer.release()


@pytest.fixture
def walk(noctule):
    """A video of a camera that turns, beside the command."""
    film("walk.avi", np.linspace(0.0, 30.0, 11))
    return noctule


def test_a_video_becomes_a_path_with_a_table_and_a_contact_sheet(walk):
    said = walk("teach", "--video", "walk.avi", "--focal", "200", "--out", "paths/walk")
    assert (said.code, said.err) == (0, "")
    lines = said.out.splitlines()
    assert lines[0] == "path paths/walk: 4 key images of 320x240 px"
    assert lines[1].split() == ["images", "shared", "parts", "one", "motion", "baseline", "turn"]
    assert lines[-2:] == ["sheet: paths/walk/contact-sheet.png", "path: paths/walk"]
    assert "image 0 at 0.00 s: first" in lines
    assert "image 3 at 2.00 s: last" in lines
    assert cv2.imread("paths/walk/contact-sheet.png") is not None
    assert walk("path", "check", "paths/walk").out == "path paths/walk: it can be repeated\n"


def test_for_programs_the_last_line_is_json(walk):
    said = walk("teach", "--video", "walk.avi", "--focal", "200", "--at", "0,1,2", "--out", "p", "--json")
    told = said.last_json
    assert told["path"] == "p"
    assert [one["stamp_s"] for one in told["taken"]] == [0.0, 1.0, 2.0]
    assert told["images"] == ["000.png", "001.png", "002.png"]
    assert [abs(link["turn_deg"]) for link in told["links"]] == pytest.approx([15.0, 15.0], abs=0.3)
    assert told["faults"] == []
    shown = walk("path", "show", "p", "--out", "sheet.png", "--json").last_json
    assert shown["links"] == told["links"]
    assert shown["contact_sheet"] == "sheet.png"
    assert Path("sheet.png").is_file()
    assert walk("path", "check", "p", "--json").last_json == {"path": "p", "ok": True, "faults": []}


def test_a_path_that_cannot_be_repeated_is_exit_code_2_and_one_line_a_fault(walk):
    said = walk("teach", "--video", "walk.avi", "--focal", "200", "--at", "0,0.2,2", "--out", "p")
    assert said.code == 0  # 27 degrees are still flown
    film("wide.avi", [0.0, 20.0, 62.0])
    said = walk("teach", "--video", "wide.avi", "--focal", "200", "--at", "0,0.2,0.4", "--out", "wide")
    assert said.code == 2
    (line,) = said.err.splitlines()
    assert line.startswith("noctule: images 001.png and 002.png: ")
    checked = walk("path", "check", "wide", "--json")
    assert (checked.code, checked.err) == (2, said.err)
    (fault,) = checked.last_json["faults"]
    assert fault["images"] == ["001.png", "002.png"]
    assert line.endswith(fault["what"])
    assert "cannot be flown" in walk("path", "show", "wide").out


def test_the_camera_can_be_a_file(walk):
    Path("camera.toml").write_text(
        "width = 320\nheight = 240\nfx = 200.0\nfy = 200.0\ncx = 159.5\ncy = 119.5\nstabilised = true\n"
    )
    assert walk("teach", "--video", "walk.avi", "--camera", "camera.toml", "--out", "p").code == 0
    from noctule.flight import load_path

    path = load_path(Path("p"))
    assert (path.camera, path.mount.stabilised) == (CAMERA, True)


def test_a_path_is_not_overwritten(walk):
    arguments = ("teach", "--video", "walk.avi", "--focal", "200", "--at", "0,1", "--out", "p")
    assert walk(*arguments).code == 0
    said = walk(*arguments)
    assert said.code == 2
    assert said.err == (
        "noctule: path p: this folder is not empty, and teaching overwrites nothing; choose another --out or "
        "remove it\n"
    )


def test_waypoints_are_flown_in_the_room_of_the_mission_without_its_columns(noctule, monkeypatch):
    Path("way.toml").write_text("poses = [[0.5, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 0.0]]\n")
    asked = []

    def take_path(mission, seed, folder):
        from noctule.flight.path_folder import Shot, save_path

        asked.append((mission.name, mission.path.poses, seed))
        shots = [Shot(cv2.cvtColor(pan(a), cv2.COLOR_BGR2RGB)) for a in (0.0, 8.0)]
        save_path(folder, shots, CAMERA, mission.camera.mount)

    monkeypatch.setattr(import_module("noctule.flight.teach"), "take_path", take_path)
    said = noctule("teach", "--waypoints", "way.toml", "--seed", "4", "--out", "p")
    assert said.code == 0, said.err
    assert asked == [("two-columns", ((0.5, 0.0, 1.0, 0.0), (1.0, 0.0, 1.0, 0.0)), 4)]


MESSAGES = [
    (
        [],
        "found none, expected exactly one of --waypoints, --keyboard, --keys, --recording, --video, --device",
    ),
    (
        ["--video", "a.avi", "--device", "0"],
        "found --video and --device, expected exactly one of --waypoints, --keyboard, --keys, --recording, "
        "--video, --device",
    ),
    (
        ["--video", "a.avi"],
        "--video needs the intrinsics of its camera, by exactly one of --camera FILE and --focal PX",
    ),
    (
        ["--device", "0", "--focal", "300", "--camera", "c.toml"],
        "--device needs the intrinsics of its camera, by exactly one of --camera FILE and --focal PX",
    ),
    (["--video", "a.avi", "--focal", "0"], "--focal is 0, expected 1 to 100000 px"),
    (["--device", "-1", "--focal", "300"], "--device is -1, expected 0 or more"),
    (
        ["--device", "0", "--focal", "300", "--seconds", "0"],
        "--seconds is 0, expected above 0, up to 3600",
    ),
    (
        ["--recording", "a.mcap", "--stabilised"],
        "--stabilised goes with --focal; a camera file says it itself",
    ),
    (["--recording", "a.mcap", "--focal", "300"], "--focal does not go with --recording; leave it out"),
    (["--recording", "a.mcap", "--mission", "x"], "--mission does not go with --recording; leave it out"),
    (["--waypoints", "a.toml", "--at", "0,1"], "--at does not go with --waypoints; leave it out"),
    (["--waypoints", "a.toml", "--no-preview"], "--no-preview does not go with --waypoints; leave it out"),
    (["--keys", "a.txt", "--no-preview"], "--no-preview does not go with --keys; leave it out"),
    (["--keys", "a.txt", "--focal", "300"], "--focal does not go with --keys; leave it out"),
    (
        ["--keyboard", "--keys", "a.txt"],
        "found --keyboard and --keys, expected exactly one of --waypoints, --keyboard, --keys, --recording, "
        "--video, --device",
    ),
    (
        ["--keyboard", "--at", "0,1"],
        "--at is '0,1', with --keyboard expected keys: images where space is pressed",
    ),
    (
        ["--video", "a.avi", "--focal", "300", "--seed", "1"],
        "--seed does not go with --video; leave it out",
    ),
]


@pytest.mark.parametrize(("options", "message"), MESSAGES)
def test_options_that_do_not_go_together_are_one_line(noctule, options, message):
    said = noctule("teach", *options, "--out", "p")
    assert (said.code, said.err) == (2, f"noctule: teach: {message}\n")
    assert not Path("p").exists()


@pytest.mark.parametrize("command", ["show", "check"])
def test_path_commands_have_help_with_an_example_to_paste(noctule, command):
    said = noctule("path", command, "--help")
    assert said.code == 0
    assert "--json" in said.out
    assert f"Example: noctule path {command} " in said.out


def test_a_folder_that_is_no_path_is_one_line(noctule):
    for command in ("show", "check"):
        said = noctule("path", command, "nowhere")
        assert (said.code, said.err) == (
            2,
            "noctule: path file nowhere/path.toml: cannot be read (No such file or directory); teach the "
            "path again\n",
        )
