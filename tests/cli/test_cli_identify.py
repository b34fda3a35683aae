"""`noctule identify` and `noctule experiment loc-identification`, with short flights."""

import json
from pathlib import Path

import numpy as np
import pytest

from noctule.cli.identifying import in_words
from noctule.estimation.identification import EXCITATIONS, validation_inputs
from noctule.experiments.loc_identification import DELAY, FULL_SCALE, RATE, axis_inputs, fly_inputs
from noctule.flight.recording import FlightRecorder, sent_message
from noctule.localization.vehicle_file import load_vehicle_model
from noctule.messages import Command, FlightState, VehicleState

T = np.arange(round(30.0 * RATE)) / RATE
TABLE_1 = (4.7202, 0.2660, 6.2330, 0.5328, 2.6504, 2.5761, 2.3788, 1.5216)


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """Half a minute on all axes, another, and half a minute on forward alone."""
    folder = tmp_path_factory.mktemp("flights")
    alone = np.column_stack([EXCITATIONS[0].inputs(T), np.zeros((T.size, 3))])
    fly_inputs(1, validation_inputs(T), 0.01, folder / "all.mcap")
    fly_inputs(2, -validation_inputs(T), 0.01, folder / "other.mcap")
    fly_inputs(3, alone, 0.01, folder / "forward.mcap")
    return folder


def test_it_tells_the_parameters_writes_the_model_and_draws(noctule, flights):
    said = noctule("identify", f"{flights}/all.mcap", "--validation", f"{flights}/other.mcap", "--out", "m")
    assert said.code == 0, said.err
    lines = said.out.splitlines()
    assert lines[0] == "identified by output-error: a = k_u u - k_v v"
    assert [line.split()[0] for line in lines[3:7]] == ["forward", "left", "up", "yaw"]
    assert next(line for line in lines if line.startswith("delay: ")).endswith(" ms")
    assert lines[-3:] == [
        "vehicle model: m/vehicle.toml",
        "figure: m/identification.png",
        "figure: m/validation.png",
    ]
    model = load_vehicle_model(Path("m/vehicle.toml"))
    assert np.abs((np.array(model.k) - TABLE_1) / TABLE_1).max() < 0.1
    assert model.delay_s == pytest.approx(DELAY, abs=0.005)
    assert model.full_scale == pytest.approx(tuple(FULL_SCALE))
    assert Path("m/identification.png").stat().st_size > 10_000
    assert Path("m/validation.png").stat().st_size > 10_000


def test_json_has_every_parameter_with_its_deviation_the_delay_and_the_fits(noctule, flights):
    found = noctule(
        "identify", f"{flights}/all.mcap", "--validation", f"{flights}/other.mcap", "--out", "m", "--json"
    ).last_json
    assert list(found["parameters"]) == [f"k{i}" for i in range(1, 9)]
    for one, true in zip(found["parameters"].values(), TABLE_1, strict=True):
        assert abs(one["estimate"] - true) < max(5.0 * one["sd"], 1e-3 * true)
    assert abs(found["delay_s"] - DELAY) < 5.0 * found["delay_sd_s"]
    assert min(found["fit"].values()) > 0.9
    assert min(found["validation_fit"].values()) > 0.9
    assert found["vehicle_model"] == "m/vehicle.toml"


def test_several_recordings_are_one_vehicle(noctule, flights):
    one = noctule("identify", f"{flights}/all.mcap", "--out", "a", "--json").last_json
    two = noctule(
        "identify", f"{flights}/all.mcap", f"{flights}/other.mcap", "--out", "b", "--json"
    ).last_json
    for name in ("k1", "k3", "k5"):
        assert two["parameters"][name]["sd"] < 0.85 * one["parameters"][name]["sd"]
    assert two["figures"] == ["b/identification-2.png", "b/identification.png"]


def test_the_published_method_finds_no_delay_and_is_biased(noctule, flights):
    said = noctule("identify", f"{flights}/all.mcap", "--method", "published", "--out", "m")
    assert "delay: taken for 0; this method finds none" in said.out
    assert abs(load_vehicle_model(Path("m/vehicle.toml")).k[1] / TABLE_1[1] - 1.0) > 0.3


def record(path, seconds, full_scale="[1, 1, 1, 1]", **changes):
    with FlightRecorder(path) as recorder:
        recorder.note("inputs", {"full_scale": full_scale})
        for k in range(round(seconds * RATE)):
            t = k / RATE
            told = {"yaw": 0.1 * t, "v_body": np.array([0.1, np.sin(t), 0.0]), **changes}
            command = Command(0.1 * np.sin(t), np.cos(t), np.sin(2 * t), np.cos(3 * t))
            message = sent_message(t, command, command, "flying", "send", "")
            recorder.tick(t, VehicleState(t, FlightState.FLYING, **told), None, (), None, message)


