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
from dataclasses import dataclass, replace
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
from noctule.geometry import Array, Pose, wrap_angle
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
_SIMPSON = np.array([1.0, 4.0, 2.0, 4.0, 2.0, 4.0, 2.0, 4.0, 2.0, 4.0, 1.0]) / 3.0  # over a tick of ten steps
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
        return axis_flights(self.axes)


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

    The heading is what a gyro of the same `noise`, a mean rate over each tick, adds up to; it is in the
    reports, and nothing else than commands and reports goes into `recording`. Raises RecordingError.
    """
    air, reports, gyro = np.random.SeedSequence([seed, 62]).spawn(3)
    rng = np.random.default_rng(gyro)
    start = Pose(np.array([0.0, 0.0, _HEIGHT]), 0.0)
    aircraft = Aircraft(table_1_spec(noise, gusts), start, True, (air, reports))
    vehicle = SimulatedVehicle(aircraft, connected=True)
    m = inputs.shape[0]
    stamps, velocities, yaw = np.empty(m), np.empty((m, 3)), np.zeros(m)
    with ExitStack() as stack:
        recorder = None if recording is None else stack.enter_context(FlightRecorder(recording))
        if recorder is not None:
            recorder.note("inputs", {"full_scale": json.dumps(FULL_SCALE.tolist())})
        for k in range(m):
            rates = [aircraft.motion.yaw_rate]
            while aircraft.steps * RATE < k * STEPS_PER_SECOND:
                aircraft.step()
                rates.append(aircraft.motion.yaw_rate)
            if k:
                # By Simpson's rule: the simulator's own heading is Euler's sum of the rates.
                turn = STEP * float(_SIMPSON @ rates)
                yaw[k] = yaw[k - 1] + turn + noise / RATE * rng.standard_normal()
            state, now = replace(vehicle.state(), yaw=wrap_angle(float(yaw[k]))), aircraft.now
            assert state.v_body is not None
            asked = Command.from_array(inputs[k] * FULL_SCALE)
            sent = vehicle.send(asked, _VALID)
            if recorder is not None:
                message = sent_message(now, asked, sent, "flying", "send", "")
                recorder.tick(now, state, None, (), None, message)
            stamps[k], velocities[k] = state.stamp, state.v_body
    return WholeFlight(stamps.copy(), inputs, stamps, velocities, yaw)


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


def axis_flights(flight: WholeFlight) -> list[AxisFlight]:
    """Return the 82 s of each axis of a flight of `axis_inputs`."""
    return [_window(flight, a) for a in range(4)]


def _window(flight: WholeFlight, axis: int) -> AxisFlight:
    """Return the 82 s in which an axis was moved."""
    begin = PAUSE + axis * (SECONDS + PAUSE)
    first, last = math.floor(begin * RATE), math.floor((begin + SECONDS) * RATE)
    rows = slice(first, last)
    part = WholeFlight(
        flight.command_stamps[rows],
        flight.inputs[rows],
        flight.stamps[rows],
        flight.velocities[rows],
        flight.yaw[rows],
    )
    if axis == 3:
        return part.yaw_flight()
    return AxisFlight(
        part.command_stamps, part.inputs[:, axis], part.stamps, part.velocities[:, axis], AXES[axis]
    )
