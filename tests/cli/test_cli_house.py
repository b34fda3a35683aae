"""The commands' help, start-up, and the commands that do not fly."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from cli_pretended import pretended_summary

import noctule
from noctule.cli import doctor as examination
from noctule.flight import bundled_missions, load_mission

COMMANDS = ["fly", "missions", "experiment", "report", "doctor", "teach"]


def test_without_a_command_the_help_is_shown(noctule):
    said = noctule()
    assert said.code == 0
    assert all(command in said.out for command in COMMANDS)


def test_the_version_is_the_packages(noctule):
    assert noctule("--version").out.strip() == "0.1.0"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_json_seed_out_and_an_example_to_paste(noctule, command):
    said = noctule(command, "--help")
    assert said.code == 0
    assert all(option in said.out for option in ("--json", "--seed", "--out"))
    example = next(line for line in said.out.splitlines() if line.startswith("Example: "))
    assert shlex.split(example)[1:3] == ["noctule", command]


def test_help_does_not_import_what_is_slow():
    slow = ("numpy", "cv2", "mujoco", "numba", "matplotlib", "joblib", "mcap", "foxglove")
    code = (
        "import sys, noctule.cli.app as app; app.run(['fly', '--help']);"
        f"print([m for m in {slow!r} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_python_m_noctule_is_the_command():
    done = subprocess.run([sys.executable, "-m", "noctule", "--version"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, f"{noctule.__version__}\n")


def test_missions_lists_every_bundled_mission_with_its_command(noctule):
    said = noctule("missions", "--json", "--seed", "4")
    listed = {entry["name"]: entry for entry in said.last_json["missions"]}
    assert {name: entry["description"] for name, entry in listed.items()} == bundled_missions()
    assert listed["two-columns"]["command"] == "noctule fly two-columns --seed 4"
    assert "noctule fly one-column\n" in noctule("missions").out


def test_missions_copies_files_that_fly_the_same(noctule):
    noctule("missions", "--out", "mine")
    for name in bundled_missions():
        copy = Path("mine") / f"{name}.toml"
        assert tomllib.loads(copy.read_text())["name"] == name
        assert load_mission(copy) == load_mission(name)


def test_report_takes_a_recording_or_the_folder_of_a_flight_or_a_seed_of_a_campaign(noctule, monkeypatch):
    asked = []

    def write_report(recording, out):
        asked.append((recording, out))
        return Path("page.html")

    monkeypatch.setattr("noctule.reports.write_report", write_report)
    flight = Path("one/seed-3")
    flight.mkdir(parents=True)
    (flight / "flight.mcap").touch()
    assert noctule("report", "one/seed-3/flight.mcap").out == "report: page.html\n"
    assert noctule("report", "one/seed-3", "--out", "there").code == 0
    assert noctule("report", "one", "--seed", "3", "--json").last_json == {"report": "page.html"}
    recording = flight / "flight.mcap"
    assert asked == [(recording, None), (recording, Path("there")), (recording, None)]


def leave_campaign(folder: str, law: str) -> None:
    """Leave what a campaign of two seeds leaves."""
    Path(folder).mkdir()
    runs = [{"seed": seed, **pretended_summary("reached", Path(folder, "x.mcap"))} for seed in (0, 1)]
    for run in runs:
        run["min_clearance_m"] = 0.2
    pooled = {**runs[0], "outcome": {"reached": 1.0}}
    Path(folder, "campaign.json").write_text(json.dumps({law: {"runs": runs, "summary": pooled}}))


def test_report_lays_campaigns_of_two_laws_side_by_side(noctule):
    leave_campaign("a", "noctule")
    leave_campaign("b", "published")
    said = noctule("report", "a", "b", "--out", "both", "--json")
    assert said.last_json == {"report": "both/campaign.html"}
    page = Path("both/campaign.html").read_text()
    assert "noctule" in page
    assert "published" in page


def test_report_refuses_the_same_law_twice_and_a_folder_that_is_no_campaign(noctule):
    leave_campaign("a", "noctule")
    leave_campaign("b", "noctule")
    said = noctule("report", "a", "b")
    assert said.err == "noctule: folder b: law 'noctule' is given twice, expected each law once\n"
    Path("c").mkdir()
    said = noctule("report", "a", "c")
    assert said.err == (
        "noctule: folder c: campaign.json cannot be read ([Errno 2] No such file or directory: "
        "'c/campaign.json'), expected the folder of a campaign\n"
    )
    assert said.code == 2


def test_doctor_leaves_a_picture_of_the_room_of_the_seed(noctule):
    cv2 = pytest.importorskip("cv2", reason="pictures are read with OpenCV")
    said = noctule("doctor", "--seed", "3", "--out", "look", "--json")
    assert said.code == 0, said.out
    assert said.last_json["ok"] is True
    names = [check["name"] for check in said.last_json["checks"]]
    assert names == ["Python", "packages", "compiled code", "disk", "drawing"]
    assert cv2.imread("look/room-3.png").shape == (480, 856, 3)


def test_doctor_says_in_one_line_what_to_install_when_opengl_is_missing(noctule, monkeypatch):
    from noctule.simulation import OpenGLError

    def missing(seed):
        raise OpenGLError("'NoneType' object has no attribute 'eglQueryString'")

    monkeypatch.setattr(examination, "_draw_room", missing)
    said = noctule("doctor")
    assert said.code == 1
    (line,) = [line for line in said.out.splitlines() if line.startswith("FAIL")]
    assert "apt-get install libegl1 libgl1-mesa-dri libgles2" in line


def test_doctor_tells_an_old_python_a_full_disk_and_a_missing_package(tmp_path):
    from importlib.metadata import PackageNotFoundError

    def nothing(name):
        raise PackageNotFoundError(name)

    python = examination.check_python((3, 10))
    assert (python.ok, python.found.endswith("; expected 3.11 to 3.13, install one of them")) == (False, True)
    disk = examination.check_disk(tmp_path, lambda folder: 100_000_000)
    assert disk.ok is False
    assert disk.found == (f"0.1 GB free in {tmp_path}, expected 0.5 GB; free some, or use --out elsewhere")
    packages = examination.check_packages(nothing)
    assert packages.ok is False
    assert packages.found.endswith("; run script/fly, or pip install noctule")


def test_doctor_tells_when_compiled_code_cannot_be_kept(monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/nowhere/at/all")
    check = examination.check_numba_cache()
    assert check.ok is False
    assert check.found == "/nowhere/at/all cannot be written; set NUMBA_CACHE_DIR to a folder of yours"
