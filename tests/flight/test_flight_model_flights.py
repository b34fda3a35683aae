"""What is read of a recording to identify its vehicle, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from noctule.flight.codec import encode_observation
from noctule.flight.model_flights import (
    InputScaleError,
    NoVelocitiesError,
    ShortFlightError,
    model_flights,
)
from noctule.flight.reader import Recording, Tick
from noctule.messages import Command, FlightState, VehicleState

RATE = 30.0


def tick(now, **changes):
    state = {
        "stamp": now,
        "flight_state": FlightState.FLYING,
        "yaw": 0.1 * now,
        "v_body": np.array([0.1 * now, 0.2, 0.3]),
        **changes,
    }
    told = encode_observation(now, VehicleState(**state), None, ())
    sent = Command(0.5 * np.sin(now), 0.1, 0.2, 0.4)
    return Tick(now, told, None, None, float("nan"), Command(), sent, "flying", "send", "", None)


def recorded(ticks, notes=None):
    return Recording(Path("flight.mcap"), tuple(ticks), notes or {}, {})


def stamps(begin, end):
    return [k / RATE for k in range(round(begin * RATE), round(end * RATE))]


def test_commands_velocities_and_yaw_come_with_their_stamps():
    found = model_flights(recorded([tick(t, stamp=t - 0.01) for t in stamps(1, 13)]))
    (flight,) = found.flights
    assert flight.stamps == pytest.approx(np.array(stamps(1, 13)) - 0.01)
    assert flight.velocities[:, 0] == pytest.approx(0.1 * np.array(stamps(1, 13)))
    assert flight.command_stamps == pytest.approx(np.array(stamps(1, 13)))
    assert flight.inputs[:, 0] == pytest.approx(0.5 * np.sin(flight.command_stamps))
    assert flight.inputs[5, 1:] == pytest.approx([0.1, 0.2, 0.4])
    assert (found.full_scale == 1.0).all()


def test_a_yaw_that_wraps_is_unwrapped():
    ticks = [tick(t, yaw=(t % 2.0) * np.pi - np.pi) for t in stamps(0, 12)]
    (flight,) = model_flights(recorded(ticks)).flights
    assert np.ptp(np.diff(flight.yaw)) < 1e-9


def test_inputs_are_shares_of_what_the_recording_notes_as_full():
    note = {"inputs": {"full_scale": json.dumps([2.0, 1.0, 0.5, 4.0])}}
    found = model_flights(recorded([tick(t) for t in stamps(0, 12)], note))
    assert found.flights[0].inputs[3, 1:] == pytest.approx([0.1, 0.4, 0.1])
    assert found.full_scale == pytest.approx([2.0, 1.0, 0.5, 4.0])


def test_a_report_that_comes_twice_counts_once():
    ticks = [tick(t, stamp=np.floor(t * 15.0) / 15.0) for t in stamps(0, 12)]
    (flight,) = model_flights(recorded(ticks)).flights
    assert (np.diff(flight.stamps) > 0.0).all()
    assert flight.stamps.size == 180
    assert flight.command_stamps.size == 360


def test_each_stretch_of_flight_is_one_flight_and_short_ones_are_left_out():
    landed = [tick(t, flight_state=FlightState.LANDED) for t in stamps(12, 14)]
    gap = [tick(t) for t in stamps(30, 42)]
    ticks = [tick(t) for t in stamps(0, 12)] + landed + [tick(t) for t in stamps(14, 18)] + gap
    flights = model_flights(recorded(ticks)).flights
    assert [round(f.stamps[0]) for f in flights] == [0, 30]
    assert all(f.command_stamps.size == len(ticks) for f in flights)


def refusal(error, recording):
    with pytest.raises(error) as told:
        model_flights(recording)
    return str(told.value)


def test_a_short_flight_is_refused():
    assert refusal(ShortFlightError, recorded([tick(t) for t in stamps(0, 4)])) == (
        "recording flight.mcap: flies for 4.0 s without a gap, expected at least 10 s; "
        "fly the deformed sinusoid, 82 s on each axis"
    )
    assert refusal(ShortFlightError, recorded([])).startswith("recording flight.mcap: flies for 0.0 s ")


@pytest.mark.parametrize(("field", "word"), [("v_body", "velocities"), ("yaw", "yaw")])
def test_a_vehicle_that_does_not_say_how_it_moves_is_refused(field, word):
    ticks = [tick(t, **({field: None} if t < 1.0 else {})) for t in stamps(0, 12)]
    assert refusal(NoVelocitiesError, recorded(ticks)) == (
        f"recording flight.mcap: 30 of 360 reports of the vehicle are without {word}, expected {word} in "
        "all; the model is identified from them: fly a vehicle that reports them"
    )


@pytest.mark.parametrize(
    ("changes", "what", "first"),
    [
        ({"v_body": np.array([0.1, np.nan, np.inf])}, "velocities", "0.1, nan, inf"),
        ({"yaw": np.nan}, "a yaw", "nan"),
    ],
)
def test_numbers_that_are_not_finite_are_refused_with_the_file_and_the_first_of_them(changes, what, first):
    ticks = [tick(t, **(changes if 1.0 <= t < 2.0 else {})) for t in stamps(0, 12)]
    assert refusal(NoVelocitiesError, recorded(ticks)) == (
        f"recording flight.mcap: 30 of 360 reports of the vehicle have {what} not finite, the first {first} "
        "at 1.000 s; expected finite numbers in all; the model is identified from them: "
        "mend what the vehicle reports and fly again"
    )


@pytest.mark.parametrize("text", ["[1, 2]", "[0, 1, 1, 1]", "nonsense", '{"a": 1}', "[1, 1, 1, NaN]"])
def test_a_note_that_cannot_be_read_is_refused(text):
    recording = recorded([tick(t) for t in stamps(0, 12)], {"inputs": {"full_scale": text}})
    assert refusal(InputScaleError, recording) == (
        f"recording flight.mcap: its note 'inputs' says full_scale {text!r}, expected four numbers above 0; "
        "was the file changed after the flight?"
    )
