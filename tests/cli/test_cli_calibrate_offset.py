"""`noctule calibrate offset --places`: a drone that stands at several places, and what comes of it."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_room import leave, leave_simulated_site

from noctule.cli.app import run
from noctule.flight.depth_recording import read_depth_recording
from noctule.flight.depth_scene import STAND, Scene
from noctule.localization.site import (
    load_camera,
    load_site,
    load_template,
    locator_of,
    save_camera,
    save_template,
)

STOOLS = {"below": (0.1, -0.7, 0.7), "middle": (-0.4, 0.2, 0.7), "far": (0.4, 1.3, 0.8)}
BESIDE = {"beside": (0.4, -0.5, 0.7), "behind": (-0.1, -0.9, 0.7)}
HEADER = "recording,x,y,z\n"


def lines(*names: str) -> str:
    places = {**STOOLS, **BESIDE}
    return HEADER + "".join(f"{name}.mcap,{','.join(map(str, places[name]))}\n" for name in names)


@pytest.fixture(scope="module")
def taught(tmp_path_factory) -> Path:
    """A site and recordings of the drone on stools, as the command line records them."""
    folder = tmp_path_factory.mktemp("offset")
    leave_simulated_site(folder / "lab")
    (folder / "stools").mkdir()
    for name, (x, y, z) in {**STOOLS, **BESIDE}.items():
        file = folder / "stools" / f"{name}.mcap"
        stand = ("--flight", "stand", f"--at={x},{y}", "--height", str(z), "--seconds", "1.5")
        assert run(("calibrate", "record", "--simulated", *stand, "--out", str(file))) == 0
    return folder


@pytest.fixture
def room(noctule, taught):
    """A copy of the site beside the command, and a way to calibrate it."""
    shutil.copytree(taught / "lab", "lab")
    Path("stools").symlink_to(taught / "stools")

    def calibrate(text: str | None, *more: str):
        if text is None:
            return noctule("calibrate", "offset", "--site", "lab", *more)
        for name in STOOLS | BESIDE:
            link = Path("own", f"{name}.mcap")
            if not link.exists():
                link.parent.mkdir(exist_ok=True)
                link.symlink_to(taught / "stools" / link.name)
        Path("own/places.csv").write_text(text)
        return noctule("calibrate", "offset", "--site", "lab", "--places", "own/places.csv", *more)

    return calibrate


def contents(folder: str) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in Path(folder).iterdir()}


def errors_far_away(site: Path) -> float:
    """Return the rms [m] of x and y where no stool stood, far from below the camera."""
    off = []
    for place in ((-0.5, 1.2, 0.7), (0.9, 1.0, 0.7), (0.0, 1.3, 0.6), (-0.9, 0.8, 0.8)):
        scene = Scene("stand", seconds=1.2, at=place)
        locator = locator_of(load_site(site))
        seen = [locator.step(frame).measurement for frame in scene.frames()]
        off.append(np.mean([m.position for m in seen if m is not None], axis=0)[:2] - place[:2])
    return float(np.sqrt(np.mean(np.sum(np.square(off), axis=1))))


def test_several_places_find_the_slant_and_positions_far_away_are_better_for_it(room):
    below = STOOLS["below"]
    where = ("--recording", "stools/below.mcap", "--height", str(below[2]), f"--at={below[0]},{below[1]}")
    one = room(None, *where)
    assert (one.code, one.err) == (0, "")
    assert "slant: one place does not tell it; it stays 0\n" in one.out
    assert "next: a stool near x " in one.out
    before = errors_far_away(Path("lab"))
    several = room(lines(*STOOLS))
    assert (several.code, several.err) == (0, "")
    slant = load_template(Path("lab")).slant
    assert -0.02 < slant < -0.004
    assert errors_far_away(Path("lab")) < 0.5 * before
    said = several.out.splitlines()
    assert said[0].startswith("offset: measured minus true is x ")
    assert [" measurements in 45 frames of recording own/" in line for line in said[1:4]] == [True] * 3
    assert all(line.endswith(" mm left") for line in said[1:4])
    assert said[4].startswith("places: 3, which disagree by ")
    assert said[5] == (
        f"slant: seen from aside, positions are off by {1e3 * slant:+.1f} mm at 45 degrees; - is towards "
        "the camera"
    )
    assert said[6:] == ["site: lab/camera.toml, lab/template.npz"]
    # Found again from the site that knows it already, it is the same and not what was left.
    told = room(lines(*STOOLS), "--json").last_json
    assert (told["slant_m"], told["slant_told"], told["next_place_m"]) == (slant, True, None)
    assert told["offset_m"] == load_camera(Path("lab")).offset.tolist()
    assert [place["place_m"] for place in told["places"]] == [list(place) for place in STOOLS.values()]
    assert told["measured"] == sum(place["measured"] for place in told["places"]) > 90


def test_a_folder_of_images_is_as_good_as_a_recording(room):
    recorded = room(lines(*STOOLS), "--out", "o", "--json").last_json
    frames = read_depth_recording(Path("stools/far.mcap")).frames()
    leave(Path("own/far"), [2 * frame.depth for frame in frames])
    text = lines(*STOOLS).replace("far.mcap", "far")
    told = room(text, "--scale", "2000", "--out", "p", "--json").last_json
    assert told["places"][2]["source"] == "folder own/far"
    assert told["slant_m"] == pytest.approx(recorded["slant_m"], abs=1e-5)
    assert told["offset_m"] == pytest.approx(recorded["offset_m"], abs=1e-5)


def test_one_place_keeps_the_slant_that_was_found_before_and_says_so(room):
    known = load_template(Path("lab"))
    save_template(Path("lab"), replace(known, slant=-0.009))
    x, y, z = STOOLS["far"]
    far = ("--recording", "stools/far.mcap", "--height", str(z), f"--at={x},{y}")
    kept = contents("lab")["template.npz"]
    told = room(None, *far, "--json").last_json
    assert contents("lab")["template.npz"] == kept
    assert (told["slant_m"], told["slant_told"]) == (-0.009, False)
    assert len(told["next_place_m"]) == 3
    said = room(None, *far).out
    assert "it stays -9.0 mm at 45 degrees, and is taken off\n" in said
    save_template(Path("lab"), known)
    without = room(None, *far, "--out", "o", "--json").last_json
    assert without["offset_m"][1] < told["offset_m"][1] - 0.002  # it is towards the camera, which is to -y
    assert list(contents("o")) == ["camera.toml"]


def test_places_seen_from_one_side_say_where_the_next_stool_belongs(room):
    save_template(Path("lab"), replace(load_template(Path("lab")), slant=-0.009))
    said = room(lines("below", *BESIDE), "--out", "o")
    assert (said.code, said.err) == (0, "")
    assert said.out.splitlines()[-3] == (
        "slant: the places, all seen from much the same side, do not tell it; it stays -9.0 mm at 45 "
        "degrees, and is taken off"
    )
    assert said.out.splitlines()[-2].endswith("height 0.7 m would tell it best, see --places")
    assert load_template(Path("o")).slant == -0.009


WRONG = [
    ("", "own/places.csv: it is empty; its first line names the columns: recording,x,y,z"),
    ("a,b\n", "own/places.csv:1: the columns are a,b; expected recording,x,y,z"),
    (
        HEADER + "below.mcap,0.1,here,0.7\n",
        "own/places.csv:2: y is 'here'; expected a number, -100 to 100 [m]",
    ),
    (HEADER + "below.mcap,0.1,0,nan\n", "own/places.csv:2: z is 'nan'; expected a number, 0 to 10 [m]"),
    (HEADER + "below.mcap,0.1,0.7\n", "own/places.csv:2: 3 values, expected 4: recording,x,y,z"),
    (
        HEADER + "\nno.mcap,0.1,0,0.7\n",
        "own/places.csv:3: recording is 'no.mcap', and there is no own/no.mcap; expected an .mcap file or a "
        "folder of images, named as seen from the file of places",
    ),
    (
        HEADER + ",0.1,0,0.7\n",
        "own/places.csv:2: recording is ''; expected an .mcap file or a folder of images, named as seen from "
        "the file of places",
    ),
    (
        lines("below", "below", "far"),
        "own/places.csv:3: own/below.mcap was named before; expected a recording of its own for each place",
    ),
    (
        lines("below", "far"),
        "own/places.csv: 2 places, expected 3 or more; a single place is given by --recording, --height and "
        "--at",
    ),
    (
        lines("below", "middle") + "places.csv,0,1,0.7\n",
        "recording own/places.csv: this is no MCAP file; expected the .mcap file of a depth camera",
    ),
]


@pytest.mark.parametrize(("text", "message"), WRONG)
def test_a_file_of_places_with_a_mistake_is_one_line_and_nothing_is_written(room, text, message):
    before = contents("lab")
    said = room(text, "--out", "o", "--json")
    assert (said.code, said.err) == (2, f"noctule: {message}\n")
    assert said.last_json == {"error": message}
    assert contents("lab") == before
    assert not Path("o").exists()


def test_places_that_disagree_write_nothing(room):
    before = contents("lab")
    said = room(lines("below", "middle", "beside") + "far.mcap,0.3,1.35,0.8\n", "--out", "o")
    assert said.code == 2
    assert said.err.startswith("noctule: offset: the places disagree along x (")
    assert said.err.count("\n") == 1
    assert contents("lab") == before
    assert not Path("o").exists()


LIMIT = (
    "expected 150 mm or less along each (25 to 30 mm are usual); check where the drone stood (--at and "
    "--height, or the file of places: metres, and their signs), and where camera.toml says that the camera "
    "hangs"
)
MISTYPED = {
    "centimetres": ("0.7", "10,-70", r"x -9\d{3}, y \+69\d{3}, z [-+]\d mm"),
    "sign": ("0.7", "0.1,0.7", r"x [-+]\d, y -1[34]\d\d, z [-+]\d mm"),
    "height": ("1.7", "0.1,-0.7", r"x [-+]\d, y [-+]\d, z -(1000|99\d|100\d) mm"),
    "height alone": ("1.7", None, r"x \+0, y \+0, z -(1000|99\d|100\d) mm"),
}


@pytest.mark.parametrize(("height", "at", "found"), MISTYPED.values(), ids=MISTYPED)
def test_a_place_that_was_mistyped_is_one_line_and_nothing_is_written(room, height, at, found):
    before = contents("lab")
    where = ("--height", height, *([] if at is None else [f"--at={at}"]))
    said = room(None, "--recording", "stools/below.mcap", *where, "--out", "o", "--json")
    assert said.code == 2
    line = rf"offset: measured minus true is {found}, {re.escape(LIMIT)}"
    assert re.fullmatch(f"noctule: {line}\n", said.err)
    assert re.fullmatch(line, said.last_json["error"])
    assert contents("lab") == before
    assert not Path("o").exists()


def test_a_file_of_places_that_is_wrong_everywhere_alike_writes_nothing(room):
    before = contents("lab")
    rows = [f"{name}.mcap,{x},{y},{z + 0.3}\n" for name, (x, y, z) in STOOLS.items()]
    said = room(HEADER + "".join(rows), "--out", "o")
    assert said.code == 2
    found = r"noctule: offset: measured minus true is x [-+]\d, y [-+]\d, z -(300|29\d|30\d) mm, "
    assert re.fullmatch(found + re.escape(LIMIT) + "\n", said.err)
    assert contents("lab") == before
    assert not Path("o").exists()


def test_a_site_whose_offset_cannot_be_is_refused_until_it_is_measured_again(noctule, room):
    known = load_camera(Path("lab"))
    save_camera(Path("lab"), replace(known, offset=np.array([0.0, -1.3968, 0.0])))
    said = noctule("locate", "--simulated", "--seconds", "0.2", "--site", "lab", "--out", "l")
    assert (said.code, said.err) == (
        2,
        "noctule: site file lab/camera.toml: offset is 0, -1.397, 0 m, expected 0.15 m or less along each "
        "axis; measure it again with `noctule calibrate offset`, or set it to [0.0, 0.0, 0.0]\n",
    )
    x, y, z = STOOLS["below"]
    where = ("--recording", "stools/below.mcap", "--height", str(z), f"--at={x},{y}")
    assert room(None, *where).code == 0
    assert np.abs(load_camera(Path("lab")).offset).max() < 0.01
    assert noctule("locate", "--simulated", "--seconds", "0.2", "--site", "lab", "--out", "l").code == 0


def test_the_simulated_drone_stands_where_it_is_said_to(room):
    x, y, z = STOOLS["middle"]
    place = ("--height", str(z), f"--at={x},{y}")
    simulated = room(None, "--simulated", "--seconds", "1.5", *place, "--json").last_json
    recorded = room(None, "--recording", "stools/middle.mcap", *place, "--json").last_json
    assert simulated == recorded  # the same frames, bit for bit
    assert np.abs(simulated["offset_m"]).max() < 0.02
    assert load_camera(Path("lab")).offset.tolist() == simulated["offset_m"]


def test_a_simulated_drone_whose_x_and_y_are_not_said_stands_in_the_middle_as_high_as_said(room):
    told = room(None, "--simulated", "--seconds", "1.5", "--height", "0.7", "--json").last_json
    assert told["offset_m"][:2] == [0.0, 0.0]
    assert abs(told["offset_m"][2]) < 0.01
    said = room(None, "--simulated", "--seconds", "1.5", "--height", "0.7", "--at", "0,0", "--json").last_json
    assert said["offset_m"][2] == told["offset_m"][2]  # it stood at 0, 0
    assert said["offset_m"][:2] != [0.0, 0.0]


@pytest.mark.parametrize(("at", "height"), [("9,9", "1.2"), ("0,0", "3.2"), ("0,0", "9")])
def test_a_place_that_the_simulated_camera_does_not_see_is_one_line(noctule, at, height):
    said = noctule("calibrate", "offset", "--simulated", "--site", "s", "--at", at, "--height", height)
    x, y = at.split(",")
    assert (said.code, said.err) == (
        2,
        f"noctule: calibrate offset: the simulated camera does not see the whole drone at x {x}, y {y}, "
        f"height {height} m; expected a place nearer to the middle of its picture\n",
    )


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--height", "1"], "--height does not go with --places; leave it out"),
        (["--at", "0,1"], "--at does not go with --places; leave it out"),
        (["--simulated"], "--simulated does not go with --places; leave it out"),
        (["--seconds", "3"], "--seconds does not go with --places; leave it out"),
    ],
)
def test_places_bring_their_own_recordings(noctule, more, message):
    said = noctule("calibrate", "offset", "--site", "s", "--places", "p.csv", *more)
    assert (said.code, said.err) == (2, f"noctule: calibrate offset: {message}\n")


def test_a_file_of_places_that_is_not_there_and_no_place_at_all_are_one_line(noctule):
    said = noctule("calibrate", "offset", "--site", "s", "--places", "no.csv")
    assert (said.code, said.err) == (
        2,
        "noctule: no.csv: cannot be read (No such file or directory); expected a .csv file of places: "
        "recording,x,y,z\n",
    )
    Path("b.csv").write_bytes(b"\xff\xfe")
    said = noctule("calibrate", "offset", "--site", "s", "--places", "b.csv")
    assert said.err == "noctule: b.csv: it is not UTF-8 text; save it as UTF-8\n"
    said = noctule("calibrate", "offset", "--site", "s", "--simulated")
    assert (said.code, said.err) == (
        2,
        "noctule: calibrate offset: found no --height, expected that of the place where the drone stands, or "
        "several places with --places FILE\n",
    )


def test_a_drone_on_the_floor_is_measured_below_the_camera_and_named_aside_of_it(room):
    def said(at: str):
        floor = ("--flight", "stand", f"--at={at}", "--height", "0.05", "--seconds", "2")
        assert run(("calibrate", "record", "--simulated", *floor, "--out", f"./{at}.mcap")) == 0
        return room(None, "--recording", f"./{at}.mcap", f"--at={at}", "--height", "0.05", "--json")

    below = said("0.1,-0.7")
    assert below.code == 0
    assert abs(below.last_json["offset_m"][2]) < 0.005
    aside = said("-0.3,1.2")
    assert (aside.code, aside.err.count("\n")) == (2, 1)
    assert "a drone 0.05 m above the floor was measured" in aside.err
    assert aside.err.endswith("put it below the camera, or on a stool of 0.2 m or more\n")


def test_the_simulated_drone_stands_where_it_is_put(noctule, taught):
    middle = next(read_depth_recording(taught / "stools" / "middle.mcap").frames())
    again = next(Scene("stand", seconds=1.5, at=STOOLS["middle"]).frames())
    usual = next(Scene("stand", seconds=1.5).frames())
    assert np.array_equal(middle.depth, again.depth)
    assert not np.array_equal(middle.depth, usual.depth)
    poses = [pose for _, pose in Scene("stand", seconds=1.0, at=(0.1, 0.2, 0.3)).poses()]
    assert {tuple(pose.position) for pose in poses} == {(0.1, 0.2, 0.3)}
    stand = ("calibrate", "record", "--simulated", "--flight", "stand", "--seconds", "0.1")
    assert noctule(*stand, "--at", f"{STAND[0]},{STAND[1]}", "--out", "a.mcap").code == 0
    assert np.array_equal(
        next(read_depth_recording(Path("a.mcap")).frames()).depth,
        next(Scene("stand", seconds=0.1).frames()).depth,
    )


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--simulated", "--at", "0,0"], "--at goes with --flight stand alone; leave it out"),
        (["--simulated", "--height", "1"], "--height goes with --flight stand alone; leave it out"),
        (
            ["--recording", "x", "--flight", "stand", "--height", "1"],
            "--at and --height go with --simulated alone; leave them out",
        ),
        (
            ["--simulated", "--flight", "stand", "--at", "9,9"],
            "the simulated camera does not see the whole drone at x 9, y 9, height 1.2 m; expected a place "
            "nearer to the middle of its picture",
        ),
    ],
)
def test_a_place_that_the_simulated_drone_cannot_take_is_one_line(noctule, more, message):
    said = noctule("calibrate", "record", *more, "--out", "a.mcap")
    assert (said.code, said.err) == (2, f"noctule: calibrate record: {message}\n")
    assert not Path("a.mcap").exists()
