"""A person's mistake is one line on stderr, with the nearest right word; exit code 2, never a traceback."""

from __future__ import annotations

import json

import pytest

COMMANDS = "fly, missions, experiment, report, doctor, teach, locate, identify, ..."


@pytest.mark.parametrize(
    ("tokens", "line"),
    [
        (
            ["fli"],
            f'unknown command "fli". Did you mean "fly"? Available commands: {COMMANDS}; '
            "see `noctule --help`",
        ),
        (["--bad"], f'unknown command "--bad". Available commands: {COMMANDS}; see `noctule --help`'),
        (["fly", "--lawx", "a"], "unknown option --lawx, did you mean --law?; see `noctule fly --help`"),
        (["fly", "--sed=3"], "unknown option --sed, did you mean --seed?; see `noctule fly --help`"),
        (["fly", "--qqqqqqqq"], "unknown option --qqqqqqqq; see `noctule fly --help`"),
        (["fly", "a", "b"], "unexpected argument 'b'; see `noctule fly --help`"),
        (
            ["fly", "--law", "noctul"],
            'invalid value "noctul" for --law. Choose from: "noctule", "published". Did you mean "noctule"?; '
            "see `noctule fly --help`",
        ),
        (
            ["fly", "--seed", "1.5"],
            "invalid value for --seed: '1.5' is not a seed, expected a whole number from 0 to 999999999; "
            "see `noctule fly --help`",
        ),
        (
            ["fly", "--seed", "-1"],
            "invalid value for --seed: '-1' is not a seed, expected a whole number from 0 to 999999999; "
            "see `noctule fly --help`",
        ),
        (
            ["fly", "--attitude-sd", "much"],
            'invalid value for --attitude-sd: unable to convert "much" into float; see `noctule fly --help`',
        ),
        (
            ["fly", "--seed"],
            'command "fly" parameter --seed requires an argument; see `noctule fly --help`',
        ),
        (
            ["fly", "--attitude-sd", "9"],
            "--attitude-sd: input should be less than or equal to 5, found 9.0",
        ),
        (
            ["experiment", "servo-5.1", "--attitude-sd", "-1"],
            "--attitude-sd: input should be greater than or equal to 0, found -1.0",
        ),
        (
            ["experiment", "servo-5.1", "--laps", "2"],
            "--laps belongs to servo-5.3 and servo-5.3-ff, found with servo-5.1; leave it out",
        ),
        (
            ["experiment", "servo-5.2", "--latency", "0.1"],
            "--latency belongs to servo-5.3 and servo-5.3-ff, found with servo-5.2; leave it out",
        ),
        (
            ["experiment", "servo-5.2", "--columns", "--seeds", "0:2"],
            "--columns belongs to servo-5.3 and servo-5.3-ff, found with servo-5.2; leave it out",
        ),
        (
            ["experiment", "servo-5.3", "--laps", "0"],
            "--laps: input should be greater than or equal to 1, found 0",
        ),
        (
            ["experiment", "servo-5.3", "--latency", "-0.1"],
            "--latency: input should be greater than or equal to 0, found -0.1",
        ),
        (["fly", "--attitude-sd", "nan"], "--attitude-sd: input should be a finite number, found nan"),
        (["fly", "--time-limit", "-3"], "--time-limit: input should be greater than 0, found -3.0"),
        (["fly", "two-colums"], "there is no mission 'two-colums'; did you mean two-columns?"),
        (
            ["fly", "--seeds", "0-3"],
            "--seeds is '0-3', expected A:B with whole numbers; 0:10 is the seeds 0 to 9",
        ),
        (
            ["fly", "--seeds", "5:5"],
            "--seeds is '5:5', which is 0 seeds, expected 1 to 10000; 0:10 is the seeds 0 to 9",
        ),
        (
            ["fly", "--seed", "3", "--seeds", "0:2"],
            "--seed 3 and --seeds 0:2 are both given, expected one; leave one out",
        ),
        (
            ["experiment", "servo-5.1", "--wrong-model", "0.3"],
            "--wrong-model does not belong to servo-5.1; leave it out",
        ),
        (
            ["experiment", "loc-fusion", "--hide", "5"],
            "--hide does not belong to loc-fusion; leave it out",
        ),
        (
            ["experiment", "loc-1", "--laps", "2"],
            "--laps does not belong to loc-1; leave it out",
        ),
        (
            ["experiment", "loc-1", "--person"],
            "--person does not belong to loc-1; leave it out",
        ),
        (
            ["experiment", "loc-1", "--wrong-model", "1"],
            "--wrong-model: input should be less than or equal to 0.9, found 1.0",
        ),
        (
            ["experiment", "loc-3", "--command-delay", "0.35"],
            "loc-3: vehicle: its commands take effect after 0.35 s, the cascade was shown to be stable up to "
            "0.30 s; mend the link, or lower K and raise longest_delay_s after trying it in simulation",
        ),
        (
            ["experiment", "servo-5"],
            'invalid value "servo-5" for NAME. Choose from: "servo-5.1", "servo-5.2", "servo-5.3", '
            '"servo-5.3-ff", "loc-detection", "loc-pose", "loc-identification", "loc-fusion", '
            '"loc-1", "loc-2", "loc-3". Did you mean "servo-5.3"?; '
            "see `noctule experiment --help`",
        ),
        (
            ["experiment"],
            'command "experiment" parameter NAME requires an argument; see `noctule experiment --help`',
        ),
        (["report"], "no recording given, expected a .mcap file or the folder of a flight"),
        (
            ["report", "a.mcap", "b.mcap"],
            "2 recordings given, expected one; several are laid side by side only when each is the "
            "folder of a campaign flown with --seeds",
        ),
        (
            ["report", "."],
            "folder .: holds 0 recordings, expected one; name the .mcap file",
        ),
        (
            ["report", "nowhere.mcap"],
            "recording nowhere.mcap: cannot be read (No such file or directory); "
            "expected the .mcap file of a flight",
        ),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_mistake_is_one_line_and_exit_code_2(noctule, tokens, line):
    said = noctule(*tokens)
    assert said.err == f"noctule: {line}\n"
    assert said.out == ""
    assert said.code == 2


def test_with_json_a_mistake_is_told_as_json_too(noctule):
    said = noctule("fly", "two-colums", "--json")
    assert json.loads(said.out) == {"error": "there is no mission 'two-colums'; did you mean two-columns?"}
    assert said.code == 2


@pytest.mark.parametrize("command", ["fly", "missions", "doctor"])
def test_a_file_in_the_way_of_the_out_folder_is_named(noctule, tmp_path, command):
    (tmp_path / "taken").write_text("")
    said = noctule(command, "--out", "taken/here")
    assert said.err == (
        "noctule: folder taken/here: cannot be written (Not a directory), expected a folder for recordings; "
        "give another with --out\n"
    )
    assert said.code == 2


def test_every_mistake_in_a_mission_file_is_told(noctule, tmp_path):
    (tmp_path / "bad.toml").write_text('nam = "x"\n[path]\nposes = [[1, 0, 1, 0]]\n')
    said = noctule("fly", "bad.toml")
    assert "bad.toml" in said.err
    assert "nam" in said.err
    assert "name" in said.err
    assert said.code == 2


def test_ctrl_c_outside_a_flight_is_one_line_and_130(noctule, monkeypatch):
    def interrupted(name):
        raise KeyboardInterrupt

    monkeypatch.setattr("noctule.flight.mission.load_mission", interrupted)
    said = noctule("fly")
    assert said.err == "noctule: stopped by Ctrl-C\n"
    assert said.code == 130


def test_what_the_machine_refuses_is_one_line_and_1(noctule, monkeypatch):
    def full(name):
        raise OSError(28, "No space left on device", "flights/x")

    monkeypatch.setattr("noctule.flight.mission.load_mission", full)
    said = noctule("fly")
    assert said.err == "noctule: flights/x: No space left on device\n"
    assert said.code == 1
