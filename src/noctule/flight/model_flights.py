"""What a recording says of the vehicle's model: the commands that were sent, the velocities it reported."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from noctule.errors import NoctuleError
from noctule.estimation.identification import WholeFlight
from noctule.flight.codec import decode_state
from noctule.flight.reader import Recording, Tick
from noctule.geometry import Array
from noctule.messages import FlightState, VehicleState

INPUTS = "inputs"
"""The note of a recording that says, as `full_scale`, which commands are an input of 1."""
LEAST = 10.0  # [s] in the air without a gap
_GAP = 0.5  # [s] without a report


class ShortFlightError(NoctuleError):
    """A recording of too short a flight."""


class NoVelocitiesError(NoctuleError):
    """A recording of a vehicle that does not report its velocities or its yaw."""


class InputScaleError(NoctuleError):
    """A recording whose note on its inputs cannot be read."""


@dataclass(frozen=True, slots=True)
class ModelFlights:
    """The parts of a recording in which the vehicle flew."""

    flights: tuple[WholeFlight, ...]
    full_scale: Array  # (4,) [m/s, rad/s], the command that is input 1


def model_flights(recording: Recording) -> ModelFlights:
    """Return what a recording holds for the identification of its vehicle.

    The inputs are the commands that were sent, by what the recording notes as an input of 1. Used are all
    stretches of at least LEAST seconds in which the vehicle says that it flies.

    Raises
    ------
    NoVelocitiesError
        When velocities or yaw are missing in the vehicle's reports, or are not finite.
    ShortFlightError
        When it flew for less than LEAST seconds.
    InputScaleError
        When the note on its inputs is damaged.
    """
    scale = _full_scale(recording)
    sent_stamps, sent = _sent(recording.ticks)
    flights, longest = [], 0.0
    for states in _stretches([decode_state(tick.told.state) for tick in recording.ticks]):
        velocities = [state.v_body for state in states if state.v_body is not None]
        yaw = [state.yaw for state in states if state.yaw is not None]
        for what, count in (("velocities", len(velocities)), ("yaw", len(yaw))):
            if count != len(states):
                raise NoVelocitiesError(
                    f"recording {recording.path}: {len(states) - count} of {len(states)} reports of the "
                    f"vehicle are without {what}, expected {what} in all; the model is identified from them: "
                    "fly a vehicle that reports them"
                )
        stamps = np.array([state.stamp for state in states])
        _check_finite(recording.path, "velocities", stamps, np.array(velocities))
        _check_finite(recording.path, "a yaw", stamps, np.array(yaw)[:, None])
        longest = max(longest, float(stamps[-1] - stamps[0]))
        if stamps[-1] - stamps[0] < LEAST:
            continue
        inputs = sent / scale
        flights.append(
            WholeFlight(sent_stamps, inputs, stamps, np.array(velocities), np.unwrap(np.array(yaw)))
        )
    if not flights:
        raise ShortFlightError(
            f"recording {recording.path}: flies for {longest:.1f} s without a gap, expected at least "
            f"{LEAST:g} s; fly the deformed sinusoid, 82 s on each axis"
        )
    return ModelFlights(tuple(flights), scale)


def _check_finite(path: Path, what: str, stamps: Array, said: Array) -> None:
    bad = np.flatnonzero(~np.isfinite(said).all(axis=1))
    if bad.size:
        first = ", ".join(f"{value:g}" for value in said[bad[0]])
        raise NoVelocitiesError(
            f"recording {path}: {bad.size} of {stamps.size} reports of the vehicle have {what} not finite, "
            f"the first {first} at {stamps[bad[0]]:.3f} s; expected finite numbers in all; the model is "
            "identified from them: mend what the vehicle reports and fly again"
        )


def _sent(ticks: Sequence[Tick]) -> tuple[Array, Array]:
    """Return the stamps (m,) and commands (m, 4) that were sent, without repeated stamps."""
    by_stamp = {tick.stamp: tick.sent.as_array() for tick in ticks}
    stamps = sorted(by_stamp)
    return np.array(stamps), np.array([by_stamp[stamp] for stamp in stamps]).reshape(-1, 4)


def _stretches(states: Sequence[VehicleState]) -> list[list[VehicleState]]:
    """Return the reports of each stretch of flight without a gap, each report once."""
    found: list[list[VehicleState]] = []
    newest = -math.inf
    going = False
    for state in states:
        if state.flight_state != FlightState.FLYING:
            going = False
            continue
        if state.stamp <= newest:
            continue
        if not going or state.stamp - newest > _GAP:
            found.append([])
        going, newest = True, state.stamp
        found[-1].append(state)
    return found


def _full_scale(recording: Recording) -> Array:
    text = recording.notes.get(INPUTS, {}).get("full_scale", "[1, 1, 1, 1]")
    try:
        scale = np.array(json.loads(text), dtype=np.float64)
        valid = scale.shape == (4,) and bool((np.isfinite(scale) & (scale > 0.0)).all())
    except (ValueError, TypeError):
        valid = False
    if not valid:
        raise InputScaleError(
            f"recording {recording.path}: its note {INPUTS!r} says full_scale {text[:60]!r}, expected four "
            "numbers above 0; was the file changed after the flight?"
        )
    return scale