def test_mistakes_are_one_line(noctule, flights):
    record(Path("short.mcap"), 3.0)
    record(Path("silent.mcap"), 12.0, v_body=None)
    record(Path("other.mcap"), 12.0, "[2, 1, 1, 1]")
    record(Path("plain.mcap"), 12.0)
    record(Path("nan.mcap"), 12.0, v_body=np.array([0.1, np.nan, 0.0]))
    fly_inputs(1, np.zeros((450, 4)), 0.01, Path("hover.mcap"))
    scales = ("[2.0, 1.0, 1.0, 1.0]", "[1.0, 1.0, 1.0, 1.0]")
    cases = {
        (): "no recording given, expected the .mcap files of flights",
        ("none.mcap",): (
            "recording none.mcap: cannot be read (No such file or directory); "
            "expected the .mcap file of a flight"
        ),
        ("short.mcap",): (
            "recording short.mcap: flies for 3.0 s without a gap, expected at least 10 s; "
            "fly the deformed sinusoid, 82 s on each axis"
        ),
        ("silent.mcap",): (
            "recording silent.mcap: 360 of 360 reports of the vehicle are without velocities, expected "
            "velocities in all; the model is identified from them: fly a vehicle that reports them"
        ),
        ("plain.mcap", "other.mcap"): (
            f"recording other.mcap: an input of 1 is the command {scales[0]}, in plain.mcap it is "
            f"{scales[1]}; expected flights of one vehicle"
        ),
        ("nan.mcap",): (
            "recording nan.mcap: 360 of 360 reports of the vehicle have velocities not finite, the first "
            "0.1, nan, 0 at 0.000 s; expected finite numbers in all; the model is identified from them: "
            "mend what the vehicle reports and fly again"
        ),
        ("hover.mcap",): (
            "recording hover.mcap: what was sent is always the same, on every axis in 15 s of flight; "
            "expected inputs that vary: fly the deformed sinusoid on each axis"
        ),
        (f"{flights}/forward.mcap",): (
            "identification: nothing was sent on left and up and yaw; expected all of forward, left, up, yaw "
            "to be moved: fly the deformed sinusoid on each"
        ),
    }
    for tokens, message in cases.items():
        said = noctule("identify", *tokens)
        assert said.code == 2
        assert said.err == f"noctule: {message}\n"
    assert not Path("flights").exists()


def test_a_flight_counts_once_under_whatever_name(noctule, flights):
    one = flights / "all.mcap"
    copy, link = Path("copy.mcap"), Path("link.mcap")
    copy.write_bytes(one.read_bytes())
    link.symlink_to(one)
    for again in (one, flights / ".." / flights.name / "all.mcap", copy, link):
        said = noctule("identify", str(one), str(again), "--out", "m")
        assert said.code == 2
        assert said.err == (
            f"noctule: recording {again}: is given twice, before as {one}; expected each flight once: it "
            "would count twice, and deviations be too small; leave one out\n"
        )
        said = noctule("identify", str(one), "--validation", str(again), "--out", "m")
        assert said.code == 2
        assert said.err == (
            f"noctule: --validation {again}: is the recording {one} that the model is identified from; "
            "expected another flight: a model is not tried on what it was fitted to\n"
        )
    assert not Path("m").exists()


def shifted(path, reports, commands, noise=0.01):
    """Record half a minute whose reports and commands are stamped later by so many seconds."""
    flown = fly_inputs(7, validation_inputs(T), noise)
    with FlightRecorder(path) as recorder:
        recorder.note("inputs", {"full_scale": json.dumps(FULL_SCALE.tolist())})
        for stamp, inputs, v, yaw in zip(
            flown.stamps, flown.inputs, flown.velocities, flown.yaw, strict=True
        ):
            command = Command.from_array(inputs * FULL_SCALE)
            state = VehicleState(stamp + reports, FlightState.FLYING, yaw=yaw, v_body=v)
            now = stamp + commands
            recorder.tick(
                now, state, None, (), None, sent_message(now, command, command, "flying", "send", "")
            )


def test_reports_that_are_stamped_early_are_refused(noctule):
    shifted(Path("early.mcap"), -0.15, 0.0)
    said = noctule("identify", "early.mcap", "--out", "m")
    assert said.code == 2
    assert said.err.startswith("noctule: identification: the delay is -8")
    assert "the stamps of reports are early, or those of commands late; stamp both by one clock" in said.err
    assert not Path("m").exists()


