"""`loc-identification`: 6.2 of the paper on localization, the vehicle's model from flights of it.

A vehicle like that of Table 1 flies the deformed sinusoid for 82 s on one axis after the other, commanded and
measured at 30 Hz, then a validation flight on all axes at once. It has no velocity loop of its own: commands
are u times `FULL_SCALE`, the speed at which drag holds the balance of a full input.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from noctule.estimation.identification import (
    AXES,
    EXCITATIONS,
    AxisFlight,
    Identification,
    Validation,
    WholeFlight,
    cramer_rao,
    identify,
    published,
    validate,
    validation_inputs,
)
from noctule.estimation.identification.excitation import SECONDS
from noctule.estimation.vehicle_model import TABLE_1, VehicleModel
from noctule.flight.recording import FlightRecorder, sent_message
from noctule.geometry import Array, Pose
from noctule.messages import Command
from noctule.settings import Settings
from noctule.simulation import LimitsSpec, VehicleSpec
from noctule.simulation.aircraft import Aircraft
from noctule.simulation.dynamics import STEP, STEPS_PER_SECOND
from noctule.simulation.vehicle import SimulatedVehicle

RATE = 30.0  # [Hz], of commands and of measurements
DELAY = 20 * STEP  # [s], from sending a command to its effect
PAUSE = 5.0  # [s], hovering between two axes
TRUE = VehicleModel.identified(TABLE_1, DELAY)
FULL_SCALE = TRUE.input_gains / TRUE.drags  # (4,) [m/s, rad/s], the command that is input 1
_NO_LOOP = 5.0  # [s], a lag so long that the drag alone is quicker: the onboard loop adds nothing
_HEIGHT = 1.2  # [m]
_VALID = 0.25  # [s]


class IdentificationOptions(Settings):
    """What `loc-identification` may be asked."""

    noise: float = Field(0.01, ge=0.0, le=2.0, description="sd of measured velocities [m/s, rad/s]")


@dataclass(frozen=True, slots=True)
class FlownVehicle:
    """What was flown."""

    axes: WholeFlight  # one axis after the other
    validation: WholeFlight

    def axis_flights(self) -> list[AxisFlight]:
        """Return the 82 s of each axis, by itself."""
        return [_window(self.axes, a) for a in range(4)]


@dataclass(frozen=True, slots=True)
class Identified:
    """What came of it."""

    flown: FlownVehicle
    output_error: Identification
    published: Identification
    validation: Validation
    bound: Array  # (8,), Cramer and Rao's for k1 to k8
    delay_bound: float  # [s]


def table_1_spec(noise: float, gusts: float = 0.0) -> VehicleSpec:
    """Return a simulated vehicle that moves as eq. (2) with Table 1 does, in continuous time.

    The simulator steps by Euler, 300 times a second; its k are such that each step is the exact one.
    """
    decay = -np.expm1(-TRUE.drags * STEP) / (TRUE.drags * STEP)
    k = np.column_stack([TRUE.input_gains * decay, TRUE.drags * decay]).ravel()
    limits = LimitsSpec(forward=10, left=10, up=10, yaw_rate=10, acceleration=10, yaw_acceleration=50)
    return VehicleSpec(
        model="identified",
        lag=_NO_LOOP,
        k=tuple(k.tolist()),
        limits=limits,
        command_latency=DELAY,
        report_rate=RATE,
        velocity_noise=noise,
        gusts=gusts,
    )


def axis_inputs() -> Array:
    """Return the inputs (m, 4) of the deformed sinusoid on one axis after the other."""
    t = np.arange(round(SECONDS * RATE)) / RATE
    quiet = np.zeros((round(PAUSE * RATE), 4))
    parts = [quiet]
    for a, excitation in enumerate(EXCITATIONS):
        moved = np.zeros((t.size, 4))
        moved[:, a] = excitation.inputs(t)
        parts += [moved, quiet]
    return np.concatenate(parts)


def fly_inputs(
    seed: int, inputs: Array, noise: float, recording: Path | None = None, gusts: float = 0.0
) -> WholeFlight:
    """Send normalised inputs (m, 4), one row a tick, to the simulated vehicle; return what was measured.

    The yaw rate, which vehicles do not report, is measured with the same `noise`. Nothing else than commands
    and reports goes into `recording`. Raises RecordingError.
    """
    air, reports, gyro = np.random.SeedSequence([seed, 62]).spawn(3)
    rng = np.random.default_rng(gyro)
    start = Pose(np.array([0.0, 0.0, _HEIGHT]), 0.0)
    aircraft = Aircraft(table_1_spec(noise, gusts), start, True, (air, reports))
    vehicle = SimulatedVehicle(aircraft, connected=True)
    m = inputs.shape[0]
    stamps, velocities, yaw, rates = np.empty(m), np.empty((m, 3)), np.empty(m), np.empty(m)
    with ExitStack() as stack:
        recorder = None if recording is None else stack.enter_context(FlightRecorder(recording))
        if recorder is not None:
            recorder.note("inputs", {"full_scale": json.dumps(FULL_SCALE.tolist())})
        for k in range(m):
            while aircraft.steps * RATE < k * STEPS_PER_SECOND:
                aircraft.step()
            state, now = vehicle.state(), aircraft.now
            assert state.v_body is not None
            assert state.yaw is not None
            asked = Command.from_array(inputs[k] * FULL_SCALE)
            sent = vehicle.send(asked, _VALID)
            if recorder is not None:
                message = sent_message(now, asked, sent, "flying", "send", "")
                recorder.tick(now, state, None, (), None, message)
            stamps[k], velocities[k], yaw[k] = state.stamp, state.v_body, state.yaw
            rates[k] = aircraft.motion.yaw_rate + noise * rng.standard_normal()
    return WholeFlight(stamps.copy(), inputs, stamps, velocities, np.unwrap(yaw), rates)


def fly_vehicle(seed: int, noise: float, out: Path | None = None, gusts: float = 0.0) -> FlownVehicle:
    """Fly both flights; into axes.mcap and validation.mcap of the folder `out` where one is given."""
    t = np.arange(round(SECONDS * RATE)) / RATE
    files = (None, None) if out is None else (out / "axes.mcap", out / "validation.mcap")
    axes = fly_inputs(2 * seed, axis_inputs(), noise, files[0], gusts)
    return FlownVehicle(axes, fly_inputs(2 * seed + 1, validation_inputs(t), noise, files[1], gusts))


def identify_flown(flown: FlownVehicle, noise: float) -> Identified:
    """Identify by both methods, validate the first; raises IdentificationError."""
    flights = flown.axis_flights()
    found = identify(flights)
    bound, delay_bound = cramer_rao(TRUE, flights, noise)
    return Identified(flown, found, published(flights), validate(found, flown.validation), bound, delay_bound)


def run(seed: int, options: IdentificationOptions, out: Path | None = None) -> dict[str, Any]:
    """Return the figures of one seed: the default method's, and under "methods" those of (15)."""
    return figures_of(identify_flown(fly_vehicle(seed, options.noise, out), options.noise))