@pytest.mark.parametrize(("late", "noted"), [(0.15, False), (0.35, True)])
def test_a_delay_with_which_no_path_can_be_followed_is_noted(noctule, late, noted):
    shifted(Path("late.mcap"), late, 0.0)
    said = noctule("identify", "late.mcap", "--out", "m")
    assert said.code == 0
    assert load_vehicle_model(Path("m/vehicle.toml")).delay_s == pytest.approx(DELAY + late, abs=0.005)
    note = (
        "note: the delay is longer than the 0.3 s that the path follower flies with; it will refuse this "
        "vehicle: mend the link"
    )
    assert (note in said.out.splitlines()) == noted


def test_a_model_worse_than_none_is_told_and_drawn_but_not_written(noctule):
    fly_inputs(3, axis_inputs(), 0.06, Path("noisy.mcap"))
    tokens = ("identify", "noisy.mcap", "--method", "published")
    said = noctule(*tokens, "--out", "m")
    assert said.code == 2
    assert said.err.startswith("noctule: identification: the fit is -")
    assert said.err.endswith(
        ", worse than the mean velocity; expected more than 0; vehicle.toml was not written: "
        "identify by output-error\n"
    )
    assert said.out.splitlines()[0] == "identified by published: a = k_u u - k_v v"
    assert said.out.splitlines()[-1] == "figure: m/identification.png"
    assert not Path("m/vehicle.toml").exists()
    told = noctule(*tokens, "--out", "m", "--json")
    assert told.code == 2
    assert len(told.out.splitlines()) == 1
    assert told.last_json["vehicle_model"] is None
    assert min(told.last_json["fit"].values()) < 0.0
    assert told.err == f"noctule: {told.last_json['error']}\n"


def test_an_axis_moved_too_little_is_named(noctule):
    inputs = validation_inputs(T)
    inputs[:, 1] *= 0.002
    flown = fly_inputs(5, inputs, 0.05, Path("little.mcap"))
    assert flown.moved == (True, True, True, True)
    said = noctule("identify", "little.mcap")
    assert said.code == 2
    assert said.err.startswith("noctule: identification of left: too little excitation, k")
    assert said.err.endswith("; fly the deformed sinusoid longer or larger\n")


def test_residuals_that_are_no_noise_are_told():
    flat = {"estimate": 1.0, "sd": 0.1}
    summary = {
        "method": "output-error",
        "parameters": {f"k{i}": flat for i in range(1, 9)},
        "delay_s": 0.0667,
        "delay_sd_s": 0.0004,
        "residuals": {
            axis: {"sd": 0.1, "correlation": 0.8 * (axis in ("up", "yaw"))}
            for axis in ("forward", "left", "up", "yaw")
        },
        "fit": {"forward": 0.98, "left": 0.97, "up": float("nan"), "yaw": 0.999},
        "vehicle_model": "v.toml",
        "figures": [],
    }
    text = in_words(summary).splitlines()
    assert text[3].split() == [
        "forward",
        "k1",
        "1.0000",
        "±",
        "0.1",
        "k2",
        "1.0000",
        "±",
        "0.1",
        "98.0",
        "%",
        "-",
    ]
    assert text[5].split()[-2:] == ["-", "-"]
    assert "delay: 66.7 ± 0.4 ms" in text
    assert text[-2] == (
        "note: what is left on up is no white noise (gusts, or a model too simple); deviations allow for it, "
        "but trust them less"
    )


def test_the_experiment_measures_tells_and_keeps_its_flights(noctule, monkeypatch):
    monkeypatch.setattr("noctule.experiments.loc_identification.SECONDS", 20.0)
    monkeypatch.setattr("noctule.estimation.identification.excitation.SECONDS", 20.0)
    tokens = ("experiment", "loc-identification", "--noise", "0.02", "--seed", "3", "--out", "e")
    found = noctule(*tokens, "--json").last_json
    assert found["seed"] == 3
    assert found["parameters"]["k1"]["true"] == TABLE_1[0]
    assert found["parameters"]["k1"]["estimate"] == pytest.approx(TABLE_1[0], rel=0.05)
    assert set(found["methods"]) == {"published"}
    assert json.loads(Path("e/figures.json").read_text()) == found
    assert Path("e/axes.mcap").is_file()
    assert Path("e/validation.mcap").is_file()
    text = noctule(*tokens).out
    assert "parameters: \n" in text
    assert "published: parameters: \n" in text
    assert text.count("\nk8 ") == 2


def test_its_noise_is_an_option_of_no_other_experiment(noctule):
    said = noctule("experiment", "loc-pose", "--noise", "0.1")
    assert said.err == "noctule: --noise does not belong to loc-pose; leave it out\n"
    said = noctule("experiment", "loc-identification", "--noise", "-1")
    assert said.code == 2
    assert said.err.startswith("noctule: --noise: input should be greater than or equal to 0")