def figures_of(result: Identified) -> dict[str, Any]:
    """Return the figures as JSON has them; nothing is said of a delay where a method finds none."""
    return {
        **_figures(result.output_error, result.bound, result.delay_bound),
        "validation_fit": dict(zip(AXES, result.validation.fit.tolist(), strict=True)),
        "methods": {"published": _figures(result.published, result.bound, None)},
    }


def _figures(found: Identification, bound: Array, delay_bound: float | None) -> dict[str, Any]:
    parameters: dict[str, Mapping[str, float]] = {
        f"k{i + 1}": {"true": true, "estimate": k, "sd": sd, "bound": least}
        for i, (true, k, sd, least) in enumerate(
            zip(TABLE_1, found.k.tolist(), found.sd.tolist(), bound.tolist(), strict=True)
        )
    }
    figures: dict[str, Any] = {"parameters": parameters}
    if delay_bound is not None:
        figures["delay_s"] = found.delay
        figures["delay_true_s"] = DELAY
        figures["delay_sd_s"] = found.delay_sd
        figures["delay_bound_s"] = delay_bound
    return figures


def _window(flight: WholeFlight, axis: int) -> AxisFlight:
    """Return the 82 s in which an axis was moved."""
    begin = PAUSE + axis * (SECONDS + PAUSE)
    first, last = math.floor(begin * RATE), math.floor((begin + SECONDS) * RATE)
    rows = slice(first, last)
    measured = flight.velocities[:, axis] if axis < 3 else flight.yaw_rates
    assert measured is not None
    sent, stamps = flight.command_stamps[rows], flight.stamps[rows]
    return AxisFlight(sent, flight.inputs[rows, axis], stamps, measured[rows], AXES[axis])
